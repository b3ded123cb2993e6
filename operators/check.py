# SPDX-License-Identifier: GPL-3.0-or-later
"""Look at the scene as a bake does, without one."""

from __future__ import annotations

from dataclasses import asdict
from typing import ClassVar

import bpy
import fmm_core
from bpy.app.translations import pgettext_iface as translated

from ..addon import bake, properties, solving
from ..addon.messages import told
from ..addon.session import session
from .threaded import ReadsScene


class FMM_RADIOSITY_OT_check(ReadsScene, bpy.types.Operator):
    """Read the scene as a bake does, and tell which effects it calls for and what is wrong with it, without baking"""

    bl_idname = "fmm_radiosity.check"
    bl_label = "Check Scene"
    bl_options: ClassVar[set[str]] = {"REGISTER"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Read, plan, and report what a bake would warn of."""
        try:
            settings, arrays = properties.settings_of(context.scene), bake.read(context).arrays
            scene = solving.scene_of(arrays)
            session.effects = {name: asdict(effect) for name, effect in fmm_core.plan(scene, settings).items()}
        except bake.FAILURES as error:
            self.report({"ERROR"}, told(bake.reason(error)))
            return {"CANCELLED"}
        warnings = [*arrays.warnings, *scene.warnings]
        for warning in warnings:
            self.report({"WARNING"}, told(warning))
        if not warnings:
            self.report({"INFO"}, translated("The scene can be baked as it is"))
        return {"FINISHED"}
