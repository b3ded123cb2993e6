# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours fitted to the light on the faces."""

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core.fit import OVERSHOOT, clear_sight
from hypothesis import given, settings
from hypothesis import strategies as st

SMALL = fmm_core.Settings(particles=300)


def fit_of(triangles, normals=None):
    """Output points and fit of triangles (T, 3, 3) that share their corners where they meet, flat unless told."""
    corners = triangles.reshape(-1, 3)
    normals = np.repeat(shapes.normals(triangles), 3, axis=0) if normals is None else normals
    vertices = np.unique(np.rint(1e6 * corners), axis=0, return_inverse=True)[1].ravel()
    centres = np.repeat(triangles.mean(axis=1), 3, axis=0)
    output = fmm_core.output_points(corners, normals, vertices, centres)
    return output, fmm_core.VertexFit(output, corners, normals, np.arange(len(corners)).reshape(-1, 3))


def fitted(solution, fit):
    return fit.values(solution.irradiance(fit.points, fit.normals, effort=fit.effort), solution.sight(fit))


def grid(size, cells):
    """A flat square at z = 0 in so many cells a side, two triangles each."""
    u, v = np.meshgrid(*[np.arange(cells) * size / cells] * 2)
    corner = np.stack([u, v, 0 * u], axis=-1).reshape(-1, 1, 1, 3)
    return (corner + size / cells * shapes.quad([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0])).reshape(-1, 3, 3)


@pytest.mark.parametrize("method", ["direct", "fmm"])
def test_a_furnace_stays_exact(method):
    triangles = shapes.subdivided_room(4)
    _, fit = fit_of(triangles)
    scene = fmm_core.Scene(triangles, 0.5, 1.0)
    solution = fmm_core.solve(scene, fmm_core.Settings(method=method, particles=2000))
    assert fitted(solution, fit) == pytest.approx(2.0, rel=1e-3)


def test_a_smooth_sphere_stays_a_furnace():
    triangles = shapes.sphere(1.0, 3, inward=True)
    corners = triangles.reshape(-1, 3)
    _, fit = fit_of(triangles, -corners)
    solution = fmm_core.solve(fmm_core.Scene(triangles, 0.5, 1.0), fmm_core.Settings(method="fmm"))
    assert fitted(solution, fit) == pytest.approx(2.0, rel=1e-2)


def test_light_scales_and_colours_do_not_mix():
    _, fit = fit_of(grid(1.0, 6))
    light, none = np.random.default_rng(0).random((len(fit.points), 3)), clear_sight(len(fit.points))
    once = fit.values(light, none)
    assert fit.values(7 * light, none) == pytest.approx(7 * once, rel=1e-9)
    for colour in range(3):
        assert fit.values(light[:, [colour] * 3], none) == pytest.approx(once[:, [colour] * 3], rel=2e-3)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1 << 30), cells=st.integers(1, 6), buried=st.floats(0, 1), joined=st.floats(0, 1))
def test_colours_are_not_negative_nor_much_brighter_than_the_light(seed, cells, buried, joined):
    rng = np.random.default_rng(seed)
    _, fit = fit_of(grid(1.0, cells))
    count = len(fit.points)
    sight = fmm_core.Sight(rng.random(count) < buried, rng.random((count, 3)) < joined)
    values = fit.values((rng.random((count, 3)) < 0.5).astype(float), sight)
    assert np.isfinite(values).all()
    assert values.min() >= 0
    assert values.max() <= 1 + OVERSHOOT


def test_a_crease_stays_sharp():
    floor, wall = grid(1.0, 3), grid(1.0, 3)[:, :, [2, 0, 1]]
    _, fit = fit_of(np.concatenate([floor, wall]))
    on_floor = fit.normals[:, 2] > 0.5
    values = fit.values(np.where(on_floor, 1.0, 5.0)[:, None] * np.ones(3), clear_sight(len(on_floor)))
    assert np.sort(values[:, 0]) == pytest.approx(np.repeat([1.0, 5.0], 16), rel=1e-3)


