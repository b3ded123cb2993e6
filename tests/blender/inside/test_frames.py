# SPDX-License-Identifier: GPL-3.0-or-later
"""A range of frames: each equals a bake of that frame alone, and all are written or none."""

import json

import bpy
import fmm_core
import numpy as np
import pytest
from scenes import baked


@pytest.fixture(autouse=True)
def moving(build):
    """A room whose box moves from frame 1 to 3, and whose lamp glows more at 3 alone; frame 2 is shown."""
    scene = bpy.context.scene
    scene.fmm_radiosity.particles = 300
    build.room()
    box = bpy.data.objects["Box"]
    for frame, height in ((1, 0.5), (2, 0.7), (3, 0.7)):
        box.location.z = height
        box.keyframe_insert("location", frame=frame)
    glow = bpy.data.materials["Glow"].node_tree.nodes["Emission"].inputs["Strength"]
    for frame, strength in ((1, 1.0), (2, 1.0), (3, 2.0)):
        glow.default_value = strength
        glow.keyframe_insert("default_value", frame=frame)
    scene.frame_start, scene.frame_end = 1, 3
    scene.frame_set(2)
    return scene


def colours(mesh, name):
    attribute = mesh.color_attributes[name]
    values = np.empty(len(attribute.data) * 4, np.float32)
    attribute.data.foreach_get("color", values)
    return values.reshape(-1, 4)


def names():
    return {mesh.name: list(mesh.color_attributes.keys()) for mesh in bpy.data.meshes}


def alone(scene, frames=(1, 2, 3)):
    """The colours of every frame baked by itself, by mesh and frame; the attributes are gone again."""
    found = {}
    for frame in frames:
        scene.frame_set(frame)
        assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
        found |= {(mesh.name, frame): baked(mesh) for mesh in bpy.data.meshes}
    for mesh in bpy.data.meshes:
        mesh.color_attributes.remove(mesh.color_attributes["Radiosity"])
    scene.frame_set(2)
    return found


def test_each_frame_equals_a_bake_of_it_alone(fmm, moving):
    expected = alone(moving)
    fmm.session.session.solution = None
    assert bpy.ops.fmm_radiosity.bake_frames() == {"FINISHED"}
    assert (moving.frame_current, fmm.session.session.solution) == (2, None)
    assert set(map(tuple, names().values())) == {("Radiosity 0001", "Radiosity 0002", "Radiosity 0003")}
    for (mesh, frame), values in expected.items():
        assert np.allclose(colours(bpy.data.meshes[mesh], f"Radiosity {frame:04d}"), values, rtol=1e-4, atol=1e-6)
    floor = bpy.data.meshes["Floor"]
    assert np.abs(colours(floor, "Radiosity 0001") - colours(floor, "Radiosity 0002")).max() > 1e-3
    frames = fmm.session.session.report["frames"]
    assert [line["frame"] for line in frames] == [1, 2, 3]
    # Where only the lamp changes nothing is traced.
    assert [line["rays"] > 0 for line in frames] == [True, True, False]


@pytest.fixture
def rolling(build, moving):
    """A floor of many faces under a lamp, and a ball over it that moves from frame 1 to 4."""
    for name in ("Box", "Floor"):
        bpy.data.meshes.remove(bpy.data.objects[name].data)
    bpy.data.materials["Glow"].node_tree.animation_data_clear()
    grey, count = build.material("Rough", Color=(0.6, 0.5, 0.4)), 24
    vertices = [(3 * x / count - 1, 3 * y / count - 1, 0.0) for y in range(count + 1) for x in range(count + 1)]
    corners = [y * (count + 1) + x for y in range(count) for x in range(count)]
    build.object("Floor", vertices, [(i, i + 1, i + count + 2, i + count + 1) for i in corners], grey)
    ball = build.ball("Ball", grey, radius=0.2)
    for frame in (1, 2, 3, 4):
        ball.location = (0.2 + 0.05 * frame, 0.5, 0.4)
        ball.keyframe_insert("location", frame=frame)
    moving.frame_end, moving.fmm_radiosity.particles = 4, 6000
    return moving


def test_what_moves_is_followed_from_frame_to_frame(fmm, rolling):
    settings = rolling.fmm_radiosity
    fresh, few = alone(rolling, (4,)), (settings.particles, settings.rays)
    settings.particles, settings.rays = 20_000, 3000
    exact = alone(rolling, (4,))
    settings.particles, settings.rays = few
    fmm.session.session.solution = None
    assert bpy.ops.fmm_radiosity.bake_frames() == {"FINISHED"}
    followed = {key: colours(bpy.data.meshes[key[0]], "Radiosity 0004") for key in exact}
    assert len(exact) == 3

    def off(found):
        return sum(np.square(found[key] - exact[key]).sum() for key in exact)

    # By squares.
    assert 0 < off(followed) < 1.3**2 * off(fresh)
    lines = fmm.session.session.report["frames"]
    # The ball has a third of all corners; they ask as many as ever.
    assert all(0 < line["rays"] < lines[0]["rays"] < lines[1]["rays"] for line in lines[2:])


