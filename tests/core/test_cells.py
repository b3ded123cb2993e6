# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's own visibility, by pairs of cells, judged by the direct method with all rays."""

import fmm_core
import numpy as np
import pytest
import shapes
from test_visibility import ALBEDO, EMISSION, TWO_BLOCKS, error, two_blocks

CELLS = {"visibility": "cells", "probes": 0}


def pairs(solution):
    counts = solution.report["counts"]
    return tuple(counts[name] for name in ("pairs_valid", "pairs_partial", "pairs_invalid"))


@pytest.fixture(scope="module")
def points():
    return shapes.random_points(TWO_BLOCKS, 40)


@pytest.fixture(scope="module")
def exact(points):
    return two_blocks(method="direct", probes=0).irradiance(*points)


@pytest.mark.parametrize(
    ("octree", "bound"),
    [({"level": 3}, 0.09), ({"level": 4}, 0.055), ({"grouping": 16}, 0.1), ({"separation": 2}, 0.2)],
)
def test_light_is_right_but_for_shadows_as_coarse_as_cells(points, exact, octree, bound):
    solution = two_blocks(**CELLS, **octree)
    found = solution.irradiance(*points)
    assert error(found, exact) < bound
    assert found.sum() == pytest.approx(exact.sum(), rel=bound / 3)
    valid, partial, invalid = pairs(solution)
    assert min(valid, partial, invalid) > 0
    assert solution.report["postponement"] == partial / (valid + partial + invalid)


def test_shadows_get_finer_with_the_cells(points, exact):
    errors = [error(two_blocks(**CELLS, level=level).irradiance(*points), exact) for level in (2, 3, 4)]
    assert errors[0] > 1.2 * errors[1] > 1.4 * errors[2]


def test_rays_follow_the_cells_and_not_the_particles():
    few, many = (
        fmm_core.solve(
            fmm_core.Scene(TWO_BLOCKS, ALBEDO, EMISSION), fmm_core.Settings(particles=count, level=2, **CELLS)
        ).report["counts"]
        for count in (3000, 12_000)
    )
    assert many["particles"] > 3 * few["particles"]
    assert many["rays"] < 1.3 * few["rays"]


@pytest.mark.parametrize("octree", [{"level": 3}, {"grouping": 64}])
@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_convex_room_postpones_nothing_and_loses_no_light(turn, octree):
    c, s = np.cos(turn), np.sin(turn)
    room = shapes.room() @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
    scene, points = fmm_core.Scene(room, 0.5, 1.0), shapes.random_points(room, 20)
    options = {"particles": 5000, "method": "fmm", "probes": 0, **octree}
    solution = fmm_core.solve(scene, fmm_core.Settings(visibility="cells", **options))
    open_space = fmm_core.solve(scene, fmm_core.Settings(effects={"occlusion": False}, **options))
    irradiance = solution.irradiance(*points)
    assert irradiance == pytest.approx(np.full_like(irradiance, 2.0), rel=1e-2)
    assert solution.report["postponement"] == 0.0
    assert pairs(solution) == (open_space.report["counts"]["pairs_valid"], 0, 0)
    assert solution.report["counts"]["rays"] > 0


@pytest.mark.parametrize("octree", [{"level": 3}, {"grouping": 32}])
@pytest.mark.parametrize("gap", [0.0, 1e-4])
def test_no_light_passes_a_wall_between_cells(gap, octree):
    left = shapes.room()
    right = left + np.array([1.0 + gap, 0.0, 0.0])
    scene = fmm_core.Scene(np.concatenate([left, right]), 0.5, (np.arange(24) < 12).astype(float))
    solution = fmm_core.solve(scene, fmm_core.Settings(particles=4000, **CELLS, **octree))
    points = zip(shapes.random_points(left, 100), shapes.random_points(right, 100), strict=True)
    lit, dark = np.split(solution.irradiance(*map(np.concatenate, points)), 2)
    assert lit == pytest.approx(np.full_like(lit, 2.0), rel=2e-2)
    assert dark.max() < 1e-6 * lit.min()
    assert pairs(solution)[2] > 0


@pytest.mark.parametrize("octree", [{"level": 3}, {"grouping": 32}])
def test_relight_traces_no_ray_and_equals_a_fresh_solve(points, octree):
    settings = fmm_core.Settings(particles=2000, **CELLS, **octree)
    first = fmm_core.solve(fmm_core.Scene(TWO_BLOCKS, ALBEDO, EMISSION), settings)
    first.irradiance(*points)
    again = first.relight(emission=3.0 * EMISSION, albedo=0.5)
    fresh = fmm_core.solve(fmm_core.Scene(TWO_BLOCKS, 0.5, 3.0 * EMISSION), settings)
    assert again.irradiance(*points) == pytest.approx(fresh.irradiance(*points), rel=1e-3, abs=1e-9)
    assert again.report["counts"]["rays"] == 0
    assert again.report["postponement"] == first.report["postponement"] > 0


def test_exact_form_factors_replace_only_what_the_sum_has(points):
    # Where it subtracted what was never added, near patches would be darker by as much.
    reach = [two_blocks(**CELLS, level=3, near_reach=reach).irradiance(*points) for reach in (2.0, 6.0)]
    assert error(reach[0], reach[1]) < 0.02
    assert reach[0].sum() == pytest.approx(reach[1].sum(), rel=5e-3)


def test_cells_are_of_the_multipole_method():
    with pytest.raises(fmm_core.Error, match=r"^visibility: 'cells' is for the method 'fmm', got 'direct'$"):
        fmm_core.Settings(visibility="cells", method="direct")
    scene = fmm_core.Scene(TWO_BLOCKS, ALBEDO, EMISSION)
    assert fmm_core.solve(scene, fmm_core.Settings(particles=500, **CELLS)).report["counts"]["leaves"] > 0
