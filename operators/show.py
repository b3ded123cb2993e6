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
        """There is a 3D view, and it shows colours or has any to show."""
        views = shading.views(context)
        if not views:
            cls.poll_message_set("There is no 3D view on the screen")
            return False
        meshes = (obj.data for obj in context.view_layer.objects if obj.type == "MESH")
        if not any(map(shading.shows, views)) and not any(len(mesh.color_attributes) for mesh in meshes):
            cls.poll_message_set("Bake first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Change the view whose panel was used, or else every view of the screen, all in one way."""
        views = shading.views(context)
        shown = all(shading.shows(view) for view in views)
        for view in views:
            if shown:
                shading.back(view)
            else:
                shading.show(view)
        return {"FINISHED"}
