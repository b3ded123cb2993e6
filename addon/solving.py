# SPDX-License-Identifier: GPL-3.0-or-later
"""From a scene that was read to the colours of its corners; nothing here touches Blender, any thread will do."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import fmm_core
import numpy as np
from fmm_core.progress import part

from . import attributes, export, materials, memory
from .memory import Progress
from .scene_arrays import SceneArrays
from .session import Session

if TYPE_CHECKING:
    from pathlib import Path


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
    def arrays(self) -> SceneArrays:
        """Those of the scene, put together when they are first asked for, in any thread."""
        return self.scene.arrays()


@dataclass(frozen=True)
class Result:
    """What a solve gives: colours (C,3) of every corner of the receivers, linear, by attribute, and the solution.

    seconds_solve: from the arrays to the colours; warnings: those that are neither of the arrays nor of the solution
    """

    arrays: SceneArrays
    output: attributes.Output
    layers: dict[str, np.ndarray]
    solution: fmm_core.Solution
    seconds_export: float
    seconds_solve: float
    warnings: tuple[str, ...] = ()

    @property
    def colours(self) -> np.ndarray:
        """Those of the main attribute."""
        return self.layers[self.output.name]


@dataclass(frozen=True)
class Places:
    """Where the light of corners of such a shape is found: output points, and samples around them for a fit."""

    shape: tuple[np.ndarray, ...]
    points: fmm_core.OutputPoints
    fit: fmm_core.VertexFit | None

    @property
    def asked(self) -> tuple[np.ndarray, np.ndarray]:
        """Points and normals (S,3) where light is gathered."""
        found = self.points if self.fit is None else self.fit
        return found.points, found.normals

    @property
    def effort(self) -> float:
        """Share of the usual rays that each of them needs."""
        return 1.0 if self.fit is None else self.fit.effort

    def values(self, gathered: np.ndarray, solution: fmm_core.Solution) -> np.ndarray:
        """Irradiance (M,3) of the output points for what was gathered (S,3)."""
        return gathered if self.fit is None else self.fit.values(gathered, solution.sight(self.fit))


def places_of(arrays: SceneArrays, fitted: bool, session: Session) -> Places:
    """Those of a scene: of the last bake where the shape is the same."""
    shape = arrays.corner_position, arrays.corner_normal, arrays.corner_vertex, arrays.corner_triangles
    last = session.places
    if last is None or (last.fit is not None) != fitted or not all(map(np.array_equal, last.shape, shape)):
        points = points_of(arrays)
        session.places = Places(shape, points, fit_of(arrays, points) if fitted else None)
    return session.places


def compute(
    data: Input,
    settings: fmm_core.Settings,
    progress: Progress | None = None,
    session: Session | None = None,
    solve: bool = True,
) -> Result:
    """Solve, and gather at the corners.

    session: its solution is used where it serves, and is then that of this bake; solve: whether a new solve may be made
    where it does not, else fmm_core.Error is raised.
    """
    start, warnings, output = time.perf_counter(), list(data.warnings), data.output
    arrays, session = data.arrays, Session() if session is None else session
    places = places_of(arrays, output.colours == "FIT", session)
    begin = time.perf_counter()
    seconds = data.seconds + begin - start
    progress = memory.limited(progress, data.memory_limit)
    solution, gathered = solved(data, settings, places, session, solve, warnings, progress)
    black, received = None, gathered
    if output.content == "INDIRECT":
        # Black surfaces send nothing on: what is left is direct.
        black = solution.relight(albedo=np.zeros_like(arrays.albedo))
        received = np.maximum(gathered - black.irradiance(*places.asked, effort=places.effort), 0.0)
    irradiance, points = places.values(received, solution), places.points
    layers = {output.name: colours_of(arrays, irradiance[points.inverse], output.content)}
    if output.directional:
        harmonics = solution.harmonics(points.points, points.normals, part(progress, 0.9, 1.0))
        if black is not None:
            harmonics -= black.harmonics(points.points, points.normals)
        harmonics = fmm_core.matched(harmonics, points.normals, irradiance)[points.inverse]
        layers |= zip(output.harmonics, harmonics.transpose(1, 0, 2), strict=True)
    if output.view:
        whole = irradiance if black is None else places.values(gathered, solution)
        layers[output.view_name] = view_of(arrays, points, solution, whole, part(progress, 0.95, 1.0))
    session.solution = solution
    _save(solution.kept, data.kept, warnings)
    return Result(arrays, output, layers, solution, seconds, time.perf_counter() - begin, tuple(warnings))


def solved(
    data: Input,
    settings: fmm_core.Settings,
    places: Places,
    session: Session,
    solve: bool,
    warnings: list[str],
    progress: Progress | None,
) -> tuple[fmm_core.Solution, np.ndarray]:
    """A solution, that of the session where it serves, and the irradiance (S,3) it has at the places.

    solve, session as in `compute`; warnings: takes those of files that could not be read.
    """
    arrays, scene, solution = data.arrays, scene_of(data.arrays), session.solution
    changed = _changed(solution, scene, settings, data.kept)
    if not changed:
        sky = fmm_core.Sky(0.0) if arrays.sky is None else arrays.sky
        parts = arrays.emission, arrays.albedo, arrays.lights, sky
        solution = solution.relight(*parts, part(progress, 0.0, 0.8), glossy=scene.glossy)
        return solution, solution.irradiance(*places.asked, part(progress, 0.8, 0.9), places.effort)
    if not solve:
        raise fmm_core.Error(changed)
    follows = session.moving and solution is not None and solution.precedes(scene)
    before = solution if follows else None
    # Two at a time may be too much for the memory.
    solution = session.solution = None
    kept = _load(data.kept, warnings)
    return fmm_core.solve_at(scene, settings, *places.asked, part(progress, 0.0, 0.9), kept, places.effort, before)


def scene_of(arrays: SceneArrays) -> fmm_core.Scene:
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
        shade=arrays.shade,
        medium=arrays.medium,
        volumes=arrays.volumes,
    )


def points_of(arrays: SceneArrays) -> fmm_core.OutputPoints:
    """Where the light of the corners is found."""
    return fmm_core.output_points(
        arrays.corner_position, arrays.corner_normal, arrays.corner_vertex, arrays.corner_triangle_centre
    )


def fit_of(arrays: SceneArrays, points: fmm_core.OutputPoints, seed: int | None = None) -> fmm_core.VertexFit:
    """Samples on the faces of the receivers, in random places where there is a seed."""
    corners = arrays.corner_position, arrays.corner_normal, arrays.corner_triangles
    return fmm_core.VertexFit(points, *corners, seed=seed)


def last_solution(data: Input, settings: fmm_core.Settings, session: Session) -> fmm_core.Solution:
    """That of the last bake, lit as it was then.

    Raises fmm_core.Error where more has changed since than it could follow.
    """
    changed = _changed(session.solution, scene_of(data.arrays), settings, data.kept)
    if changed:
        raise fmm_core.Error(changed)
    return session.solution


def _changed(
    solution: fmm_core.Solution | None, scene: fmm_core.Scene, settings: fmm_core.Settings, kept: Path | None
) -> str:
    """Why a solution is not as good as a new one, or has not what is to be kept; nothing where it is and has."""
    if solution is not None and solution.settings == settings and (kept is None or solution.kept is not None):
        if solution.serves(scene):
            return ""
        if solution.scene.same_geometry(scene.near_origin()):
            return "since the last bake surfaces began or ceased to glow, or colours moved within a mesh: bake again"
    return "more than lights and colours has changed since the last bake: bake again"


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


def colours_of(arrays: SceneArrays, irradiance: np.ndarray, content: str) -> np.ndarray:
    """Colours (C,3) of diffuse corners that receive irradiance (C,3) in W/m^2.

    "FULL" is their radiance, (emission + albedo irradiance) / pi; the others are irradiance / pi, the light alone.
    """
    if content != "FULL":
        return irradiance / math.pi
    return (arrays.corner_emission + np.minimum(arrays.corner_albedo, fmm_core.MAX_ALBEDO) * irradiance) / math.pi


def view_of(
    arrays: SceneArrays,
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
    gloss = materials.gloss_of(arrays.corner_gloss[corner].astype(float), towards, arrays.tables)
    found = solution.radiance(points.points[at], points.normals[at], gloss, irradiance[at], progress)
    return found[inverse.reshape(-1)] + arrays.corner_emission / math.pi
