# SPDX-License-Identifier: GPL-3.0-or-later
"""Each kind of lamp and sky over a plane with a blocker: the same numbers as Cycles, absolutely."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "tests/cycles/bake_lights.py"
NAMES = re.findall(r'^    "([a-z ]+)": ', SCRIPT.read_text(), re.MULTILINE)


def bake_all(folder, faces, samples):
    out = folder / "lights.npz"
    command = [sys.executable, SCRIPT, out, str(faces), str(samples)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return np.load(out)


@pytest.fixture(scope="module")
def coarse(tmp_path_factory):
    return bake_all(tmp_path_factory.mktemp("coarse"), 12, 512)


@pytest.fixture(scope="module")
def fine(tmp_path_factory):
    return bake_all(tmp_path_factory.mktemp("fine"), 40, 2048)


def difference(baked, name):
    """Relative L2 difference from Cycles: the noise of two seeds is independent, so it drops out of their product."""
    ours, (first, second) = baked[f"{name} ours"], baked[f"{name} cycles"]
    assert len(ours) > 300
    squared = ((ours - first) * (ours - second)).sum() / (first * second).sum()
    sys.stdout.write(f"{name}: {100 * np.sqrt(max(squared, 0)):.2f} % off Cycles\n")
    return squared


@pytest.mark.parametrize("name", NAMES)
def test_lamps_and_skies_agree_with_cycles_once_its_noise_is_taken_out(coarse, name):
    assert difference(coarse, name) < 0.01**2


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_they_agree_on_a_fine_mesh(fine, name):
    assert difference(fine, name) < 0.01**2
