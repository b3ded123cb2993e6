# SPDX-License-Identifier: GPL-3.0-or-later
"""What a camera sees of a glossy floor: the same numbers as Cycles, absolutely."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def baked(tmp_path_factory):
    out = tmp_path_factory.mktemp("gloss") / "gloss.npz"
    command = [sys.executable, ROOT / "tests/cycles/bake_gloss.py", out, "256"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return np.load(out)


def difference(baked, name, ours="ours"):
    """Relative L2 difference from Cycles: the noise of two seeds is independent, so it drops out of their product."""
    found, (first, second) = baked[f"{name} {ours}"], baked[f"{name} cycles"]
    assert len(found) > 300
    off = np.sqrt(max(((found - first) * (found - second)).sum() / (first * second).sum(), 0.0))
    sys.stdout.write(f"{name}: {ours} {100 * off:.2f} % off Cycles\n")
    return off


@pytest.mark.parametrize("material", ["plastic", "metal"])
@pytest.mark.parametrize(("light", "bound"), [("area", 0.02), ("sun", 0.01), ("emitter", 0.02), ("sky", 0.01)])
def test_gloss_agrees_with_cycles_once_its_noise_is_taken_out(baked, light, material, bound):
    assert difference(baked, f"{light} {material}") < bound
    assert difference(baked, f"{light} {material}", "dull") > 2 * bound


@pytest.mark.parametrize(("material", "bound"), [("plastic", 0.01), ("metal", 0.1)])
def test_light_that_gloss_sends_to_a_wall_counts_as_diffuse(baked, material, bound):
    """So a metal floor that sees in itself a wall, which shines in its light, is a little off."""
    assert difference(baked, f"wall {material}") < bound
