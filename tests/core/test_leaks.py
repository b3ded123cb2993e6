# SPDX-License-Identifier: GPL-3.0-or-later
"""No light comes through walls, under them or where things touch."""

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import visibility
from test_visibility import FMM, LAMP, block


@pytest.mark.parametrize("gap", [0.0, 1e-4])
def test_light_does_not_leak_through_a_wall(gap):
    left = shapes.room()
    right = left + np.array([1.0 + gap, 0.0, 0.0])
    scene = fmm_core.Scene(np.concatenate([left, right]), 0.5, (np.arange(24) < 12).astype(float))
    solution = fmm_core.solve(scene, fmm_core.Settings(particles=4000, **FMM))
    lit = solution.irradiance(*shapes.random_points(left, 30))
    dark = solution.irradiance(*shapes.random_points(right, 30))
    assert dark.max() < 1e-6 * lit.min()


@pytest.mark.parametrize("method", ["fmm", "direct"])
def test_light_does_not_leak_between_turned_rooms_of_fine_meshes_that_share_corners(method):
    # One mesh for all that looks at corners, finer than the particles; rays go through corners of the wall.
    axes = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    axes *= np.sign(np.linalg.det(axes))
    left = 2 * shapes.subdivided_room(12)
    right, lamp = left + np.array([2.0, 0.0, 0.0]), LAMP * [0.3, 0.5, 0.0] + [0.5, 0.5, 1.9]
    triangles = np.concatenate([left, right, lamp]) @ axes
    emission = np.where(np.arange(len(triangles)) < 2 * len(left), 0.0, 10.0)
    settings = fmm_core.Settings(particles=1500, method=method, probes=0)
    solution = fmm_core.solve(fmm_core.Scene(triangles, 0.6, emission), settings)
    lit = solution.irradiance(*shapes.random_points(left @ axes, 1))
    dark = solution.irradiance(*shapes.random_points(right @ axes, 1))
    assert dark.max() < 1e-6 * lit.mean()


