# SPDX-License-Identifier: GPL-3.0-or-later
"""What each effect that a scene does not call for would cost: bakes of the Cornell room with and without it.

uv run python benchmarks/effects.py [--json] [--small] [--table saved plan]

Core-seconds of solve and gather, the best of three, taken in turn. Where an effect cannot be forced on because the
scene has nothing of it, the other bake has next to nothing of it instead. Occlusion is measured where the direct method
is chosen: the fast multipole method proves by itself that nothing is in the way.

The table "plan" has the core-seconds that deciding takes, the median of three, and those of the whole bake.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
from common import Array, Row, print_rows
from cycles_bake import Mesh, gridded
from fmm_core import Gloss, Opacity, PointLight, Scene, Settings, Sky, solve
from fmm_core.effects import plan, planned
from scenes import VERTICES, clutter_mesh, cornell, cornell_mesh, quad, sphere, timed_bake

REPEATS = 3
#: Lamps of the scenes that have some.
LAMPS = 4


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


def bare_mesh(vertices: int) -> Mesh:
    """The room without blocks, where every plane has to be proved not to be in the way."""
    faces, owners = gridded(cornell()[0][:10], vertices)
    return Mesh(faces, np.full((len(faces), 3), 0.5), np.where(owners < 2, 1.0, 0.0))


def lit(mesh: Mesh) -> Scene:
    """The mesh under lamps and a sky."""
    scene = mesh.scene()
    lamps = [PointLight((0.5, y, 0.9), 1.0, radius=0.05) for y in np.linspace(0.2, 0.8, LAMPS)]
    return Scene(scene.triangles, scene.albedo, scene.emission, lights=lamps, sky=Sky(1.0))


def plan_rows(small: bool) -> list[Row]:
    """Core-seconds of the plan and of the bake at the vertices, of several scenes."""
    many, few = (2_000, 500) if small else (VERTICES["cornell"], 20_000)
    level = 3 if small else 4
    crowd = clutter_mesh(3_000, 8) if small else clutter_mesh(VERTICES["clutter"])
    ball = sphere(level)[:, ::-1]
    ball = Mesh(ball, np.full((len(ball), 3), 0.5), np.ones(len(ball)))
    room, bare = cornell_mesh(few), bare_mesh(many)
    large = cornell_mesh(many)
    scenes = {
        "room": (room.scene(), room),
        "large room": (large.scene(), large),
        "clutter": (crowd.scene(), crowd),
        "clutter, lamps and sky": (lit(crowd), crowd),
        "bare room": (bare.scene(), bare),
        "bare room, lamps and sky": (lit(bare), bare),
        "inside of a ball": (ball.scene(), ball),
    }
    return [plan_row(name, scene, mesh) for name, (scene, mesh) in scenes.items()]


def plan_row(name: str, scene: Scene, mesh: Mesh) -> Row:
    """The median of several plans, and one bake."""
    settings, output, seconds = Settings(probes=0), mesh.output_points(), []
    for _ in range(REPEATS):
        start = time.process_time()
        planned(scene, plan(scene, settings.begin()))
        seconds.append(time.process_time() - start)
    start = time.process_time()
    timed_bake(scene, settings, (output.points, output.normals))
    bake_seconds, plan_seconds = time.process_time() - start, float(np.median(seconds))
    return {
        "scene": name,
        "triangles": len(scene.triangles),
        "plan_seconds": plan_seconds,
        "bake_seconds": bake_seconds,
        "plan_share": plan_seconds / bake_seconds,
    }


def saved_rows(small: bool) -> list[Row]:
    """Core-seconds and rays without each effect and with it."""
    particles, rows = 500 if small else 20_000, []
    for effect, (without, with_it, forced) in cases().items():
        few = min(4000, particles) if effect == "occlusion" else particles
        start = Settings(
            method="direct", particles=few, quadrature=1, max_iterations=1, probes=0, effects={"occlusion": False}
        )
        at = solve(without(), start).particles
        points, runs = (at.positions, at.normals), ([], [])
        for _ in range(1 if small else REPEATS):
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
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--small", action="store_true", help="few particles")
    tables = {"saved": saved_rows, "plan": plan_rows}
    parser.add_argument("--table", nargs="+", choices=tables, default=list(tables), help="which")
    options = parser.parse_args()
    print_rows([row for name in options.table for row in tables[name](options.small)], options.json)


if __name__ == "__main__":
    main()
