# SPDX-License-Identifier: GPL-3.0-or-later
"""A study judges its bakes rightly, and recommends what it should."""

import fmm_core
import numpy as np
import pytest
from fmm_core import study as studies
from fmm_core.study import Bake, Judge, judge, study
from test_accuracy import POINTS, SCENE

SETTINGS = fmm_core.Settings(particles=3000, target_error=0.02)


@pytest.fixture
def short(monkeypatch):
    """Few bakes."""
    tried = {"ALL_RAYS": (10, 400), "ALL_TRUNCATIONS": (0, 4), "ALL_GROUPINGS": (32, 64), "PAPER_RAYS": (50,)}
    for name, values in tried.items():
        monkeypatch.setattr(studies, name, values)


@pytest.fixture(scope="module")
def truth():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(studies, "TRUTH_RAYS", 512)
        patch.setattr(studies, "TRUTH_PARTICLE_RAYS", 300_000)
        return judge(SCENE, SETTINGS, *POINTS, range(0, len(POINTS[0]), 2))


def test_the_truth_is_that_of_the_direct_method(truth):
    fine = fmm_core.solve(SCENE, fmm_core.Settings(method="direct", particles=6000, probes=0))
    found = fine.irradiance(POINTS[0][truth.rows], POINTS[1][truth.rows])
    assert (truth.rows % 2 == 0).all()
    assert truth.error(found) < 0.01
    assert truth.error(1.05 * found) == pytest.approx(0.05, abs=0.01)


def test_noise_of_the_truth_drops_out():
    rng = np.random.default_rng(0)
    noise = rng.normal(0.0, 0.1, (2, 20_000, 3))
    assert Judge(np.arange(20_000), 1.0 + noise).error(np.full((20_000, 3), 1.02)) == pytest.approx(0.02, rel=0.2)


def test_a_study_bakes_with_all_settings_and_recommends_one_that_meets_the_target(short, truth):
    seen = []
    done = study(SCENE, SETTINGS, *POINTS, truth, lambda fraction, text: seen.append(fraction))
    bakes = {name: [bake for bake in done.bakes if bake.series == name] for name in {b.series for b in done.bakes}}
    assert [bake.rays for bake in bakes["rays"]] == [10, 400]
    assert bakes["rays"][1].error < 0.5 * bakes["rays"][0].error
    assert [bake.truncation for bake in bakes["p"]] == [0, 4]
    assert bakes["p"][1].error < 0.5 * bakes["p"][0].error
    assert [bake.grouping for bake in bakes["s"]] == [32, 64]
    assert {bake.rays for bake in bakes["p"] + bakes["s"]} == {400}
    assert bakes["paper"][0].truncation == 2
    assert bakes["brute force"][0].error < 0.02
    assert done.best.error <= done.target == 0.02
    assert done.best in (*bakes["s"], *bakes["brute force"])
    assert "2 %" in done.why
    assert seen == sorted(seen)


def test_a_study_can_be_cancelled(short, truth):
    with pytest.raises(fmm_core.Cancelled):
        study(SCENE, SETTINGS, *POINTS, truth, lambda fraction, text: fraction < 0.2)


def test_too_large_scenes_are_not_baked_by_brute_force(short, truth, monkeypatch):
    for name, value in (("ALL_RAYS", 20), ("ALL_TRUNCATIONS", 1), ("ALL_GROUPINGS", 64)):
        monkeypatch.setattr(studies, name, (value,))
    monkeypatch.setattr(studies, "PAPER_RAYS", ())
    monkeypatch.setattr(studies, "MOST_DIRECT", 10)
    done = study(SCENE, SETTINGS, *POINTS, truth)
    assert not any(bake.series == "brute force" for bake in done.bakes)
    assert "triangles are too many" in done.skipped[0]


def test_what_is_enough():
    bakes = [Bake("rays", seconds, error) for seconds, error in ((1, 0.05), (2, 0.012), (3, 0.0095), (4, 0.009))]
    assert studies._fewest(bakes, 0.02) == bakes[1]
    assert studies._fewest(bakes, 0.01) == bakes[2]
    # Nothing meets it: the fewest of those that are about as good as the best.
    assert studies._fewest(bakes, 0.001) == bakes[2]
    assert studies._fastest(bakes[::-1], 0.02) == bakes[1]
