# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps and sky: closed forms, energy, shadows, relighting without rays, and bad input."""

from dataclasses import replace

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import AreaLight, PointLight, Sky, SpotLight, SunLight
from test_spots import window_room
from test_visibility import block

FLOOR = shapes.quad([-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0])
BLOCK = np.concatenate([FLOOR, block([-0.2, -0.2, 0.2], [0.2, 0.2, 0.6])])
DOWN, UP = (0.0, 0.0, -1.0), [0.0, 0.0, 1.0]
FEW = fmm_core.Settings(particles=200, probes=0)
AT = np.array([[0.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.9, -0.3, 0.0], [-0.7, 0.1, 0.0]])
STRETCH = np.array([[2.0, 0.3, 0], [0, 0.8, 0], [0, 0.1, 0.7]])
#: One of each kind, above the floor.
LAMPS = [
    PointLight((0.1, 0, 2), 3.0),
    PointLight((0.1, 0, 2), 3.0, radius=0.3),
    PointLight((0.1, 0, 2), 3.0, radius=0.3, disc=True),
    SunLight((0.3, 0.2, -1), 2.0),
    SunLight((0.3, 0.2, -1), 2.0, angle=0.2),
    SpotLight((0.1, 0, 2), 3.0, radius=0.1, direction=(0.1, 0, -1), angle=0.8, blend=0.5),
    AreaLight((0.1, 0, 2), (0.4, 0, 0), (0, -0.3, 0), 2.0),
    AreaLight((0.1, 0, 2), (0.4, 0, 0), (0, -0.3, 0), 2.0, ellipse=True),
    AreaLight((0.1, 0, 2), (0.4, 0, 0), (0, -0.3, 0), 2.0, spread=0.8),
    AreaLight((0.1, 0, 2), (0.4, 0, 0), (0, -0.3, 0), 2.0, ellipse=True, spread=0.8),
    SpotLight((0.1, 0, 2), 3.0, radius=0.1, direction=(0.1, 0, -1), angle=0.8, blend=0.5, stretch=STRETCH),
]


def name(lamp):
    return f"{type(lamp).__name__}-{LAMPS.index(lamp)}"


def solve(triangles, albedo=0.0, settings=FEW, **light):
    return fmm_core.solve(fmm_core.Scene(triangles, albedo, **light), settings)


def lit(triangles, points=AT, normals=UP, settings=FEW, **light):
    """Irradiance of the first colour by light that nothing reflects."""
    solution = solve(triangles, settings=settings, **light)
    return solution.irradiance(points, np.broadcast_to(normals, np.shape(points)))[:, 0]


