# SPDX-License-Identifier: GPL-3.0-or-later
"""Speed at equal error against Cycles' bake to vertex colours.

uv run python benchmarks/cycles.py [--json] [--scene cornell clutter] [--vertices N]

Both engines get the same mesh, smooth but at creases, and are judged at the same random corners, by the relative L2
error of the irradiance over corners and colours. Corners on a crease or a rim are left out: there Cycles, which asks at
the very vertex, sees whichever face is nearer.

Cycles bakes one joined mesh (separate objects cost it more), direct and indirect, 32 bounces, nothing clamped, light
tree off, its faster setting here. Its error falls with the square root of the samples and its seconds grow linearly;
both are fitted to the measured bakes, and the mismatches are the largest relative distances from the fits. The exponent
of a free fit is near -1/2, a little below at first: bakes of 4 to 64 samples alone overstate by a fifth what 1 % takes
it, so give it large counts. From the fits follow the samples and the seconds that it takes to our error, and how many
times ours these are (`ratio`; `core_ratio` is that of the seconds of all cores together, which is to be believed where
the machine has other work). Ours runs with its default settings, and with coarser ones whose error is near 1 %.

Our seconds are those from arrays to irradiance: scene, output points (one for each vertex and normal), solve and
gather, through the public API. A small solve and a small bake before the timing load libraries and tables. Each engine
runs in a process of its own; peak memory is that of the whole process.

The truth is the direct sum with all rays over the radiosity of a much finer solution. For the clutter it is 16,384 rays
over the hemisphere of each corner: objects cut each other there, and one ray a patch misses what is left of it. It is
kept in a cache folder between runs. `bias_against_cycles` is its distance from the expectation of Cycles, from the
product of the differences of two independent bakes, in which noise drops out, give or take `bias_noise` (one standard
error, both squared); `cycles_brighter_by` is the part of it that a common factor makes up, which is known much better.
"""

import argparse
import hashlib
import json
import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from common import Array, Cost, Row, in_child, print_rows, relative_l2
from cycles_bake import Mesh, bake
from fmm_core import Scene, Settings, solve
from fmm_core.report import peak_memory_mib
from fmm_core.settings import RAYS
from numpy.typing import NDArray
from scenes import FINE, VERTICES, clutter_mesh, cornell, cornell_mesh, exact_gather, many_rays, timed_bake

#: The error that counts as good: both are compared there as well.
GOOD = 0.01
#: Settings of ours that come close to it.
COARSER = {
    "cornell": {"rays": 50, "truncation": 3},
    "clutter": {"rays": 50, "truncation": 2, "grouping": 600, "tolerance": 1e-2},
}


def ours(mesh: Mesh, settings: Settings, sample: NDArray[np.int64]) -> Row:
    """Our irradiance (S, 3) W/m^2 at the sampled corners, seconds and memory; to run in a fresh process."""
    warm_up(settings)
    start = Cost.now()
    points = mesh.output_points()
    solution, irradiance, _ = timed_bake(mesh.scene(), settings, (points.points, points.normals))
    cost = Cost.now().since(start)
    return {
        "irradiance": irradiance[points.inverse[sample]],
        "points": len(points.points),
        "particles": len(solution.particles),
        "cost": cost,
        "memory_mib": peak_memory_mib(),
    }


def warm_up(settings: Settings) -> None:
    """Loads what a process loads once."""
    small = solve(Scene(*cornell()), replace(settings, method="fmm", particles=600))
    small.irradiance(small.particles.positions, small.particles.normals)


def cycles(mesh: Mesh, samples: Sequence[int], threads: int, sample: NDArray[np.int64]) -> Row:
    """Cycles' irradiance (B, S, 3) W/m^2 at the sampled corners, seconds and memory; to run in a fresh process."""
    # Blender talks on standard output, where our rows go, and has a module `cycles` that this one must not hide.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    sys.path.remove(str(Path(__file__).parent))
    bake(cornell_mesh(100), [1], threads)
    irradiance, costs = bake(mesh, samples, threads)
    return {"irradiance": irradiance[:, sample], "costs": costs, "memory_mib": peak_memory_mib()}


