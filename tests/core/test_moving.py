# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames in which something moves: what it does not touch is not traced again, the light is that of a fresh bake."""

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import moving

BALL = 0.05 * shapes.sphere(1.0, 1)
PLACES = np.random.default_rng(3).uniform(0.2, 0.8, (12, 3))
LAMP = shapes.quad([0.4, 0.4, 0.99], [0.4, 0.6, 0.99], [0.6, 0.6, 0.99], [0.6, 0.4, 0.99])
STEP = (0.03, 0.0, 0.02)
METHODS = [{"method": "fmm", "particles": 1500}, {"method": "direct", "particles": 300}]


def triangles(step=(0.0, 0.0, 0.0)):
    """A room with a lamp and balls, of which the first moves."""
    balls = BALL + PLACES[:, None, None]
    balls[0] += step
    return np.concatenate([shapes.room(), LAMP, *balls])


POINTS = shapes.random_points(triangles(), 2)


def bake(corners, kept=None, opacity=1.0, **options):
    """Irradiance at the points, which do not move, and the rays that were traced."""
    emission = np.where(np.arange(len(corners)) // 2 == 6, 10.0, 0.0)
    scene = fmm_core.Scene(corners, 0.6, emission, opacity=opacity)
    solution = fmm_core.solve(scene, fmm_core.Settings(probes=0, **options), kept=kept)
    irradiance = solution.irradiance(*POINTS)
    return irradiance, solution.report["counts"]["rays"]


@pytest.mark.parametrize("options", METHODS, ids=str)
def test_a_frame_equals_a_fresh_bake_of_it_by_few_rays(options):
    kept = fmm_core.MovingVisibility()
    first, _ = bake(triangles(), kept, **options)
    second, rays = bake(triangles(STEP), kept, **options)
    fresh, all_rays = bake(triangles(STEP), **options)
    assert np.allclose(second, fresh, rtol=1e-9)
    assert np.abs(first - fresh).max() > 0.01 * fresh.mean()
    assert 0 < rays < 0.25 * all_rays
    # And back again, by what the second frame has asked.
    third, rays = bake(triangles(), kept, **options)
    assert np.allclose(third, first, rtol=1e-9)
    assert 0 < rays < 0.25 * all_rays
    again, rays = bake(triangles(), kept, **options)
    assert (again == third).all()
    assert rays == 0


@pytest.mark.parametrize("change", ["size", "number", "opacity"])
def test_all_is_traced_anew_where_rays_are_others(change):
    kept, options = fmm_core.MovingVisibility(), METHODS[0]
    bake(triangles(), kept, **options)
    corners, opacity = triangles(STEP), 1.0
    if change == "size":
        corners[0, 0] -= 0.1
    elif change == "number":
        corners = corners[:-1]
    else:
        opacity = np.where(np.arange(len(corners)) == len(corners) - 1, 0.5, 1.0)
    found = bake(corners, kept, opacity, **options)
    expected = bake(corners, None, opacity, **options)
    assert (found[0] == expected[0]).all()
    assert found[1] == expected[1]


def test_boxes_hold_what_has_moved_before_and_after():
    last = np.random.default_rng(0).uniform(-1, 1, (100, 3, 3)).astype(np.float32)
    now = last.copy()
    now[[3, 4, 50]] += 0.1
    boxes = moving._boxes(last, now)
    assert len(boxes) == 2
    for low, high in boxes[:1]:
        corners = np.concatenate([last[3:5], now[3:5]]).reshape(-1, 3)
        assert np.allclose(low, corners.min(axis=0) - moving.MARGIN)
        assert np.allclose(high, corners.max(axis=0) + moving.MARGIN)
    now[::2] += 0.1
    assert len(moving._boxes(last, now)) == moving.MOST_BOXES
    assert len(moving._boxes(last, last)) == 0


def test_rays_pass_a_box_where_one_of_their_points_is_inside():
    rng = np.random.default_rng(1)
    origins, directions = rng.uniform(-1, 1, (2, 2000, 3)).astype(np.float32)
    directions[:50, 0], directions[50:100, 1:] = 0.0, 0.0
    boxes = np.array([[[-0.3, -0.2, 0.0], [0.1, 0.4, 0.5]]], np.float32)
    reach = rng.uniform(0.1, 2, 2000).astype(np.float32)
    along = np.linspace(0, 1, 4001)[:, None, None] * reach[:, None]
    points = origins + along * directions
    inside = ((points >= boxes[0, 0]) & (points <= boxes[0, 1])).all(axis=2).any(axis=0)
    found = moving._pass(boxes, origins, directions, reach)
    assert found[inside].all()
    # Points so close together miss no more than corners that are cut off.
    assert np.count_nonzero(found & ~inside) < 10
    assert 50 < np.count_nonzero(inside) < 1000
