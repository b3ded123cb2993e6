# SPDX-License-Identifier: GPL-3.0-or-later
"""Solve the last bake again for other lights and colours."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import bpy

from ..addon import bake
from ..addon.session import session
from .threaded import Again

if TYPE_CHECKING:
    import fmm_core


class FMM_RADIOSITY_OT_relight(Again, bpy.types.Operator):
    """Bring the last bake up to date after lights or base colours have changed, without looking for shadows again"""

    bl_idname = "fmm_radiosity.relight"
    bl_label = "Relight"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    def solve(self, data: bake.Input, settings: fmm_core.Settings, progress: bake.Progress | None) -> bake.Result:
        """Solve with what the last bake has seen."""
        return bake.compute(data, settings, progress, session, solve=False)