def truth(scene: Scene, points: tuple[Array, Array], settings: Settings, cache: Path) -> Array:
    """Irradiance (S, 3) W/m^2 by the direct sum over a fine solution, computed once."""
    key = hashlib.sha256(repr(settings).encode())
    for array in (scene.triangles, scene.albedo, scene.emission, *points):
        key.update(np.ascontiguousarray(array))
    path = cache / f"{key.hexdigest()[:16]}.npy"
    if not path.exists():
        irradiance = in_child(fine_irradiance, scene, points, settings)
        cache.mkdir(parents=True, exist_ok=True)
        np.save(path, irradiance)
    return np.load(path)


def fine_irradiance(scene: Scene, points: tuple[Array, Array], settings: Settings) -> Array:
    """The truth itself; its memory goes with the process that it runs in."""
    solution = solve(scene, settings)
    return exact_gather(solution, points) if settings.method == "direct" else many_rays(solution, points)


def bias(bakes: Array, samples: Sequence[int], exact: Array) -> dict[str, float | None]:
    """How far the truth (S, 3) is from the expectation of the bakes (B, S, 3), noise taken out, and give or take."""
    mean = np.average(bakes, axis=0, weights=samples)
    row: dict[str, float | None] = {"cycles_brighter_by": float((mean * exact).sum() / (exact**2).sum() - 1)}
    if len(bakes) < 2:
        return row | {"bias_against_cycles": None, "bias_noise": None}
    most = int(np.argmax(samples))
    others = np.average(np.delete(bakes, most, 0), axis=0, weights=np.delete(samples, most))
    products = ((bakes[most] - exact) * (others - exact)).sum(axis=1) / (exact**2).sum(axis=1).mean()
    squared, noise = products.mean(), products.std() / np.sqrt(len(products))
    return row | {"bias_against_cycles": float(np.sqrt(max(0.0, squared))), "bias_noise": float(np.sqrt(noise))}


def fit_errors(samples: Sequence[int], measured: Sequence[float]) -> tuple[float, float]:
    """c of error = c / sqrt(samples), and the largest relative distance of an error from it."""
    single = np.array(measured) * np.sqrt(samples)
    # The law sets in at large counts, where Cycles is a little better than at small ones.
    c = np.average(single, weights=samples)
    return float(c), float(np.abs(single / c - 1).max())


def fit_seconds(samples: Sequence[int], measured: Sequence[float]) -> tuple[float, float, float]:
    """a and b of seconds = a + b samples (a = 0 for a single bake), and the largest relative distance from it."""
    columns = np.column_stack([np.ones(len(samples)), samples])
    columns[:, 0] *= len(samples) > 1
    # Relative distances count, so that the quickest bake has a say in what a bake costs at the least.
    columns /= np.array(measured)[:, None]
    a, b = np.linalg.lstsq(columns, np.ones(len(samples)), rcond=None)[0]
    return float(a), float(b), float(np.abs(columns @ [a, b] - 1).max())


def judges(mesh: Mesh, coarse: Scene, options: argparse.Namespace) -> tuple[NDArray[np.int64], Array]:
    """Corners (S,) to judge at, and their true irradiance (S, 3) W/m^2.

    coarse: the same surfaces in as few triangles as there can be, from which the truth is computed.
    """
    interior = mesh.interior_corners()
    sample = np.random.default_rng(0).choice(interior, min(options.sample, len(interior)), replace=False)
    points = mesh.output_points()
    rows = points.inverse[sample]
    few = len(coarse.triangles) < len(mesh.faces) // 10
    particles = options.truth_particles or (20_000 if few else FINE)
    fine = Settings(particles=particles, rays=options.truth_rays, method="direct" if few else "fmm", probes=0)
    return sample, truth(coarse, (points.points[rows], points.normals[rows]), fine, options.cache)


