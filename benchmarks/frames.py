# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames in which one object of many moves: each solved alone, and each after the one before it.

uv run python benchmarks/frames.py [--json FILE] [--level LEVEL] [--frames COUNT] [--small]

The clutter of `scenes.py`; in each frame its last object is a fiftieth of the room farther on. Seconds and core-seconds
of solve and gather at the vertices, the rays of both, and their error in the last frame against the truth as
`measured_error.py` has it.
`ratio` is the seconds of a frame that is solved alone over those of one that follows.
"""

import numpy as np
from common import Array, Cost, Row, print_machine, print_table, write_json
from common import parser as base_parser
from cycles_bake import Mesh
from fmm_core import Scene, Settings, Solution, solve
from measured_error import of_mesh, true_error, truth
from scenes import clutter

Points = tuple[Array, Array]
#: How far the object moves from frame to frame.
STEP = np.array([0.02, 0.01, 0.0])
#: Share of the rays that the truth is found with in a run that only shows that all works.
LITTLE = 0.02
COLUMNS = {
    "frame": ("frame", "d"),
    "alone_seconds": ("alone, s", ".2f"),
    "followed_seconds": ("followed, s", ".2f"),
    "ratio": ("ratio", ".2f"),
    "alone_core_seconds": ("alone, core-s", ".2f"),
    "followed_core_seconds": ("followed, core-s", ".2f"),
    "alone_rays": ("rays alone", "d"),
    "followed_rays": ("followed", "d"),
    "alone_error": ("error alone", ".4f"),
    "followed_error": ("followed", ".4f"),
}


def frames(level: int, objects: int, count: int) -> list[tuple[Scene, Points]]:
    """Scenes, and the vertices of each."""
    triangles, albedo, emission = clutter(objects, level)
    moves = (albedo == albedo[-1]).all(axis=1)
    return [of_mesh(Mesh(triangles + moves[:, None, None] * k * STEP, albedo, emission)) for k in range(count)]


def timed(scene: Scene, points: Points, before: Solution | None = None) -> tuple[Solution, Array, Cost]:
    """The solution, the irradiance at the points, and what both took."""
    start = Cost.now()
    solution = solve(scene, Settings(method="fmm", probes=0), before=before)
    irradiance = solution.irradiance(*points)
    return solution, irradiance, Cost.now().since(start)


def run(level: int, objects: int, count: int, effort: float) -> list[Row]:
    """A row for each frame."""
    rows, followed = [], None
    for number, (scene, points) in enumerate(frames(level, objects, count)):
        followed, found, cost = timed(scene, points, followed)
        alone, right, of_alone = timed(scene, points)
        exact = truth(scene, points, effort) if number == count - 1 else None
        row: Row = {"frame": number + 1, "triangles": len(scene.triangles), "ratio": of_alone.seconds / cost.seconds}
        for name, solution, irradiance, took in (
            ("alone", alone, right, of_alone),
            ("followed", followed, found, cost),
        ):
            row[f"{name}_seconds"], row[f"{name}_core_seconds"] = took
            row[f"{name}_rays"] = solution.report["counts"]["rays"]
            row[f"{name}_error"] = None if exact is None else true_error(irradiance, exact)
        rows.append(row)
    return rows


def main() -> None:
    options = base_parser(__doc__)
    options.add_argument("--level", type=int, default=3, help="of subdivision: 3 has 24,960 triangles, 4 has 97,536")
    options.add_argument("--frames", type=int, default=4, help="how many")
    asked = options.parse_args()
    print_machine()
    rows = run(2, 8, 3, LITTLE) if asked.small else run(asked.level, 72, asked.frames, 1.0)
    print_table(rows, COLUMNS)
    write_json(asked.json, rows)


if __name__ == "__main__":
    main()
