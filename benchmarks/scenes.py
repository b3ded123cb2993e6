# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes with occlusion: error against the direct method with all rays, seconds, rays, and relighting.

uv run python benchmarks/scenes.py [--json] [--scene cornell clutter growth]
"""

import argparse
import time

import numpy as np
from common import print_rows
from fmm_core import Scene, Settings, Solution, solve
from fmm_core.direct import DirectSpace
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Receivers at which the exact answer is summed with all rays.
SAMPLE = 2000
#: Rays a receiver of "default" and "fine".
RAYS = {"default": 200, "fine": 1500}


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


def receivers(triangles: Array) -> tuple[Array, Array]:
    """The vertices with their triangles' normals, one for each direction, stepped a little inside."""
    edges = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = (triangles + 1e-3 * (triangles.mean(axis=1, keepdims=True) - triangles)).reshape(-1, 3)
    normals = np.repeat(normals, 3, axis=0)
    keys = np.rint(np.column_stack([triangles.reshape(-1, 3) * 1e6, normals * 1e2])).astype(np.int64)
    chosen = np.unique(keys, axis=0, return_index=True)[1]
    return points[chosen], normals[chosen]


def sphere_receivers(triangles: Array) -> tuple[Array, Array]:
    """One point in the middle of every other triangle: about as many as there are vertices."""
    edges = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    return triangles.mean(axis=1)[::2], (normals / np.linalg.norm(normals, axis=1, keepdims=True))[::2]


def timed_bake(scene: Scene, settings: Settings, points: tuple[Array, Array]) -> tuple[Solution, Array, float]:
    """The solution, the irradiance at the points, and the seconds of both."""
    start = time.perf_counter()
    solution = solve(scene, settings)
    irradiance = solution.irradiance(*points)
    return solution, irradiance, time.perf_counter() - start


def exact_gather(solution: Solution, points: tuple[Array, Array]) -> Array:
    """Irradiance from the radiosity of a solution by the direct sum with all rays."""
    return DirectSpace(solution._space.sums).gather(*points, solution.radiosity)


def compare(name: str, scene: Scene, points: tuple[Array, Array], particles: int, reference: Solution) -> list[dict]:
    """Error, rays and seconds of default and fine settings."""
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(points[0]), min(SAMPLE, len(points[0])), replace=False)
    exact = exact_gather(reference, (points[0][chosen], points[1][chosen]))
    rows = []
    for quality, rays in RAYS.items():
        settings = Settings(method="fmm", particles=particles, rays=rays, probes=0)
        solution, irradiance, seconds = timed_bake(scene, settings, points)
        start = time.perf_counter()
        solution.relight(emission=2.0 * scene.emission).irradiance(*points)
        relight = time.perf_counter() - start
        difference = np.linalg.norm(irradiance[chosen] - exact, axis=1)
        size = np.linalg.norm(exact, axis=1)
        within = np.mean(difference <= 0.05 * size + 1e-3 * np.sqrt((size**2).mean()))
        report = solution.report
        rows.append(
            {
                "scene": name,
                "quality": quality,
                "particles": len(solution.particles),
                "points": len(points[0]),
                "l2_error": float(np.sqrt((difference**2).sum() / (size**2).sum())),
                "within_5_percent": float(within),
                "rays_per_receiver": report["counts"]["rays"] / (len(solution.particles) + len(points[0])),
                "seconds": seconds,
                "relight_seconds": relight,
                "postponement": report["postponement"],
                "memory_mib": report["peak_memory_mib"],
            }
        )
    return rows


def run_cornell() -> list[dict]:
    scene = Scene(*cornell())
    reference = solve(scene, Settings(method="direct", particles=20_000))
    points = reference.particles.positions, reference.particles.normals
    return compare("cornell", scene, points, 20_000, reference)


def run_clutter() -> list[dict]:
    scene = Scene(*clutter())
    reference = solve(scene, Settings(method="fmm", particles=1000, rays=RAYS["fine"], probes=0))
    return compare("clutter", scene, sphere_receivers(scene.triangles), 1000, reference)


def run_growth() -> list[dict]:
    scene = Scene(*cornell())
    rows = []
    for times in (4, 5, 6, 7):
        points = receivers(subdivided(scene.triangles, times))
        particles = max(5_001, len(points[0]) // 4)
        for quality, rays in list(RAYS.items())[:1]:
            settings = Settings(method="fmm", particles=particles, rays=rays, probes=0)
            solution, _, seconds = timed_bake(scene, settings, points)
            start = time.perf_counter()
            solution.relight(emission=2.0 * scene.emission).irradiance(*points)
            row = {"scene": "growth", "quality": quality, "points": len(points[0]), "seconds": seconds}
            row |= {"particles": len(solution.particles), "relight_seconds": time.perf_counter() - start}
            rows.append(row | {"memory_mib": solution.report["peak_memory_mib"]})
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    runs = {"cornell": run_cornell, "clutter": run_clutter, "growth": run_growth}
    parser.add_argument("--scene", nargs="+", choices=runs, default=list(runs))
    parser.add_argument("--json", action="store_true", help="print the rows as JSON")
    options = parser.parse_args()
    rows = [row for name in options.scene for row in runs[name]()]
    print_rows(rows, options.json)


if __name__ == "__main__":
    main()
