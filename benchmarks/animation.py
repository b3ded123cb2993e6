# SPDX-License-Identifier: GPL-3.0-or-later
"""A frame in which one object of the clutter moves a little: rays traced anew and seconds, against a fresh bake of it.

uv run python benchmarks/animation.py [--json] [--small]
"""

import argparse

import numpy as np
from common import Array, print_rows, relative_l2
from cycles_bake import Mesh
from fmm_core import MovingVisibility, Settings
from scenes import clutter, timed_bake

#: Of the objects: one that others stand around. How far it goes, in sides of the room.
MOVED, STEP = 16, np.array([0.02, 0.0, 0.01])
#: Triangles of the room itself at the level of subdivision of `clutter`.
ROOM = 12 * 64


def triangles_of(number: int, level: int) -> slice:
    """Which triangles belong to an object: boxes and ellipsoids in turn."""
    counts = 10 * 4 ** (level - 1), 8 * 4**level
    start = ROOM + sum(counts[before % 2] for before in range(number))
    return slice(start, start + counts[number % 2])


def frames(objects: int, level: int) -> tuple[Mesh, Mesh]:
    """The clutter before and after."""
    triangles, albedo, emission = clutter(objects, level)
    moved = triangles.copy()
    moved[triangles_of(min(MOVED, objects - 2), level)] += STEP
    return Mesh(triangles, albedo, emission), Mesh(moved, albedo, emission)


def bake(mesh: Mesh, kept: MovingVisibility | None) -> tuple[Array, float, int]:
    """Irradiance at the vertices, seconds, and rays."""
    output = mesh.output_points()
    points = output.points, output.normals
    solution, irradiance, seconds = timed_bake(mesh.scene(), Settings(probes=0, method="fmm"), points, kept)
    return irradiance, seconds, solution.report["counts"]["rays"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print the rows as JSON")
    parser.add_argument("--small", action="store_true", help="a few seconds' run, to see that all works")
    options = parser.parse_args()
    first, second = frames(8, 2) if options.small else frames(72, 4)
    kept = MovingVisibility()
    _, first_seconds, _ = bake(first, kept)
    irradiance, seconds, rays = bake(second, kept)
    fresh, fresh_seconds, fresh_rays = bake(second, None)
    row = {
        "triangles": len(second.faces),
        "rays": rays,
        "share_of_fresh_rays": rays / fresh_rays,
        "first_seconds": first_seconds,
        "seconds": seconds,
        "fresh_seconds": fresh_seconds,
        "difference": relative_l2(irradiance, fresh),
    }
    print_rows([row], options.json)


if __name__ == "__main__":
    main()
