# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes that use what an earlier one found: of the same session, and of a file beside the .blend."""

import json

import bpy
import fmm_core
import numpy as np
import pytest
from scenes import baked


@pytest.fixture(autouse=True)
def few_particles(empty):
    bpy.context.scene.fmm_radiosity.particles = 300


@pytest.fixture
def bake(fmm):
    """Bakes by the operator; returns the colours and the report."""

    def bake():
        assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
        return all_baked(), fmm.session.session.report

    return bake


@pytest.fixture
def room(build, tmp_path):
    """A saved scene that bakes."""
    build.room()
    path = tmp_path / "room.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


@pytest.fixture
def from_command(command, tmp_path):
    """Bakes a file by the command line with the option; returns the colours, the report and the lines on stderr."""

    def run(path, *options):
        status, lines = command("bake", path, "-o", tmp_path / "out" / "out.blend", "--report", tmp_path / "out.json",
                                *options)  # fmt: skip
        assert status == 0, lines
        return all_baked(), json.loads((tmp_path / "out.json").read_text()), lines

    return run


def all_baked():
    return {mesh.name: baked(mesh) for mesh in bpy.data.meshes}


def same(a, b, rtol=0.0):
    return a.keys() == b.keys() and all(np.allclose(a[name], b[name], rtol=rtol, atol=0) for name in a)


def change_lights(radiance=(1.0, 4.0, 2.0), albedo=(0.2, 0.6, 0.3, 1.0)):
    bpy.data.materials["Glow"].node_tree.nodes["Emission"].inputs["Color"].default_value = (*radiance, 1.0)
    bpy.data.materials["Red"].node_tree.nodes["Diffuse BSDF"].inputs["Color"].default_value = albedo


def forget(fmm):
    fmm.session.session.solution = None


def test_bake_with_other_lights_and_colours_traces_no_ray(build, fmm, bake):
    build.room()
    before, report = bake()
    assert report["counts"]["rays"] > 0
    assert "kept" not in fmm.report.summary(report)
    change_lights()
    after, report = bake()
    assert report["counts"]["rays"] == 0
    assert fmm.report.summary(report).endswith(", visibility kept")
    assert report["warnings"] == []
    assert not same(after, before, rtol=0.1)
    forget(fmm)
    fresh, report = bake()
    assert report["counts"]["rays"] > 0
    assert same(after, fresh, rtol=1e-3)


def test_other_geometry_settings_or_emitters_are_solved_anew(build, fmm, bake):
    build.room()
    bake()

    def moved():
        bpy.data.objects["Box"].location.z += 0.1

    def resampled():
        bpy.context.scene.fmm_radiosity.particles = 500

    def another_emitter():
        bpy.data.objects["Box"].data.materials[0] = build.light("Second", (1.0, 1.0, 1.0))

    for change in (moved, resampled, another_emitter):
        change()
        bpy.context.view_layer.update()
        found, report = bake()
        assert report["counts"]["rays"] > 0, change
        forget(fmm)
        assert same(found, bake()[0]), change


def test_smooth_shading_is_gathered_anew(build, fmm, bake):
    build.room()
    grey = build.material("Grey")
    ball = build.ball("Ball", grey)
    ball.location = (2, 2, 1)
    before, _ = bake()
    ball.data.polygons.foreach_set("use_smooth", [False] * len(ball.data.polygons))
    ball.data.update()
    found, report = bake()
    assert report["counts"]["rays"] > 0
    assert found["Ball"].shape != before["Ball"].shape
    forget(fmm)
    assert same(found, bake()[0])


def test_cancelled_bakes_leave_a_solution_that_is_right(build, fmm, bake):
    build.room()
    bake()
    session, settings = fmm.session.session, fmm.properties.settings_of(bpy.context.scene)
    change_lights()
    for move, last in ((False, 0.0), (False, 0.1), (True, 0.1), (True, 0.8)):
        bpy.data.objects["Box"].location.x += 0.1 * move
        bpy.context.view_layer.update()
        with pytest.raises(fmm_core.Cancelled):
            fmm.bake.bake(bpy.context, settings, lambda fraction, text, last=last: fraction <= last, session=session)
    found, _ = bake()
    forget(fmm)
    assert same(found, bake()[0], rtol=1e-3)