def compare(name: str, mesh: Mesh, coarse: Scene, options: argparse.Namespace) -> list[Row]:
    """A row for each bake of Cycles, one for each of ours, and one that compares it; coarse as in `judges`."""
    sample, exact = judges(mesh, coarse, options)
    usual = Settings(particles=options.particles, rays=options.rays, probes=0)
    all_settings = usual, replace(usual, **COARSER[name])
    all_ours = [in_child(ours, mesh, settings, sample) for settings in all_settings]
    their = in_child(cycles, mesh, options.samples, options.threads, sample)
    head = {"scene": name, "vertices": mesh.vertex_count, "corners": len(mesh.corners)}
    bakes, costs = their["irradiance"], their["costs"]
    found = [relative_l2(irradiance, exact) for irradiance in bakes]
    rows = [
        head | {"engine": "cycles", "samples": count, "l2_error": one} | spent._asdict()
        for count, one, spent in zip(options.samples, found, costs, strict=True)
    ]
    both = head | {"engine": "both", "cycles_memory_mib": their["memory_mib"]} | bias(bakes, options.samples, exact)
    for settings, own in zip(all_settings, all_ours, strict=True):
        error, cost = relative_l2(own.pop("irradiance"), exact), own.pop("cost")
        rows.append(head | {"engine": "ours", "rays": settings.rays, "l2_error": error} | cost._asdict() | own)
        rows.append(both | {"rays": settings.rays} | equal_error(options.samples, found, costs, error, cost))
    return rows


def equal_error(
    samples: Sequence[int], measured: Sequence[float], costs: Sequence[Cost], error: float, own: Cost
) -> Row:
    """The fits of Cycles, and how many times our `own` cost it takes to our error, and to 1 %."""
    c, error_mismatch = fit_errors(samples, measured)
    a, b, seconds_mismatch = fit_seconds(samples, [cost.seconds for cost in costs])
    core_a, core_b, _ = fit_seconds(samples, [cost.core_seconds for cost in costs])
    row: Row = {
        "error_of_one_sample": c,
        "error_mismatch": error_mismatch,
        "error_exponent": float(np.polyfit(np.log(samples), np.log(measured), 1)[0]) if len(samples) > 1 else None,
        "start_seconds": a,
        "seconds_a_sample": b,
        "seconds_mismatch": seconds_mismatch,
    }
    wanted = {"equal": error} | ({"good": GOOD} if error <= GOOD else {})
    for name, bar in wanted.items():
        count = (c / bar) ** 2
        row |= {f"{name}_error": bar, f"{name}_samples": count, f"{name}_seconds": a + b * count}
        row[f"{name}_ratio"] = (a + b * count) / own.seconds
        row[f"{name}_core_ratio"] = (core_a + core_b * count) / own.core_seconds
    return row


def run(name: str, options: argparse.Namespace) -> list[Row]:
    vertices = options.vertices or VERTICES[name]
    if name == "cornell":
        return compare(name, cornell_mesh(vertices), Scene(*cornell()), options)
    mesh = clutter_mesh(vertices, options.objects)
    return compare(name, mesh, mesh.scene(), options)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", nargs="+", choices=VERTICES, default=list(VERTICES))
    parser.add_argument("--json", action="store_true", help="print the rows as JSON")
    parser.add_argument("--vertices", type=int, help=f"about how many; {json.dumps(VERTICES)}")
    parser.add_argument("--objects", type=int, default=72, help="in the clutter")
    parser.add_argument("--samples", type=int, nargs="+", default=[16, 64, 256], help="of Cycles, one bake each")
    parser.add_argument("--threads", type=int, default=os.cpu_count(), help="of Cycles; ours takes all")
    parser.add_argument("--particles", type=int, help="of our solve; the core's choice")
    parser.add_argument("--rays", type=int, default=RAYS, help="of our solve, a receiver")
    parser.add_argument("--sample", type=int, default=4000, help="corners at which both are judged")
    parser.add_argument("--truth-particles", type=int, help="of the radiosity that the truth is summed from")
    parser.add_argument("--truth-rays", type=int, default=2000, help="the same, where it is not by the direct method")
    cache = Path(tempfile.gettempdir()) / "fmm-radiosity-truth"
    parser.add_argument("--cache", type=Path, default=cache, help="folder of the truth")
    options = parser.parse_args()
    print_rows([row for name in options.scene for row in run(name, options)], options.json)


if __name__ == "__main__":
    main()
