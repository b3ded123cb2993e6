# SPDX-License-Identifier: GPL-3.0-or-later
"""A medium that absorbs light on its way, against closed forms and against the direct method."""

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import AreaLight, PointLight, Sky, SunLight, Volume, reference
from fmm_core.effects import plan
from test_accuracy import reference_of
from test_visibility import ALBEDO, EMISSION, TWO_BLOCKS

MEDIUM = np.array([0.0, 0.5, 2.0])
METHODS = ["direct", "fmm"]


def solve(triangles, albedo, emission=0.0, method="direct", particles=1000, rays=None, probes=0, **scene):
    whole = fmm_core.Scene(triangles, albedo, emission, **{"medium": MEDIUM, **scene})
    return fmm_core.solve(whole, fmm_core.Settings(method=method, particles=particles, rays=rays, probes=probes))


@pytest.mark.parametrize("method", METHODS)
def test_small_patches_far_apart_lose_what_their_distance_takes(method):
    near = 0.02 * (shapes.quad([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]) - [0.5, 0.5, 0])
    triangles = np.concatenate([near, near[:, ::-1] + [0.3, 0.0, 1.2]])
    emission, points = np.array([0, 0, 1.0, 1.0]), (np.zeros((1, 3)), [[0, 0, 1.0]])
    found, clear = (
        solve(triangles, 0.0, emission, method, particles=64, medium=medium).irradiance(*points)
        for medium in (MEDIUM, 0.0)
    )
    assert found == pytest.approx(clear * np.exp(-MEDIUM * np.hypot(0.3, 1.2)), rel=1e-3)
    assert clear[0, 0] > 0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("albedo", [0.0, 0.8])
def test_inside_a_sphere_that_glows(method, albedo):
    """Each point receives 2 (1 - (1 + t) exp(-t)) / t^2 of the radiosity, with t the absorption along a diameter."""
    sphere = shapes.sphere(1.0, 4, inward=True)
    solution = solve(sphere, albedo, 1.0, method, rays=400)
    # Triangles cut the sphere short: by the mean chord of a convex body, 4 volumes over its surface.
    a, b, c = sphere.transpose(1, 0, 2)
    volume, area = (a * np.cross(b, c)).sum() / -6, np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    t = 6 * volume / area * MEDIUM[1:]
    received = np.append(1.0, 2 * (1 - (1 + t) * np.exp(-t)) / t**2)
    found = solution.irradiance(*shapes.random_points(sphere, 1)).mean(axis=0)
    assert found == pytest.approx(received / (1 - albedo * received), rel=0.01)


@pytest.mark.parametrize(
    "lamp", [PointLight((0.2, 0.1, 2.0), 5.0), AreaLight((0, 0, 2), (0.75, 0, 0), (0, -0.25, 0), 5.0)]
)
def test_lamps_lose_what_the_way_to_each_of_their_points_takes(lamp):
    floor = shapes.quad([-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0])
    points = np.array([[0.7, -0.4, 0.0], [0, 0, 0]]), np.tile([0, 0, 1.0], (2, 1))
    found, clear = (solve(floor, 0.5, lights=[lamp], medium=medium).irradiance(*points) for medium in (MEDIUM, 0.0))
    if isinstance(lamp, PointLight):
        distances = np.linalg.norm(points[0] - lamp.position, axis=1)
        assert found == pytest.approx(clear * np.exp(-np.outer(distances, MEDIUM)), rel=1e-6)
        return
    ends = np.stack(np.meshgrid(np.linspace(-0.75, 0.75, 301), np.linspace(-0.25, 0.25, 101), [2.0]), -1).reshape(-1, 3)
    between = ends - points[0][:, None]
    squared = (between**2).sum(axis=2)
    weights = between[..., 2] ** 2 / squared**2
    left = np.exp(-np.sqrt(squared)[..., None] * MEDIUM)
    share = (weights[..., None] * left).sum(axis=1) / weights.sum(axis=1)[:, None]
    assert found == pytest.approx(clear * share, rel=0.01)


