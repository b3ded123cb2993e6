# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes that are finer than the light needs, and rooms so full that rays go over the hemispheres."""

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import multipole
from fmm_core.particles import make_particles
from hypothesis import given, settings
from hypothesis import strategies as st
from test_visibility import LAMP, block, error


def crowd(objects, times):
    """Triangles, albedo and emission of a lit room with many blocks, some through each other and through the walls."""
    rng = np.random.default_rng(5)
    parts = [shapes.room(), LAMP]
    for _ in range(objects):
        low = rng.uniform(-0.02, 0.8, 3)
        parts.append(block(low, low + rng.uniform(0.05, 0.2, 3)))
    triangles = np.concatenate(parts)
    albedo = np.repeat(rng.uniform(0.2, 0.8, (len(triangles) // 2, 3)), 2, axis=0)
    emission = np.zeros(len(triangles))
    emission[12:14] = 10.0
    return shapes.finer(triangles, times), np.repeat(albedo, 4**times, axis=0), np.repeat(emission, 4**times)


@pytest.fixture(scope="module")
def full_room():
    """The scene, points on it, and their irradiance by the direct method, 0.6 % off for the size of its patches."""
    scene = fmm_core.Scene(*crowd(16, 1))
    reference = fmm_core.solve(scene, fmm_core.Settings(method="direct", particles=12_000, probes=0))
    points, normals = shapes.random_points(scene.triangles, 2)
    return scene, (points, normals), reference.irradiance(points, normals)


def bake(scene, points, **options):
    solution = fmm_core.solve(scene, fmm_core.Settings(method="fmm", particles=8000, probes=0, **options))
    return solution.irradiance(*points), solution.report["counts"]["rays"] / (len(solution.particles) + len(points[0]))


def test_of_few_rays_more_are_for_emitters():
    # The share of the light that one aimed ray stands for, and rays over the hemisphere.
    usual, few, many = (np.array(multipole._effort(rays))[[0, 4]] for rays in (200, 50, 800))
    assert usual / many == pytest.approx([4, 1 / 4])
    assert few / usual == pytest.approx([4**0.75, 1 / 4])


def test_a_crowded_room_is_gathered_within_one_and_a_half_percent(full_room):
    scene, points, exact = full_room
    found, rays = bake(scene, points)
    assert error(found, exact) < 0.015
    assert rays < 300


def test_gathered_light_grows_exact_with_the_rays(full_room):
    scene, points, exact = full_room
    (few, _), (many, _) = (bake(scene, points, rays=rays) for rays in (40, 1000))
    assert error(many, exact) < 0.01
    assert error(few, exact) > 1.5 * error(many, exact)


def test_light_is_neither_lost_nor_made_in_a_crowd(full_room):
    scene, points, exact = full_room
    assert bake(scene, points)[0].sum() == pytest.approx(exact.sum(), rel=5e-3)


def test_a_fine_mesh_is_as_exact_as_a_coarse_one_with_far_fewer_particles_than_triangles():
    coarse = crowd(2, 0)
    fine = fmm_core.Scene(shapes.finer(coarse[0], 5), np.repeat(coarse[1], 4**5, axis=0), np.repeat(coarse[2], 4**5))
    # On the walls: in the narrow gap below a block the patches of the direct method are too coarse.
    points = shapes.random_points(coarse[0][:12], 100)
    exact = fmm_core.solve(
        fmm_core.Scene(*coarse), fmm_core.Settings(method="direct", particles=8000, probes=0)
    ).irradiance(*points)
    solution = fmm_core.solve(fine, fmm_core.Settings(method="fmm", particles=6000, probes=0))
    assert len(solution.particles) < len(fine.triangles) / 3
    sides = coarse[0][:, 1:] - coarse[0][:, :1]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum() / 2
    assert solution.particles.weights.sum() == pytest.approx(area)
    assert error(solution.irradiance(*points), exact) < 0.015


def test_no_particle_stands_for_two_objects_or_two_colours():
    sheet = shapes.finer(shapes.quad([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]), 5)
    triangles = np.concatenate([sheet, sheet + [0.0, 0.0, 1e-4]])
    albedo = np.where(sheet.mean(axis=1)[:, :1] < 0.5, 0.2, 0.7)
    scene = fmm_core.Scene(triangles, np.tile(albedo, (2, 1)) * np.ones(3), np.full(len(triangles), 1.0))
    particles = make_particles(scene, 100, 1, lambda points, normals: np.zeros(len(points), bool))
    assert len(particles) < len(triangles) / 4
    node = particles.parts[: len(triangles), 0]
    height, colour = triangles.mean(axis=1)[:, 2], scene.albedo[:, 0]
    for values in (height, colour):
        assert np.array_equal(values[particles.triangle[node]], values)


def test_a_group_is_stood_for_by_a_triangle_that_can_be_seen():
    sheet = shapes.finer(shapes.quad([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]), 4)
    scene = fmm_core.Scene(sheet, 0.5, 1.0)
    particles = make_particles(scene, 10, 1, lambda points, normals: points[:, 0] < 0.95)
    in_sight = [group for group in np.unique(particles.parts[: len(sheet), 0]) if _reaches(particles, sheet, group)]
    assert len(in_sight) > 0
    assert (particles.positions[in_sight, 0] >= 0.95).all()


def _reaches(particles, sheet, group):
    members = particles.parts[: len(sheet), 0] == group
    return (sheet[members].mean(axis=1)[:, 0] >= 0.95).any()


def test_near_light_of_groups_is_found_where_nothing_is_in_the_way():
    room = shapes.finer(shapes.room(), 4)
    settings = fmm_core.Settings(method="fmm", particles=300, probes=0, effects={"occlusion": True})
    solution = fmm_core.solve(fmm_core.Scene(room, 0.5, 1.0), settings)
    assert len(solution.particles) < len(room)
    found = solution.irradiance(*shapes.random_points(room, 1))
    assert found == pytest.approx(np.full_like(found, 2.0), rel=0.02)


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.97))
@settings(max_examples=10, deadline=None)
def test_krylov_and_shooting_end_at_the_same_light(seed, albedo):
    rng = np.random.default_rng(seed)
    triangles = rng.uniform(-1, 1, (8, 3, 3))
    scene = fmm_core.Scene(triangles, albedo, rng.uniform(0, 1, 8), two_sided=True)
    solved = [
        fmm_core.solve(scene, fmm_core.Settings(particles=200, iteration=iteration, tolerance=1e-6)).radiosity
        for iteration in ("krylov", "shooting")
    ]
    assert solved[0] == pytest.approx(solved[1], rel=1e-4, abs=1e-8)


def test_bright_surfaces_want_few_applications():
    scene = fmm_core.Scene(np.concatenate([shapes.room(), LAMP]), 0.99, (np.arange(14) >= 12).astype(float))
    report = fmm_core.solve(scene, fmm_core.Settings(particles=1000)).report
    assert not report["warnings"]
    assert len(report["residuals"]) <= 30


@pytest.mark.parametrize("turn", range(4))
def test_light_between_stacked_sheets_is_that_of_the_direct_method_however_patches_meet(turn):
    # Points opposite to a patch see its points at the horizon; emitters are cut finer than what they face.
    axes = np.linalg.qr(np.random.default_rng(turn).normal(size=(3, 3)))[0] if turn else np.eye(3)
    sheet = np.array([[0.55, -0.42, 0.28], [-0.52, -0.3, 0.53], [-0.15, 0.79, -0.35]])
    normal = np.cross(sheet[1] - sheet[0], sheet[2] - sheet[0])
    sheets = (sheet + 2e-5 * np.arange(4)[:, None, None] * normal / np.linalg.norm(normal)) @ axes
    scene = fmm_core.Scene(sheets, 0.7, [0.0, 1.0, 80.0, 470.0], two_sided=[True, False, True, True])
    light = []
    for method in ("direct", "fmm"):
        solution = fmm_core.solve(scene, fmm_core.Settings(particles=200, method=method, probes=0))
        light.append((solution.particles.weights[:, None] * solution.received).sum())
    assert light[1] == pytest.approx(light[0], rel=5e-3)
