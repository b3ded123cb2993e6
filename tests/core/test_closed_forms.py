# SPDX-License-Identifier: GPL-3.0-or-later
"""Solutions that are known exactly: furnaces, opposite and adjacent squares, a sphere in a sphere."""

import fmm_core
import numpy as np
import pytest
import shapes

UNIT_SQUARE = ([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0])


def irradiance_from(source, receiver, per_side=200):
    """Mean irradiance on a receiving parallelogram (origin, u, v) from black triangles of emission 1."""
    origin, u, v = (np.array(p, dtype=float) for p in receiver)
    triangles = np.concatenate([source, shapes.quad(origin, origin + u, origin + u + v, origin + v)])
    emission = np.arange(len(triangles)) < len(source)
    scene = fmm_core.Scene(triangles, albedo=0.0, emission=emission.astype(float))
    solution = fmm_core.solve(scene, fmm_core.Settings(particles=600))
    middle = (np.arange(per_side) + 0.5) / per_side
    s, t = (grid.reshape(-1, 1) for grid in np.meshgrid(middle, middle))
    points = origin + s * u + t * v
    normal = np.cross(u, v)
    return solution.irradiance(points, np.broadcast_to(normal, points.shape))[:, 0].mean()


def test_parallel_unit_squares_exchange_the_closed_form_share():
    # Howell, A Catalog of Radiation Heat Transfer Configuration Factors, C-11, with X = Y = 1.
    exact = 2 / np.pi * (np.log(np.sqrt(4 / 3)) + 2 * np.sqrt(2) * np.arctan(1 / np.sqrt(2)) - 2 * np.arctan(1))
    factor = irradiance_from(shapes.quad(*UNIT_SQUARE), ([0, 0, 1], [0, 1, 0], [1, 0, 0]))
    assert factor == pytest.approx(exact, rel=1e-3)


def test_perpendicular_unit_squares_with_a_common_edge_exchange_the_closed_form_share():
    # Howell, C-14, with H = W = 1.
    logs = np.log(4 / 3) + np.log(3 / 4) + np.log(3 / 4)
    exact = (2 * np.arctan(1) - np.sqrt(2) * np.arctan(1 / np.sqrt(2)) + logs / 4) / np.pi
    factor = irradiance_from(shapes.quad(*UNIT_SQUARE), ([0, 0, 0], [0, 1, 0], [0, 0, 1]))
    assert factor == pytest.approx(exact, rel=1e-3)


def missing(solution, points, normals):
    """Largest part of a hemisphere that a point misses, or has too much, before closed scenes are made whole."""
    operator = solution._space.sums.direct_operator(points, normals)
    return np.abs(operator.apply(np.ones((len(solution.particles), 3))) - 1).max()


