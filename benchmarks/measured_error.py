# SPDX-License-Identifier: GPL-3.0-or-later
"""Is the measured error of a bake its true one? In rooms, clutter, among balls, in the examples, and where one setting
spoils it.

uv run python benchmarks/measured_error.py [--json FILE] [--only NAME ...]

The true error is that at all output points, of which two in ten thousand may have a fifth of it. It is found against
the light that rays over each hemisphere, eight million of them in all, find in a solution with ten times the rays and
p = 8, and in what further rays from all surfaces say that it lacks. What they are off by themselves is taken out: two
sets of them give the mean of the product of both differences. `ratio` is measured over true, and `measuring` what it
takes as a share of the other seconds of the bake.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
from common import Array, Row, print_table, write_json
from common import parser as base_parser
from cycles_bake import Mesh
from fmm_core import Scene, Settings, SunLight, solve
from scenes import block, clutter, clutter_mesh, cornell, cornell_mesh, quad, sphere, subdivided

import examples

Points = tuple[Array, Array]
#: Rays that the truth is found with: of all points, of each at least and at most, and of all surfaces together.
TRUTH_RAYS, LEAST_RAYS, MOST_RAYS, TRUTH_SAMPLES = 8_000_000, 512, 4096, 4_000_000
#: What it is solved with.
FINE = Settings(method="fmm", truncation=8, rays=2000, particles=30_000, probes=0)
#: The bars for the ratio, either way, and for the share of the other seconds that measuring takes.
FACTOR, SHARE = 1.5, 0.25
COLUMNS = {
    "name": ("scene", "s"),
    "true": ("true", ".4f"),
    "measured_rms": ("measured", ".4f"),
    "probes": ("probes", "d"),
    "low": ("low", ".4f"),
    "high": ("high", ".4f"),
    "gathered": ("gathered", ".4f"),
    "ratio": ("ratio", ".2f"),
    "seconds": ("seconds", ".2f"),
    "share": ("measuring", ".0%"),
}


@dataclass(frozen=True)
class Case:
    """A scene, where it is baked, and how."""

    name: str
    make: Callable[[], tuple[Scene, Points]]
    options: dict[str, Any] = field(default_factory=dict)


def scattered(triangles: Array, count: int = 4000) -> Points:
    """Random points (M, 3) on triangles, even by area, and their normals."""
    rng = np.random.default_rng(3)
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(cross, axis=1)
    chosen = rng.choice(len(area), count, p=area / area.sum())
    root, other = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    a, b, c = triangles[chosen].transpose(1, 0, 2)
    return (1 - root) * a + root * ((1 - other) * b + other * c), cross[chosen] / area[chosen, None]


def in_triangles(triangles: Array, albedo: Array, emission: Array) -> tuple[Scene, Points]:
    """A scene that is judged at random points of its triangles."""
    return Scene(triangles, albedo, emission), scattered(np.asarray(triangles))


def of_mesh(mesh: Mesh) -> tuple[Scene, Points]:
    """A scene that is judged at its vertices."""
    output = mesh.output_points()
    return mesh.scene(), (output.points, output.normals)


def room() -> tuple[Scene, Points]:
    """The room with two blocks."""
    return in_triangles(*cornell())


def pale_room() -> tuple[Scene, Points]:
    """The same, nearly white."""
    triangles, albedo, emission = cornell()
    return in_triangles(triangles, np.where(emission[:, None] > 0, albedo, 0.95), emission)


def spheres() -> tuple[Scene, Points]:
    """Four balls in a room, as curved as their 2,000 triangles each make them."""
    triangles, albedo, emission = (values[:12] for values in cornell())
    places = ((0.25, 0.3, 0.2), (0.7, 0.3, 0.2), (0.45, 0.7, 0.25), (0.7, 0.65, 0.6))
    balls = [0.18 * sphere(4) + np.array(place) for place in places]
    count = sum(map(len, balls))
    parts = np.concatenate([triangles, *balls]), np.concatenate([albedo, np.full((count, 3), 0.6)])
    return in_triangles(*parts, np.concatenate([emission, np.zeros(count)]))


def many_lamps() -> tuple[Scene, Points]:
    """The room with two blocks and sixteen small lamps."""
    triangles, albedo, emission = cornell()
    lamps = [
        triangle
        for x in np.linspace(0.1, 0.85, 4)
        for y in np.linspace(0.1, 0.85, 4)
        for triangle in quad(*(np.array([x + a, y + b, 0.98]) for a, b in ((0, 0), (0, 0.03), (0.03, 0.03), (0.03, 0))))
    ]
    keep = emission == 0
    triangles = np.concatenate([triangles[keep], np.array(lamps)])
    albedo = np.concatenate([albedo[keep], np.zeros((len(lamps), 3))])
    return in_triangles(triangles, albedo, np.where(np.arange(len(triangles)) < keep.sum(), 0.0, 100.0))


def sunny_room(window: bool) -> tuple[Scene, Points]:
    """The room with two blocks and a sun that shines in at its open side, or through a window there."""
    triangles, albedo, emission = cornell()
    triangles, albedo = triangles[emission == 0], albedo[emission == 0]
    if window:
        # Around the window from 0.3 to 0.55 along x and from 0.5 to 0.75 along z.
        parts = ((0.0, 0.3, 0.0, 1.0), (0.55, 1.0, 0.0, 1.0), (0.3, 0.55, 0.0, 0.5), (0.3, 0.55, 0.75, 1.0))
        front = [
            triangle
            for x, right, z, top in parts
            for triangle in quad(*np.array([[x, 0, z], [x, 0, top], [right, 0, top], [right, 0, z]], float))
        ]
        triangles = np.concatenate([triangles, np.array(front)])
        albedo = np.concatenate([albedo, np.full((len(front), 3), 0.73)])
    sun = SunLight((0.2, 0.8, -0.5), 5.0, 0.01)
    return Scene(triangles, albedo, lights=[sun]), scattered(triangles)


def columns() -> tuple[Scene, Points]:
    """A room full of thin columns, lit by a bright wall."""
    triangles, albedo, _ = (values[:10] for values in cornell())
    stands = [
        triangle
        for x in np.linspace(0.15, 0.85, 5)
        for y in np.linspace(0.15, 0.85, 5)
        for triangle in block((x, y), 0.03, 0.8, x + y)
    ]
    triangles = subdivided(np.concatenate([triangles, np.array(stands)]), 2)
    albedo = np.repeat(np.concatenate([albedo, np.full((len(stands), 3), 0.5)]), 16, axis=0)
    return in_triangles(triangles, albedo, np.where(np.arange(len(triangles)) // 32 == 4, 5.0, 0.0))


CASES = (
    Case("room", room),
    Case("room, 30 rays", room, {"rays": 30}),
    Case("room, p = 0", room, {"truncation": 0}),
    Case("room, p = 1", room, {"truncation": 1}),
    Case("room, 500 points", room, {"particles": 500}),
    Case("room, direct, 500", room, {"particles": 500, "method": "direct"}),
    Case("white room, p = 1", pale_room, {"truncation": 1}),
    Case("fine mesh", lambda: of_mesh(cornell_mesh(20_000))),
    Case("clutter", lambda: of_mesh(clutter_mesh(12_500)), {}),
    Case("clutter of 20", lambda: in_triangles(*clutter(20, 3)), {"rays": 60}),
    Case("balls", spheres),
    Case("balls, p = 0", spheres, {"truncation": 0}),
    Case("sixteen lamps", many_lamps),
    Case("columns", columns),
    Case("sun", partial(sunny_room, False)),
    Case("window", partial(sunny_room, True)),
    *(Case(name.replace("_", " "), partial(examples.example, name)) for name in examples.NAMES),
)
#: The scene of a short run, and the share of the rays that the truth is found with there.
SMALL, FEW = ("room, 500 points",), 0.1


def truth(scene: Scene, points: Points, effort: float) -> Array:
    """Two independent estimates (2, M, 3) of the irradiance at the points, by a share of all rays."""
    rays = np.clip(TRUTH_RAYS // len(points[0]), LEAST_RAYS, MOST_RAYS)
    fine = replace(FINE, rays=round(effort * FINE.rays), particles=round(effort**0.5 * FINE.particles))
    return solve(scene, fine).estimates(*points, round(effort * rays), round(effort * TRUTH_SAMPLES))


def true_error(found: Array, exact: Array) -> float:
    """Relative L2 error of irradiance (M, 3), as far as the truth tells."""
    one, other = exact
    squared = ((found - one) * (found - other)).sum() / (one * other).sum()
    return float(np.sqrt(max(0.0, squared)))


@lru_cache(maxsize=1)
def judged(make: Callable[[], tuple[Scene, Points]], effort: float) -> tuple[Scene, Points, Array]:
    """A scene, where it is baked, and what is true there; kept for the next case of the same scene."""
    scene, points = make()
    return scene, points, truth(scene, points, effort)


def run(case: Case, effort: float) -> Row:
    """Measured and true error of one bake."""
    scene, points, exact = judged(case.make, effort)
    solution = solve(scene, Settings(**({"method": "fmm", "particles": 8000} | case.options)))
    found = solution.irradiance(*points)
    error, seconds = solution.report["error"], solution.report["seconds"]
    true = true_error(found, exact)
    return {
        "name": case.name,
        "true": true,
        "judged": len(found),
        **error,
        "ratio": error["measured_rms"] / true,
        "seconds": seconds["total"],
        "share": seconds["accuracy"] / (seconds["total"] - seconds["accuracy"]),
    }


def main() -> None:
    options = base_parser(__doc__)
    options.add_argument("--only", nargs="+", choices=[case.name for case in CASES], help="some of the scenes")
    arguments: argparse.Namespace = options.parse_args()
    names = SMALL if arguments.small else arguments.only
    effort = FEW if arguments.small else 1.0
    rows = [run(case, effort) for case in CASES if names is None or case.name in names]
    print_table(rows, COLUMNS)
    outside = [row["name"] for row in rows if not 1 / FACTOR <= row["ratio"] <= FACTOR]
    print(f"{len(rows) - len(outside)} of {len(rows)} within a factor of {FACTOR}", *outside, sep="; ")
    dear = [row["name"] for row in rows if row["share"] > SHARE]
    print(f"{len(rows) - len(dear)} of {len(rows)} take at most {SHARE:.0%} to measure", *dear, sep="; ")
    write_json(arguments.json, rows)


if __name__ == "__main__":
    main()
