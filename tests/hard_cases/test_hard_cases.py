# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes that break renderers, one a test, with the bound that each must meet beside it."""

import itertools

import fmm_core
import numpy as np
import pytest
import shapes
from energy import audit
from fmm_core import _binding

#: Light may be created by no more than this share of what is emitted.
CREATED = 5e-3
METHODS = pytest.mark.parametrize("method", ["direct", "fmm"])
ROOM = shapes.room()
BLOCK = shapes.room((0.3, 0.25, 0.4))[:, ::-1] + [0.35, 0.4, 0.2]
LAMP = shapes.quad([0.3, 0.3, 0.97], [0.3, 0.7, 0.97], [0.7, 0.7, 0.97], [0.7, 0.3, 0.97])
#: Open in front, with a block in the air and a lamp.
SCENE = np.concatenate([ROOM[2:], BLOCK, LAMP])


def lit(triangles, lamps, albedo=0.6, **options):
    """A scene in which the last triangles shine."""
    shines = np.arange(len(triangles)) >= len(triangles) - lamps
    return fmm_core.Scene(triangles, albedo, shines.astype(float), **options)


def settings(method="direct", **options):
    return fmm_core.Settings(method=method, **({"particles": 600, "probes": 0} | options))


def l_shaped_room():
    """A closed prism over an L, fronts inside."""
    plan = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], float)
    walls = [
        shapes.quad([*b, 0], [*a, 0], [*a, 1], [*b, 1]) for a, b in zip(plan, np.roll(plan, -1, axis=0), strict=True)
    ]
    for x, y in ((0, 0), (1, 0), (0, 1)):
        walls.append(shapes.quad([x, y, 0], [x + 1, y, 0], [x + 1, y + 1, 0], [x, y + 1, 0]))
        walls.append(shapes.quad([x, y, 1], [x, y + 1, 1], [x + 1, y + 1, 1], [x + 1, y, 1]))
    return np.concatenate(walls)


CLOSED = {"cube": ROOM, "sphere": shapes.sphere(1.0, 3, inward=True), "l_shape": l_shaped_room()}


@pytest.mark.parametrize(("albedo", "bound"), [(0.1, 1e-3), (0.5, 1e-3), (0.9, 1e-3), (0.99, 5e-3)])
@METHODS
@pytest.mark.parametrize("shape", CLOSED)
def test_furnace(shape, method, albedo, bound, at_most):
    triangles, exact = CLOSED[shape], 1 / (1 - albedo)
    solution = fmm_core.solve(fmm_core.Scene(triangles, albedo, 1.0), fmm_core.Settings(method=method, probes=0))
    points = shapes.corner_points(triangles)
    found = 1 + albedo * solution.irradiance(*points)
    at_most(bound, error=np.abs(found / exact - 1).max(), particles=np.abs(solution.radiosity / exact - 1).max())
    assert len(solution.report["residuals"]) <= 30
    assert solution.report["warnings"] == []


@METHODS
@pytest.mark.parametrize(("scale", "shift"), [(1e-4, 0.0), (1e5, 0.0), (1.0, 1e6), (1e-3, 10.0)])
def test_scale_and_distance(scale, shift, method, at_most):
    points, normals = shapes.random_points(SCENE, 4)
    there = np.array([shift, -shift, shift / 2])
    at_home = fmm_core.solve(lit(SCENE, 2), settings(method)).irradiance(points, normals)
    far = fmm_core.solve(lit(scale * SCENE + there, 2), settings(method))
    found = far.irradiance(scale * points + there, normals)
    at_most(1e-3, difference=np.linalg.norm(found - at_home) / np.linalg.norm(at_home))


@METHODS
def test_slivers_of_aspect_a_million(method, at_most):
    # The floor once more, as a fan of slivers about one corner and a rest, and slivers in the air.
    rng = np.random.default_rng(1)
    ends = np.array([[1.0, k * 1e-6, 0.0] for k in range(4)])
    fan = [[[0, 0, 0], a, b] for a, b in itertools.pairwise(ends)]
    rest = [[[0, 0, 0], ends[-1], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]]
    floor = np.abs(ROOM[:, :, 2]).max(axis=1) == 0
    a, b = rng.uniform(0.2, 0.8, (2, 12, 3))
    air = np.stack([a, b, (a + b) / 2 + 1e-6 * rng.uniform(-1, 1, (12, 3))], axis=1)
    clean = np.concatenate([ROOM[~floor], ROOM[floor], LAMP])
    ugly = np.concatenate([ROOM[~floor], np.array(fan + rest, float), air, LAMP])
    points = shapes.random_points(ROOM, 5)
    exact = fmm_core.solve(lit(clean, 2), settings()).irradiance(*points)
    flying = (np.arange(len(ugly)) >= len(ugly) - 14) & (np.arange(len(ugly)) < len(ugly) - 2)
    result = audit(lit(ugly, 2, two_sided=flying), settings(method))
    at_most(0.01, light=np.linalg.norm(result.solution.irradiance(*points) - exact) / np.linalg.norm(exact))
    at_most(CREATED, created=result.created)