@pytest.mark.parametrize("cells", [1, 7])
def test_rays_to_the_rim_of_a_wall_do_not_slip_into_the_room_behind(cells):
    room = shapes.subdivided_room(cells)
    triangles = np.concatenate([room - [1.0, 0.0, 0.0], room])
    scene = fmm_core.Scene(triangles, 0.5, np.arange(len(triangles)) < len(room))
    particles = fmm_core.particles.make_particles(scene, 4000, 2)
    occlusion = visibility.Occlusion(scene)
    points, normals = shapes.random_points(shapes.room(), 20_000)
    rng = np.random.default_rng(0)
    rim, along = np.tile([[0.0, 0.0], [0.0, 1.0]], (len(points) // 2, 1)), rng.uniform(size=len(points))
    rim[:, 0] = along
    rim[::3] = rim[::3, ::-1]
    directions = np.column_stack([np.zeros(len(points)), rim]) + rng.normal(scale=1e-7, size=points.shape) - points
    facing = (directions * normals).sum(axis=1) > 1e-3
    met = occlusion.met(points[facing], normals[facing], directions[facing], occlusion.surface(particles)).particles
    assert facing.sum() > 100_000
    assert not particles.emits[met[met >= 0]].any()
    assert (met < 0).mean() < 1e-3


@pytest.mark.parametrize("cells", [11, 60])
@pytest.mark.parametrize("thickness", [0.0, 0.02])
def test_light_does_not_leak_along_a_floor_under_a_wall(cells, thickness):
    # The cells of the room's floor, walls and ceiling lie under the wall, and have a lit part and a dark one.
    room = shapes.subdivided_room(cells) * [2.0, 1.0, 1.0]
    low, high = [0.953, -0.01, -0.01], [0.953 + thickness, 1.01, 1.01]
    triangles = np.concatenate([room, block(low, high), LAMP])
    scene = fmm_core.Scene(triangles, 0.7, np.where(np.arange(len(triangles)) < len(triangles) - 2, 0.0, 10.0))
    solution = fmm_core.solve(scene, fmm_core.Settings(particles=4000, **FMM))
    points, normals = shapes.random_points(shapes.room([2.0, 1.0, 1.0]), 500)
    found = solution.irradiance(points, normals)
    dark = points[:, 0] > high[0] + 1e-3
    assert found[dark].max() < 1e-6 * found[points[:, 0] < 0.9].mean()


@pytest.mark.parametrize("gap", [0.0, -0.05, 1e-4])
def test_contact_interpenetration_and_a_close_plane_make_no_leak(gap):
    # The bottom of the block, and the floor below it, are dark.
    box = block([0.3, 0.3, gap], [0.7, 0.7, 0.4])
    triangles = np.concatenate([shapes.room(), box])
    emission = np.where(np.arange(len(triangles)) == 2, 1.0, 0.0)
    emission[3] = 1.0
    scene = fmm_core.Scene(triangles, 0.5, emission)
    below = np.column_stack([np.random.default_rng(0).uniform(0.35, 0.65, (200, 2)), np.zeros(200)])
    up = np.tile([0.0, 0.0, 1.0], (200, 1))
    found = fmm_core.solve(scene, fmm_core.Settings(particles=4000, **FMM)).irradiance(below, up)
    exact = fmm_core.solve(scene, fmm_core.Settings(particles=4000, method="direct", probes=0)).irradiance(below, up)
    assert found.max() <= 1.01 * exact.max() + 1e-6


@pytest.mark.parametrize("two_sided", [False, True])
@pytest.mark.parametrize("method", ["fmm", "direct"])
def test_no_light_comes_under_a_plane_just_above_the_floor(method, two_sided):
    rug = shapes.quad([0.2, 0.2, 1e-4], [0.6, 0.2, 1e-4], [0.6, 0.6, 1e-4], [0.2, 0.6, 1e-4])
    triangles = np.concatenate([shapes.subdivided_room(8), LAMP, rug])
    part = np.arange(len(triangles)) - len(triangles) + 4
    scene = fmm_core.Scene(
        triangles, 0.6, np.where((part >= 0) & (part < 2), 10.0, 0.0), two_sided=two_sided & (part >= 2)
    )
    solution = fmm_core.solve(scene, fmm_core.Settings(particles=1500, method=method, probes=0))
    under = np.column_stack([np.random.default_rng(0).uniform(0.21, 0.59, (300, 2)), np.zeros(300)])
    up = np.tile([0.0, 0.0, 1.0], (300, 1))
    beside = solution.irradiance([[0.7, 0.7, 0.0]], [[0.0, 0.0, 1.0]])
    found = solution.irradiance(under, up)
    # One ray of the 200 of a point may find the gap.
    assert found.max() < beside.min() / 200
    assert found.mean() < 1e-4 * beside.min()


@pytest.mark.parametrize("wall", ["sheet", "two faces", "thin block", "in one mesh", "in one fine mesh"])
def test_light_does_not_leak_past_a_thin_wall_that_is_not_midway(wall):
    at, lamp = 0.87, shapes.quad([0.3, 0.3, 0.98], [0.3, 0.7, 0.98], [0.7, 0.7, 0.98], [0.7, 0.3, 0.98])
    sheet = shapes.quad([at, 0, 0], [at, 1, 0], [at, 1, 1], [at, 0, 1])
    room, beyond = shapes.room((2.0, 1.0, 1.0)), at
    if wall == "two faces":
        sheet = np.concatenate([sheet, sheet[:, ::-1]])
    if wall == "thin block":
        sheet, beyond = block([at, -0.01, -0.01], [at + 1e-5, 1.01, 1.01]), at + 1e-5
    if wall.startswith("in one"):
        # Side walls have corners where the sheet joins, floor and ceiling do not.
        sides = [shapes.quad([a, 0, 0], [a, 0, 1], [b, 0, 1], [b, 0, 0]) for a, b in ((0, at), (at, 2))]
        sides += [shapes.quad([a, 1, 0], [b, 1, 0], [b, 1, 1], [a, 1, 1]) for a, b in ((0, at), (at, 2))]
        room = np.concatenate([room[:4], room[8:], *sides])
    if wall == "in one fine mesh":
        room = shapes.finer(room, 4)
    triangles = np.concatenate([room, sheet, lamp])
    part = np.arange(len(triangles)) - len(room)
    two_sided = (part >= 0) & (part < len(sheet)) & (wall not in ("two faces", "thin block"))
    scene = fmm_core.Scene(triangles, 0.7, np.where(part >= len(sheet), 10.0, 0.0), two_sided=two_sided)
    solution = fmm_core.solve(scene, fmm_core.Settings(particles=3000, **FMM))
    rng = np.random.default_rng(0)
    dark = np.column_stack(
        [beyond + 10 ** rng.uniform(-4, -0.3, 3000), rng.uniform(0.002, 0.998, 3000), np.zeros(3000)]
    )
    lit = np.column_stack([rng.uniform(0.1, 0.8, (200, 2)), np.zeros(200)])
    found = [solution.irradiance(points, np.tile([0.0, 0.0, 1.0], (len(points), 1))) for points in (dark, lit)]
    assert found[0].max() < 1e-6 * found[1].mean()
