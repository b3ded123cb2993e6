# SPDX-License-Identifier: GPL-3.0-or-later
"""What each effect that a scene does not call for would cost: bakes of the Cornell room with and without it.

uv run python benchmarks/effects.py [--json] [--small]

Core-seconds of solve and gather, the best of three, taken in turn. Where an effect cannot be forced on because the
scene has nothing of it, the other bake has next to nothing of it instead. Occlusion is measured where the direct method
is chosen: the fast multipole method proves by itself that nothing is in the way.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
from common import Array, print_rows
from fmm_core import Gloss, Opacity, PointLight, Scene, Settings, Sky, solve
from scenes import cornell, quad

REPEATS = 3


def cases() -> dict[str, tuple[Callable[[], Scene], Callable[[], Scene], dict[str, bool]]]:
    """By effect: a scene without it, one with it, and what is forced on in the latter."""
    triangles, albedo, emission = cornell()
    bare, shine = triangles[:10], np.where(np.arange(10) < 2, 1.0, 0.0)
    grey, coloured = np.full_like(albedo, 0.5), np.full_like(albedo, 0.5)
    coloured[0, 0] += 1e-9
    front = quad(*np.array([[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]], float))
    sealed = np.concatenate([front, triangles])
    sealed_light = np.append([0.0, 0.0], emission)
    clear = np.ones(len(triangles))
    clear[-1] = 1 - 1e-9
    dim = PointLight((0.5, 0.5, 0.9), 1e-9, radius=0.05)

    def plain() -> Scene:
        return Scene(triangles, albedo, emission)

    def under_sky() -> Scene:
        return Scene(sealed, 0.5, sealed_light, sky=Sky(1.0))

    return {
        "occlusion": (lambda: Scene(bare, 0.5, shine), lambda: Scene(bare, 0.5, shine), {"occlusion": True}),
        "interreflection": (lambda: Scene(triangles, 0.0, emission), lambda: Scene(triangles, 1e-6, emission), {}),
        "colour": (lambda: Scene(triangles, grey, emission), lambda: Scene(triangles, coloured, emission), {}),
        "lamps": (plain, lambda: Scene(triangles, albedo, emission, lights=[dim]), {}),
        "sky": (under_sky, under_sky, {"sky": True}),
        "transparency": (plain, lambda: Scene(triangles, albedo, emission, opacity=Opacity(clear)), {}),
        "two_sided": (plain, lambda: Scene(triangles, albedo, emission, True), {}),
        "glossy": (plain, lambda: Scene(triangles, albedo, emission, glossy=1), {}),
        "medium": (plain, lambda: Scene(triangles, albedo, emission, medium=1e-9), {}),
    }


def bake(scene: Scene, forced: dict[str, bool], points: tuple[Array, Array], particles: int) -> tuple[float, int]:
    """Core-seconds and rays."""
    start = time.process_time()
    settings = Settings(particles=particles, probes=0, effects=forced)
    solution = solve(scene, settings)
    irradiance = solution.irradiance(*points)
    if scene.glossy:
        # A thousand of them, as each has a few hundred rays of its own.
        positions, normals = points[0][:1000], points[1][:1000]
        gloss = Gloss(towards=normals, diffuse=np.full_like(positions, 0.2), facing=np.full_like(positions, 0.5))
        solution.radiance(positions, normals, gloss, irradiance[:1000])
    return time.process_time() - start, solution.report["counts"]["rays"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--small", action="store_true", help="few particles")
    options = parser.parse_args()
    particles, rows = 500 if options.small else 20_000, []
    for effect, (without, with_it, forced) in cases().items():
        few = min(4000, particles) if effect == "occlusion" else particles
        start = Settings(
            method="direct", particles=few, quadrature=1, max_iterations=1, probes=0, effects={"occlusion": False}
        )
        at = solve(without(), start).particles
        points, runs = (at.positions, at.normals), ([], [])
        for _ in range(1 if options.small else REPEATS):
            runs[0].append(bake(without(), {}, points, few))
            runs[1].append(bake(with_it(), forced, points, few))
        (spared, rays), (spent, more_rays) = min(runs[0]), min(runs[1])
        rows.append({
            "effect": effect,
            "seconds_without": spared,
            "seconds_with": spent,
            "seconds_saved": spent - spared,
            "rays_without": rays,
            "rays_with": more_rays,
        })  # fmt: skip
    print_rows(rows, options.json)


if __name__ == "__main__":
    main()