@METHODS
def test_zero_area_duplicate_and_coincident_opposite_faces(method, at_most):
    lines = np.array([[[0, 0, 0], [1, 1, 1], [0.5, 0.5, 0.5]], [[1, 0, 0]] * 3])
    ugly = np.concatenate([ROOM[2:], BLOCK, BLOCK, lines, ROOM[4:6], ROOM[4:6, ::-1], LAMP])
    points = shapes.random_points(SCENE, 4)
    exact = fmm_core.solve(lit(SCENE, 2), settings(method)).irradiance(*points)
    result = audit(lit(ugly, 2), settings(method))
    assert len(result.solution.scene.triangles) == len(SCENE) + 2
    at_most(0.01, light=np.linalg.norm(result.solution.irradiance(*points) - exact) / np.linalg.norm(exact))
    at_most(CREATED, created=result.created)


@METHODS
def test_two_plates_that_almost_touch(method, at_most):
    low = shapes.quad([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0])
    plates = np.concatenate([low, low[:, ::-1] + [0, 0, 1e-5]])
    result = audit(fmm_core.Scene(plates, 0.5, [0, 0, 1.0, 1.0]), settings(method))
    points = shapes.random_points(low, 50)
    received = result.solution.irradiance(*points)[:, 0]
    # All but a rim of 1e-5 is as if they were endless: E = 1 + 0.25 E.
    at_most(1e-3, light=np.abs(np.median(received) * 0.75 - 1))
    at_most(CREATED, created=result.created)


@METHODS
def test_a_vertex_on_another_face(method, at_most):
    spike = np.array([[0.5, 0.5, 0], [0.8, 0.4, 0.5], [0.4, 0.8, 0.5], [0.3, 0.3, 0.6]])
    cone = spike[[[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]]]
    result = audit(lit(np.concatenate([ROOM[2:], cone, LAMP]), 2), settings(method))
    # The same spike just above the floor.
    apart = np.concatenate([ROOM[2:], cone + [0, 0, 1e-5], LAMP])
    points = shapes.random_points(SCENE, 4)
    exact = fmm_core.solve(lit(apart, 2), settings(particles=4000)).irradiance(*points)
    at_most(0.02, light=np.linalg.norm(result.solution.irradiance(*points) - exact) / np.linalg.norm(exact))
    at_most(CREATED, created=result.created)


@METHODS
@pytest.mark.parametrize("axes", [(-1, 1, 1), (-2, -0.5, 1), (-1, -1, -1)])
def test_negative_scale(axes, method, at_most):
    points, normals = shapes.random_points(SCENE, 4)
    plain, scale = np.abs(axes), np.array(axes, float)

    def received(by):
        # Corners in the other order keep the fronts where they were.
        turned = 1 if by.prod() > 0 else -1
        to = normals / by
        solution = fmm_core.solve(lit((by * SCENE)[:, ::turned], 2), settings(method))
        return solution.irradiance(by * points, to)

    found, expected = received(scale), received(plain)
    at_most(0.01, light=np.linalg.norm(found - expected) / np.linalg.norm(expected))


@METHODS
def test_an_emitter_of_a_millionth_of_the_area(method, at_most):
    side = np.sqrt(6e-6)
    speck = shapes.quad([0.5, 0.5, 0.6], [0.5, 0.5 + side, 0.6], [0.5 + side, 0.5 + side, 0.6], [0.5 + side, 0.5, 0.6])
    result = audit(lit(np.concatenate([ROOM, speck]), 2, albedo=0.0), settings(method, particles=1200))
    below = result.solution.irradiance([[0.5 + side / 2, 0.5 + side / 2, 0.0]], [[0, 0, 1.0]])[0, 0]
    at_most(1e-3, light=np.abs(below / (side**2 / (np.pi * 0.36)) - 1))
    at_most(CREATED, created=result.created)


@METHODS
def test_emission_that_spans_eight_decades(method, at_most):
    shines = np.arange(len(SCENE)) == 3
    both = np.where(np.arange(len(SCENE)) >= len(SCENE) - 2, 1e8, shines.astype(float))
    points = shapes.random_points(SCENE, 4)
    alone = [fmm_core.Scene(SCENE, 0.6, e) for e in (both, np.where(both > 1, both, 0.0))]
    together, bright = (fmm_core.solve(s, settings(method)).irradiance(*points) for s in alone)
    at_most(1e-3, difference=np.linalg.norm(together - bright) / np.linalg.norm(bright))
    at_most(CREATED, created=audit(alone[0], settings(method)).created)


