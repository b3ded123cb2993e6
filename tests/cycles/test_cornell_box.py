# SPDX-License-Identifier: GPL-3.0-or-later
"""The bake of the Cornell box against Cycles' bake of the same file."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]


def bake_both(tmp_path, samples, seeds):
    out = tmp_path / "both.npz"
    script, scene = ROOT / "tests/cycles/bake_both.py", ROOT / "examples/cornell_box.blend"
    command = [sys.executable, script, scene, str(samples), str(seeds), out]
    subprocess.run(command, check=True, cwd=ROOT, capture_output=True)
    arrays = np.load(out)
    inside = arrays["inside"]
    return arrays["ours"][inside], arrays["cycles"][:, inside]


def test_irradiance_agrees_with_cycles_once_its_noise_is_taken_out(tmp_path):
    ours, (first, second) = bake_both(tmp_path, samples=64, seeds=2)
    assert len(ours) > 10_000
    # The noise of two seeds is independent, so it drops out of the mean product of both differences.
    squared = ((ours - first) * (ours - second)).sum() / (first * second).sum()
    assert squared < 0.01**2
    assert ours.mean(axis=0) == pytest.approx((first + second).mean(axis=0) / 2, rel=0.003)


@pytest.mark.slow
def test_irradiance_is_within_two_percent_of_cycles_at_4096_samples(tmp_path):
    ours, (cycles,) = bake_both(tmp_path, samples=4096, seeds=1)
    error = np.linalg.norm(ours - cycles) / np.linalg.norm(cycles)
    sys.stdout.write(f"relative L2 difference from Cycles at 4,096 samples: {100 * error:.2f} %\n")
    assert error < 0.02
