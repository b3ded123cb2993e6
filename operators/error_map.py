# SPDX-License-Identifier: GPL-3.0-or-later
"""Show where the baked colours are off."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import bpy
from bpy.app.translations import pgettext_iface as translated

from ..addon import attributes, error_map, shading
from ..addon.report import percent
from ..addon.session import session
from .threaded import Again

if TYPE_CHECKING:
    import fmm_core

    from ..addon import bake


class FMM_RADIOSITY_OT_error_map(Again, bpy.types.Operator):
    """Show where the baked colours are off, found with four times the rays: dark is right, yellow is wrong"""

    bl_idname = "fmm_radiosity.error_map"
    bl_label = "Error Map"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Straight through."""
        return _back(context) or super().execute(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """In a thread of its own, where there is a window."""
        return _back(context) or super().invoke(context, event)

    def reading(self, context: bpy.types.Context) -> bake.Reading:
        """Read the scene, and check that the map can be written."""
        data = yield from super().reading(context)
        error_map.check(data)
        return data

    def solve(
        self, data: bake.Input, settings: fmm_core.Settings, progress: bake.Progress | None
    ) -> error_map.ErrorMap:
        """Find the map; in the thread, away from Blender."""
        return error_map.compute(data, settings, progress, session)

    def succeed(self, context: bpy.types.Context, result: error_map.ErrorMap) -> set[str]:
        """Write the map."""
        attributes.write([result.layers])
        session.map_top = result.top
        for view in shading.views(context):
            shading.show(view)
        self.report({"INFO"}, translated("Error map: yellow is {:s} or more").format(percent(result.top)))
        return {"FINISHED"}


def _back(context: bpy.types.Context) -> set[str] | None:
    """Show the colours again where the map is shown."""
    if not error_map.shown(context.scene, context.view_layer):
        return None
    attributes.activate(context.scene.fmm_radiosity.attribute_name)
    return {"FINISHED"}