def test_nothing_comes_from_infinitely_far_away():
    floor = shapes.quad([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0])
    points = np.full((1, 3), 0.5) * [1, 1, 0], [[0, 0, 1.0]]
    solution = solve(floor, 0.5, sky=Sky(1.0), lights=[SunLight((0, 0, -1), 1.0)])
    found = solution.irradiance(*points)
    assert (found[:, 1:] == 0).all()
    assert found[0, 0] == pytest.approx(np.pi + 1, rel=1e-3)
    dark = solve(floor, 0.5, 1.0, sky=Sky(1.0), lights=[SunLight((0, 0, -1), 1.0)], medium=0.1)
    assert dark.irradiance(*points).max() == 0
    effects = dark.report["effects"]
    assert not effects["sky"]["used"]
    assert not effects["lamps"]["used"]


@pytest.fixture(scope="module")
def points():
    """Not in the gaps under the blocks, which are far narrower than any patch of the direct method."""
    places, normals = shapes.random_points(TWO_BLOCKS, 20)
    above = places[:, 2] > 0.05
    return places[above], normals[above]


def test_shadows_and_bounces_are_those_of_the_direct_method(points):
    exact, found = (
        solve(TWO_BLOCKS, ALBEDO, EMISSION, method, particles=4000).irradiance(*points) for method in METHODS
    )
    assert np.linalg.norm(found - exact) < 0.015 * np.linalg.norm(exact)


def test_measured_error_knows_the_medium(points):
    solution = solve(TWO_BLOCKS, ALBEDO, EMISSION, "fmm", particles=4000, probes=200)
    solution.irradiance(*points)
    assert solution.report["error"]["measured_rms"] < 0.03
    clear = solve(TWO_BLOCKS, ALBEDO, EMISSION, "fmm", particles=4000, medium=0.0).irradiance(*points)
    assert np.abs(solution.irradiance(*points) - clear).max() > 0.3 * clear.mean()


@pytest.mark.parametrize("places", [1, 3])
def test_light_that_a_judge_follows_further_loses_what_all_ways_take(places, monkeypatch):
    """What the surfaces lack is what they reflect, once as it is told, and once as rays go on to find it."""
    room, albedo = shapes.subdivided_room(4), 0.6
    scene = fmm_core.Scene(room, albedo, 1.0, medium=MEDIUM)
    solution = fmm_core.solve(scene, fmm_core.Settings(method="direct", particles=len(room), probes=0))
    monkeypatch.setattr(reference, "NEAR", np.inf)
    monkeypatch.setattr(reference, "PLACES", 0)
    judge, particles = reference_of(solution), solution.particles
    shining, nothing = np.ones((len(particles), 3)), np.zeros((len(particles), 3))
    reflected, last = nothing, shining
    for _ in range(places):
        counts = np.full(len(particles), 256)
        (last, _), _ = judge.irradiance(particles.positions, particles.normals, last, nothing, nothing, counts, 0)
        last = albedo * last
        reflected = reflected + last
    at = np.full((1, 3), 0.5) * [1, 1, 0], np.array([[0, 0, 1.0]])
    (_, told), _ = judge.irradiance(*at, shining, reflected, nothing, np.array([20_000]), 1)
    monkeypatch.setattr(reference, "PLACES", places)
    (_, found), _ = judge.irradiance(*at, shining, nothing, nothing, np.array([20_000]), 2)
    assert found == pytest.approx(told, rel=0.02)


def test_the_plan_says_what_light_does_not_get_through():
    sun, floor = SunLight((0, 0, -1), 1.0), TWO_BLOCKS[:2]
    effects = plan(fmm_core.Scene(floor, 0.5, 1.0, sky=Sky(1.0), lights=[sun], medium=0.1), fmm_core.Settings())
    assert not effects["sky"].used
    assert effects["sky"].why == "no light of the sky gets through the medium"
    assert not effects["lamps"].used
    assert effects["lamps"].why.startswith("no lamp's light gets through the medium")
    left = plan(fmm_core.Scene(floor, 0.5, 1.0, sky=Sky(1.0), lights=[sun], medium=[0, 0.1, 0.1]), fmm_core.Settings())
    assert left["sky"].used
    assert left["lamps"].used


