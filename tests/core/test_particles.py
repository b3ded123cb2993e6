# SPDX-License-Identifier: GPL-3.0-or-later
"""Quadrature rules and the cutting of triangles."""

import math

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import _binding
from fmm_core.cutting import bisected
from fmm_core.particles import make_particles
from fmm_core.quadrature import triangle_rule
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st


@pytest.mark.parametrize("degree", [1, 2, 4, 5])
def test_rule_integrates_monomials_up_to_its_degree_and_no_further(degree):
    points, weights = triangle_rule(degree)
    x, y = points[:, 0], points[:, 1]

    def error(i, j):
        exact = 2 * math.factorial(i) * math.factorial(j) / math.factorial(i + j + 2)
        return abs((weights * x**i * y**j).sum() - exact)

    assert max(error(i, n - i) for n in range(degree + 1) for i in range(n + 1)) < 1e-14
    assert max(error(i, degree + 1 - i) for i in range(degree + 2)) > 1e-5
    assert (points > 0).all()
    assert (weights > 0).all()


@settings(deadline=None)
@given(
    corners=st.lists(st.floats(-10, 10), min_size=18, max_size=18),
    count=st.integers(1, 3000),
    degree=st.sampled_from([1, 2, 4, 5]),
    two_sided=st.booleans(),
)
def test_particles_cover_the_area_with_unit_normals(corners, count, degree, two_sided):
    triangles = np.array(corners).reshape(2, 3, 3)
    try:
        scene = fmm_core.Scene(triangles, emission=1.0, two_sided=two_sided)
    except fmm_core.Error:
        return
    # Surfaces in one place share it, see test_hard_cases.py.
    assume(np.linalg.svd(triangles.reshape(6, 3) - triangles[0, 0])[1][2] > 1e-4 * np.ptp(triangles))
    particles = make_particles(scene, count, degree)
    cross = np.cross(scene.triangles[:, 1] - scene.triangles[:, 0], scene.triangles[:, 2] - scene.triangles[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2 * (1 + two_sided)
    covered = np.bincount(particles.triangle, particles.weights, minlength=len(area))
    assert covered == pytest.approx(area, rel=1e-6)
    assert np.linalg.norm(particles.normals, axis=1) == pytest.approx(1.0)
    assert len(particles) == len(particles.patches) * particles.per_patch


@settings(deadline=None)
@example(seed=30, degree=2, times=1)
@example(seed=37572, degree=2, times=1)
@given(seed=st.integers(0, 2**32 - 1), degree=st.sampled_from([1, 2]), times=st.integers(1, 4))
def test_patches_that_are_cut_keep_their_surface(seed, degree, times):
    rng = np.random.default_rng(seed)
    scene = fmm_core.Scene(rng.uniform(-1, 1, (5, 3, 3)), 0.5, 1.0)
    whole = cut = make_particles(scene, 100, degree)
    for _ in range(times):
        rows = rng.permutation(len(cut.areas))[: rng.integers(1, len(cut.areas))]
        cut = bisected(cut, rows)
    assert cut.weights.sum() == pytest.approx(whole.weights.sum())
    assert np.bincount(cut.triangle, cut.weights) == pytest.approx(np.bincount(whole.triangle, whole.weights))
    double = np.cross(cut.patches[:, 1] - cut.patches[:, 0], cut.patches[:, 2] - cut.patches[:, 0])
    assert np.linalg.norm(double, axis=1) / 2 == pytest.approx(cut.areas)
    assert np.repeat(double, cut.per_patch, axis=0) / 2 / np.repeat(cut.areas, cut.per_patch)[:, None] == pytest.approx(
        cut.normals, abs=1e-6
    )
    # A place near each of their points is found to belong to that point.
    surface = _binding.Surface(scene.triangles, (cut.edges, cut.fractions, cut.parts), cut.rule, cut.hidden, 1e-9)
    a, b, c = scene.triangles[cut.triangle].transpose(1, 0, 2)
    e, f, to = b - a, c - a, cut.positions - a
    ee, ef, ff, et, ft = ((x * y).sum(axis=1) for x, y in ((e, e), (e, f), (f, f), (e, to), (f, to)))
    u, v = ((ff * et - ef * ft) / (ee * ff - ef**2), (ee * ft - ef * et) / (ee * ff - ef**2))
    places = cut.triangle.astype(np.int32), u.astype(np.float32), v.astype(np.float32)
    met = surface.met(*places, (-cut.normals).astype(np.float32))[0]
    assert (met == np.arange(len(cut))).mean() > 0.99


def test_number_of_particles_is_about_the_one_asked_for():
    scene = fmm_core.Scene(shapes.room(), emission=1.0)
    for count in (100, 1000, 10_000):
        assert 0.5 * count < len(make_particles(scene, count, 1)) < 2 * count


def test_small_emitter_gets_its_share_of_particles():
    emitter = shapes.quad([0.49, 0.49, 0.5], [0.49, 0.51, 0.5], [0.51, 0.51, 0.5], [0.51, 0.49, 0.5])
    triangles = np.concatenate([shapes.room(), emitter])
    emission = np.where(np.arange(14) < 12, 0.0, 1.0)
    particles = make_particles(fmm_core.Scene(triangles, emission=emission), 2000, 1)
    assert np.count_nonzero(particles.triangle >= 12) > 100


def test_a_group_of_many_colours_has_their_mean():
    room = shapes.subdivided_room(48).round(9)
    rng = np.random.default_rng(3)
    albedo, opacity = 0.5 + 0.02 * rng.random((len(room), 3)), rng.random(len(room))
    albedo[: len(room) // 2] += 0.25
    emission = np.r_[1.0, np.zeros(len(room) - 1)]
    scene = fmm_core.Scene(room, albedo, emission, opacity=opacity)
    particles = make_particles(scene, 600, 1, lambda points, normals: np.zeros(len(points), bool))
    found = particles.of_triangles(scene.albedo)
    assert len(particles) < len(room) / 2
    areas = np.linalg.norm(np.cross(room[:, 1] - room[:, 0], room[:, 2] - room[:, 0]), axis=1) / 2
    assert particles.weights @ found == pytest.approx((opacity * areas) @ albedo)
    assert ((found < 0.6) == (albedo < 0.6)[particles.triangle]).all()
