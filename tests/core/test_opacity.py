# SPDX-License-Identifier: GPL-3.0-or-later
"""Transparent triangles: what passes them, what they reflect, and that whole ones cost nothing."""

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import Opacity
from fmm_core.opacity import MOST_MET, cell_centres, cell_of
from fmm_core.visibility import Occlusion
from hypothesis import given
from hypothesis import strategies as st

LAMP = shapes.quad([0.0, 0, 2], [0.0, 1, 2], [1.0, 1, 2], [1.0, 0, 2])
SHEET = shapes.quad([-1.0, -1, 1], [2.0, -1, 1], [2.0, 2, 1], [-1.0, 2, 1])
FLOOR = shapes.quad([-1.0, -1, 0], [2.0, -1, 0], [2.0, 2, 0], [-1.0, 2, 0])
POINTS = np.column_stack([*np.random.default_rng(1).random((2, 60)), np.full(60, 1e-4)])
UP = np.tile([0.0, 0.0, 1.0], (60, 1))
METHODS = pytest.mark.parametrize("method", ["direct", "fmm"])


def irradiance(triangles, opacity=1.0, albedo=0.0, method="direct", **options):
    emission = np.where(np.arange(len(triangles)) < 2, 1.0, 0.0)
    scene = fmm_core.Scene(triangles, albedo, emission, two_sided=True, opacity=opacity)
    settings = fmm_core.Settings(method=method, **{"particles": 1500, "probes": 0, **options})
    return fmm_core.solve(scene, settings).irradiance(POINTS, UP)


def relative(found, expected):
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


@given(st.integers(1, 9), st.data())
def test_cells_are_where_their_centres_are(steps, data):
    cell = data.draw(st.integers(0, steps * steps - 1))
    u, v = cell_centres(steps)[cell]
    assert cell_of(np.array([steps]), np.array([u]), np.array([v])) == cell
    # The first cell lies at the first corner, the last one at the second.
    assert cell_centres(steps)[0] == pytest.approx([1 / (3 * steps)] * 2)
    assert cell_centres(steps)[-1] == pytest.approx([1 - 2 / (3 * steps), 1 / (3 * steps)])


@given(st.integers(1, 9), st.floats(0, 1), st.floats(0, 1))
def test_every_place_of_a_triangle_is_in_a_cell(steps, u, v):
    cell = int(cell_of(np.array([steps]), np.array([u]), np.array([min(v, 1 - u)]))[0])
    assert 0 <= cell < steps * steps
    assert np.abs(cell_centres(steps)[cell] - [u, min(v, 1 - u)]).max() <= 2 / (3 * steps) + 1e-9


@pytest.mark.parametrize(
    ("opacity", "message"),
    [
        (1.5, "opacity: triangle 0 is 1.5"),
        ([1.0, -0.5, 0, 0, 0, 0], "opacity: triangle 1 is -0.5"),
        ([1.0, np.nan, 0, 0, 0, 0], "opacity: triangle 1 is nan"),
        ([1.0, 1.0], "opacity: expected 6 rows like triangles, got 2"),
        (0.0, "opacity: no triangle with an area stops any light"),
    ],
)
def test_wrong_opacity_is_refused(opacity, message):
    with pytest.raises(fmm_core.Error, match=message):
        irradiance(np.concatenate([LAMP, SHEET, FLOOR]), opacity)


def test_cells_that_do_not_fit_are_refused():
    with pytest.raises(fmm_core.Error, match="for 4 cells, and cells"):
        Opacity([1.0, 1.0], [2, 0], [0.5] * 3)


@METHODS
@pytest.mark.parametrize("opacity", [0.0, 0.25, 0.7])
def test_a_dark_sheet_lets_its_share_through(opacity, method):
    effort = {"method": method, "particles": 4000, "rays": 1500}
    through = irradiance(np.concatenate([LAMP, SHEET, FLOOR]), [1, 1, opacity, opacity, 1, 1], **effort)
    assert relative(through, (1 - opacity) * irradiance(np.concatenate([LAMP, FLOOR]))) < 0.01


@pytest.mark.parametrize("radius", [0.0, 0.2])
def test_a_lamp_shines_through_veils_without_noise(radius):
    veils, opacity = np.concatenate([SHEET, SHEET + [0, 0, 0.3]]), [0.3, 0.3, 0.25, 0.25]
    lamp = fmm_core.PointLight(np.array([0.5, 0.5, 2.0]), intensity=10.0, radius=radius)

    def lit(opacity, kept=None):
        scene = fmm_core.Scene(np.concatenate([veils, FLOOR]), 0.0, 0.0, opacity=[*opacity, 1, 1], lights=[lamp])
        settings = fmm_core.Settings(particles=300, probes=0)
        return fmm_core.solve(scene, settings, kept=kept).irradiance(POINTS, UP)

    kept = fmm_core.KeptVisibility()
    found = lit(opacity, kept)
    assert relative(found, 0.7 * 0.75 * lit([0, 0, 0, 0])) < 1e-3
    assert (lit(opacity, kept) == found).all()


