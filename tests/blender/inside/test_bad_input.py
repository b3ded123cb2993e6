# SPDX-License-Identifier: GPL-3.0-or-later
"""Bad scenes and bad arguments: the exit status, one line that names what is wrong, and nothing half-written."""

import contextlib
import os
import shutil
import subprocess
import warnings

import bpy
import pytest

NAME_MAX = 255


@pytest.fixture(autouse=True)
def few_particles(empty):
    bpy.context.scene.fmm_radiosity.particles = 300


@pytest.fixture
def room(build, tmp_path):
    """A saved scene that bakes."""
    build.room()
    path = tmp_path / "room.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


@pytest.fixture
def small_disk(tmp_path):
    """A disk of its own with 100 KiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=100k", "tmpfs", str(folder)]
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("mounting a small disk is not allowed here")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def not_finite(build):
    build.quad("Lamp", build.light())
    build.quad("Broken").data.vertices[2].co.y = float("nan")


def far_away(build):
    build.quad("Lamp", build.light())
    build.quad("Lost").data.vertices[2].co.y = float("inf")


def no_mesh(build):
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Nothing", None))


def empty_mesh(build):
    build.object("Hollow", [(0, 0, 0), (1, 0, 0)], [])


def no_emitter(build):
    build.quad("Unlit")


def no_area(build):
    build.object("Line", [(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2)], build.light())


def only_emitter_without_area(build):
    no_area(build)
    build.quad("Unlit")


def too_bright(build):
    build.quad("Lamp", build.material("Nova", "ShaderNodeEmission", Strength=3e38))


def infinitely_bright(build):
    build.quad("Lamp", build.material("Nova", "ShaderNodeEmission", Strength=float("inf")))


def name_taken(build):
    build.quad("Lamp", build.light()).data.attributes.new("Radiosity", "FLOAT", "POINT")


@pytest.mark.parametrize(
    ("scene", "named"),
    [
        (not_finite, ("'Broken'", "vertex 2", "nan")),
        (far_away, ("'Lost'", "3.4e+38 m", "1e+15 m")),
        (no_mesh, ("no mesh", "'Scene'")),
        (empty_mesh, ("'Hollow'", "no faces")),
        (no_emitter, ("gives off light", "Emission")),
        (no_area, ("'Line'", "1 face without area")),
        (only_emitter_without_area, ("gives off light", "'Line'", "1 face without area")),
        (too_bright, ("material 'Nova'", "W/m^2")),
        (infinitely_bright, ("material 'Nova'", "W/m^2")),
        (name_taken, ("'Lamp'", "'Radiosity'", "FLOAT")),
    ],
)
def test_bad_scene(build, command, tmp_path, scene, named):
    scene(build)
    path = tmp_path / "bad.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
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
            "fmm-radiosity: warning: object 'Hollow' has no faces: left out",
            "fmm-radiosity: warning: object 'Torn': 1 face without area left out",
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
    suffix = {"-o": ".blend", "--report": ".json", "--preview": ".png"}[option]
    path, blocked = tmp_path / "room.blend", tmp_path / "file" / f"out{suffix}"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    (tmp_path / "file").write_text("in the way")
    outputs = {"-o": tmp_path / "out.blend", option: blocked}
    status, lines = command("bake", path, *(word for pair in outputs.items() for word in pair))
    assert (status, len(lines)) == (1, 1)
    assert f"cannot write '{blocked}'" in lines[0]
    assert sorted(item.name for item in tmp_path.iterdir()) == ["file", "room.blend"]


def test_full_disk_leaves_the_scene(build, command, tmp_path, small_disk):
    build.room()
    path = small_disk / "room.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"), compress=True)
    shutil.copy(tmp_path / "room.blend", path)
    before = path.read_bytes()
    status, lines = command("bake", path, "-o", path)
    assert (status, len(lines)) == (1, 1)
    assert f"cannot write '{path}'" in lines[0]
    assert path.read_bytes() == before
    assert os.listdir(small_disk) == ["room.blend"]


@pytest.mark.parametrize("option", ["--report", "--preview"])
def test_full_disk_leaves_no_part_of_a_file(command, room, tmp_path, small_disk, option):
    with contextlib.suppress(OSError):
        (small_disk / "filling").write_bytes(bytes(1_000_000))
    path = small_disk / ("out.json" if option == "--report" else "out.png")
    status, lines = command("bake", room, "-o", tmp_path / "out.blend", option, path)
    assert (status, len(lines)) == (1, 1)
    assert f"cannot write '{path}'" in lines[0]
    assert os.listdir(small_disk) == ["filling"]
    assert not (tmp_path / "out.blend").exists()


@pytest.mark.parametrize("opened", [False, True])
@pytest.mark.parametrize(("option", "name"), [("--report", "link.json"), ("--preview", "link.png")])
def test_only_the_output_may_be_the_scene(command, room, tmp_path, option, name, opened):
    (tmp_path / name).symlink_to(room)
    if opened:
        bpy.ops.wm.open_mainfile(filepath=str(room))
    before = room.read_bytes()
    status, lines = command("bake", *([] if opened else [room]), "-o", tmp_path / "out.blend", option, tmp_path / name)
    assert (status, len(lines)) == (2, 1)
    assert option in lines[0]
    assert "the scene" in lines[0]
    assert room.read_bytes() == before
    assert command("bake", *([] if opened else [room]), "-o", room) == (0, [])
    assert room.read_bytes() != before


@pytest.mark.parametrize("exists", [False, True])
def test_links_are_written_through(command, room, tmp_path, exists):
    target, link = tmp_path / "target.blend", tmp_path / "link.blend"
    link.symlink_to(target)
    if exists:
        target.write_bytes(b"old")
    assert command("bake", room, "-o", link) == (0, [])
    assert link.is_symlink()
    assert target.stat().st_size > 10_000


def test_link_to_itself(command, room, tmp_path):
    link = tmp_path / "link.blend"
    link.symlink_to(link)
    status, lines = command("bake", room, "-o", link)
    assert (status, len(lines)) == (1, 1)
    assert f"cannot write '{link}'" in lines[0]
    assert link.is_symlink()


def test_long_names(command, room, tmp_path):
    longest = tmp_path / ("n" * (NAME_MAX - len(".blend")) + ".blend")
    assert command("bake", room, "-o", longest) == (0, [])
    assert longest.stat().st_size > 10_000
    too_long = tmp_path / f"n{longest.name}"
    for arguments, verb in (((room, "-o", too_long), "write"), ((too_long, "-o", room), "read")):
        status, lines = command("bake", *arguments)
        assert (status, lines) == (1, [f"fmm-radiosity: error: cannot {verb} '{too_long}': File name too long"])
    deep = tmp_path.joinpath(*["d" * 200] * 5, "out.blend")
    assert command("bake", room, "-o", deep) == (
        1,
        [f"fmm-radiosity: error: cannot write '{deep}': File name too long"],
    )


@pytest.mark.parametrize("step", ["reading", "compute", "write"])
def test_no_memory_is_one_line(command, room, tmp_path, fmm, monkeypatch, step):
    def fail(*_arguments):
        raise MemoryError("Unable to allocate 3 TiB")

    monkeypatch.setattr(fmm.bake, step, fail)
    assert command("bake", room, "-o", tmp_path / "out.blend") == (
        1,
        ["fmm-radiosity: error: not enough memory: Unable to allocate 3 TiB"],
    )
    with pytest.raises(RuntimeError, match=r"^Error: not enough memory: Unable to allocate 3 TiB\n?$"):
        bpy.ops.fmm_radiosity.bake()


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
        (["bake", "-o", "x.blend", "--with", "sky", "--without", "glossy", "--with", "glossy"], "'glossy' is in both"),
        (["bake", "-o", "x.txt"], "x.txt"),
        (["bake", "-o", "x.blend", "--report", "x.blend"], "--report"),
        (["bake", "-o", "x.blend", "--report", "x.txt"], "--report: 'x.txt' must end in .json"),
        (["bake", "-o", "x.blend", "--preview", "x.jpg"], "--preview: 'x.jpg' must end in .png"),
        (["bake", "", "-o", "x.blend"], "scene"),
        (["bake", "a.blend", "-o", ""], "-o"),
        (["bake", "-o", "x.blend", "--bogus"], "--bogus"),
        (["study"], "--out"),
        (["study", "--out", "x", "--target-error", "2"], "target_error"),
        (["study", "--out", "x", "--cycles", "16", "0"], "--cycles"),
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
