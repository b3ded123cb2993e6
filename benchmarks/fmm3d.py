# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds from points to values beside FMM3D's Laplace FMM, on the faces of a cube, inward normals.

    uv run --with fmm3dpy python benchmarks/fmm3d.py

FMM3D (PyPI fmm3dpy) is no dependency of this project; its wheel runs on one thread. Both get the same points, in turn,
each run in a fresh process with one thread, nothing warmed up; the best of three runs counts for either. What is
compared: FMM3D sums one charge over 1/(4 pi r) at a requested precision of 1e-3, and delivers more; ours sums red,
green and blue over the radiosity kernel at the least p whose measured relative L2 error, against the direct sum at 500
random receivers, is below the target. Ours drops the pairs that do not face each other, on a cube those of one face,
which FMM3D has to sum: their share is printed. Then ours on two threads at 1e-4, for figures that others have published
for both cores.
"""

import importlib.util
import os
import sys
import time

import numpy as np
from common import (
    Cloud,
    Row,
    cube,
    direct,
    errors,
    in_child,
    multipole,
    parser,
    print_machine,
    print_table,
    receivers,
    write_json,
)
from fmm_core import Settings, cost

SIZES = (100_000, 1_000_000)
SMALL = (3_000,)
#: Alternating runs of both.
ROUNDS = 3
FMM3D_PRECISION = 1e-3
COLUMNS = {
    "particles": ("particles", ",d"),
    "engine": ("engine       ", "s"),
    "threads": ("threads", "d"),
    "truncation": ("p", "d"),
    "grouping": ("s", "d"),
    "relative_l2": ("L2 error", ".1e"),
    "seconds": ("seconds", ".3g"),
    "setup": ("of it setup", ".3g"),
}


def ours(count: int, truncation: int, grouping: int) -> Row:
    """Seconds and error of one truncation; to run in a fresh process with its threads set."""
    cloud = cube(count)
    expansion = Settings(truncation=truncation).expansion_in_use
    run = multipole(cloud, truncation, expansion, grouping)
    rows = receivers(cloud)
    return {
        "engine": "ours",
        "truncation": truncation,
        "grouping": grouping,
        "expansion": expansion,
        "seconds": run.whole,
        "setup": run.setup,
        "passes": run.passes,
        **errors(run.irradiance[rows], direct(cloud, rows)),
    }


def fmm3d(count: int) -> Row:
    """Seconds and error of FMM3D for one charge a particle; to run in a fresh process with its threads set."""
    import fmm3dpy

    cloud = cube(count)
    charges = np.ascontiguousarray(cloud.strengths[:, 0])
    sources = np.asfortranarray(cloud.positions.T)
    start = time.perf_counter()
    potential = fmm3dpy.lfmm3d(eps=FMM3D_PRECISION, sources=sources, charges=charges, pg=1).pot
    seconds = time.perf_counter() - start
    rows = receivers(cloud)
    return {"engine": "FMM3D", "seconds": seconds, **errors(potential[rows, None], potentials(cloud, rows))}


def potentials(cloud: Cloud, rows: np.ndarray) -> np.ndarray:
    """The direct sum of charges over 1 / (4 pi r), (M, 1), each particle without itself."""
    exact = np.empty((len(rows), 1))
    for i, row in enumerate(rows):
        distances = np.linalg.norm(cloud.positions - cloud.positions[row], axis=1)
        distances[row] = np.inf
        exact[i] = (cloud.strengths[:, 0] / distances).sum() / (4 * np.pi)
    return exact


def with_threads(threads: int) -> None:
    """Threads of the processes that start from now on."""
    os.environ |= {"RAYON_NUM_THREADS": str(threads), "OMP_NUM_THREADS": str(threads)}


def truncation_for(count: int, error: float) -> tuple[int, int]:
    """The least p whose measured error is at most `error`, and the s that the cost model chooses for it."""
    cloud = cube(count)
    rows = receivers(cloud)
    exact = direct(cloud, rows)
    for truncation in range(2, 12):
        settings = Settings(truncation=truncation)
        grouping = cost.choose_grouping(cloud.positions, cloud.normals, settings)
        found = multipole(cloud, truncation, settings.expansion_in_use, grouping).irradiance[rows]
        if errors(found, exact)["relative_l2"] <= error:
            return truncation, grouping
    sys.exit(f"fmm3d: no p below 12 reaches an error of {error:g}")


def dropped_pairs(count: int) -> Row:
    """Pairs of particles, and those of them that lie in one face and never exchange light."""
    faces = np.unique(cube(count).normals, axis=0, return_counts=True)[1]
    return {"pairs": count**2, "dropped": int((faces.astype(np.int64) ** 2).sum())}


def compare(count: int) -> list[Row]:
    """Both on one thread at 1e-3, in turn, and ours on two threads at 1e-4."""
    with_threads(1)
    chosen = in_child(truncation_for, count, FMM3D_PRECISION)
    pairs = [(in_child(ours, count, *chosen), in_child(fmm3d, count)) for _ in range(ROUNDS)]
    rows = [min(turns, key=lambda run: run["seconds"]) | {"threads": 1} for turns in zip(*pairs, strict=True)]
    with_threads(2)
    chosen = in_child(truncation_for, count, 1e-4)
    runs = [in_child(ours, count, *chosen) for _ in range(ROUNDS)]
    rows.append(min(runs, key=lambda run: run["seconds"]) | {"threads": 2})
    return [{"particles": count, **row} for row in rows]


def main() -> None:
    arguments = parser(__doc__).parse_args()
    if importlib.util.find_spec("fmm3dpy") is None:
        sys.exit("fmm3d: fmm3dpy is missing, run: uv run --with fmm3dpy python benchmarks/fmm3d.py")
    print_machine()
    rows: list[Row] = []
    for count in SMALL if arguments.small else SIZES:
        rows += compare(count)
    print_table(rows, COLUMNS)
    for mine, theirs, both in zip(*(rows[i::3] for i in range(3)), strict=True):
        count = mine["particles"]
        pairs = dropped_pairs(count)
        print(
            f"N = {count:,}: ours is {theirs['seconds'] / mine['seconds']:.1f} times as fast as FMM3D (at least 3), "
            f"three colours and a tensor kernel against one colour; of {pairs['pairs']:.3g} pairs ours drops "
            f"{pairs['dropped'] / pairs['pairs']:.1%}, which do not face each other"
        )
        print(f"N = {count:,}: {both['seconds']:.2f} s on two threads at an error of {both['relative_l2']:.0e}")
    write_json(arguments.json, rows)


if __name__ == "__main__":
    main()
