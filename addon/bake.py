# SPDX-License-Identifier: GPL-3.0-or-later
"""One bake: read the scene, solve, write the colours. Panel and command line both come here.

`read` and `write` touch Blender and belong to the main thread; `compute` does not and may run in any.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import fmm_core
import numpy as np

from . import attributes, export

if TYPE_CHECKING:
    import bpy

#: What ends a bake with one line for the user; anything else is a mistake of the program.
FAILURES = (fmm_core.Error, MemoryError)
#: Called with a fraction from 0 to 1 and a text; returning False cancels.
Progress = Callable[[float, str], bool | None]


@dataclass(frozen=True)
class Input:
    """What a solve needs: the arrays of the scene, and the seconds it took to read them."""

    arrays: export.SceneArrays
    seconds: float


@dataclass(frozen=True)
class Result:
    """What a solve gives: colours (C,3), linear radiance of every corner of the receivers, and the solution."""

    arrays: export.SceneArrays
    colours: np.ndarray
    solution: fmm_core.Solution
    seconds_export: float


def bake(context: bpy.types.Context, settings: fmm_core.Settings, progress: Progress | None = None) -> dict:
    """Bake the scene of a context; returns the report.

    Raises fmm_core.Error, in one line, on anything that cannot be baked, and fmm_core.Cancelled; the scene is then as
    it was.
    """
    return write(compute(read(context), settings, progress))


def read(context: bpy.types.Context) -> Input:
    """Read the scene of a context, and check already here that its meshes can be written."""
    start = time.perf_counter()
    arrays = export.read_scene(context.evaluated_depsgraph_get())
    attributes.check(arrays.receivers)
    return Input(arrays, time.perf_counter() - start)


def compute(data: Input, settings: fmm_core.Settings, progress: Progress | None = None) -> Result:
    """Solve and gather at the corners; never touches Blender."""
    arrays = data.arrays
    scene = fmm_core.Scene(arrays.triangles, arrays.albedo, arrays.emission, arrays.two_sided)
    solution = fmm_core.solve(scene, settings, _part(progress, 0.0, 0.8))
    points = fmm_core.output_points(
        arrays.corner_position, arrays.corner_normal, arrays.corner_vertex, arrays.corner_triangle_centre
    )
    irradiance = solution.irradiance(points.points, points.normals, _part(progress, 0.8, 1.0))
    return Result(arrays, outgoing_radiance(arrays, irradiance[points.inverse]), solution, data.seconds)


def outgoing_radiance(arrays: export.SceneArrays, irradiance: np.ndarray) -> np.ndarray:
    """Radiance (C,3) of diffuse corners that receive irradiance (C,3) in W/m^2: (emission + albedo irradiance) / pi."""
    return (arrays.corner_emission + np.minimum(arrays.corner_albedo, fmm_core.MAX_ALBEDO) * irradiance) / math.pi


def write(result: Result) -> dict:
    """Write the colours of a solve to the meshes; returns the report."""
    start = time.perf_counter()
    attributes.write(result.arrays.receivers, result.colours)
    report = dict(result.solution.report)
    seconds = dict(report["seconds"], export=result.seconds_export, write=time.perf_counter() - start)
    seconds["total"] = sum(value for phase, value in seconds.items() if phase != "total")
    report["seconds"] = seconds
    report["warnings"] = [*result.arrays.warnings, *report["warnings"]]
    return report


def reason(error: Exception) -> str:
    """Why a bake failed, for the user, in one line."""
    if isinstance(error, MemoryError):
        return " ".join(f"not enough memory: {error}".removesuffix(": ").split())
    return " ".join(str(error).split())


def _part(progress: Progress | None, start: float, end: float) -> Progress | None:
    """Progress of one step, which is the part from start to end of the whole."""
    if progress is None:
        return None
    return lambda fraction, text: progress(start + (end - start) * fraction, text)


def summary(report: dict) -> str:
    """A report in one line."""
    counts, error = report["counts"], report.get("error") or {}
    measured, seconds = error.get("measured_rms"), report["seconds"]["total"]
    text = f"{counts['output_points']:,} points from {counts['triangles']:,} triangles in {seconds:.2f} s"
    return text if measured is None else f"{text}, measured error {100 * measured:.2g} %"
