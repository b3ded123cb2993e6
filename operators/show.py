# SPDX-License-Identifier: GPL-3.0-or-later
"""Show the baked colours in the 3D view, and go back."""

from __future__ import annotations

from typing import ClassVar

import bpy

from ..addon import shading


class FMM_RADIOSITY_OT_show(bpy.types.Operator):
    """Show the baked colours in the 3D view as they are, or the view as it was before"""

    bl_idname = "fmm_radiosity.show"
    bl_label = "Show Result"
    bl_options: ClassVar[set[str]] = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There is a 3D view."""
        if not _views(context):
            cls.poll_message_set("There is no 3D view on the screen")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Change the view whose panel was used, or else every view of the screen, all in one way."""
        views = _views(context)
        shown = all(shading.shows(view) for view in views)
        for view in views:
            if shown:
                shading.back(view)
            elif not shading.shows(view):
                shading.show(view)
        return {"FINISHED"}


def _views(context: bpy.types.Context) -> list[bpy.types.SpaceView3D]:
    if isinstance(context.space_data, bpy.types.SpaceView3D):
        return [context.space_data]
    areas = context.screen.areas if context.screen is not None else ()
    return [area.spaces.active for area in areas if area.type == "VIEW_3D"]
