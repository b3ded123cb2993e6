# SPDX-License-Identifier: GPL-3.0-or-later
"""`fmm-radiosity` in the repository's own environment."""

import json
import math
import subprocess
import sys

import pytest


def test_help_needs_no_blender(run):
    done = run("bake", "--help", after="assert 'bpy' not in sys.modules")
    assert (done.returncode, done.stderr) == (0, "")
    assert "--target-error" in done.stdout


@pytest.mark.parametrize(
    "arguments",
    [
        ("bake", "-o", "x.blend"),
        ("bake", "a.blend", "-o", "b.blend", "-p", "99"),
        ("bake", "a.blend", "-o", "b.blend", "--without", "fog"),
    ],
)
def test_bad_arguments_need_no_blender(run, arguments):
    done = run(*arguments, after="assert 'bpy' not in sys.modules")
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)


def test_missing_scene(run):
    done = run("bake", "none.blend", "-o", "out.blend")
    assert done.returncode == 1
    assert done.stderr == "fmm-radiosity: error: cannot read 'none.blend': no such file\n"
    assert done.stdout == ""


def test_bake_of_an_example(run, colours, root, tmp_path):
    scene, out = root / "examples" / "cornell_empty.blend", tmp_path / "out.blend"
    effects = "--without", "sky", "--with", "occlusion"
    done = run("bake", scene, "-o", out, "--particles", "1", *effects, "--report", tmp_path / "out.json")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"{out}: ")
    report = json.loads((tmp_path / "out.json").read_text())
    assert report["version"] == 1
    assert report["warnings"] == []
    assert report["settings"]["effects"] == {"occlusion": True, "sky": False}
    assert report["effects"]["occlusion"]["used"]
    assert report["seconds"]["export"] > 0
    assert report["seconds"]["total"] >= report["seconds"]["export"] + report["seconds"]["write"]
    radiance = colours(out)
    assert [len(values) > 0 for values in radiance.values()] == [True, True]
    for values in radiance.values():
        assert all(math.isfinite(value) and value >= 0 for value in values)
        assert max(values) > 0.1
    # Red and green walls beside white ones: what is written is more than one colour.
    assert len(set(radiance["Room"])) > 1000


DRIVEN = """
import bpy, sys
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
driver = bpy.data.objects["Room"].driver_add("location", 0).driver
# Not one of the expressions that Blender reads without Python.
driver.expression = "max([0.0, 0.0])"
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[2])
bpy.app.driver_namespace.clear()
"""


def test_a_driver_in_python_does_not_spoil_the_exit_status(run, root, tmp_path):
    scene, driven = root / "examples" / "cornell_empty.blend", tmp_path / "driven.blend"
    subprocess.run([sys.executable, "-c", DRIVEN, str(scene), str(driven)], check=True, capture_output=True)
    done = run("bake", driven, "-o", tmp_path / "out.blend", "--particles", "1", "--probes", "0")
    assert (done.returncode, done.stderr) == (0, "")
