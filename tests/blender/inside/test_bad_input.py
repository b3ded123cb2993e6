# SPDX-License-Identifier: GPL-3.0-or-later
"""Bad scenes and bad arguments: the exit status, one line that names what is wrong, and nothing half-written."""

import bpy
import pytest


@pytest.fixture(autouse=True)
def few_particles(empty):
    bpy.context.scene.fmm_radiosity.particles = 300


def not_finite(build):
    build.quad("Lamp", build.light())
    build.quad("Broken").data.vertices[2].co.y = float("nan")


def no_mesh(build):
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Nothing", None))


def empty_mesh(build):
    build.object("Hollow", [(0, 0, 0), (1, 0, 0)], [])


def no_emitter(build):
    build.quad("Unlit")


def no_area(build):
    build.object("Line", [(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2)], build.light())


def name_taken(build):
    build.quad("Lamp", build.light()).data.attributes.new("Radiosity", "FLOAT", "POINT")


@pytest.mark.parametrize(
    ("scene", "named"),
    [
        (not_finite, ("'Broken'", "vertex 2", "nan")),
        (no_mesh, ("no mesh", "'Scene'")),
        (empty_mesh, ("'Hollow'", "no faces")),
        (no_emitter, ("gives off light", "Emission")),
        (no_area, ("'Line'", "1 face without area")),
        (name_taken, ("'Lamp'", "'Radiosity'", "FLOAT")),
    ],
)
def test_bad_scene(build, command, tmp_path, scene, named):
    scene(build)
    path = tmp_path / "bad.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    status, lines = command("bake", path, "-o", tmp_path / "new" / "out.blend", "--report", tmp_path / "out.json")
    assert status == 1
    assert len(lines) == 1
    assert lines[0].startswith("fmm-radiosity: error: ")
    assert all(part in lines[0] for part in named), lines
    assert [item.name for item in tmp_path.iterdir()] == ["bad.blend"]


def test_good_faces_beside_bad_ones_are_baked(build, command, tmp_path):
    build.quad("Lamp", build.light(), z=1, down=True)
    build.object("Torn", [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)])
    build.object("Hollow", [(0, 0, 0)], [])
    path = tmp_path / "fair.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    assert command("bake", path, "-o", tmp_path / "out.blend") == (
        0,
        [
            "fmm-radiosity: warning: object 'Torn': 1 face without area left out",
            "fmm-radiosity: warning: object 'Hollow' has no faces: left out",
        ],
    )


@pytest.mark.parametrize("content", [b"", b"no blend file at all", b"BLENDER-v402RENDH_\x00\x00" * 9])
def test_unreadable_file(command, tmp_path, content):
    path = tmp_path / "bad.blend"
    path.write_bytes(content)
    status, lines = command("bake", path, "-o", tmp_path / "out.blend")
    assert (status, len(lines)) == (1, 1)
    assert f"cannot read '{path}'" in lines[0]
    assert [item.name for item in tmp_path.iterdir()] == ["bad.blend"]


def test_cut_off_file(build, command, tmp_path):
    build.room()
    path = tmp_path / "bad.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=False)
    path.write_bytes(path.read_bytes()[:10_000])
    status, lines = command("bake", path, "-o", tmp_path / "out.blend")
    assert (status, len(lines)) == (1, 1)
    assert f"cannot read '{path}'" in lines[0]


def test_missing_file(command, tmp_path):
    assert command("bake", tmp_path / "none.blend", "-o", tmp_path / "out.blend") == (
        1,
        [f"fmm-radiosity: error: cannot read '{tmp_path / 'none.blend'}': no such file"],
    )


@pytest.mark.parametrize("option", ["-o", "--report", "--preview"])
def test_unwritable_output_is_found_before_the_solve(build, command, tmp_path, option):
    build.room()
    path, blocked = tmp_path / "room.blend", tmp_path / "file" / "out.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    (tmp_path / "file").write_text("in the way")
    outputs = {"-o": tmp_path / "out.blend", option: blocked}
    status, lines = command("bake", path, *(word for pair in outputs.items() for word in pair))
    assert (status, len(lines)) == (1, 1)
    assert f"cannot write '{blocked}'" in lines[0]
    assert sorted(item.name for item in tmp_path.iterdir()) == ["file", "room.blend"]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ([], "command"),
        (["bake"], "-o"),
        (["fry", "-o", "x.blend"], "fry"),
        (["bake", "-o", "x.blend", "-p", "many"], "many"),
        (["bake", "-o", "x.blend", "-p", "21"], "truncation"),
        (["bake", "-o", "x.blend", "-s", "0"], "grouping"),
        (["bake", "-o", "x.blend", "--particles", "-5"], "particles"),
        (["bake", "-o", "x.blend", "--target-error", "nan"], "target_error"),
        (["bake", "-o", "x.blend", "--method", "guess"], "guess"),
        (["bake", "-o", "x.txt"], "x.txt"),
        (["bake", "-o", "x.blend", "--report", "x.blend"], "--report"),
        (["bake", "-o", "x.blend", "--bogus"], "--bogus"),
    ],
)
def test_bad_arguments(command, arguments, named):
    status, lines = command(*arguments)
    assert (status, len(lines)) == (2, 1)
    assert lines[0].startswith("fmm-radiosity: error: ")
    assert named in lines[0]


def test_no_scene_at_all(command, tmp_path):
    status, lines = command("bake", "-o", tmp_path / "out.blend")
    assert (status, lines) == (1, ["fmm-radiosity: error: no scene: name a .blend file to read"])


def test_help(command):
    assert command("bake", "--help")[0] == 0