def test_solution_goes_with_the_file(build, fmm, bake):
    build.room()
    bake()
    assert fmm.session.session.solution is not None
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert fmm.session.session.solution is None


def test_option_keeps_visibility_beside_the_scene(room, fmm, from_command, tmp_path):
    kept = tmp_path / "room.fmm-visibility"
    before, report, lines = from_command(room)
    assert not kept.exists()
    first, report, lines = from_command(room, "--keep-visibility")
    assert (report["counts"]["rays"] > 0, lines) == (True, [])
    assert same(first, before)
    names = ["out", "out.json", "room.blend", kept.name]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    again, report, lines = from_command(room, "--keep-visibility")
    assert (report["counts"]["rays"], lines) == (0, [])
    assert same(again, first)

    change_lights()
    bpy.ops.wm.save_as_mainfile(filepath=str(room))
    written = kept.read_bytes()
    relit, report, lines = from_command(room, "--keep-visibility")
    assert (report["counts"]["rays"], lines) == (0, [])
    assert kept.read_bytes() == written
    fresh, report, lines = from_command(room)
    assert report["counts"]["rays"] > 0
    assert same(relit, fresh, rtol=1e-3)


def test_files_that_do_not_fit_are_computed_anew_with_a_warning(room, from_command, tmp_path):
    kept = tmp_path / "room.fmm-visibility"
    expected, _, _ = from_command(room, "--keep-visibility")
    kept.write_bytes(kept.read_bytes()[:-100])
    found, report, lines = from_command(room, "--keep-visibility")
    assert len(lines) == 1
    assert f"warning: kept visibility '{kept}' is damaged" in lines[0]
    assert report["counts"]["rays"] > 0
    assert same(found, expected)
    assert from_command(room, "--keep-visibility")[1]["counts"]["rays"] == 0

    bpy.data.objects["Box"].location.z += 0.1
    bpy.ops.wm.save_as_mainfile(filepath=str(room))
    found, report, lines = from_command(room, "--keep-visibility")
    assert [line.split("warning: ")[1] for line in lines] == [
        "the kept visibility is of other geometry and is computed anew"
    ]
    assert same(found, from_command(room)[0])
    assert from_command(room, "--keep-visibility")[1]["counts"]["rays"] == 0


def test_file_that_cannot_be_written_is_a_warning(room, from_command, tmp_path):
    (tmp_path / "room.fmm-visibility").mkdir()
    expected, _, _ = from_command(room)
    found, _, lines = from_command(room, "--keep-visibility")
    assert same(found, expected)
    assert len(lines) == 2
    assert "cannot read" in lines[0]
    assert "visibility is not kept: cannot write" in lines[1]


def test_panel_keeps_visibility_for_the_next_session(room, fmm, bake, tmp_path):
    bpy.context.scene.fmm_radiosity.keep_visibility = True
    first, report = bake()
    assert report["counts"]["rays"] > 0
    assert (tmp_path / "room.fmm-visibility").exists()
    forget(fmm)
    again, report = bake()
    assert report["counts"]["rays"] == 0
    assert same(again, first)


def test_panel_keeps_visibility_that_was_switched_on_later(room, bake, tmp_path):
    bake()
    bpy.context.scene.fmm_radiosity.keep_visibility = True
    assert bake()[1]["counts"]["rays"] > 0
    (tmp_path / "room.fmm-visibility").unlink()
    assert bake()[1]["counts"]["rays"] == 0
    assert (tmp_path / "room.fmm-visibility").exists()


def test_option_saved_in_the_scene_counts_on_the_command_line(room, from_command, tmp_path):
    bpy.context.scene.fmm_radiosity.keep_visibility = True
    bpy.ops.wm.save_as_mainfile(filepath=str(room))
    from_command(room)
    assert (tmp_path / "room.fmm-visibility").exists()


def test_unsaved_scene_has_no_place_for_the_file(build, bake):
    build.room()
    bpy.context.scene.fmm_radiosity.keep_visibility = True
    _, report = bake()
    assert report["warnings"] == ["visibility is not kept: save the .blend first, the file goes beside it"]
