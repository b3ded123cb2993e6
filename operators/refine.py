# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut faces of the selected meshes where the baked light changes fast, as at the edges of shadows."""

from __future__ import annotations

from typing import ClassVar

import bpy
from bpy.app.translations import pgettext_iface as translated

from ..addon import bake, subdivision
from ..addon.messages import told
from .on_meshes import OnMeshes, check


class FMM_RADIOSITY_OT_refine(OnMeshes, bpy.types.Operator):
    """Halve the faces of the selected meshes where the baked light changes fast, as at shadow edges; then bake again"""

    bl_idname = "fmm_radiosity.refine"
    bl_label = "Refine at Shadows"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    shown = ("contrast", "edge_length", "copies")

    contrast: bpy.props.FloatProperty(
        name="Contrast",
        description="Faces are cut where brightness differs by more than this share from corner to corner",
        default=0.1,
        min=0.001,
        max=2.0,
        soft_max=0.5,
    )
    edge_length: bpy.props.FloatProperty(
        name="Smallest Edge",
        description="Edges that are no longer than this are left alone",
        subtype="DISTANCE",
        default=0.01,
        min=1e-5,
        soft_min=0.001,
        soft_max=1.0,
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Refine once."""
        name, chosen = context.scene.fmm_radiosity.attribute_name, subdivision.receivers(context)
        if not any(name in obj.data.color_attributes for obj in chosen):
            self.report({"ERROR"}, translated("No selected mesh has been baked: bake first"))
            return {"CANCELLED"}
        limits = name, self.contrast, self.edge_length
        try:
            check(sum(subdivision.expected_refined(obj, *limits) for obj in chosen))
        except bake.FAILURES as error:
            self.report({"ERROR"}, told(bake.reason(error)))
            return {"CANCELLED"}
        made = sum(subdivision.refine(obj, *limits) for obj in self.objects(context))
        self.report({"INFO"}, translated("{:,d} vertices more: bake again to light them").format(made))
        return {"FINISHED"}