@pytest.mark.parametrize("method", ["direct", "fmm"])
def test_a_normal_that_leans_over_sees_the_floor_that_it_stands_on(method):
    """By an angle a: the share (1 - cos a) / 2 of its hemisphere is below its horizon, and there is the floor."""
    # One side of a room of cells, and something black without which surfaces would exchange no light at all.
    floor = shapes.subdivided_room(12)
    floor = 2 * floor[(floor[..., 2] == 0).all(axis=1)] - [1, 1, 0]
    speck = shapes.quad([0, 0, 3], [0, 0.01, 3], [0.01, 0.01, 3], [0.01, 0, 3])
    lamp = fmm_core.PointLight((0.0, 0.0, 2.0), 3.0)
    scene = fmm_core.Scene([*floor, *speck], albedo=[0.7] * len(floor) + [0.0, 0.0], lights=[lamp])
    solution = fmm_core.solve(scene, fmm_core.Settings(method=method, probes=0))
    places = (np.arange(11) - 5) / 6.4
    x, y = (grid.ravel() for grid in np.meshgrid(places, places))
    points, normals = np.stack([x, y, 1e-4 + 0 * x], axis=1), np.stack([x / 2, y / 2, 1 + 0 * x], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    to = np.array(lamp.position) - points
    squared = (to**2).sum(axis=1)
    to /= np.sqrt(squared)[:, None]
    from_lamp, of_floor = 3 * (to * normals).sum(axis=1) / squared, 0.7 * 3 * to[:, 2] / squared
    exact = from_lamp + of_floor * (1 - normals[:, 2]) / 2
    found = solution.irradiance(points, normals)[:, 0]
    assert np.linalg.norm(found - exact) < 0.005 * np.linalg.norm(exact)
    assert np.linalg.norm(from_lamp - exact) > 0.01 * np.linalg.norm(exact)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_closed_cube_furnace_is_exact_in_its_corners_too(scale):
    cube = shapes.room() * scale
    solution = fmm_core.solve(fmm_core.Scene(cube, albedo=0.5, emission=1.0))
    points, normals = (
        np.concatenate(p) for p in zip(shapes.corner_points(cube), shapes.random_points(cube, 40), strict=True)
    )
    radiosity = 1.0 + 0.5 * solution.irradiance(points, normals)
    assert missing(solution, points, normals) < 1e-3
    assert np.abs(radiosity / 2 - 1).max() < 1e-3
    assert np.abs(solution.radiosity / 2 - 1).max() < 1e-3


@pytest.mark.parametrize("per_side", [1, 4, 14, 20])
def test_furnace_is_exact_on_meshes_of_any_density(per_side):
    triangles = shapes.subdivided_room(per_side)
    solution = fmm_core.solve(fmm_core.Scene(triangles, albedo=0.5, emission=1.0))
    points, normals = shapes.corner_points(triangles)
    assert missing(solution, points, normals) < 2e-3
    assert np.abs((1.0 + 0.5 * solution.irradiance(points, normals)) / 2 - 1).max() < 1e-3


@pytest.mark.parametrize("quadrature", [1, 2, 4, 5])
def test_every_quadrature_rule_keeps_the_furnace(quadrature):
    cube = shapes.room()
    settings = fmm_core.Settings(particles=1500, quadrature=quadrature)
    solution = fmm_core.solve(fmm_core.Scene(cube, albedo=0.5, emission=1.0), settings)
    points, normals = shapes.corner_points(cube)
    assert missing(solution, points, normals) < 2e-3
    assert np.abs((1.0 + 0.5 * solution.irradiance(points, normals)) / 2 - 1).max() < 1e-3


def test_inner_sphere_is_seen_from_the_outer_one_by_the_ratio_of_their_areas():
    inner, outer = shapes.sphere(0.5, 4), shapes.sphere(1.0, 4, inward=True)
    emission = np.arange(len(inner) + len(outer)) < len(inner)
    scene = fmm_core.Scene(np.concatenate([inner, outer]), albedo=0.0, emission=emission.astype(float))
    solution = fmm_core.solve(scene)
    centres = outer.mean(axis=1)
    irradiance = solution.irradiance(centres, -centres)[:, 0]
    # Polyhedra in place of spheres: their own areas count.
    area = [np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1).sum() for t in (inner, outer)]
    assert irradiance.mean() == pytest.approx(area[0] / area[1], rel=5e-3)
    assert irradiance.std() < 0.01 * irradiance.mean()


def test_a_wall_between_two_rooms_keeps_the_dark_one_dark():
    left = shapes.room()
    right = left + np.array([1.0, 0.0, 0.0])
    emission = np.arange(24) < 12
    solution = fmm_core.solve(
        fmm_core.Scene(np.concatenate([left, right]), albedo=0.5, emission=emission.astype(float))
    )
    lit = solution.irradiance(*shapes.random_points(left, 30))
    dark = solution.irradiance(*shapes.random_points(right, 30))
    assert dark.max() < 1e-6 * lit.min()


def test_energy_that_is_emitted_is_absorbed_or_escapes():
    """Escape is measured on its own, by cosine-distributed rays from every particle."""
    import embreex.mesh_construction
    import embreex.rtcore_scene

    walls = shapes.room()[2:]
    block = shapes.room((0.3, 0.3, 0.5))[:, ::-1] + [0.3, 0.3, 1e-3]
    triangles = np.concatenate([walls, block])
    emission = np.zeros(len(triangles))
    emission[-2:] = 1.0
    albedo = np.full(len(triangles), 0.7)
    solution = fmm_core.solve(fmm_core.Scene(triangles, albedo=albedo, emission=emission))
    particles = solution.particles
    emitted = (particles.weights * emission[particles.triangle]).sum()
    absorbed = (particles.weights * 0.3 * solution.irradiance(particles.positions, particles.normals)[:, 0]).sum()

    embree = embreex.rtcore_scene.EmbreeScene()
    _ = embreex.mesh_construction.TriangleMesh(embree, triangles.astype(np.float32))
    rays = 256
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(len(particles), rays, 3))
    direction = direction / np.linalg.norm(direction, axis=2, keepdims=True) + particles.normals[:, None]
    origin = np.repeat(particles.positions + 1e-5 * particles.normals, rays, axis=0).astype(np.float32)
    missed = embree.run(origin, direction.reshape(-1, 3).astype(np.float32), query="OCCLUDED") != 0
    share = missed.reshape(-1, rays).mean(axis=1)
    escaped = (particles.weights * share * solution.radiosity[:, 0]).sum()
    assert absorbed + escaped == pytest.approx(emitted, rel=5e-3)
