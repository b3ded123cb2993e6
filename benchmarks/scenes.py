# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes with occlusion: error against the direct method with all rays, seconds, rays, and relighting.

uv run python benchmarks/scenes.py [--json] [--scene cornell clutter growth]

The exponent of growth is that of the seconds from the first size to each, against the points.
"""

import argparse
import time

import numpy as np
from common import Array, Row, print_rows, relative_l2
from cycles_bake import Mesh, gridded
from fmm_core import Scene, Settings, Solution, solve
from fmm_core.direct import DirectSpace
from fmm_core.reference import Reference
from fmm_core.settings import RAYS as DEFAULT_RAYS
from numpy.typing import NDArray

Points = tuple[Array, Array]
#: Receivers at which the exact answer is summed with all rays.
SAMPLE = 2000
#: Rays a receiver of default settings, and of fine ones.
RAYS = (DEFAULT_RAYS, 1500)
#: Rays over the hemisphere that a truth is found with.
TRUTH_RAYS = 16_384
#: Particles of a truth in which none stands for several triangles.
FINE = 60_000
#: Vertices of each scene, those of the clutter at its usual level of subdivision, and those of the growth.
VERTICES = {"cornell": 80_000, "clutter": 50_000}
CLUTTER_LEVEL = 4
GROWTH = (5_000, 20_000, 80_000, 200_000, 500_000)
#: Lamps are this many times as strong when relit.
LAMPS_LATER = 3.0


def quad(a: Array, b: Array, c: Array, d: Array) -> list[list[Array]]:
    """Two triangles, counter-clockwise from the front."""
    return [[a, b, c], [a, c, d]]


def block(centre: tuple[float, float], half: float, height: float, turn: float) -> list[list[Array]]:
    """Top and sides of a block that stands on the floor."""
    cos, sin = np.cos(turn), np.sin(turn)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half @ np.array([[cos, sin], [-sin, cos]]) + centre
    low = np.column_stack([corners, np.zeros(4)])
    high = low + [0.0, 0.0, height]
    sides = [quad(low[i], low[(i + 1) % 4], high[(i + 1) % 4], high[i]) for i in range(4)]
    return quad(*high) + [triangle for side in sides for triangle in side]


def cornell() -> tuple[Array, Array, Array]:
    """Triangles, albedo and emission of a room with two blocks and a lamp just below the ceiling."""
    v = {k: np.array([k >> 2 & 1, k >> 1 & 1, k & 1], float) for k in range(8)}
    walls = quad(v[0], v[4], v[6], v[2]) + quad(v[1], v[3], v[7], v[5]) + quad(v[2], v[6], v[7], v[3])
    walls += quad(v[0], v[2], v[3], v[1]) + quad(v[4], v[5], v[7], v[6])
    lamp = [np.array([x, y, 0.995]) for x, y in ((0.35, 0.35), (0.35, 0.65), (0.65, 0.65), (0.65, 0.35))]
    blocks = block((0.33, 0.62), 0.15, 0.6, 0.3) + block((0.68, 0.35), 0.15, 0.3, -0.3)
    triangles = np.array(walls + quad(*lamp) + blocks)
    albedo = np.full((len(triangles), 3), 0.73)
    albedo[6:8], albedo[8:10], albedo[10:12] = (0.65, 0.05, 0.05), (0.12, 0.45, 0.15), 0.0
    emission = np.zeros(len(triangles))
    emission[10:12] = 31.4
    return triangles, albedo, emission


def subdivided(triangles: Array, times: int) -> Array:
    """Every triangle in four, so many times."""
    for _ in range(times):
        a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        triangles = np.stack([np.stack(part, axis=1) for part in parts], axis=1).reshape(-1, 3, 3)
    return triangles


def sphere(level: int) -> Array:
    """The unit sphere as a subdivided octahedron."""
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    faces = [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)]
    triangles = subdivided(axes[np.array(faces)], level)
    return triangles / np.linalg.norm(triangles, axis=2, keepdims=True)


def clutter(objects: int = 72, level: int = 4) -> tuple[Array, Array, Array]:
    """A room with many separate ellipsoids and boxes, some of them through each other, and a lamp at its ceiling."""
    rng = np.random.default_rng(1)
    room, albedo, emission = cornell()
    room, albedo, emission = room[:12], albedo[:12], emission[:12]
    triangles, colours, light = [subdivided(room, 3)], [np.repeat(albedo, 64, axis=0)], [np.repeat(emission, 64)]
    cube = subdivided(np.array(block((0.0, 0.0), 0.7, 1.4, 0.0)), level - 1) - [0.0, 0.0, 0.7]
    for number in range(objects):
        shape = sphere(level) if number % 2 else cube
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        axes[0] *= np.sign(np.linalg.det(axes))
        size, place = rng.uniform(0.03, 0.1, 3), rng.uniform([0.1, 0.1, 0.05], [0.9, 0.9, 0.7])
        triangles.append(shape * size @ axes + place)
        colours.append(np.tile(rng.uniform(0.2, 0.8, 3), (len(shape), 1)))
        light.append(np.zeros(len(shape)))
    return np.concatenate(triangles), np.concatenate(colours), np.concatenate(light)


def cornell_mesh(vertices: int) -> Mesh:
    """The room with two blocks in quads of one size."""
    triangles, albedo, emission = cornell()
    faces, owners = gridded(triangles, vertices)
    return Mesh(faces, albedo[owners], emission[owners])


def clutter_mesh(vertices: int, objects: int = 72) -> Mesh:
    """The room of many objects in triangles, at the level of subdivision that comes nearest."""
    level = CLUTTER_LEVEL + round(np.log2(vertices / VERTICES["clutter"]) / 2)
    return Mesh(*clutter(objects, max(1, level)))


def timed_bake(scene: Scene, settings: Settings, points: tuple[Array, Array]) -> tuple[Solution, Array, float]:
    """The solution, the irradiance at the points, and the seconds of both."""
    start = time.perf_counter()
    solution = solve(scene, settings)
    irradiance = solution.irradiance(*points)
    return solution, irradiance, time.perf_counter() - start


def exact_gather(solution: Solution, points: tuple[Array, Array]) -> Array:
    """Irradiance from the radiosity of a solution by the direct sum with all rays."""
    return DirectSpace(solution._space.sums).gather(*points, solution.radiosity)


def many_rays(solution: Solution, points: Points) -> Array:
    """The same by very many rays over the hemisphere, which see what is left of a patch that another object cuts."""
    solved = solution._solved(rays=1)
    reference = Reference(solved.scene, solved.space.sums, solved.lit, solved.direct)
    nothing = 0 * solution.radiosity
    counts = np.full(len(points[0]), TRUTH_RAYS)
    (found, _), _ = reference.irradiance(*points, solution.radiosity, nothing, nothing, counts, 0)
    return found


def compare(
    name: str, scene: Scene, points: Points, settings: Settings, judged: NDArray[np.int64], exact: Array
) -> Row:
    """Error at the judged rows of the points, where the exact irradiance (S, 3) is known, rays and seconds of a bake.

    Points darker than a fiftieth of the mean count as near enough within a thousandth of the mean.
    """
    solution, irradiance, seconds = timed_bake(scene, settings, points)
    start = time.perf_counter()
    again = solution.relight(emission=LAMPS_LATER * scene.emission, albedo=0.5 * scene.albedo)
    relit = again.irradiance(*points)
    relight = time.perf_counter() - start
    difference = np.linalg.norm(irradiance[judged] - exact, axis=1)
    size = np.linalg.norm(exact, axis=1)
    report = solution.report
    fresh = solve(Scene(scene.triangles, 0.5 * scene.albedo, LAMPS_LATER * scene.emission), settings)
    return {
        "scene": name,
        "rays": settings.rays,
        "triangles": len(scene.triangles),
        "particles": len(solution.particles),
        "points": len(points[0]),
        "l2_error": relative_l2(irradiance[judged], exact),
        "within_5_percent": float(np.mean(difference <= 0.05 * size + 1e-3 * np.sqrt((size**2).mean()))),
        "rays_per_receiver": report["counts"]["rays"] / (len(solution.particles) + len(points[0])),
        "seconds": seconds,
        "relight_seconds": relight,
        "relight_rays": again.report["counts"]["rays"],
        "relight_against_fresh": relative_l2(relit, fresh.irradiance(*points)),
        "postponement": report["postponement"],
        "memory_mib": report["peak_memory_mib"],
        "irradiance": irradiance,
    }


def without_irradiance(row: Row) -> Row:
    """What is to be printed of a row."""
    return {name: value for name, value in row.items() if name != "irradiance"}


def chosen(count: int) -> NDArray[np.int64]:
    """Random rows to judge at."""
    return np.random.default_rng(0).choice(count, min(SAMPLE, count), replace=False)


def run_cornell(small: bool) -> list[Row]:
    """The two-block room in few triangles, judged at its particles."""
    scene, particles = Scene(*cornell()), 2_000 if small else 20_000
    reference = solve(scene, Settings(method="direct", particles=particles))
    points = reference.particles.positions, reference.particles.normals
    rows = chosen(len(points[0]))
    exact = exact_gather(reference, (points[0][rows], points[1][rows]))
    each = [Settings(method="fmm", particles=particles, rays=rays, probes=0) for rays in RAYS]
    return [without_irradiance(compare("cornell", scene, points, settings, rows, exact)) for settings in each]


def run_clutter(small: bool) -> list[Row]:
    """The clutter, judged at its vertices."""
    mesh = clutter_mesh(3_000, 8) if small else clutter_mesh(VERTICES["clutter"])
    scene, output = mesh.scene(), mesh.output_points()
    rows = np.unique(output.inverse[mesh.interior_corners()])
    rows = rows[chosen(len(rows))]
    fine = solve(scene, Settings(method="fmm", particles=FINE, rays=10 * RAYS[0], probes=0))
    judged = output.points[rows], output.normals[rows]
    exact, by_many = exact_gather(fine, judged), many_rays(fine, judged)
    found = []
    for rays in RAYS:
        row = compare("clutter", scene, (output.points, output.normals), Settings(rays=rays, probes=0), rows, exact)
        found.append(without_irradiance(row) | {"l2_error_by_rays": relative_l2(row["irradiance"][rows], by_many)})
    return found


def run_growth(small: bool) -> list[Row]:
    """The two-block room in ever finer meshes, judged at their vertices, at default settings."""
    reference = solve(Scene(*cornell()), Settings(method="direct", particles=1_000 if small else 20_000))
    found = []
    for vertices in GROWTH[: 1 if small else None]:
        mesh = cornell_mesh(vertices)
        output = mesh.output_points()
        rows = np.unique(output.inverse[mesh.interior_corners()])
        rows = rows[chosen(len(rows))]
        exact = exact_gather(reference, (output.points[rows], output.normals[rows]))
        points = output.points, output.normals
        row = compare("growth", mesh.scene(), points, Settings(method="fmm", probes=0), rows, exact)
        found.append(without_irradiance(row))
        first = found[0]
        if len(found) > 1:
            grown = found[-1]["points"] / first["points"]
            found[-1]["exponent"] = float(np.log(found[-1]["seconds"] / first["seconds"]) / np.log(grown))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    runs = {"cornell": run_cornell, "clutter": run_clutter, "growth": run_growth}
    parser.add_argument("--scene", nargs="+", choices=runs, default=list(runs))
    parser.add_argument("--json", action="store_true", help="print the rows as JSON")
    parser.add_argument("--small", action="store_true", help="a few seconds' run, to see that all works")
    options = parser.parse_args()
    rows = [row for name in options.scene for row in runs[name](options.small)]
    print_rows(rows, options.json)


if __name__ == "__main__":
    main()
