# SPDX-License-Identifier: GPL-3.0-or-later
"""A look at the scene without a bake."""

import bpy
import pytest


@pytest.fixture
def session(fmm):
    fmm.session.session.forget()
    return fmm.session.session


def test_check_tells_what_a_bake_would_do_and_bakes_nothing(build, session):
    build.room()
    bpy.context.scene.fmm_radiosity.particles = 300
    bpy.context.scene.fmm_radiosity.without = {"colour"}
    assert bpy.ops.fmm_radiosity.check() == {"FINISHED"}
    planned = session.effects
    assert planned["occlusion"]["used"]
    assert not planned["lamps"]["used"]
    assert "switched off" in planned["colour"]["why"]
    assert session.report is None
    assert all("Radiosity" not in mesh.attributes for mesh in bpy.data.meshes)
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    assert session.report["effects"] == planned == session.effects


def test_check_says_what_is_missing(build, session):
    build.cube("Box")
    with pytest.raises(RuntimeError, match="nothing in scene 'Scene' gives off light: add a lamp"):
        bpy.ops.fmm_radiosity.check()
    assert session.effects is None


def test_nothing_is_remembered_of_another_file(build, session):
    build.room()
    assert bpy.ops.fmm_radiosity.check() == {"FINISHED"}
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    assert session.effects is None


def test_an_error_too_small_to_be_told_is_below_a_figure(fmm):
    error = {"measured_rms": 0.0, "low": 0.0, "high": 0.0}
    assert fmm.report.measured(error) == "below 0.01 %"
    error = {"measured_rms": 0.004, "low": 0.0031, "high": 0.005}
    assert fmm.report.measured(error) == "0.4 % (0.31 % to 0.5 %)"