def test_the_plan_says_what_it_takes_and_can_be_overruled():
    scene = fmm_core.Scene(TWO_BLOCKS, 0.5, EMISSION, medium=[0.0, 0.0, np.log(2) / 3])
    assert plan(scene, fmm_core.Settings())["medium"].why == "a medium takes half of the light on 3 m"
    points = shapes.random_points(TWO_BLOCKS, 1)
    settings = fmm_core.Settings(particles=500, probes=0, effects={"medium": False})
    without = fmm_core.solve(scene, settings)
    clear = fmm_core.solve(fmm_core.Scene(TWO_BLOCKS, 0.5, EMISSION), fmm_core.Settings(particles=500, probes=0))
    assert without.irradiance(*points) == pytest.approx(clear.irradiance(*points), rel=1e-9)
    assert not without.report["effects"]["medium"]["used"]
    assert not without.serves(fmm_core.Scene(TWO_BLOCKS, 0.5, EMISSION))


@pytest.mark.parametrize(
    ("medium", "why"), [(-0.1, "absorbs -0.1 per metre"), (np.nan, "absorbs nan"), ([1, 2], r"got \(2,\)")]
)
def test_what_is_no_medium_is_refused(medium, why):
    with pytest.raises(fmm_core.Error, match=why):
        fmm_core.Scene(TWO_BLOCKS, 0.5, EMISSION, medium=medium)


def test_cells_are_refused():
    scene = fmm_core.Scene(TWO_BLOCKS, 0.5, EMISSION, medium=0.1)
    with pytest.raises(fmm_core.Error, match="'cells' cannot be used where something absorbs"):
        fmm_core.solve(scene, fmm_core.Settings(method="fmm", visibility="cells"))


def cuboid(low, high):
    """A closed box seen from outside."""
    return shapes.room()[:, ::-1] * (np.array(high) - low) + low


def test_a_mesh_around_everything_is_a_world_full_of_it():
    points = shapes.random_points(TWO_BLOCKS, 4)
    around = [Volume(cuboid([-1.0, -1, -1], [2.0, 2, 2]), MEDIUM)]
    for method in METHODS:
        inside, world = (
            solve(TWO_BLOCKS, ALBEDO, EMISSION, method, particles=800, **absorbing).irradiance(*points)
            for absorbing in ({"medium": 0.0, "volumes": around}, {"medium": MEDIUM})
        )
        assert inside == pytest.approx(world, rel=1e-6, abs=1e-9)


FLOOR = shapes.quad([-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0])
#: A plate of 0.3 m above the floor, that ends at x = 0.5.
PLATE = Volume(cuboid([-90.0, -90, 0.4], [0.5, 90, 0.7]), MEDIUM)


@pytest.mark.parametrize("lamp", [PointLight((0.2, 0.1, 2.0), 5.0), SunLight((0.3, 0.2, -1.0), 1.0)])
def test_only_the_part_of_a_way_that_is_inside_counts(lamp):
    points = np.array([[-0.7, -0.4, 0.0], [0, 0, 0], [0.95, 0.9, 0.0]]), np.tile([0, 0, 1.0], (3, 1))
    found, clear = (
        solve(FLOOR, 0.5, lights=[lamp], medium=0.0, volumes=volumes).irradiance(*points) for volumes in ([PLATE], [])
    )
    ways = -np.array(lamp.direction) if isinstance(lamp, SunLight) else lamp.position - points[0]
    inside = np.broadcast_to(0.3 * np.linalg.norm(ways, axis=-1) / ways[..., 2], 3) * [1, 1, 0]
    assert found == pytest.approx(clear * np.exp(-np.outer(inside, MEDIUM)), rel=1e-6)


def test_the_sky_above_a_plate_is_an_exponential_integral():
    """2 E3(t) of its light is left (Siegel and Howell, Thermal Radiation Heat Transfer, appendix D)."""
    wide = Volume(cuboid([-900.0, -900, 0.4], [900, 900, 0.7]), MEDIUM)
    solution = solve(FLOOR, 0.5, sky=Sky(1.0), rays=500, medium=0.0, volumes=[wide])
    found = solution.irradiance([[0, 0, 0.0]], [[0, 0, 1.0]])
    mu = (np.arange(100_000) + 0.5) / 100_000
    left = [2 * np.mean(mu * np.exp(-0.3 * sigma / mu)) for sigma in MEDIUM]
    assert found[0] == pytest.approx(np.pi * np.array(left), rel=3e-3)


