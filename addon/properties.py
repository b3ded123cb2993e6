# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of a bake that are saved with the scene."""

from __future__ import annotations

import bpy
import fmm_core

_DEFAULTS = fmm_core.Settings()


class FMM_RADIOSITY_settings(bpy.types.PropertyGroup):
    """Saved in the scene as `scene.fmm_radiosity`; 0 stands for "let the solver choose"."""

    truncation: bpy.props.IntProperty(
        name="Truncation",
        description="Order p at which the multipole expansions are cut: more is slower and more accurate",
        default=_DEFAULTS.truncation,
        min=0,
        max=20,
    )
    grouping: bpy.props.IntProperty(
        name="Grouping",
        description="At most this many particles s in a leaf of the octree, 0 to choose from the scene",
        default=0,
        min=0,
        max=4096,
    )
    particles: bpy.props.IntProperty(
        name="Particles",
        description="About how many points the light is gathered at, 0 to choose from the scene",
        default=0,
        min=0,
        soft_max=1_000_000,
    )
    rays: bpy.props.IntProperty(
        name="Rays",
        description="About how many shadow rays each colour is found with: more is slower and less grainy",
        default=_DEFAULTS.rays,
        min=10,
        soft_max=5000,
        max=100_000,
    )
    target_error: bpy.props.FloatProperty(
        name="Target Error",
        description="Relative error of the light that is good enough, 0 to use the other settings as they are",
        default=0.0,
        min=0.0,
        max=1.0,
        precision=4,
    )
    keep_visibility: bpy.props.BoolProperty(
        name="Keep Visibility",
        description="Save what sees what in a file beside the .blend, so that the next bake is faster, also in another "
        "session, as long as only lights and colours have changed",
        default=False,
    )


def settings_of(scene: bpy.types.Scene, **overrides: object) -> fmm_core.Settings:
    """Settings of a scene; keyword arguments go first. Raises fmm_core.Error naming a wrong value."""
    own = scene.fmm_radiosity
    values = {
        "truncation": own.truncation,
        "grouping": own.grouping or None,
        "particles": own.particles or None,
        "rays": own.rays,
        "target_error": own.target_error or None,
    }
    return fmm_core.Settings(**(values | overrides))


def register() -> None:
    """Add the settings to every scene."""
    bpy.types.Scene.fmm_radiosity = bpy.props.PointerProperty(type=FMM_RADIOSITY_settings)


def unregister() -> None:
    """Take the settings away."""
    del bpy.types.Scene.fmm_radiosity