def brute(lamp, point, count=400_000):
    """Irradiance on a point of the floor from random points of a lamp, summed plainly by the lamp's definition."""
    rng = np.random.default_rng(0)
    if isinstance(lamp, AreaLight):
        a, b = rng.uniform(-1, 1, (2, count))
        y = np.asarray(lamp.position) + a[:, None] * lamp.u + b[:, None] * np.asarray(lamp.v)
        normal = np.cross(lamp.u, lamp.v)
        area, normal = 4 * np.linalg.norm(normal), normal / np.linalg.norm(normal)
        to = y - point
        distance = np.linalg.norm(to, axis=1)
        leaving = -(to @ normal) / distance
        kept = np.where(a**2 + b**2 <= 1, 1.0, 0.0) if lamp.ellipse else np.ones(count)
        if lamp.spread < np.pi:
            half = lamp.spread / 2
            kept *= np.maximum(np.tan(half) - np.tan(np.arccos(leaving)), 0) / (np.tan(half) - half)
        return lamp.radiance[0] * area * (kept * leaving * to[:, 2] / distance**3).mean()
    # A ball of even radiance, seen by those of its points that face the receiver.
    n = rng.normal(size=(count, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    to = np.asarray(lamp.position) + lamp.radius * n - point
    distance = np.linalg.norm(to, axis=1)
    facing = np.maximum(-(to * n).sum(axis=1) / distance, 0)
    kept = np.ones(count)
    if isinstance(lamp, SpotLight):
        edge = np.cos(lamp.angle / 2)
        # Where the cone is round, with its axis.
        axis, ray = np.linalg.solve(lamp.stretch, lamp.direction), np.linalg.solve(lamp.stretch, -to.T).T
        cosine = ray @ axis / np.linalg.norm(ray, axis=1) / np.linalg.norm(axis)
        t = np.clip((cosine - edge) / ((1 - edge) * lamp.blend), 0, 1)
        kept = t * t * (3 - 2 * t)
    radiance = lamp.intensity[0] / (np.pi * lamp.radius**2)
    return radiance * 4 * np.pi * lamp.radius**2 * (kept * facing * to[:, 2] / distance**3).mean()


def test_point_and_sun_over_a_plane():
    distance = np.linalg.norm(AT - [0.1, 0, 2], axis=1)
    assert lit(FLOOR, lights=[LAMPS[0]]) == pytest.approx(3.0 * 2.0 / distance**3, rel=1e-6)
    # A ball of even radiance lights like a point, a disc that faces the receiver a little less.
    assert lit(FLOOR, lights=[LAMPS[1]]) == pytest.approx(3.0 * 2.0 / distance**3, rel=1e-6)
    facing = 3.0 * 2.0 / distance / (distance**2 + 0.3**2)
    assert lit(FLOOR, lights=[LAMPS[2]]) == pytest.approx(facing, rel=1e-6)
    for sun in LAMPS[3:5]:
        assert lit(FLOOR, lights=[sun]) == pytest.approx(2.0 / np.sqrt(1.13), rel=1e-6)


@pytest.mark.parametrize("lamp", [LAMPS[1], *LAMPS[5:]], ids=name)
def test_sized_lamps_over_a_plane(lamp):
    expected = [brute(lamp, point) for point in AT]
    fine = fmm_core.Settings(particles=200, rays=2000)
    assert lit(FLOOR, settings=fine, lights=[lamp]) == pytest.approx(expected, rel=5e-3, abs=1e-3 * max(expected))


def test_square_lamp_has_its_form_factor():
    # From the middle of a square of side 2 at distance 1, Howell's catalogue of configuration factors, B-4.
    factor = 4 * 2 / (2 * np.pi) * (1 / np.sqrt(2)) * np.arctan(1 / np.sqrt(2))
    lamp = AreaLight((0, 0, 1), (1, 0, 0), (0, -1, 0), 1.0)
    assert lit(FLOOR, AT[:1], lights=[lamp]) == pytest.approx([np.pi * factor], rel=1e-6)
    disc = AreaLight((0, 0, 1), (1, 0, 0), (0, -1, 0), 1.0, ellipse=True)
    assert lit(FLOOR, AT[:1], lights=[disc]) == pytest.approx([np.pi / 2], rel=2e-3)
    assert lit(FLOOR, [[0, 0, 2]], DOWN, lights=[lamp]) == pytest.approx([0.0])


def test_half_of_a_lamp_below_the_horizon():
    # A cap of half angle s that the horizon halves gives s - sin s cos s times its radiance.
    lamp = PointLight((0, 0, 2), np.pi * 0.25, radius=0.5)
    half = np.arcsin(0.25)
    wall = lit(FLOOR, [[0, 0, 0]], [1.0, 0, 0], lights=[lamp])
    assert wall == pytest.approx([half - np.sin(half) * np.cos(half)], rel=1e-5)


@pytest.mark.parametrize("lamp", LAMPS, ids=name)
@pytest.mark.parametrize("method", ["direct", "fmm"])
def test_a_block_shades_what_lies_under_it_and_nothing_else(lamp, method):
    settings = fmm_core.Settings(particles=200, method=method)
    open_floor, shaded = (lit(triangles, settings=settings, lights=[lamp]) for triangles in (FLOOR, BLOCK))
    expected = np.where(np.arange(4) == 0, 0.0, open_floor)
    assert shaded == pytest.approx(expected, rel=1e-6, abs=1e-9)
    through = fmm_core.solve(fmm_core.Scene(BLOCK, 0.0, lights=[replace(lamp, shadows=False)]), settings).irradiance(
        AT, np.tile(UP, (4, 1))
    )
    assert through[:, 0] == pytest.approx(open_floor, rel=1e-6)


@pytest.mark.parametrize("lamp", [LAMPS[2], LAMPS[4], LAMPS[6], LAMPS[9]], ids=name)
def test_penumbra_converges_to_what_points_of_the_lamp_see(lamp):
    # The edge of a screen lies above y = 0.
    screen = shapes.quad([-5, 0, 1], [5, 0, 1], [5, 5, 1], [-5, 5, 1])
    triangles = np.concatenate([FLOOR, screen])
    x = np.column_stack([np.zeros(40), np.linspace(-1, 1, 40), np.zeros(40)])
    fine, default = (
        lit(triangles, x, settings=fmm_core.Settings(particles=50, rays=rays), lights=[lamp]) for rays in (20_000, 200)
    )
    partly = (fine > 0.05 * fine.max()) & (fine < 0.95 * fine.max())
    assert partly.sum() > 3
    assert np.linalg.norm(default - fine) < 0.01 * np.linalg.norm(fine)


def test_even_sky_over_a_plane_and_half_of_it_behind_a_wall():
    assert lit(FLOOR, sky=Sky(2.0)) == pytest.approx(2 * np.pi, rel=1e-12)
    wall = shapes.quad([0, -1e4, 0], [0, 1e4, 0], [0, 1e4, 1e4], [0, -1e4, 1e4])
    points = [[-1.0, 0, 0], [-0.01, 0, 0]]
    assert lit(np.concatenate([FLOOR, wall]), points, sky=Sky(2.0)) == pytest.approx(np.pi, rel=0.01)


def directions(rows, columns):
    """(rows, columns, 3) in which the pixels of an image of the sky lie, and their solid angles (rows, columns)."""
    theta = np.pi * (np.arange(rows) + 0.5)[:, None] / rows
    phi = np.pi - 2 * np.pi * (np.arange(columns) + 0.5) / columns
    parts = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
    solid = 2 * np.pi / columns * np.sin(theta) * np.pi / rows
    return np.stack(np.broadcast_arrays(*parts), axis=2), np.broadcast_to(solid, (rows, columns))


@pytest.mark.parametrize("size", [(4, 8), (40, 80), (300, 600)])
def test_image_of_the_sky_brings_its_light_from_the_right_side(size):
    rows, columns = size
    # Light from +y and a sun of one pixel, on surfaces that look to all sides; a floor far below hides little.
    towards, solid = directions(rows, columns)
    image = np.repeat(np.maximum(towards[..., 1:2], 0.0), 3, axis=2)
    sun = rows // 4, columns // 8
    image[sun] += [30.0 / solid[sun], 10.0 / solid[sun], 0.0]
    fine = max(1, 300 // rows)
    towards, solid = directions(fine * rows, fine * columns)
    normals = np.concatenate([np.eye(3), -np.eye(3)[:2]])
    cosines = np.maximum(np.einsum("nx,rcx->nrc", normals, towards), 0)
    expected = np.einsum("nrc,rc,rck->nk", cosines, solid, image.repeat(fine, 0).repeat(fine, 1))
    solution = solve(FLOOR - [0, 0, 20], sky=Sky(image), settings=fmm_core.Settings(particles=20, rays=400))
    found = solution.irradiance(np.zeros((5, 3)), normals)
    assert found == pytest.approx(expected, rel=0.02, abs=0.003 * expected.max())


@pytest.mark.parametrize("lamp", LAMPS, ids=name)
def test_a_lamp_in_a_convex_room_traces_no_ray(lamp):
    room = shapes.room((4, 4, 3)) - [2, 2, 0]
    if isinstance(lamp, SunLight):
        room = room[:2]
    settings = fmm_core.Settings(particles=600, method="fmm", probes=0)
    solution = solve(room, 0.5, settings, lights=[lamp])
    solution.irradiance(*shapes.random_points(room, 5))
    assert solution.report["counts"]["rays"] == 0


def test_a_lamp_outside_of_a_convex_room_is_shut_out():
    room = shapes.room((4, 4, 3)) - [2, 2, 0]
    for lamp in (PointLight((0, 0, 5), 1.0), SunLight(DOWN, 1.0), AreaLight((0, 0, 5), (1, 0, 0), (0, -1, 0), 1.0)):
        assert solve(room, 0.5, lights=[lamp]).irradiance(*shapes.random_points(room, 2)).max() == 0.0
    assert solve(room, 0.5, sky=Sky(1.0)).irradiance(*shapes.random_points(room, 2)).max() == 0.0


@pytest.mark.parametrize("gap", [0.0, 1e-5])
def test_a_lamp_in_the_plane_of_a_ceiling_shines_far_and_along_it(gap):
    wide = np.concatenate([shapes.room() * [10, 10, 1], 0.05 * shapes.sphere(1.0, 1) + [9.7, 0.3, 0.2]])
    lamp = AreaLight((2.0, 5.0, 1.0 - gap), (0.5, 0, 0), (0, -0.5, 0), 5.0)
    floor, wall = [[x, 5.0, 0.0] for x in (2, 3, 4, 5, 7, 9.9)], [[10.0, 5.0, z] for z in (0.1, 0.9, 0.99, 0.999)]
    points, normals = np.array(floor + wall), np.repeat([[0, 0, 1.0], [-1.0, 0, 0]], [6, 4], axis=0)
    scene = fmm_core.Scene(wide, 0.0, lights=[lamp])
    solution = fmm_core.solve(scene, fmm_core.Settings(probes=0, particles=100))
    assert solution.report["effects"]["occlusion"]["used"]
    expected = lamp.unshadowed(points, normals)[:, None] * lamp.colour
    assert solution.irradiance(points, normals) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("method", ["direct", "fmm"])
@pytest.mark.parametrize("lamp", [LAMPS[0], LAMPS[2], LAMPS[7]], ids=name)
def test_no_light_is_lost_or_made_in_a_closed_room(lamp, method):
    room = shapes.room((4, 4, 3)) - [2, 2, 0]
    power = {LAMPS[0]: 4 * np.pi * 3, LAMPS[2]: None, LAMPS[7]: np.pi * 2.0 * np.pi * 0.4 * 0.3}[lamp]
    solution = solve(room, 0.5, fmm_core.Settings(particles=4000, method=method), lights=[lamp])
    particles = solution.particles
    # What leaves a surface of albedo 0.5 is what it absorbs.
    absorbed = (particles.weights * solution.radiosity[:, 0]).sum()
    if power is None:
        assert absorbed < 4 * np.pi * 3
    else:
        assert absorbed == pytest.approx(power, rel=5e-3)


def test_nothing_of_a_black_picture_stands_out():
    assert Sky(np.zeros((8, 16, 3))).bright is None


def test_furnace_under_an_even_sky_is_a_furnace():
    # A lid that is replaced by sky of the same radiosity changes nothing.
    room = shapes.room()
    lid = shapes.normals(room)[:, 2] < -0.9
    open_box = room[~lid]
    closed = solve(room, 0.5, emission=1.0)
    opened = solve(open_box, 0.5, fmm_core.Settings(particles=1000, rays=1000), emission=1.0, sky=Sky(2 / np.pi))
    points = shapes.random_points(open_box, 3)
    assert opened.irradiance(*points) == pytest.approx(closed.irradiance(*points), rel=0.01)


def test_a_second_sun_is_found_however_weak_it_is_beside_the_first():
    def sky(second):
        image = np.full((64, 128, 3), 0.05)
        image[10, 40], image[30, 90] = 2e4, second
        return Sky(image)

    points = shapes.random_points(BLOCK, 4)
    before = solve(BLOCK, 0.5, sky=sky(0.05))
    before.irradiance(*points)
    found = before.relight(sky=sky(200.0)).irradiance(*points)
    assert found == pytest.approx(solve(BLOCK, 0.5, sky=sky(200.0)).irradiance(*points), rel=1e-3)


@pytest.mark.parametrize("method", ["direct", "fmm"])
def test_other_power_and_colour_need_no_ray(method):
    settings = fmm_core.Settings(particles=300, method=method)
    sun = np.full((20, 40, 3), 0.2)
    sun[4, 7] = [300.0, 200.0, 100.0]
    points = shapes.random_points(BLOCK, 4)
    before = solve(BLOCK, 0.5, settings, lights=LAMPS, sky=Sky(sun))
    before.irradiance(*points)
    lamps = [replace(lamp, **{lamp.power: (0.5, 2.0, 1.0 + k)}) for k, lamp in enumerate(LAMPS)]
    other = Sky(sun * [2.0, 1.0, 0.3])
    after = before.relight(albedo=0.3, lights=lamps, sky=other)
    found = after.irradiance(*points)
    assert after.report["counts"]["rays"] == 0
    assert after.report["warnings"] == []
    fresh = solve(BLOCK, 0.3, settings, lights=lamps, sky=other).irradiance(*points)
    assert found == pytest.approx(fresh, rel=1e-3)
    dark = after.relight(lights=LAMPS[:1], sky=Sky(0.0))
    assert dark.irradiance(*points) == pytest.approx(
        solve(BLOCK, 0.3, settings, lights=LAMPS[:1]).irradiance(*points), rel=1e-3
    )
    assert dark.report["counts"]["rays"] == 0


def test_a_lamp_that_moves_traces_its_own_rays_only():
    points = shapes.random_points(BLOCK, 4)
    before = solve(BLOCK, 0.5, lights=LAMPS, sky=Sky(1.0))
    before.irradiance(*points)
    moved = [*LAMPS[1:], PointLight((0.3, 0.3, 1.5), 1.0)]
    after = before.relight(lights=moved)
    found = after.irradiance(*points)
    fresh = solve(BLOCK, 0.5, lights=moved, sky=Sky(1.0))
    fresh.irradiance(*points)
    assert 0 < after.report["counts"]["rays"] < fresh.report["counts"]["rays"] / len(moved)
    assert found == pytest.approx(fresh.irradiance(*points), rel=1e-3)


def test_patches_that_a_spot_has_cut_are_kept_for_other_suns(tmp_path):
    room, points = window_room(0.25), shapes.random_points(window_room(0.25), 2)
    kept, settings = fmm_core.KeptVisibility(), fmm_core.Settings(method="fmm", particles=1000, probes=0)
    suns = [SunLight((-2.0, 0.02, -1.0), 10.0), SunLight((-2.0, 0.5, -1.0), 10.0)]
    first = fmm_core.solve(fmm_core.Scene(room, 0.5, lights=suns[:1]), settings, kept=kept)
    first.irradiance(*points)
    kept.save(tmp_path / "room")
    again = fmm_core.KeptVisibility.load(tmp_path / "room")
    other = fmm_core.Scene(room, 0.5, lights=suns[1:])
    moved = fmm_core.solve(other, settings, kept=again)
    found = moved.irradiance(*points)
    assert len(moved.particles) == len(first.particles) > 1500
    assert found == pytest.approx(first.relight(lights=suns[1:]).irradiance(*points), rel=1e-3)


def test_kept_visibility_has_the_rays_of_lamps_and_sky():
    kept, points = fmm_core.KeptVisibility(), shapes.random_points(BLOCK, 2)
    scene = fmm_core.Scene(BLOCK, 0.5, lights=LAMPS, sky=Sky(1.0))
    first = fmm_core.solve(scene, FEW, kept=kept)
    irradiance = first.irradiance(*points)
    again = fmm_core.solve(scene, FEW, kept=kept)
    assert (again.irradiance(*points) == irradiance).all()
    assert first.report["counts"]["rays"] > again.report["counts"]["rays"] == 0


def test_far_from_the_origin_lamps_come_along():
    step, points = np.array([1e4, -2e4, 5e3]), shapes.random_points(BLOCK, 4)
    near = solve(BLOCK, 0.5, lights=LAMPS)
    far = solve(BLOCK + step, 0.5, lights=[lamp.moved(step) for lamp in LAMPS])
    expected = near.irradiance(*points)
    found = far.irradiance(points[0] + step, points[1])
    assert np.linalg.norm(found - expected) < 5e-3 * np.linalg.norm(expected)
    relit = far.relight(lights=[lamp.moved(step) for lamp in LAMPS])
    assert relit.irradiance(points[0] + step, points[1]) == pytest.approx(found, rel=1e-3)


def test_lamps_and_sky_can_be_cancelled():
    with pytest.raises(fmm_core.Cancelled):
        fmm_core.solve(
            fmm_core.Scene(BLOCK, 0.5, lights=LAMPS, sky=Sky(1.0)), FEW, lambda fraction, text: "lamps" not in text
        )


def test_measured_error_counts_lamps():
    settings = fmm_core.Settings(particles=500, method="fmm", rays=20)
    solution = solve(BLOCK, 0.0, settings, sky=Sky(1.0))
    solution.irradiance(*shapes.random_points(BLOCK, 30))
    assert 1e-3 < solution.report["error"]["measured_rms"] < 0.1


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PointLight((0, 0), 1.0), r"PointLight.position: expected three numbers, got shape \(2,\)"),
        (lambda: PointLight((0, 0, np.nan), 1.0), r"PointLight.position is \(0.0, 0.0, nan\), which is not finite"),
        (lambda: PointLight((0, 0, 0), -1.0), "PointLight.intensity is -1, it must not be negative"),
        (lambda: PointLight((0, 0, 0), 1.0, radius=-2), "PointLight.radius: expected a number from 0 to 1e.60, got -2"),
        (lambda: PointLight((0, 0, 0), 1.0, disc=3), "PointLight.disc: expected True or False, got 3"),
        (lambda: SunLight((0, 0, 0), 1.0), "SunLight.direction is 0, which is no direction"),
        (lambda: SunLight(DOWN, (1, 2, np.inf)), "SunLight.irradiance is .*inf.*, which is not finite"),
        (lambda: SpotLight((0, 0, 0), 1.0, angle=4.0), "SpotLight.angle: expected a number from 0 to 3.14159, got 4"),
        (lambda: SpotLight((0, 0, 0), 1.0, stretch=np.diag([1, 0, 1])), "SpotLight.stretch is .*, which is flat"),
        (lambda: AreaLight((0, 0, 0), (1, 0, 0), (2, 0, 0), 1.0), "AreaLight: u .* and v .* span no area"),
        (lambda: AreaLight((0, 0, 0), (1, 0, 0), (0, 1, 0), "x"), "AreaLight.radiance: expected numbers"),
        (lambda: Sky(np.zeros((4, 8))), r"sky: expected a number, three or an image \(H, W, 3\), got shape \(4, 8\)"),
        (lambda: Sky([1, -1, 0]), "sky: row 0, column 0 is"),
        (lambda: Sky(np.full((2, 4, 3), np.nan)), "sky: row 0, column 0 is"),
        (lambda: fmm_core.Scene(FLOOR, lights=3), "lights: expected a sequence of lights, got int"),
        (lambda: fmm_core.Scene(FLOOR, lights=["lamp"]), "lights: number 0 is no light but str"),
        (lambda: fmm_core.Scene(FLOOR, sky=1.0), "sky: expected a Sky or None, got float"),
        (lambda: fmm_core.Scene(FLOOR, lights=[PointLight((0, 0, 1), 0.0)]), "emission: the scene has no emitter"),
        (lambda: fmm_core.Scene(FLOOR, sky=Sky(0.0)), "emission: the scene has no emitter"),
    ],
)
def test_bad_lights_are_refused_by_name_and_value(make, message):
    with pytest.raises(fmm_core.Error, match=message) as error:
        make()
    assert "\n" not in str(error.value)
