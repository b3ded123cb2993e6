# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark against Cycles still runs, and both engines get the same scene; its figures are not judged here."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "cycles.py"


@pytest.mark.parametrize("scene", ["cornell", "clutter"])
def test_benchmark_compares_one_small_scene_of_both_engines(scene, tmp_path):
    options = ["--scene", scene, "--vertices", "2500", "--objects", "4", "--truth-particles", "3000", "--sample", "400"]
    command = [sys.executable, BENCHMARK, "--json", "--samples", "2", "8", "--cache", tmp_path, *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    first, second, ours, both, coarser, near_good = json.loads(done.stdout)
    assert 0.03 < second["l2_error"] < first["l2_error"] < 1
    assert ours["l2_error"] < 0.03
    assert abs(both["cycles_brighter_by"]) < 0.02
    assert both["equal_samples"] == pytest.approx((both["error_of_one_sample"] / ours["l2_error"]) ** 2)
    at_bake = both["start_seconds"] + both["seconds_a_sample"] * second["samples"]
    assert at_bake == pytest.approx(second["seconds"])
    assert both["equal_ratio"] == pytest.approx(both["equal_seconds"] / ours["seconds"])
    assert coarser["rays"] == near_good["rays"] < ours["rays"]
    assert near_good["equal_samples"] == pytest.approx((both["error_of_one_sample"] / coarser["l2_error"]) ** 2)
    assert list(tmp_path.iterdir())
