# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles' own bake of diffuse light, to compare with. It changes the scene: never for one that is saved afterwards."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from fmm_core import Error
from fmm_core.study import Bake, Judge

from .study import corners_of

if TYPE_CHECKING:
    import bpy
    from fmm_core import OutputPoints

    from .scene_arrays import SceneArrays

_ATTRIBUTE = "Cycles"


def bake(context: bpy.types.Context, arrays: SceneArrays, samples: int) -> tuple[np.ndarray, float]:
    """Irradiance (C,3) W/m^2 at the corners of the receivers without any bias, and the seconds of the bake.

    Raises fmm_core.Error where Cycles cannot bake.
    """
    import bpy

    unbiased(context.scene)
    context.scene.cycles.samples = context.scene.cycles.seed = samples
    for obj in context.view_layer.objects:
        obj.select_set(False)
    for receiver in arrays.receivers:
        colours = bpy.data.meshes[receiver.mesh].color_attributes
        if _ATTRIBUTE not in colours:
            colours.new(_ATTRIBUTE, "FLOAT_COLOR", "CORNER")
        colours.active_color = colours[_ATTRIBUTE]
        obj = context.view_layer.objects[receiver.object]
        obj.select_set(True)
        context.view_layer.objects.active = obj
    start = time.perf_counter()
    try:
        bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"})
    except RuntimeError as error:
        raise Error(f"Cycles could not bake: {' '.join(str(error).split())}") from None
    seconds = time.perf_counter() - start
    irradiance = np.empty((len(arrays.corner_position), 3))
    for receiver in arrays.receivers:
        data = bpy.data.meshes[receiver.mesh].color_attributes[_ATTRIBUTE].data
        values = np.empty(4 * len(data), np.float32)
        data.foreach_get("color", values)
        irradiance[receiver.rows] = np.pi * values.reshape(-1, 4)[:, :3]
    return irradiance, seconds


def study(
    context: bpy.types.Context, arrays: SceneArrays, judge: Judge, points: OutputPoints, samples: Sequence[int]
) -> list[Bake]:
    """A bake for each number of samples, judged as those of a study are."""
    rows, found = corners_of(points)[judge.rows], []
    for count in samples:
        irradiance, seconds = bake(context, arrays, count)
        found.append(Bake("Cycles", seconds, judge.error(irradiance[rows]), samples=count))
    return found


def unbiased(scene: bpy.types.Scene) -> None:
    """Cycles without any bias, into vertex colours: all bounces, no clamping, and no light tree (which is slower)."""
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.use_light_tree = cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.max_bounces = cycles.diffuse_bounces = 32
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    scene.render.bake.target = "VERTEX_COLORS"
