# SPDX-License-Identifier: GPL-3.0-or-later
"""A target error alone chooses the settings, and the error that comes out is no larger."""

from dataclasses import replace

import fmm_core
import numpy as np
import pytest
from fmm_core.target import MOST_PARTICLES, _met, better
from test_accuracy import POINTS, SCENE, exact  # noqa: F401


def baked(**options):
    return fmm_core.solve_at(SCENE, fmm_core.Settings(method="fmm", **options), *POINTS)


def last(measured, gathered, method="fmm", particles=1000, high=None, rays=100):
    error = {"measured_rms": measured, "high": high or 1.2 * measured, "gathered": gathered}
    return error | {"method": method, "particles": particles, "rays": rays}


@pytest.mark.parametrize("target", [0.05, 0.01])
def test_the_target_is_met_with_no_other_setting(exact, target):  # noqa: F811
    solution, found = baked(target_error=target)
    report = solution.report
    assert np.linalg.norm(found - exact) / np.linalg.norm(exact) < 1.2 * target
    assert report["error"]["measured_rms"] == report["rounds"][-1]["measured_rms"] <= target
    assert not report["warnings"]
    first = fmm_core.Settings(target_error=target).begin()
    assert (report["rounds"][0]["rays"], report["rounds"][0]["truncation"]) == (first.rays, first.truncation)
    assert report["settings"]["rays"] == report["rounds"][-1]["rays"]
    assert report["seconds"]["total"] == pytest.approx(report["rounds"][-1]["seconds"])


def test_a_lower_target_begins_with_more_rays_and_a_larger_p():
    many, few = (fmm_core.Settings(target_error=target).begin() for target in (0.01, 0.05))
    assert many.rays > 2 * few.rays
    assert many.truncation > few.truncation


@pytest.mark.parametrize(
    ("rounds", "met"),
    [
        ([(0.012, 0.014)], False),
        ([(0.009, 0.011)], True),
        ([(0.009, 0.02)], False),
        ([(0.009, 0.02), (0.008, 0.02)], True),
        ([(0.012, 0.02), (0.008, 0.02)], False),
    ],
)
def test_a_target_is_met_surely_or_twice(rounds, met):
    assert _met([{"measured_rms": measured, "high": high} for measured, high in rounds], 0.01) == met


def test_settings_that_are_given_stay_and_a_target_that_they_forbid_is_told():
    solution, _ = baked(target_error=0.01, rays=30, truncation=2, particles=1000, probes=0)
    report = solution.report
    assert [report["settings"][name] for name in ("rays", "truncation", "particles")] == [30, 2, 1000]
    assert ["nothing is left to raise" in text for text in report["warnings"]] == [True]
    assert report["error"]["measured_rms"] > 0.01


def test_the_direct_method_takes_more_particles():
    asked = fmm_core.Settings(method="direct", target_error=0.01)
    raised = better(asked, asked.begin(), last(0.02, 0.015, method="direct"), None)
    assert raised.particles > 2000
    assert raised.truncation == asked.begin().truncation


def test_what_is_raised_is_what_the_error_comes_from():
    asked = fmm_core.Settings(target_error=0.01)
    used = asked.begin()
    grainy = better(asked, used, last(0.03, 0.03), None)
    assert grainy.rays > 3 * used.rays
    assert grainy.particles is None
    coarse = better(asked, used, last(0.03, 0.004), None)
    assert coarse.particles > 2000
    assert coarse.truncation == used.truncation + 1
    stuck = better(asked, grainy, last(0.03, 0.03), last(0.03, 0.031, rays=used.rays))
    assert stuck.particles > 2000
    assert stuck.rays == used.rays


def test_particles_are_no_cure_for_few_rays_that_are_given():
    asked = fmm_core.Settings(target_error=0.01, rays=30)
    used = asked.begin()
    finer = better(asked, used, last(0.0272, 0.027, rays=30), None)
    assert finer == replace(used, truncation=used.truncation + 1)
    assert better(asked, finer, last(0.0271, 0.027, rays=30), last(0.0272, 0.027, rays=30)) == finer
    coarse = better(asked, finer, last(0.1, 0.1, rays=30), last(0.1, 0.1, rays=30))
    assert coarse.particles > 2000


def test_nothing_is_left_to_raise_where_rays_do_not_help_and_particles_are_as_many_as_may_be():
    asked = fmm_core.Settings(target_error=0.01)
    most = replace(asked.begin(), particles=MOST_PARTICLES)
    grainy = better(asked, most, last(0.03, 0.03), None)
    assert grainy.rays > most.rays
    assert better(asked, grainy, last(0.03, 0.03), last(0.03, 0.031)) == grainy
    assert better(asked, grainy, last(0.03, 0.015), last(0.03, 0.031)) != grainy


@pytest.mark.parametrize("method", ["direct", "fmm"])
def test_what_is_met_but_not_surely_is_raised_by_how_wrong_it_may_be(method):
    asked = fmm_core.Settings(method=method, target_error=0.01)
    near, far = (better(asked, asked.begin(), last(0.008, 0.008, method, high=high), None) for high in (0.013, 0.03))
    assert far.particles > 5000
    assert near.particles < 0.6 * far.particles


def test_defaults_are_those_of_before_where_there_is_no_target():
    used = fmm_core.Settings().begin()
    assert (used.truncation, used.rays) == (4, 200)
    assert fmm_core.Settings(truncation=7, target_error=0.01).begin().truncation == 7
