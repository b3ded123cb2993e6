# SPDX-License-Identifier: GPL-3.0-or-later
"""Open the report of the last bake as a text."""

from __future__ import annotations

from typing import ClassVar

import bpy

from ..addon import report
from ..addon.session import session
from .editors import editor

NAME = "Radiosity Report"


class FMM_RADIOSITY_OT_show_report(bpy.types.Operator):
    """Open the report of the last bake: error, seconds, counts, settings and all warnings"""

    bl_idname = "fmm_radiosity.show_report"
    bl_label = "Show Report"
    bl_options: ClassVar[set[str]] = {"REGISTER"}

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        """There was a bake in this session."""
        if session.report is None:
            cls.poll_message_set("Bake first")
        return session.report is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write the text, and show it in a Text Editor: one that is open, or else a new window."""
        text = bpy.data.texts.get(NAME) or bpy.data.texts.new(NAME)
        text.from_string(report.text(session.report))
        if not bpy.app.background:
            editor(context, "TEXT_EDITOR").text = text
        return {"FINISHED"}