def test_what_fails_half_way_changes_nothing(moving):
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    before = {mesh.name: baked(mesh) for mesh in bpy.data.meshes}
    floor = bpy.data.meshes["Floor"]
    floor.attributes.new("Radiosity 0003", "FLOAT", "POINT")
    with pytest.raises(RuntimeError, match=r"frame 3: .*rename it"):
        bpy.ops.fmm_radiosity.bake_frames()
    assert moving.frame_current == 2
    assert set(map(tuple, names().values())) == {("Radiosity",)}
    assert all((baked(mesh) == before[mesh.name]).all() for mesh in bpy.data.meshes)


def test_a_warning_names_the_frame_unless_it_is_true_of_all(fmm, moving):
    box, lamp = bpy.data.objects["Box"], bpy.data.objects["Lamp"]
    lamp.is_holdout = True
    for frame, hidden in ((1, False), (2, True), (3, True)):
        box.hide_viewport = hidden
        box.keyframe_insert("hide_viewport", frame=frame)
    moving.frame_set(1)
    assert bpy.ops.fmm_radiosity.bake_frames() == {"FINISHED"}
    holdout, hidden = fmm.session.session.report["warnings"]
    assert holdout.startswith("object 'Lamp' is a holdout")
    assert hidden == "frame 2: object 'Box' is hidden in the viewport: left out"


def darken(scene, *frames):
    """Let the lamp give off nothing in these frames."""
    glow = bpy.data.materials["Glow"].node_tree.nodes["Emission"].inputs["Strength"]
    for frame in frames:
        glow.default_value = 0.0
        glow.keyframe_insert("default_value", frame=frame)
    scene.frame_set(2)


@pytest.mark.parametrize("dark", [1, 2, 3])
def test_a_frame_without_light_is_black(fmm, moving, dark):
    darken(moving, dark)
    moving.fmm_radiosity.directional = True
    assert bpy.ops.fmm_radiosity.bake_frames() == {"FINISHED"}
    for mesh in bpy.data.meshes:
        for frame in (1, 2, 3):
            for name in (f"Radiosity {frame:04d}", f"Radiosity {frame:04d} SH 0"):
                values = colours(mesh, name)
                assert (values[:, 3] == 1).all()
                assert (values[:, :3].max() > 0) == (frame != dark), name
    report = fmm.session.session.report
    assert report["warnings"] == [f"frame {dark}: nothing gives off light, its colours are black"]
    assert [line["frame"] for line in report["frames"]] == [1, 2, 3]
    assert report["frames"][dark - 1]["rays"] == 0


def test_a_range_without_light_is_refused(moving):
    darken(moving, 1, 2, 3)
    with pytest.raises(RuntimeError, match="frame 1: nothing in scene 'Scene' gives off light"):
        bpy.ops.fmm_radiosity.bake_frames()
    assert set(map(tuple, names().values())) == {()}


def test_the_preview_range_is_what_is_baked(moving):
    moving.use_preview_range = True
    moving.frame_preview_start, moving.frame_preview_end = 2, 3
    assert bpy.ops.fmm_radiosity.bake_frames() == {"FINISHED"}
    assert set(map(tuple, names().values())) == {("Radiosity 0002", "Radiosity 0003")}


def test_a_cancelled_range_changes_nothing(fmm, moving):
    settings = fmm.properties.settings_of(moving)
    seen = []

    def progress(fraction, _text):
        seen.append(fraction)
        return fraction < 0.7

    with pytest.raises(fmm_core.Cancelled):
        fmm.animation.solve(bpy.context, [1, 3], settings, progress)
    assert moving.frame_current == 2
    assert 0.5 < seen[-1] < 0.8
    assert seen == sorted(seen)
    assert set(map(tuple, names().values())) == {()}


def test_command_writes_attributes_or_one_file(command, moving, tmp_path):
    scene, baked_file, arrays = tmp_path / "in.blend", tmp_path / "out.blend", tmp_path / "out.npz"
    bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    assert command("bake", scene, "-o", arrays, "--frames", "1-2", "--report", tmp_path / "r.json") == (0, [])
    with np.load(arrays) as found:
        floor = {frame: found[f"Floor/Radiosity {frame:04d}"] for frame in (1, 2)}
        assert sorted(found) == [
            f"{name}/Radiosity {frame:04d}" for name in ("Box", "Floor", "Lamp") for frame in (1, 2)
        ]
    assert not any(names().values())
    report = json.loads((tmp_path / "r.json").read_text())
    assert [line["frame"] for line in report["frames"]] == [1, 2]
    assert command("bake", scene, "-o", baked_file, "--frames", "1-2") == (0, [])
    bpy.ops.wm.open_mainfile(filepath=str(baked_file))
    assert bpy.context.scene.frame_current == 2
    mesh = bpy.data.meshes["Floor"]
    for frame, values in floor.items():
        assert np.allclose(colours(mesh, f"Radiosity {frame:04d}")[:, :3], values, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("--frames", "3-1"), "the first one first"),
        (("--frames", "a"), "expected frames as 1-24, got 'a'"),
        (("--frames", "1-2", "--preview", "x.png"), "of one frame"),
        (("-o", "out.npz"), "must end in .blend"),
    ],
)
def test_wrong_frames_are_told_in_one_line(command, tmp_path, monkeypatch, arguments, why):
    monkeypatch.chdir(tmp_path)
    status, lines = command("bake", "-o", "out.blend", *arguments)
    assert (status, len(lines)) == (2, 1)
    assert why in lines[0]
