# SPDX-License-Identifier: GPL-3.0-or-later
"""One bake: read the scene, solve, write the colours. Panel and command line both come here.

`read` and `write` touch Blender and belong to the main thread; `compute` does not and may run in any.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import fmm_core
import numpy as np
from fmm_core.progress import part

from . import attributes, estimate, export, materials, memory
from .memory import Progress

if TYPE_CHECKING:
    import bpy

    from .session import Session

#: What ends a bake with one line for the user; anything else is a mistake of the program.
FAILURES = (fmm_core.Error, MemoryError)
#: Of the file beside the .blend that keeps what rays found.
KEPT_SUFFIX = ".fmm-visibility"


@dataclass(frozen=True)
class Input:
    """What a solve needs: the scene as it was read, and the seconds that took.

    output: what is to be written; memory_limit: MiB that it may take, 0 for no limit; kept: the file that keeps
    visibility, or None; warnings: what could not be done as asked, one line each
    """

    scene: export.Reading
    seconds: float
    output: attributes.Output
    memory_limit: int = 0
    kept: Path | None = None
    warnings: tuple[str, ...] = ()

    @cached_property
    def arrays(self) -> export.SceneArrays:
        """Those of the scene, put together when they are first asked for, in any thread."""
        return self.scene.arrays()


@dataclass(frozen=True)
class Result:
    """What a solve gives: colours (C,3) of every corner of the receivers, linear, by attribute, and the solution.

    warnings: those that are neither of the arrays nor of the solution
    """

    arrays: export.SceneArrays
    output: attributes.Output
    layers: dict[str, np.ndarray]
    solution: fmm_core.Solution
    seconds_export: float
    warnings: tuple[str, ...] = ()

    @property
    def colours(self) -> np.ndarray:
        """Those of the main attribute."""
        return self.layers[self.output.name]


def bake(
    context: bpy.types.Context,
    settings: fmm_core.Settings,
    progress: Progress | None = None,
    keep: bool = False,
    session: Session | None = None,
) -> dict:
    """Bake the scene of a context; returns the report. keep as in `read`, session as in `compute`.

    Raises fmm_core.Error, in one line, on anything that cannot be baked, and fmm_core.Cancelled; the scene is then as
    it was.
    """
    return write(compute(read(context, keep), settings, progress, session))


def read(context: bpy.types.Context, keep: bool = False, **output: object) -> Input:
    """Read the scene of a context as its settings say, and check already here that its meshes can be written.

    keep: what rays find is kept in a file beside the .blend, and taken from there if it is of the same geometry.
    output: fields of `Output` in place of what the scene says.
    """
    from . import preferences, properties

    start, output = time.perf_counter(), properties.output_of(context.scene, **output)
    scene = export.read(context, context.scene.fmm_radiosity.scope, output.view)
    attributes.check(scene.receivers, output)
    blend, kept, warnings = context.blend_data.filepath, None, ()
    if keep and blend:
        kept = preferences.kept_file(Path(blend), KEPT_SUFFIX)
    elif keep:
        warnings = ("visibility is not kept: save the .blend first, the file goes beside it",)
    limit, settings = preferences.memory_limit(), properties.settings_of(context.scene)
    memory.check(estimate.predict(scene.vertex_count, settings, output.colours == "FIT").memory_mib, limit)
    return Input(scene, time.perf_counter() - start, output, limit, kept, warnings)


def compute(
    data: Input,
    settings: fmm_core.Settings,
    progress: Progress | None = None,
    session: Session | None = None,
    solve: bool = True,
) -> Result:
    """Solve and gather at the corners; never touches Blender.

    session: its solution is used where it serves, and is then that of this bake; solve: whether a new solve may be made
    where it does not, else fmm_core.Error is raised.
    """
    start, warnings = time.perf_counter(), list(data.warnings)
    arrays = data.arrays
    seconds = data.seconds + time.perf_counter() - start
    progress = memory.limited(progress, data.memory_limit)
    scene = scene_of(arrays)
    points, fit = points_of(arrays), None
    if data.output.colours == "FIT":
        fit = fmm_core.VertexFit(points, arrays.corner_position, arrays.corner_normal, arrays.corner_triangles)
    found, effort = (points, 1.0) if fit is None else (fit, fit.effort)
    solution = None if session is None else session.solution
    if solution is not None and _serves(solution, scene, settings, data.kept):
        sky = fmm_core.Sky(0.0) if arrays.sky is None else arrays.sky
        parts = arrays.emission, arrays.albedo, arrays.lights, sky
        solution = solution.relight(*parts, part(progress, 0.0, 0.8), glossy=scene.glossy)
        irradiance = solution.irradiance(found.points, found.normals, part(progress, 0.8, 0.9), effort)
    elif not solve:
        raise fmm_core.Error("more than lights and colours has changed since the last bake: bake again")
    else:
        # Two at a time may be too much for the memory.
        solution = None
        if session is not None:
            session.solution = None
        at = found.points, found.normals
        solution, irradiance = fmm_core.solve_at(
            scene, settings, *at, part(progress, 0.0, 0.9), _load(data.kept, warnings), effort
        )
    output, black, whole = data.output, None, irradiance
    if output.content == "INDIRECT":
        # Black surfaces send nothing on: what is left is direct.
        black = solution.relight(albedo=np.zeros_like(arrays.albedo))
        irradiance = np.maximum(irradiance - black.irradiance(found.points, found.normals, effort=effort), 0.0)
    if fit is not None:
        sight = solution.sight(fit)
        whole, irradiance = (fit.values(values, sight) for values in (whole, irradiance))
    layers = {output.name: colours_of(arrays, irradiance[points.inverse], output.content)}
    if output.directional:
        harmonics = solution.harmonics(points.points, points.normals, part(progress, 0.9, 1.0))
        if black is not None:
            harmonics -= black.harmonics(points.points, points.normals)
        harmonics = fmm_core.matched(harmonics, points.normals, irradiance)[points.inverse]
        layers |= zip(output.harmonics, harmonics.transpose(1, 0, 2), strict=True)
    if output.view:
        layers[output.view_name] = view_of(arrays, points, solution, whole, part(progress, 0.95, 1.0))
    if session is not None:
        session.solution = solution
    _save(solution.kept, data.kept, warnings)
    return Result(arrays, output, layers, solution, seconds, tuple(warnings))


def scene_of(arrays: export.SceneArrays) -> fmm_core.Scene:
    """The scene as the core takes it."""
    return fmm_core.Scene(
        arrays.triangles,
        arrays.albedo,
        arrays.emission,
        arrays.two_sided,
        arrays.opacity,
        lights=arrays.lights,
        sky=arrays.sky,
        glossy=0 if arrays.eye is None else int(np.count_nonzero(arrays.corner_gloss[:, materials.SHINE])),
    )


def points_of(arrays: export.SceneArrays) -> fmm_core.OutputPoints:
    """Where the light of the corners is found."""
    return fmm_core.output_points(
        arrays.corner_position, arrays.corner_normal, arrays.corner_vertex, arrays.corner_triangle_centre
    )


def _serves(solution: fmm_core.Solution, scene: fmm_core.Scene, settings: fmm_core.Settings, kept: Path | None) -> bool:
    """Whether a solution is as good as a new one, and has what is to be kept."""
    return (kept is None or solution.kept is not None) and solution.settings == settings and solution.serves(scene)


def _load(path: Path | None, warnings: list[str]) -> fmm_core.KeptVisibility | None:
    """What is kept in a file, nothing yet where there is none that is any good; None where nothing is to be kept."""
    if path is None:
        return None
    try:
        if path.exists():
            return fmm_core.KeptVisibility.load(path)
    except fmm_core.Error as error:
        warnings.append(f"{error}; it is computed anew")
    return fmm_core.KeptVisibility()


def _save(kept: fmm_core.KeptVisibility | None, path: Path | None, warnings: list[str]) -> None:
    """Keep in a file what it does not have yet; that it cannot be written is no reason to lose the bake."""
    if kept is None or path is None:
        return
    try:
        if kept.unsaved or not path.exists():
            kept.save(path)
    except fmm_core.Error as error:
        warnings.append(f"visibility is not kept: {error}")


def colours_of(arrays: export.SceneArrays, irradiance: np.ndarray, content: str) -> np.ndarray:
    """Colours (C,3) of diffuse corners that receive irradiance (C,3) in W/m^2.

    "FULL" is their radiance, (emission + albedo irradiance) / pi; the others are irradiance / pi, the light alone.
    """
    if content != "FULL":
        return irradiance / math.pi
    return (arrays.corner_emission + np.minimum(arrays.corner_albedo, fmm_core.MAX_ALBEDO) * irradiance) / math.pi


def view_of(
    arrays: export.SceneArrays,
    points: fmm_core.OutputPoints,
    solution: fmm_core.Solution,
    irradiance: np.ndarray,
    progress: Progress | None,
) -> np.ndarray:
    """Radiance (C,3) of corners towards the camera, for irradiance (M,3) at the output points."""
    # Corners at one point may be of different materials.
    mixed = arrays.corner_gloss @ np.random.default_rng(0).random(materials.GLOSS)
    _, corner, inverse = np.unique(
        np.column_stack([points.inverse, mixed]), axis=0, return_index=True, return_inverse=True
    )
    at = points.inverse[corner]
    towards = arrays.eye[:3] - arrays.eye[3] * points.points[at]
    # A point at the camera is seen from straight ahead.
    towards = np.where(np.linalg.norm(towards, axis=1, keepdims=True) > 0, towards, points.normals[at])
    gloss = materials.gloss_of(arrays.corner_gloss[corner].astype(float), towards)
    found = solution.radiance(points.points[at], points.normals[at], gloss, irradiance[at], progress)
    return found[inverse.reshape(-1)] + arrays.corner_emission / math.pi


def write(result: Result) -> dict:
    """Write the colours of a solve to the meshes; returns the report."""
    start = time.perf_counter()
    attributes.write([attributes.Layers(result.arrays.receivers, result.layers, result.output)])
    return report_of(result, time.perf_counter() - start)


def report_of(result: Result, seconds_write: float = 0.0) -> dict:
    """The report of a bake: that of its solve, and what was done around it."""
    report = dict(result.solution.report)
    seconds = dict(report["seconds"], export=result.seconds_export, write=seconds_write)
    seconds["total"] = sum(value for phase, value in seconds.items() if phase != "total")
    report["seconds"] = seconds
    report["warnings"] = [*result.arrays.warnings, *report["warnings"], *result.warnings]
    return report


def reason(error: Exception) -> str:
    """Why a bake failed, for the user, in one line."""
    if isinstance(error, MemoryError):
        return " ".join(f"not enough memory: {error}".removesuffix(": ").split())
    return " ".join(str(error).split())