def test_what_lies_under_an_object_does_not_darken_what_does_not():
    output, fit = fit_of(grid(1.0, 10))
    inside = np.abs(fit.points[:, :2] - 0.5).max(axis=1) < 0.23
    light = np.where(inside, 0.0, 1.0)[:, None] * np.ones(3)
    straddling = np.abs(output.points[:, :2] - 0.5).max(axis=1) < 0.25
    assert np.count_nonzero(straddling) == 25
    darkened = fit.values(light, clear_sight(len(inside)))
    mended = fit.values(light, fmm_core.Sight(inside, np.ones((len(inside), 3), bool)))
    rim = straddling & (np.abs(output.points[:, :2] - 0.5).max(axis=1) > 0.15)
    assert darkened[rim].max() < 0.5
    assert mended[rim | ~straddling] == pytest.approx(1.0, rel=5e-3)


def test_a_thin_wall_keeps_its_shadow():
    """Floor and walls run under and past a closed wall 0.02 thick, which stands askew on them."""
    room = np.concatenate([shapes.subdivided_room(10), shapes.subdivided_room(10) + [1.0, 0.0, 0.0]])
    room = room[(np.abs(room[:, :, 0] - 1.0) > 1e-9).any(axis=1)]
    turn = np.array([[np.cos(0.15), np.sin(0.15), 0.0], [-np.sin(0.15), np.cos(0.15), 0.0], [0.0, 0.0, 1.0]])
    middle = np.array([1.013, 0.5, 0.0])
    wall = (shapes.room((0.02, 3.0, 1.0))[:, ::-1] - [0.01, 1.5, 0.0]) @ turn + middle
    lamp = shapes.quad([0.2, 0.3, 0.99], [0.2, 0.7, 0.99], [0.6, 0.7, 0.99], [0.6, 0.3, 0.99])
    triangles = np.concatenate([room, wall, lamp])
    emission = np.where(np.arange(len(triangles)) < len(triangles) - 2, 0.0, 30.0)
    output, fit = fit_of(triangles)
    solution = fmm_core.solve(fmm_core.Scene(triangles, 0.7, emission), fmm_core.Settings(method="fmm", probes=0))
    light, sight = solution.irradiance(fit.points, fit.normals, effort=fit.effort), solution.sight(fit)
    behind = (output.points - middle) @ turn[0]
    blind = fit.values(light, fmm_core.Sight(sight.buried, np.ones_like(sight.joined)))
    assert blind[behind > 0.0101].max() > 0.05
    mended = fit.values(light, sight)
    # Vertices inside the wall, of which there are a few, belong to both sides, and are dark.
    assert np.count_nonzero(np.abs(behind) < 0.0099) > 0
    assert mended[behind > -0.0099].max() < 1e-6
    assert mended[behind < -0.0101].mean() > 1


def test_what_samples_see_is_asked_for_once():
    block = shapes.room((0.4, 0.3, 0.2))[:, ::-1] + [0.35, 0.35, 0.0]
    triangles = np.concatenate([shapes.subdivided_room(5), block])
    _, fit = fit_of(triangles)
    solution = fmm_core.solve(fmm_core.Scene(triangles, 0.5, np.arange(len(triangles)) < 2.0), SMALL)
    first = fitted(solution, fit)
    relit = solution.relight(2.0 * solution.scene.emission)
    assert fitted(relit, fit) == pytest.approx(2 * first, rel=1e-3)
    assert relit.report["counts"]["rays"] == 0


def test_a_convex_room_traces_no_ray():
    triangles = shapes.subdivided_room(4)
    _, fit = fit_of(triangles)
    solution = fmm_core.solve(fmm_core.Scene(triangles, 0.5, 1.0), fmm_core.Settings(method="fmm", particles=2000))
    rays = solution.report["counts"]["rays"]
    fitted(solution, fit)
    assert solution.report["counts"]["rays"] == rays


def test_triangles_without_area_get_colours_too():
    line = np.array([[[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]]])
    triangles = np.concatenate([grid(1.0, 2), line])
    up = np.tile([0.0, 0.0, 1.0], (3 * len(triangles), 1))
    _, fit = fit_of(triangles, up)
    assert fit.values(np.ones((len(fit.points), 3)), clear_sight(len(fit.points))) == pytest.approx(1.0, rel=1e-3)


def test_wrong_corners_are_named():
    output, _ = fit_of(grid(1.0, 1))
    corners = grid(1.0, 1).reshape(-1, 3)
    with pytest.raises(fmm_core.Error, match="triangles: expected corners from 0 to 5"):
        fmm_core.VertexFit(output, corners, corners, [[0, 1, 6]])
    with pytest.raises(fmm_core.Error, match="differ in length"):
        fmm_core.VertexFit(output, corners[1:], corners[1:], [[0, 1, 2]])