@pytest.fixture(scope="module")
def convex():
    """An open room with nothing in the way, its direct sum and points."""
    scene = lit(np.concatenate([ROOM[2:-2], ROOM[-2:]]), 2)
    points = shapes.random_points(ROOM, 20)
    return scene, points, fmm_core.solve(scene, settings(particles=1200)).irradiance(*points)


@pytest.mark.parametrize(
    ("options", "bound"),
    [
        # Expansions of one term only are coarse; what they are expanded over is still in the right place.
        ({"truncation": 0}, 0.25),
        ({"truncation": 20, "expansion": "whole"}, 1e-4),
        ({"grouping": 1}, 5e-3),
        ({"grouping": 100_000}, 1e-9),
    ],
    ids=["p_0", "p_20", "s_1", "s_above_n"],
)
def test_extreme_setting(options, bound, convex, at_most):
    scene, points, exact = convex
    found = fmm_core.solve(scene, settings("fmm", particles=1200, **options)).irradiance(*points)
    at_most(bound, error=np.linalg.norm(found - exact) / np.linalg.norm(exact))


@METHODS
def test_one_particle(method, at_most):
    triangle = np.array([[[0, 0, 0], [1, 0, 0], [0, 1.0, 0]]])
    solution = fmm_core.solve(fmm_core.Scene(triangle, 0.5, 1.0), settings(method, particles=1, quadrature=1))
    assert len(solution.particles) == 1
    above = solution.irradiance([[1 / 3, 1 / 3, 10.0]], [[0, 0, -1.0]])[0, 0]
    at_most(0.01, error=abs(above / (0.5 / (np.pi * 100)) - 1), itself=solution.radiosity.max() - 1)


@pytest.mark.parametrize("expansion", ["whole", "compressed", "paper"])
def test_all_particles_at_one_point(expansion, at_most):
    points = np.tile([[0.3, -0.2, 0.7]], (200, 1))
    normals = np.random.default_rng(0).normal(size=(200, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    fmm = _binding.Fmm((points, normals), np.full(200, 1e-20), None, 4, 8, None, 1, expansion)
    found, _ = fmm.apply(np.ones((200, 3)))
    assert np.isfinite(found).all()
    at_most(1e-12, light=np.abs(found).max())


@METHODS
def test_a_plane_has_a_flat_octree(method, at_most):
    tiles = shapes.subdivided_room(12)
    floor = tiles[np.abs(tiles[:, :, 2]).max(axis=1) == 0]
    shines = (np.arange(len(floor)) % 3 == 0).astype(float)
    result = audit(fmm_core.Scene(floor, 0.8, shines), settings(method, particles=1000))
    at_most(1e-9, received=result.irradiance.max())
    at_most(CREATED, created=result.created)


@METHODS
def test_sizes_from_one_to_a_million(method, at_most):
    speck = 1e-6 * shapes.sphere(1.0, 1) + [0.5, 0.5, 0.5]
    points = shapes.random_points(SCENE, 4)
    exact = fmm_core.solve(lit(SCENE, 2), settings(method)).irradiance(*points)
    result = audit(lit(np.concatenate([speck, SCENE]), 2), settings(method))
    at_most(0.01, light=np.linalg.norm(result.solution.irradiance(*points) - exact) / np.linalg.norm(exact))
    at_most(CREATED, created=result.created)


@METHODS
@pytest.mark.parametrize("albedo", [1.0, 7.0])
def test_albedo_of_one_and_above(albedo, method, at_most):
    result = audit(lit(SCENE, 2, albedo=albedo), settings(method))
    assert any("clamped" in text for text in result.solution.report["warnings"])
    assert not any("stopped" in text for text in result.solution.report["warnings"])
    at_most(CREATED, created=result.created)


UGLY = {
    "non_manifold": np.concatenate([ROOM[2:], BLOCK, BLOCK[:2] + [0.3, 0, 0], BLOCK[4:6] + [0, 0.25, 0], LAMP]),
    "self_intersecting": np.concatenate([ROOM[2:], BLOCK, BLOCK @ np.array([[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]])
                                         + [0.3, -0.2, 0.1], LAMP]),
    "inside_out": np.concatenate([ROOM[2:], BLOCK[:, ::-1], LAMP]),
    "open": np.concatenate([ROOM[2:], BLOCK[3:], LAMP]),
}  # fmt: skip


@METHODS
@pytest.mark.parametrize("two_sided", [False, True], ids=["one_side", "both_sides"])
@pytest.mark.parametrize("mesh", UGLY)
def test_mesh(mesh, two_sided, method, at_most):
    result = audit(lit(UGLY[mesh], 2, two_sided=two_sided), settings(method, particles=1200))
    at_most(CREATED, created=result.created)
    assert result.absorbed + result.escaped > 0.5 * result.emitted
