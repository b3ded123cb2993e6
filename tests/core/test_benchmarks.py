# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmarks still run, on a few particles; what they measure is not judged here."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import fmm_core
import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def run(name, *options):
    return run_whole(name, "--small", *options, timeout=120)


def run_whole(name, *options, timeout):
    command = [sys.executable, BENCHMARKS / f"{name}.py", *options]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)


@pytest.mark.parametrize("name", ["growth", "accuracy"])
def test_benchmark_prints_its_table_and_saves_its_picture(name, tmp_path):
    table, picture = tmp_path / "table.json", tmp_path / "picture.png"
    done = run(name, "--json", table, "--picture", picture)
    assert done.returncode == 0, done.stderr
    assert "L2 error" in done.stdout
    rows = json.loads(table.read_text())["rows"]
    assert all(0 <= row["relative_l2"] < 2 and row["application"] > 0 for row in rows)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_postponement_prints_its_table_and_saves_its_picture(tmp_path):
    table, picture = tmp_path / "table.json", tmp_path / "picture.png"
    done = run("postponement", "--json", table, "--picture", picture)
    assert done.returncode == 0, done.stderr
    assert "alpha" in done.stdout
    rows = json.loads(table.read_text())["rows"]
    assert {(row["scene"], row["visibility"]) for row in rows} >= {("empty", "cells"), ("two blocks", "rays")}
    assert all(0 <= row["share"] < 1 and (row["alpha"] > 0) == (row["scene"] != "empty") for row in rows)
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.skipif(importlib.util.find_spec("fmm3dpy") is not None, reason="fmm3dpy is installed")
def test_comparison_says_in_one_line_what_is_missing():
    done = run("fmm3d")
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "fmm3dpy is missing" in done.stderr


def test_fitted_colours_are_nearer_to_the_light_on_the_faces_than_those_at_vertices():
    done = run("vertex_fit", "--json")
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)
    assert len(rows) == 2
    assert all(0 < row["fit_l2_error"] < 0.85 * row["points_l2_error"] < 0.1 for row in rows)


def test_effects_are_compared_with_and_without():
    done = run("effects", "--json")
    assert done.returncode == 0, done.stderr
    table = json.loads(done.stdout)
    rows = {row["effect"]: row for row in table if "effect" in row}
    assert list(rows) == list(fmm_core.EFFECTS)
    assert rows["occlusion"]["rays_without"] == 0 < rows["occlusion"]["rays_with"]
    assert rows["sky"]["rays_without"] < rows["sky"]["rays_with"]
    plans = [row for row in table if "plan_share" in row]
    assert len(plans) > 3
    assert all(0 < row["plan_share"] < 1 for row in plans)


def test_shipped_scenes_can_be_read():
    code = "import examples; scene, at = examples.example('cornell_box'); print(len(scene.triangles), *map(len, at))"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=BENCHMARKS, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    triangles, points, normals = map(int, done.stdout.splitlines()[-1].split())
    assert triangles > 1000
    assert points == normals > 1000


@pytest.mark.slow
def test_the_measured_error_is_the_true_one_in_all_scenes_and_takes_a_quarter_of_a_bake(tmp_path):
    table = tmp_path / "table.json"
    done = run_whole("measured_error", "--json", table, timeout=3000)
    assert done.returncode == 0, done.stderr
    rows = json.loads(table.read_text())
    assert all(300 <= row["probes"] <= 1000 and row["true"] > 0 for row in rows)
    assert len({row["name"].split(",")[0] for row in rows}) >= 10
    assert {row["name"]: row["ratio"] for row in rows if not 1 / 1.5 < row["ratio"] < 1.5} == {}
    # A bake of a third of a second is not worth a measurement that says nothing.
    assert {row["name"]: row["share"] for row in rows if row["share"] > 0.25 and row["seconds"] > 1} == {}


def test_measured_and_true_error_are_compared(tmp_path):
    table = tmp_path / "table.json"
    done = run("measured_error", "--json", table)
    assert done.returncode == 0, done.stderr
    (row,) = json.loads(table.read_text())
    assert row["judged"] == 4000
    assert 0 < row["low"] <= row["measured_rms"] <= row["high"]
    assert row["ratio"] == pytest.approx(row["measured_rms"] / row["true"])


def test_bakes_to_a_target_are_compared_with_it(tmp_path):
    table = tmp_path / "table.json"
    done = run("target_error", "--targets", "0.05", "--json", table)
    assert done.returncode == 0, done.stderr
    (row,) = json.loads(table.read_text())
    assert 0 < row["true"] == pytest.approx(0.05 * row["over"])
    assert row["measured_rms"] < 0.05


def test_frames_are_compared_with_frames_alone(tmp_path):
    table = tmp_path / "table.json"
    done = run("frames", "--json", table)
    assert done.returncode == 0, done.stderr
    rows = json.loads(table.read_text())
    assert [row["frame"] for row in rows] == [1, 2, 3]
    assert all(0 < rows[2][f"{name}_error"] < 0.2 for name in ("alone", "followed"))
    assert rows[2]["followed_rays"] < 0.7 * rows[2]["alone_rays"]