@METHODS
def test_cells_shade_like_triangles_of_their_own(method):
    steps, cells = 5, np.random.default_rng(2).random((2, 25)) < 0.5
    opacity = Opacity([1, 1, 0, 0, 1, 1], [0, 0, steps, steps, 0, 0], cells.ravel())
    assert opacity.mean[2:4] == pytest.approx(cells.mean(axis=1))
    # The corners of the cell that lies around each centre: the lower ones, and the ones turned round between them.
    u, v = np.round(cell_centres(steps) * steps * 3).astype(int).T
    lower = u % 3 == 1
    at = [np.stack([u // 3 + x * lower + (1 - lower) * (1 - x), v // 3 + y * lower + (1 - lower) * (1 - y)], axis=1)
          for x, y in ((0, 0), (1, 0), (0, 1))]  # fmt: skip
    corners = np.stack(at, axis=1) / steps
    sheet = (SHEET - [0.5, 0.5, 0]) / 3 + [0.5, 0.5, 0.5]
    pieces = [half[0] + (corners @ (half[1:] - half[0]))[stops] for half, stops in zip(sheet, cells, strict=True)]
    effort = {"method": method, "particles": 3000, "rays": 1500}
    expected = irradiance(np.concatenate([LAMP, *pieces, FLOOR]), **effort)
    found = irradiance(np.concatenate([LAMP, sheet, FLOOR]), opacity, **effort)
    assert 0.2 < expected.mean() / irradiance(np.concatenate([LAMP, FLOOR])).mean() < 0.8
    assert relative(found, expected) < 1e-3


@METHODS
def test_a_furnace_does_not_see_what_is_transparent(method):
    room = shapes.subdivided_room(3)
    sheet = shapes.quad([0.1, 0.1, 0.5], [0.9, 0.2, 0.4], [0.9, 0.9, 0.5], [0.1, 0.8, 0.6])
    triangles = np.concatenate([room, sheet])
    opacity = np.r_[np.ones(len(room)), 0.3, 0.6]
    scene = fmm_core.Scene(triangles, 0.5, 1.0, np.arange(len(triangles)) >= len(room), opacity)
    solution = fmm_core.solve(scene, fmm_core.Settings(method=method, particles=1500, probes=0))
    points, normals = shapes.random_points(room, 40)
    assert solution.irradiance(points, normals).mean() == pytest.approx(2.0, rel=0.003)
    assert np.abs(solution.irradiance(points, normals) - 2.0).max() < 0.1
    assert relative(solution.radiosity, np.full(solution.radiosity.shape, 2.0)) < 0.02


@METHODS
def test_a_room_loses_light_through_a_ceiling_of_glass(method):
    room = shapes.subdivided_room(4)
    above, below = (room[:, :, 2].min(axis=1) > 0.99), (room[:, :, 2].max(axis=1) < 0.01)

    def solved(opacity, albedo):
        scene = fmm_core.Scene(room, albedo, np.where(below, 1.0, 0.0), opacity=opacity)
        settings = fmm_core.Settings(method=method, particles=3000, probes=0)
        return fmm_core.solve(scene, settings).irradiance(POINTS * [0.8, 0.8, 0] + [0.1, 0.1, 1e-4], UP)

    half = solved(np.where(above, 0.5, 1.0), 0.6)
    assert relative(half, solved(1.0, np.where(above, 0.3, 0.6))) < 0.005


def test_a_sheet_reflects_its_share():
    above = shapes.quad([-1.0, -1, 2.5], [-1.0, 2, 2.5], [2.0, 2, 2.5], [2.0, -1, 2.5])
    triangles, points = np.concatenate([LAMP, SHEET, above]), POINTS * [1, 1, 0] + [0, 0, 1.9]

    def upwards(opacity):
        emission = [1, 1, 0, 0, 0, 0]
        scene = fmm_core.Scene(triangles, [0, 0, 0.8, 0.8, 0, 0], emission, [0, 0, 1, 1, 0, 0], [1, 1, *opacity, 1, 1])
        return fmm_core.solve(scene, fmm_core.Settings(particles=1500)).irradiance(points, -UP)

    assert relative(upwards([0.4, 0.4]), 0.4 * upwards([1.0, 1.0])) < 0.01


def test_no_ray_passes_more_surfaces_than_any_scene_has():
    stack = np.concatenate([SHEET + [0, 0, -0.01 * i] for i in range(MOST_MET + 8)])
    scene = fmm_core.Scene(np.concatenate([LAMP, stack]), 0.5, np.r_[1, 1, np.zeros(len(stack))],
                           opacity=np.r_[1, 1, np.full(len(stack), 1e-9)])  # fmt: skip
    lamp = np.tile([0.5, 0.4, 2.0], (60, 1))
    occlusion = Occlusion(scene)
    assert not occlusion.visible_targets(POINTS, UP, lamp, -UP).any()
    few = fmm_core.Scene(np.concatenate([LAMP, stack[:20]]), 0.5, np.r_[1, 1, np.zeros(20)],
                         opacity=np.r_[1, 1, np.full(20, 1e-9)])  # fmt: skip
    assert Occlusion(few).visible_targets(POINTS, UP, lamp, -UP).all()


def test_what_is_whole_takes_the_path_of_all_others():
    triangles = np.concatenate([LAMP, SHEET, FLOOR])
    whole = fmm_core.Scene(triangles, 0.5, 1.0, opacity=Opacity(np.ones(6), [0, 0, 2, 0, 0, 0], np.ones(4)))
    assert whole.opacity is None


def test_kept_rays_are_those_of_one_opacity():
    triangles, kept = np.concatenate([LAMP, SHEET, FLOOR]), fmm_core.KeptVisibility()

    def solved(opacity):
        scene = fmm_core.Scene(triangles, 0.5, [1, 1, 0, 0, 0, 0], opacity=[1, 1, opacity, opacity, 1, 1])
        return fmm_core.solve(scene, fmm_core.Settings(particles=600), kept=kept)

    first = solved(0.5)
    again = solved(0.5)
    assert (again.radiosity == first.radiosity).all()
    assert again.report["counts"]["rays"] == 0
    other = solved(0.6)
    assert other.report["counts"]["rays"] > 0
    assert any("other geometry" in text for text in other.report["warnings"])
    assert not first.serves(other.scene)
    assert first.serves(again.scene)
