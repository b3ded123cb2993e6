# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut the faces of the selected meshes until they are fine enough to carry light."""

from __future__ import annotations

from typing import ClassVar

import bpy
from bpy.app.translations import pgettext_iface as translated

from ..addon import bake, subdivision
from ..addon.messages import told
from .on_meshes import OnMeshes, check


class FMM_RADIOSITY_OT_subdivide(OnMeshes, bpy.types.Operator):
    """Give the selected meshes enough vertices to carry light and shadow: no edge stays longer than asked for"""

    bl_idname = "fmm_radiosity.subdivide"
    bl_label = "Subdivide Evenly"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    shown = ("edge_length", "copies")

    edge_length: bpy.props.FloatProperty(
        name="Edge Length",
        description="No edge stays longer than this. Shadows are as sharp as this is short",
        subtype="DISTANCE",
        default=0.1,
        min=1e-5,
        soft_min=0.001,
        soft_max=10.0,
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask first, and say what it comes to."""
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the options and the expected number of vertices."""
        super().draw(context)
        try:
            text = translated("About {:,d} vertices").format(self._expected(context))
        except bake.FAILURES as error:
            text = told(bake.reason(error))
        self.layout.label(text=text, translate=False)

    def _expected(self, context: bpy.types.Context) -> int:
        return sum(subdivision.expected_vertices(obj, self.edge_length) for obj in subdivision.receivers(context))

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Subdivide."""
        try:
            check(self._expected(context))
        except bake.FAILURES as error:
            self.report({"ERROR"}, told(bake.reason(error)))
            return {"CANCELLED"}
        made = sum(subdivision.subdivide(obj, self.edge_length) for obj in self.objects(context))
        self.report({"INFO"}, translated("Subdivided to {:,d} vertices").format(made))
        return {"FINISHED"}
