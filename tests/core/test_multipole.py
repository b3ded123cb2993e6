# SPDX-License-Identifier: GPL-3.0-or-later
"""The fast multipole method against the direct sum, through the public API."""

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import _binding, cost
from hypothesis import given, settings
from hypothesis import strategies as st

#: The unoccluded Cornell room: open in front, with its lamp in the ceiling.
WALLS = shapes.room()[2:]
LAMP = shapes.quad([0.35, 0.35, 0.99], [0.35, 0.65, 0.99], [0.65, 0.65, 0.99], [0.65, 0.35, 0.99])
ROOM = np.concatenate([WALLS, LAMP])
EMISSION = np.where(np.arange(len(ROOM)) < len(WALLS), 0.0, 10 * np.pi)
SCENE = fmm_core.Scene(ROOM, np.array([[0.73, 0.5, 0.2]] * len(ROOM)), EMISSION)
POINTS = shapes.random_points(ROOM, 100)


def solved(**options):
    options = {"particles": 9000, "visibility": "none", "tolerance": 1e-6} | options
    return fmm_core.solve(SCENE, fmm_core.Settings(**options))


@pytest.fixture(scope="module")
def exact():
    return solved(method="direct").irradiance(*POINTS)


def error(solution, exact):
    return np.linalg.norm(solution.irradiance(*POINTS) - exact) / np.linalg.norm(exact)


@pytest.mark.parametrize("expansion", ["whole", "compressed"])
def test_error_against_the_direct_sum_falls_with_p(exact, expansion):
    errors = [error(solved(method="fmm", truncation=p, expansion=expansion), exact) for p in (2, 4, 8)]
    assert errors[0] < 0.02
    assert errors[1] < 0.005
    assert errors[2] < 0.0002
    assert errors == sorted(errors, reverse=True)


def test_papers_expansion_falls_with_p_too(exact):
    errors = [error(solved(method="fmm", truncation=p, expansion="paper"), exact) for p in (2, 4, 6)]
    assert errors[2] < 0.005
    assert errors == sorted(errors, reverse=True)


@pytest.mark.parametrize(
    "options", [{"grouping": 4}, {"grouping": 1000}, {"level": 3}, {"separation": 2}, {"grouping": None}]
)
def test_any_tree_and_any_separation_give_the_same_light(exact, options):
    assert error(solved(method="fmm", truncation=5, **options), exact) < 0.002


def test_measured_error_is_the_true_one_at_all_particles():
    solution, direct = solved(method="fmm", truncation=4), solved(method="direct")
    report, particles = solution.report["error"], solution.particles
    exact = direct.irradiance(particles.positions, particles.normals)
    difference = solution.irradiance(particles.positions, particles.normals) - exact
    weights = particles.weights[:, None]
    true = np.sqrt((weights * difference**2).sum() / (weights * exact**2).sum())
    assert report["probes"] == 300
    assert report["measured_rms"] == pytest.approx(true, rel=0.5)
    assert report["measured_max"] > report["measured_rms"]
    assert report["bound"] > report["measured_max"]
    assert solved(method="fmm", truncation=2, probes=0).report["error"]["measured_rms"] is None


def test_report_counts_boxes_and_pairs():
    counts = solved(method="fmm").report["counts"]
    assert counts["rays"] == 0
    assert counts["boxes"] > counts["leaves"] > 0
    assert counts["pairs_valid"] > 0


def test_occlusion_is_refused_until_it_is_there():
    with pytest.raises(fmm_core.Error, match="method 'fmm' does not treat occlusion yet"):
        fmm_core.Settings(method="fmm")


@settings(max_examples=40, deadline=None)
@given(
    count=st.integers(1, 300),
    clusters=st.integers(1, 4),
    spread=st.sampled_from([0.0, 1e-6, 1e-2, 1.0]),
    grouping=st.integers(1, 400),
    truncation=st.integers(0, 6),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_cloud_of_particles_gives_finite_light_close_to_the_direct_sum(
    count, clusters, spread, grouping, truncation, seed
):
    rng = np.random.default_rng(seed)
    points = rng.random((clusters, 3))[rng.integers(0, clusters, count)] + spread * rng.random((count, 3))
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # Expansions know no softening: it has to be below the distances that they serve.
    softening = np.full(count, 1e-20)
    strengths = rng.random((count, 3))
    fmm = _binding.Fmm((points, normals), softening, None, truncation, grouping, None, 1, "whole")
    found, _ = fmm.apply(strengths)
    exact = _binding.Sources(points, normals, softening, np.ones(count), 1).irradiance(points, normals, strengths)
    assert np.isfinite(found).all()
    # What all pairs would exchange head on: a pair near its horizon may lose its little light altogether.
    squared = ((points[:, None] - points[None]) ** 2).sum(axis=2)
    scale = (1 / (np.pi * np.maximum(squared, softening))) @ strengths
    # Corners of the two nearest boxes that are expanded about: sqrt(3) and 4 - sqrt(3) half sides away.
    ratio = np.sqrt(3) / (4 - np.sqrt(3))
    assert (np.abs(found - exact) <= (0.16 * 0.61**truncation + ratio ** (truncation + 1)) * scale).all()


def test_unit_costs_are_positive_and_seconds_add_them_up():
    unit = cost.unit_costs(3, "whole", 1)
    assert set(unit) == set(cost.WORK)
    assert min(unit[work] for work in ("p2m", "m2l", "l2p", "p2p")) > 0
    nothing = dict.fromkeys(cost.WORK.values(), 0)
    one = cost.seconds(nothing | {"interactions": 1000}, 3, "whole", 1)
    assert one == pytest.approx(1000 * unit["m2l"])


def test_dear_near_pairs_make_small_leaves_and_dear_translations_large_ones(monkeypatch):
    points, normals = cost._room(20_000)
    chosen = []
    for dear in ("p2p", "m2l"):
        unit = dict.fromkeys(cost.WORK, 1e-9) | {dear: 1e-4}
        monkeypatch.setattr(cost, "unit_costs", lambda *_, unit=unit: unit)
        chosen.append(cost.choose_grouping(points, normals, fmm_core.Settings(truncation=4)))
    assert chosen[0] < chosen[1]
    assert set(chosen) <= set(cost.GROUPINGS)


def test_sixteen_times_the_points_on_surfaces_are_sixteen_times_the_work():
    points, normals = cost._room(40_000)
    few = cost.predicted_counts(points[:2500], normals[:2500], 64, 4, 1)
    many = cost.predicted_counts(points, normals, 64, 4, 1)
    for what in ("boxes", "points"):
        assert 8 < many[what] / few[what] < 32


def test_sampled_counts_predict_those_of_the_whole_tree():
    points, normals = cost._room(100_000)
    fmm = _binding.Fmm((points, normals), np.full(len(points), 1e-12), None, 0, 64, None, 1, "whole")
    counts, predicted = fmm.counts(), cost.predicted_counts(points, normals, 64, 0, 1)
    assert predicted["boxes"] == pytest.approx(counts["boxes"], rel=0.3)
    assert predicted["point_pairs"] == pytest.approx(counts["point_pairs"], rel=0.3)
