# SPDX-License-Identifier: GPL-3.0-or-later
"""What the benchmarks share: clouds of particles, timed sums over them, errors, tables and pictures."""

import argparse
import json
import multiprocessing
import os
import platform
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import fmm_core
import numpy as np
from fmm_core import _binding
from fmm_core.particles import make_particles
from numpy.typing import NDArray

Array = NDArray[np.float64]
Row = dict[str, Any]

#: Radiant exitance of the lamp, W/m^2; the walls give off what they reflect of an irradiance of 1 W/m^2.
LAMP = 10 * np.pi
WHITE, RED, GREEN = (0.73, 0.73, 0.73), (0.65, 0.05, 0.05), (0.12, 0.45, 0.15)
#: Receivers that the direct sum judges an error at.
RECEIVERS = 500
#: A measurement is repeated for this many seconds, within these limits; the best one counts.
ENOUGH_SECONDS, LEAST_REPEATS, MOST_REPEATS = 0.5, 3, 20


@dataclass(frozen=True)
class Cloud:
    """Particles that are receivers too: positions, normals (N, 3), softening (N,) m^2, strengths (N, 3) W."""

    positions: Array
    normals: Array
    softening: Array
    strengths: Array

    def __len__(self) -> int:
        return len(self.positions)


@dataclass(frozen=True)
class Timed:
    """One sum: seconds of setup and of one application, the latter also by pass, irradiance (N, 3), amounts of work."""

    setup: float
    application: float
    passes: dict[str, float]
    irradiance: Array
    counts: dict[str, int]

    @property
    def whole(self) -> float:
        """Seconds from points to values."""
        return self.setup + self.application


class Cost(NamedTuple):
    """What a piece of work took: seconds, and seconds of all cores together, which a busy machine changes less."""

    seconds: float
    core_seconds: float

    @classmethod
    def now(cls) -> "Cost":
        """Since any moment."""
        return cls(time.perf_counter(), time.process_time())

    def since(self, start: "Cost") -> "Cost":
        """From one `now` to a later one."""
        return Cost(self.seconds - start.seconds, self.core_seconds - start.core_seconds)


def cornell_room(count: int) -> Cloud:
    """About `count` quadrature points of the unoccluded Cornell room.

    Five walls of the unit cube, open in front (y = 0), the left one red, the right one green, the others white, and a
    lamp of 0.3 by 0.3 that looks down from just under the ceiling. A tenth of the points lies on the lamp.
    """
    x, y, z = np.eye(3)
    walls = (
        (_quad(0 * x, x, y), WHITE),
        (_quad(z, y, x), WHITE),
        (_quad(y, x, z), WHITE),
        (_quad(0 * x, y, z), RED),
        (_quad(x, z, y), GREEN),
    )
    lamp = _quad(np.array([0.35, 0.35, 0.99]), 0.3 * y, 0.3 * x)
    triangles = np.concatenate([wall for wall, _ in walls] + [lamp])
    albedo = np.repeat([colour for _, colour in walls] + [(0.0, 0.0, 0.0)], 2, axis=0)
    scene = fmm_core.Scene(triangles, albedo, np.where(np.arange(len(triangles)) < 2 * len(walls), 0.0, LAMP))
    particles = make_particles(scene, count, degree=2)
    radiosity = (scene.emission + scene.albedo)[particles.triangle]
    return Cloud(particles.positions, particles.normals, particles.softening, particles.weights[:, None] * radiosity)


def _quad(corner: Array, u: Array, v: Array) -> Array:
    """Two triangles of the parallelogram at a corner; their front is where u x v points."""
    a, b, c, d = corner, corner + u, corner + u + v, corner + v
    return np.array([[a, b, c], [a, c, d]])