@pytest.mark.parametrize("method", METHODS)
def test_light_between_surfaces_loses_what_is_taken_inside(method):
    near = 0.02 * (shapes.quad([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]) - [0.5, 0.5, 0])
    triangles = np.concatenate([near, near[:, ::-1] + [0.3, 0.0, 1.2]])
    found, clear = (
        solve(triangles, 0.0, [0, 0, 1.0, 1.0], method, particles=64, medium=0.0, volumes=volumes).irradiance(
            np.zeros((1, 3)), [[0, 0, 1.0]]
        )
        for volumes in ([PLATE], [])
    )
    assert found == pytest.approx(clear * np.exp(-MEDIUM * 0.3 * np.hypot(0.3, 1.2) / 1.2), rel=1e-3)


def test_bounces_through_a_mesh_are_those_of_the_direct_method(points):
    ball, slab = 0.25 * shapes.sphere(1.0, 1) + [0.5, 0.5, 0.75], cuboid([0.0] * 3, [0.2, 1, 1])
    volumes, some = [Volume(ball, 4.0), Volume(slab, 1.0)], [rows[::3] for rows in points]
    exact, found, clear = (
        solve(TWO_BLOCKS, ALBEDO, EMISSION, method, particles=1000, medium=0.0, volumes=inside).irradiance(*some)
        for method, inside in (("direct", volumes), ("fmm", volumes), ("fmm", []))
    )
    assert np.linalg.norm(found - exact) < 0.02 * np.linalg.norm(exact)
    assert np.linalg.norm(clear - exact) > 0.3 * np.linalg.norm(exact)


def test_light_that_passes_no_mesh_is_still_expanded():
    room, emission = shapes.room(), np.where(np.arange(12) < 2, 1.0, 0.0)
    points = shapes.random_points(room, 4)
    corner, all_of_it = Volume(cuboid([0.0] * 3, [0.05] * 3), 1.0), Volume(cuboid([-1.0] * 3, [2.0] * 3), 1.0)
    few, many, none = (
        solve(room, 0.5, emission, "fmm", particles=6000, medium=0.0, volumes=volumes)
        for volumes in ([corner], [all_of_it], [])
    )
    assert few.irradiance(*points) == pytest.approx(none.irradiance(*points), rel=0.03)
    assert few.report["postponement"] < 0.3
    assert many.report["counts"]["pairs_valid"] == 0
    assert few.report["counts"]["rays"] < many.report["counts"]["rays"]


def test_a_solution_serves_the_same_meshes_only():
    scene = fmm_core.Scene(FLOOR, 0.5, sky=Sky(1.0), volumes=[PLATE])
    solution = fmm_core.solve(scene, fmm_core.Settings(particles=64, probes=0))
    assert solution.serves(fmm_core.Scene(FLOOR, 0.4, sky=Sky(2.0), volumes=[PLATE]))
    assert not solution.serves(fmm_core.Scene(FLOOR, 0.5, sky=Sky(1.0), volumes=[PLATE.moved(0.1)]))
    assert not solution.serves(fmm_core.Scene(FLOOR, 0.5, sky=Sky(1.0)))
    assert solution.report["effects"]["medium"]["why"] == "light is absorbed inside 1 mesh"
    nothing = fmm_core.Scene(FLOOR, 0.5, sky=Sky(1.0), volumes=[Volume(PLATE.triangles, 0.0)])
    assert not plan(nothing, solution.settings)["medium"].used


@pytest.mark.parametrize(
    ("triangles", "absorption", "why"),
    [
        (PLATE.triangles[:, ::-1], 1.0, "closed mesh seen from outside"),
        (np.full((4, 3, 3), np.nan), 1.0, "finite triangles"),
        (np.zeros((4, 3)), 1.0, "expected finite triangles of shape"),
        (PLATE.triangles, -1.0, "absorbs -1 per metre"),
    ],
)
def test_what_is_no_volume_is_refused(triangles, absorption, why):
    with pytest.raises(fmm_core.Error, match=why):
        Volume(triangles, absorption)
