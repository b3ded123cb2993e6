# SPDX-License-Identifier: GPL-3.0-or-later
"""Add a node that brings the baked light into the materials of the selected objects."""

from __future__ import annotations

from typing import ClassVar

import bpy

from ..addon import nodes


class FMM_RADIOSITY_OT_add_nodes(bpy.types.Operator):
    """Add a node to the selected materials: base colour times baked light, to be connected after the last bake"""

    bl_idname = "fmm_radiosity.add_nodes"
    bl_label = "Add Light Node"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """A selected object has a material with nodes."""
        if not _materials(context):
            cls.poll_message_set("Select an object with a material first, one that is not linked from a library")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add one to each material."""
        settings = context.scene.fmm_radiosity
        for material in _materials(context):
            nodes.add(material, settings.attribute_name, multiply=settings.content != "FULL")
        return {"FINISHED"}


def _materials(context: bpy.types.Context) -> list[bpy.types.Material]:
    """Materials of the selected objects that have nodes and can be changed, each once."""
    slots = [slot.material for obj in context.selected_objects for slot in obj.material_slots]
    return list(dict.fromkeys(item for item in slots if item and item.node_tree and item.is_editable))
