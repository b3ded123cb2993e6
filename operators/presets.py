# SPDX-License-Identifier: GPL-3.0-or-later
"""Save the settings of quality as a preset, or remove one."""

from __future__ import annotations

from typing import ClassVar

import bpy
from bl_operators.presets import AddPresetBase


class FMM_RADIOSITY_OT_preset_add(AddPresetBase, bpy.types.Operator):
    """Save these settings under a name, or remove such a preset"""

    bl_idname = "fmm_radiosity.preset_add"
    bl_label = "Add Radiosity Preset"
    preset_menu = "FMM_RADIOSITY_PT_presets"
    preset_subdir = "fmm_radiosity"
    preset_defines: ClassVar[list[str]] = ["settings = bpy.context.scene.fmm_radiosity"]
    preset_values: ClassVar[list[str]] = [
        f"settings.{name}" for name in ("truncation", "grouping", "particles", "rays", "target_error")
    ]
