# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake the radiosity of the scene into a colour attribute of its meshes."""

from __future__ import annotations

from typing import ClassVar

import bpy

from .threaded import Threaded


class FMM_RADIOSITY_OT_bake(Threaded, bpy.types.Operator):
    """Find the light of the scene, with shadows and all bounces, and write it to a colour attribute of every mesh"""

    bl_idname = "fmm_radiosity.bake"
    bl_label = "Bake Radiosity"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
