# SPDX-License-Identifier: GPL-3.0-or-later
"""The tab "Radiosity" in the sidebar of the 3D view."""

from __future__ import annotations

import bpy

from . import bake
from .session import session


class FMM_RADIOSITY_PT_bake(bpy.types.Panel):
    """Settings, the bake button, and what the last bake came to."""

    bl_label = "FMM Radiosity"
    bl_category = "Radiosity"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column()
        column.enabled = session.running is None
        for name in ("truncation", "grouping", "particles", "rays", "target_error", "keep_visibility"):
            column.prop(context.scene.fmm_radiosity, name)
        if session.running is None:
            layout.operator("fmm_radiosity.bake", icon="RENDER_STILL")
        else:
            layout.progress(factor=session.running.fraction, text=session.running.text)
        if session.report is not None:
            _draw_report(layout, session.report)


def _draw_report(layout: bpy.types.UILayout, report: dict) -> None:
    column = layout.column(align=True)
    for line in bake.summary(report).split(", "):
        column.label(text=line)
    for warning in report["warnings"][:5]:
        column.label(text=warning, icon="ERROR")
    if len(report["warnings"]) > 5:
        column.label(text=f"and {len(report['warnings']) - 5} more, see the Info editor")
