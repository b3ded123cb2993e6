# SPDX-License-Identifier: GPL-3.0-or-later
"""Occlusion in the fast multipole method, judged by the direct method with all rays."""

from importlib.metadata import version

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import accuracy, visibility
from fmm_core.particles import strong_emitters

FMM = {"method": "fmm", "probes": 0}


def block(low, high):
    low, high = np.array(low), np.array(high)
    return shapes.room(high - low)[:, ::-1] + low


LAMP = shapes.quad([0.35, 0.35, 0.99], [0.35, 0.65, 0.99], [0.65, 0.65, 0.99], [0.65, 0.35, 0.99])
TWO_BLOCKS = np.concatenate(
    [shapes.room(), LAMP, block([0.15, 0.5, 1e-3], [0.45, 0.8, 0.6]), block([0.55, 0.2, 1e-3], [0.8, 0.45, 0.3])]
)
EMISSION = np.where((np.arange(len(TWO_BLOCKS)) // 2) == 6, 10.0, 0.0)
ALBEDO = np.where(np.arange(len(TWO_BLOCKS))[:, None] < 4, [0.7, 0.3, 0.2], [0.7, 0.7, 0.7])


def two_blocks(**options):
    scene = fmm_core.Scene(TWO_BLOCKS, ALBEDO, EMISSION)
    return fmm_core.solve(scene, fmm_core.Settings(particles=6000, **options))


@pytest.fixture(scope="module")
def points():
    return shapes.random_points(TWO_BLOCKS, 40)


@pytest.fixture(scope="module")
def exact(points):
    return two_blocks(method="direct", probes=0).irradiance(*points)


def error(found, exact):
    return np.linalg.norm(found - exact) / np.linalg.norm(exact)


def test_shadows_are_those_of_the_direct_method_within_one_percent(points, exact):
    solution = two_blocks(**FMM)
    found = solution.irradiance(*points)
    assert error(found, exact) < 0.01
    difference, size = np.linalg.norm(found - exact, axis=1), np.linalg.norm(exact, axis=1)
    assert np.mean(difference < 0.05 * size + 1e-3 * size.mean()) > 0.99
    assert solution.report["counts"]["rays"] < 400 * (len(points[0]) + len(solution.particles))


def test_error_falls_with_the_rays(points, exact):
    assert error(two_blocks(**FMM, rays=2000).irradiance(*points), exact) < 0.004


def test_measured_error_is_the_true_one(points, monkeypatch):
    # By all that are asked for, however short the bake.
    monkeypatch.setattr(accuracy, "SHARE", 1e6)
    # Not in the gaps under the blocks nor beside them, which are far narrower than any patch of the direct method.
    above = points[0][:, 2] > 0.05
    judged = points[0][above], points[1][above]
    solution = two_blocks(method="fmm", probes=1000, quadrature=1)
    true = error(solution.irradiance(*judged), two_blocks(method="direct", quadrature=1).irradiance(*judged))
    measured = solution.report["error"]
    assert measured["probes"] == 1000
    assert true / 1.5 < measured["measured_rms"] < 1.5 * true


def test_light_is_neither_lost_nor_made_on_the_whole(points, exact):
    found = two_blocks(**FMM).irradiance(*points)
    assert found.sum() == pytest.approx(exact.sum(), rel=3e-3)


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_convex_room_traces_no_ray(turn):
    c, s = np.cos(turn), np.sin(turn)
    room = shapes.room() @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
    solution = fmm_core.solve(fmm_core.Scene(room, 0.5, 1.0), fmm_core.Settings(particles=5000, **FMM))
    irradiance = solution.irradiance(*shapes.random_points(room, 20))
    assert irradiance == pytest.approx(np.full_like(irradiance, 2.0), rel=5e-3)
    assert solution.report["counts"]["rays"] == 0


def test_a_strong_lamp_does_not_hide_a_weak_one_in_another_room():
    rooms = np.concatenate([2 * shapes.room(), 2 * shapes.room() + [2.1, 0.0, 0.0]])
    blocks = np.concatenate([block([2.6, 0.5, 0.0], [3.0, 0.9, 0.5]), block([3.2, 1.2, 0.0], [3.5, 1.5, 0.9])])
    lamps = [LAMP / 3 * [1.0, 1.0, 0.0] + [x, 0.9, 1.9] for x in (0.9, 3.0)]
    triangles = np.concatenate([rooms, blocks, *lamps])
    emission = np.zeros(len(triangles))
    emission[-4:] = 1e4, 1e4, 2.0, 2.0
    scene = fmm_core.Scene(triangles, 0.5, emission)
    points = shapes.random_points(rooms[12:], 20)
    solutions = [
        fmm_core.solve(scene, fmm_core.Settings(particles=1500, method=m, probes=0)) for m in ("fmm", "direct")
    ]
    found, exact = (solution.irradiance(*points) for solution in solutions)
    assert error(found, exact) < 0.01


@pytest.mark.parametrize("below", [0.0, 1e-9, 5e-7])
@pytest.mark.parametrize("method", ["fmm", "direct"])
def test_a_lamp_in_the_plane_of_the_ceiling_gives_all_of_its_light(method, below):
    def lit(z):
        lamp = LAMP * [1.0, 1.0, 0.0] + [0.0, 0.0, z]
        triangles = np.concatenate([shapes.subdivided_room(4), lamp])
        scene = fmm_core.Scene(triangles, 0.5, np.where(np.arange(len(triangles)) < len(triangles) - 2, 0.0, 10.0))
        solution = fmm_core.solve(scene, fmm_core.Settings(particles=2000, method=method, probes=0))
        return solution.irradiance(*shapes.random_points(shapes.room()[:4], 40))

    assert error(lit(1.0 - below), lit(1.0 - 1e-4)) < 0.01


@pytest.mark.parametrize("off", [0.0, 5e-7])
@pytest.mark.parametrize("method", ["fmm", "direct"])
def test_a_faint_panel_in_the_plane_of_a_wall_gives_all_of_its_light(method, off):
    def lit(off):
        panel = shapes.quad([off, 0.05, 0.05], [off, 0.95, 0.05], [off, 0.95, 0.95], [off, 0.05, 0.95])
        # A lamp outside, beside which the panel is faint.
        parts = [shapes.subdivided_room(4), panel, LAMP + [3.0, 0.0, 0.0]]
        scene = fmm_core.Scene(np.concatenate(parts), 0.5, np.repeat([0.0, 1.0, 1e4], [len(part) for part in parts]))
        assert not strong_emitters(scene)[len(parts[0])]
        solution = fmm_core.solve(scene, fmm_core.Settings(particles=4000, method=method, probes=0))
        return solution.irradiance(*shapes.random_points(shapes.room()[2:], 40))

    assert error(lit(off), lit(1e-4)) < 0.01


@pytest.mark.parametrize("method", ["fmm", "direct"])
def test_relight_equals_a_fresh_solve_where_lamps_change_against_each_other(points, method):
    settings = fmm_core.Settings(particles=2000, method=method, probes=0)
    second = np.concatenate([TWO_BLOCKS, LAMP * 0.2 + [0.1, 0.1, 0.7]])
    lamp = np.arange(len(second)) // 2 == 6
    small = np.arange(len(second)) >= len(TWO_BLOCKS)
    before, after = 10.0 * lamp + 100.0 * small, 2.0 * lamp + 3000.0 * small
    first = fmm_core.solve(fmm_core.Scene(second, 0.6, before), settings)
    fresh = fmm_core.Scene(second, 0.6, after)
    assert first.serves(fresh)
    expected = fmm_core.solve(fresh, settings).irradiance(*points)
    assert error(first.relight(emission=after).irradiance(*points), expected) < 1e-3


@pytest.mark.parametrize("method", ["fmm", "direct"])
def test_relight_traces_no_ray_and_equals_a_fresh_solve(points, method):
    settings = fmm_core.Settings(particles=2000, method=method, probes=0)
    first = fmm_core.solve(fmm_core.Scene(TWO_BLOCKS, ALBEDO, EMISSION), settings)
    first.irradiance(*points)
    again = first.relight(emission=3.0 * EMISSION, albedo=0.5)
    fresh = fmm_core.solve(fmm_core.Scene(TWO_BLOCKS, 0.5, 3.0 * EMISSION), settings)
    assert again.irradiance(*points) == pytest.approx(fresh.irradiance(*points), rel=1e-3, abs=1e-9)
    assert again.report["counts"]["rays"] == 0
    assert first.report["counts"]["rays"] > 0


def test_light_that_is_only_brighter_is_not_exchanged_again(points):
    second = np.where(np.arange(len(TWO_BLOCKS)) // 2 == 2, 1.0, 0.0)
    scene = fmm_core.Scene(TWO_BLOCKS, ALBEDO, EMISSION + second)
    first, shot = (
        fmm_core.solve(scene, fmm_core.Settings(particles=2000, probes=0, iteration=iteration))
        for iteration in ("krylov", "shooting")
    )
    for factor in (3.0, np.array([1.0, 2.0, 0.5])):
        brighter = first.relight(emission=factor * scene.emission)
        assert brighter.report["residuals"] == []
        assert brighter.irradiance(*points) == pytest.approx(factor * first.irradiance(*points), rel=1e-12)
    # Other light: shooting always begins in the dark.
    for emission in (EMISSION + 1.001 * second, EMISSION + 1.5 * second, second, EMISSION[:, None] * [0.0, 1.0, 1.0]):
        relit, expected = first.relight(emission=emission), shot.relight(emission=emission)
        assert relit.irradiance(*points) == pytest.approx(expected.irradiance(*points), rel=2e-4, abs=1e-9)
        assert len(relit.report["residuals"]) > 3
    # The last of them has no red.
    assert relit.relight(emission=2.0 * emission).report["residuals"] == []
    assert len(relit.relight(emission=EMISSION).report["residuals"]) > 3


@pytest.mark.parametrize("moved", [0.25, 1.0])
def test_a_scene_that_has_moved_far_from_the_origin_is_solved_anew(moved):
    first = fmm_core.solve(fmm_core.Scene(TWO_BLOCKS + 1024.0, ALBEDO, EMISSION), fmm_core.Settings(particles=1000))
    assert first.serves(fmm_core.Scene(TWO_BLOCKS + 1024.0, ALBEDO, 2 * EMISSION))
    assert not first.serves(fmm_core.Scene(TWO_BLOCKS + 1024.0 + [moved, 0.0, 0.0], ALBEDO, EMISSION))


def test_relight_refuses_what_a_scene_refuses():
    solution = fmm_core.solve(fmm_core.Scene(shapes.room(), 0.5, 1.0), fmm_core.Settings(particles=100))
    with pytest.raises(fmm_core.Error, match="emission: expected shape"):
        solution.relight(emission=np.ones(5))
    with pytest.raises(fmm_core.Error, match="no emitter"):
        solution.relight(emission=0.0)
    assert "albedo 1.5 is clamped to 0.999" in solution.relight(albedo=1.5).report["warnings"]


def test_brighter_light_neither_hides_that_an_iteration_stopped_nor_comes_of_what_a_caller_changed():
    scene, brief = (
        fmm_core.Scene(TWO_BLOCKS, 0.95, EMISSION),
        fmm_core.Settings(particles=500, max_iterations=2, probes=0),
    )
    assert any(
        "iteration stopped" in text for text in fmm_core.solve(scene, brief).relight(2 * EMISSION).report["warnings"]
    )
    solution = fmm_core.solve(fmm_core.Scene(TWO_BLOCKS, ALBEDO, EMISSION), fmm_core.Settings(particles=500, probes=0))
    before = solution.radiosity.copy()
    solution.radiosity *= 2
    assert solution.relight(3 * EMISSION).radiosity == pytest.approx(3 * before, rel=1e-6)


def test_relight_says_where_a_new_solve_is_more_exact():
    scene = fmm_core.Scene(TWO_BLOCKS, ALBEDO, EMISSION)
    solution = fmm_core.solve(scene, fmm_core.Settings(particles=2000, **FMM))
    assert not solution.relight(emission=2.0 * EMISSION).report["warnings"]
    other = np.where(np.arange(len(TWO_BLOCKS)) == 20, 5.0, 0.0)
    assert "a new solve is more exact" in solution.relight(emission=other).report["warnings"][0]


def test_faces_that_coincide_and_look_away_from_each_other_both_count():
    box = block([0.3, 0.3, 0.3], [0.6, 0.6, 0.6])
    triangles = np.concatenate([shapes.room(), LAMP, box, box[:, ::-1]])
    scene = fmm_core.Scene(triangles, 0.7, np.where(np.arange(len(triangles)) // 2 == 6, 10.0, 0.0))
    points = shapes.random_points(np.concatenate([shapes.room(), box]), 30)
    direct = fmm_core.solve(scene, fmm_core.Settings(particles=4000, method="direct")).irradiance(*points)
    found = fmm_core.solve(scene, fmm_core.Settings(particles=4000, **FMM)).irradiance(*points)
    assert error(found, direct) < 0.015


@pytest.mark.parametrize("turned", [False, True])
def test_a_wall_that_is_a_wall_of_the_next_room_too_is_as_bright_as_alone(turned):
    axes = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0] if turned else np.eye(3)
    axes *= np.sign(np.linalg.det(axes))
    room, screen = (
        shapes.subdivided_room(3),
        shapes.quad([0.4, 0.4, 0.6], [0.4, 0.6, 0.6], [0.6, 0.6, 0.6], [0.6, 0.4, 0.6]),
    )
    lit = np.concatenate([room, LAMP, screen, screen[:, ::-1] - [0, 0, 0.01]])
    # The same walls seen from outside, cut otherwise.
    again = shapes.subdivided_room(4)[:, ::-1]
    points, normals = shapes.random_points(shapes.room(), 40)
    light = []
    for triangles in (lit, np.concatenate([lit, again])):
        emission = np.zeros(len(triangles))
        emission[len(room) : len(room) + 2] = 10.0
        scene = fmm_core.Scene(triangles @ axes, 0.7, emission)
        solution = fmm_core.solve(scene, fmm_core.Settings(particles=2000, **FMM))
        light.append(solution.irradiance(points @ axes, normals @ axes))
    assert error(light[1], light[0]) < 0.02


@pytest.mark.parametrize("away", [1e6, -3e5])
def test_shadows_stay_far_from_the_origin(points, away):
    far = np.array([away, 0.5 * away, away])
    here, there = (
        fmm_core.solve(fmm_core.Scene(TWO_BLOCKS + shift, ALBEDO, EMISSION), fmm_core.Settings(particles=3000, **FMM))
        for shift in (0.0, far)
    )
    assert there.report["counts"]["rays"] > 0
    assert np.abs(there.particles.positions - far - here.particles.positions).max() < 1e-6
    # Where a ray grazes an edge the rounding of the corners decides.
    assert error(there.irradiance(points[0] + far, points[1]), here.irradiance(*points)) < 3e-3


def test_rays_from_a_sliver_do_not_meet_it():
    rng = np.random.default_rng(0)
    for _ in range(100):
        a, b, aside = rng.uniform(-1, 1, (3, 3))
        sliver = np.array([a, b, (a + b) / 2 + 1e-6 * aside])
        occlusion = visibility.Occlusion(fmm_core.Scene(sliver[None], 0.5, 1.0))
        normal = np.cross(sliver[1] - sliver[0], sliver[2] - sliver[0])
        normals = np.array([normal, -normal]) / np.linalg.norm(normal)
        points = np.tile(sliver.mean(axis=0), (2, 1))
        assert occlusion.shares_met(points, normals, 64)[1].max() == 0


@pytest.mark.parametrize("opaque", [True, False])
def test_rays_meet_the_same_triangles_however_these_are_given_to_the_tracer(monkeypatch, opaque):
    opacity = 1.0 if opaque else fmm_core.Opacity(np.full(len(TWO_BLOCKS), 0.5))
    scene = fmm_core.Scene(TWO_BLOCKS, ALBEDO, EMISSION, opacity=opacity)
    rng = np.random.default_rng(0)
    points = rng.choice(scene.triangles.mean(axis=1), 500)
    directions = rng.normal(size=(500, 3))
    whole = visibility.Occlusion(scene)._met(points.astype(np.float32), directions.astype(np.float32))
    monkeypatch.setattr(visibility, "PIECE", 3)
    pieces = visibility.Occlusion(scene)._met(points.astype(np.float32), directions.astype(np.float32))
    assert len(np.unique(whole[0])) > 10
    assert all((a == b).all() for a, b in zip(whole, pieces, strict=True))


@pytest.mark.parametrize("quadrature", [1, 2])
def test_a_lamp_that_the_horizon_cuts_leaves_no_specks(quadrature):
    # The plane of a wall of the block goes through the lamp high above it.
    lamp = shapes.quad([0.38, 0.6, 0.985], [0.62, 0.6, 0.985], [0.62, 0.41, 0.985], [0.38, 0.41, 0.985])
    triangles = np.concatenate([shapes.room(), block([0.35, 0.52, 0.0], [0.65, 0.82, 0.3]), lamp])
    scene = fmm_core.Scene(triangles, 0.5, np.where(np.arange(len(triangles)) < len(triangles) - 2, 0.0, 40.0))
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0.351, 0.649, 3000), np.full(3000, 0.52), rng.uniform(0.01, 0.29, 3000)])
    normals = np.tile([0.0, -1.0, 0.0], (3000, 1))

    def received(**options):
        return fmm_core.solve(scene, fmm_core.Settings(probes=0, **options)).irradiance(points, normals)[:, 0]

    exact = received(particles=4000, method="direct")
    found = received(particles=3000, rays=200, method="fmm", quadrature=quadrature)
    assert np.abs(found - exact).max() < 0.08 * exact.mean()


def test_a_scene_of_another_embreex_is_built_by_its_first_ray(monkeypatch):
    assert version("embreex") == visibility.KNOWN_EMBREEX
    rays = np.full((1, 3), 0.5, np.float32), np.array([[0.0, 0.0, -1.0]], np.float32)
    room = shapes.subdivided_room(20).astype(np.float32)
    built = visibility._Tracer(room).run(*rays)
    monkeypatch.setattr(visibility, "KNOWN_EMBREEX", "another")
    assert visibility._Tracer(room).run(*rays) == built
    assert built >= 0


@pytest.mark.parametrize("quadrature", [2, 5])
def test_close_patches_that_a_horizon_cuts_are_seen_as_far_as_they_are_in_front(quadrature):
    floor = shapes.quad([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0])
    corner, across = np.array([0.5, 0.3, 0.03]), np.array([0, 0.4, 0])
    tilt = 0.3 * np.array([np.cos(0.35), 0, np.sin(0.35)])
    plate = shapes.quad(corner, corner + across, corner + across + tilt, corner + tilt)
    scene = fmm_core.Scene(np.concatenate([floor, plate]), 0.0, [1.0, 1.0, 0.0, 0.0])
    points = shapes.random_points(plate, 500)

    def received(occlusion):
        effects = {"occlusion": occlusion}
        options = fmm_core.Settings(method="direct", particles=60, quadrature=quadrature, effects=effects)
        return fmm_core.solve(scene, options).irradiance(*points)

    # Nothing is in the way.
    assert received(True) == pytest.approx(received(False), rel=1e-9)


@pytest.mark.parametrize("quadrature", [1, 2])
def test_penumbrae_of_a_bright_wall_are_finer_than_its_patches(quadrature):
    floor = shapes.quad([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0])
    wall = shapes.quad([0, 1, 0], [1, 1, 0], [1, 1, 1], [0, 1, 1])
    posts = [shapes.quad([x, 0.8, 0], [x + 0.04, 0.8, 0], [x + 0.04, 0.8, 1], [x, 0.8, 1]) for x in (0.2, 0.45, 0.7)]
    scene = fmm_core.Scene(np.concatenate([floor, wall, *posts]), 0.0, np.repeat([0.0, 1.0, 0.0], [2, 2, 6]), True)
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(0.05, 0.95, 40), np.linspace(0.1, 0.7, 20)))
    points = np.stack([x, y, 0 * x], axis=1), np.tile([0.0, 0.0, 1.0], (800, 1))
    coarse = fmm_core.Settings(particles=400, method="fmm", quadrature=quadrature, probes=0)
    solution = fmm_core.solve(scene, coarse)
    found, exact = solution.irradiance(*points), solution.estimates(*points, 2048, 1000).mean(axis=0)
    # Of patches that are seen or not by their middles it is 0.07 and 0.05.
    assert np.linalg.norm(found - exact) < 0.03 * np.linalg.norm(exact)
