# SPDX-License-Identifier: GPL-3.0-or-later
"""What accuracy costs in the scene that is open: many bakes of it, their table and their picture.

`run` does not touch Blender and may run in any thread; nothing here writes to the scene.
"""

from __future__ import annotations

import csv
import io
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import fmm_core
import numpy as np
from fmm_core.progress import part
from fmm_core.study import Bake, Judge, Study, judge, study

from . import memory
from .solving import points_of, scene_of

if TYPE_CHECKING:
    from .memory import Progress
    from .scene_arrays import SceneArrays
    from .solving import Input

#: Share of the progress that finding the truth takes.
_TRUTH = 0.15
#: Fewer points than these are no judges: then all are.
_FEW = 50
#: Share of a full turn that faces fill around a vertex that is not on a rim.
_CLOSED = 0.75
#: Vertices that are closer than this share of the scene's size lie on each other.
_SAME = 1e-6


def run(
    data: Input, settings: fmm_core.Settings, progress: Progress | None = None, compared: bool = False
) -> tuple[Study, Judge, fmm_core.OutputPoints]:
    """Bake the scene again and again at its vertices; raises fmm_core.Error and fmm_core.Cancelled.

    compared: whether another program bakes as well, and all are judged only where it bakes alike.
    """
    arrays, progress = data.arrays, memory.limited(progress, data.memory_limit)
    scene = scene_of(arrays)
    points = points_of(arrays)
    at = points.points, points.normals
    rows = _inside_faces(data, points) if compared else np.arange(len(points.points))
    truth = judge(scene, settings, *at, rows, part(progress, 0.0, _TRUTH))
    return study(scene, settings, *at, truth, part(progress, _TRUTH, 1.0)), truth, points


def title(blend: str) -> str:
    """What stands above the picture of a study of a file."""
    name = Path(blend).stem.replace("_", " ")[:40]
    return f"{name[:1].upper()}{name[1:]}: what accuracy costs" if name else "What accuracy costs"


def add(done: Study, others: list[Bake]) -> Study:
    """The study with bakes of another program."""
    return replace(done, bakes=(*done.bakes, *others))


def corners_of(points: fmm_core.OutputPoints) -> np.ndarray:
    """(M,) a corner at each output point."""
    return np.unique(points.inverse, return_index=True)[1]


def table(done: Study) -> str:
    """The bakes as a table to read, and what is recommended."""
    names = "series", "p", "s", "particles", "rays", "samples", "seconds", "error"
    lines = ["{:<12}{:>4}{:>6}{:>11}{:>7}{:>9}{:>10}{:>10}".format(*names)]
    for bake in done.bakes:
        values = (bake.truncation, bake.grouping, bake.particles, bake.rays, bake.samples)
        cells = ["" if value is None else f"{value:,}" for value in values]
        cells += [f"{bake.seconds:.2f}", f"{100 * bake.error:.2f} %"]
        lines.append("{:<12}{:>4}{:>6}{:>11}{:>7}{:>9}{:>10}{:>10}".format(bake.series, *cells))
    lines += [f"left out: {text}" for text in done.skipped]
    return "\n".join([*lines, f"recommended: {done.why}"])


def as_csv(done: Study) -> str:
    """The bakes as comma-separated values, one a line below their names; errors as shares of 1."""
    text = io.StringIO()
    names = [field.name for field in fields(Bake)]
    writer = csv.DictWriter(text, [*names, "recommended"], lineterminator="\n")
    writer.writeheader()
    for bake in done.bakes:
        writer.writerow(asdict(bake) | {"recommended": int(bake == done.best)})
    return text.getvalue()


def _inside_faces(data: Input, points: fmm_core.OutputPoints) -> np.ndarray:
    """Rows of output points that any program bakes alike: inside of reflecting surfaces, on no edge, rim or contact."""
    arrays, first = data.arrays, corners_of(points)
    normals = np.bincount(arrays.corner_vertex[first], minlength=arrays.corner_vertex.max() + 1)
    around = np.bincount(points.inverse[arrays.corner_triangles].ravel(), _angles(arrays).ravel(), len(first))
    size = np.ptp(arrays.corner_position, axis=0).max() or 1.0
    places = np.rint(arrays.corner_position[first] / (_SAME * size))
    _, same, counts = np.unique(places, axis=0, return_inverse=True, return_counts=True)
    good = (normals[arrays.corner_vertex[first]] == 1) & (around > _CLOSED * 2 * np.pi)
    good &= counts[same.reshape(-1)] == 1
    good &= (arrays.corner_albedo[first] > 0).all(axis=1) & ~arrays.corner_emission[first].any(axis=1)
    rows = np.flatnonzero(good)
    return rows if len(rows) >= _FEW else np.arange(len(first))


def _angles(arrays: SceneArrays) -> np.ndarray:
    """(R,3) rad: the angle of each triangle that the receivers are drawn with, at each of its corners."""
    corners = arrays.corner_position[arrays.corner_triangles]
    sides = np.roll(corners, -1, axis=1) - corners
    sides /= np.maximum(np.linalg.norm(sides, axis=2, keepdims=True), np.finfo(float).tiny)
    return np.arccos(np.clip(-(sides * np.roll(sides, 1, axis=1)).sum(axis=2), -1.0, 1.0))