def cube(count: int) -> Cloud:
    """Random points on the faces of the unit cube, inward normals, random strengths of 0 to 1 W in all."""
    rng = np.random.default_rng(0)
    points, face = rng.random((count, 3)), rng.integers(0, 6, count)
    points[np.arange(count), face % 3] = face // 3
    normals = np.eye(3)[face % 3] * (1.0 - 2.0 * (face // 3))[:, None]
    return Cloud(points, normals, np.full(count, 1e-12), rng.random((count, 3)) / count)


def multipole(cloud: Cloud, truncation: int, expansion: str, grouping: int, separation: int = 1) -> Timed:
    """The sum over all particles at all particles: octree, lists, translations and one application."""
    start = time.perf_counter()
    points = cloud.positions, cloud.normals
    fmm = _binding.Fmm(points, cloud.softening, None, truncation, grouping, None, separation, expansion)
    ready = time.perf_counter()
    irradiance, passes = fmm.apply(cloud.strengths)
    seconds = time.perf_counter() - ready
    return Timed(ready - start, seconds, dict(passes), irradiance, fmm.counts())


def brute_force(cloud: Cloud, rows: NDArray[np.int64] | slice = slice(None)) -> Timed:
    """The direct sum, timed."""
    start = time.perf_counter()
    irradiance = direct(cloud, rows)
    return Timed(0.0, time.perf_counter() - start, {}, irradiance, {})


def direct(cloud: Cloud, rows: NDArray[np.int64] | slice = slice(None)) -> Array:
    """The direct sum over all particles at those in `rows`."""
    sources = _binding.Sources(cloud.positions, cloud.normals, cloud.softening, np.ones(len(cloud)), np.ones(1))
    points, normals = np.ascontiguousarray(cloud.positions[rows]), np.ascontiguousarray(cloud.normals[rows])
    return sources.irradiance(points, normals, cloud.strengths)


def receivers(cloud: Cloud) -> NDArray[np.int64]:
    """Random particles to measure an error at."""
    return np.random.default_rng(1).choice(len(cloud), size=min(RECEIVERS, len(cloud)), replace=False)


def errors(found: Array, exact: Array) -> dict[str, float]:
    """Relative error over receivers and colours together: L2 norm, and mean over the receivers."""
    shares = np.linalg.norm(found - exact, axis=1) / np.linalg.norm(exact, axis=1)
    return {"relative_l2": relative_l2(found, exact), "mean_relative": float(shares.mean())}


def relative_l2(found: Array, exact: Array) -> float:
    """Norm of the difference over receivers and colours together, as a share of the exact one's."""
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


def best(measure: Callable[[], Timed]) -> Timed:
    """The quickest of several runs."""
    start = time.perf_counter()
    quickest, runs = measure(), 1
    while runs < LEAST_REPEATS or (runs < MOST_REPEATS and time.perf_counter() - start < ENOUGH_SECONDS):
        quickest, runs = min(quickest, measure(), key=lambda run: run.whole), runs + 1
    return quickest


def in_child(work: Callable[..., Any], *arguments: object) -> Any:
    """Runs a function in a fresh process, which alone decides on its memory and its threads."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(work, *arguments).result()


def parser(description: str, picture: str | None = None) -> argparse.ArgumentParser:
    """The options that all benchmarks have."""
    result = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    result.add_argument("--json", type=Path, help="write the table there")
    result.add_argument("--small", action="store_true", help="a few seconds' run, to see that all works")
    if picture:
        default = Path(__file__).parents[1] / "docs" / "images" / picture
        result.add_argument("--picture", type=Path, default=default, help="default: docs/images/" + picture)
    return result


def print_machine() -> None:
    """How many cores there are, and how busy they are."""
    load = f", load average {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    print(f"{os.cpu_count()} cores, {platform.machine()}{load}")


def print_table(rows: Sequence[Row], columns: dict[str, tuple[str, str]]) -> None:
    """Prints rows by columns {key: (title, format)}; None prints as a dash."""
    print("  ".join(f"{title:>{len(title) + 2}}" for title, _ in columns.values()))
    for row in rows:
        cells = ("-" if row.get(key) is None else format(row[key], form) for key, (_, form) in columns.items())
        print("  ".join(f"{cell:>{len(title) + 2}}" for cell, (title, _) in zip(cells, columns.values(), strict=True)))


def print_rows(rows: Sequence[Row], as_json: bool) -> None:
    """Prints rows one a line as names and values, or all of them as JSON."""
    if as_json:
        print(json.dumps(rows, indent=1))
        return
    for row in rows:
        print(
            "  ".join(
                f"{key} {value:.4g}" if isinstance(value, float) else f"{key} {value}" for key, value in row.items()
            )
        )


def write_json(path: Path | None, content: object) -> None:
    """Writes the results where they are asked for."""
    if path:
        path.write_text(json.dumps(content, indent=1) + "\n")
