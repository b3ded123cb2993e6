# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake writes, and what it leaves alone."""

import json
import math
import os
import time

import bpy
import fmm_core
import numpy as np
import pytest
from scenes import baked

SETTINGS = fmm_core.Settings(particles=300)


@pytest.fixture(autouse=True)
def few_particles(empty):
    bpy.context.scene.fmm_radiosity.particles = 300


def all_baked():
    return {mesh.name: baked(mesh) for mesh in bpy.data.meshes}


def test_code_comes_from_the_zip():
    import addon_utils

    user = os.environ["BLENDER_USER_RESOURCES"]
    assert fmm_core.__file__.startswith(user)
    assert addon_utils._extensions_warnings_get() == {}


def test_colours_are_radiance_at_the_output_points(build, fmm, read):
    build.room()
    bpy.context.scene.fmm_radiosity.colours = "POINTS"
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    arrays = read()
    scene = fmm_core.Scene(arrays.triangles, arrays.albedo, arrays.emission, arrays.two_sided)
    solution = fmm_core.solve(scene, SETTINGS)
    points = fmm_core.output_points(
        arrays.corner_position, arrays.corner_normal, arrays.corner_vertex, arrays.corner_triangle_centre
    )
    irradiance = solution.irradiance(points.points, points.normals)[points.inverse]
    expected = (arrays.corner_emission + arrays.corner_albedo * irradiance) / math.pi
    assert expected.max() > 2.9
    for receiver in arrays.receivers:
        colours = baked(bpy.data.meshes[receiver.mesh])
        assert np.allclose(colours[:, :3], expected[receiver.rows], rtol=1e-6, atol=1e-7)
        assert (colours[:, 3] == 1).all()


def test_pauses_between_the_steps_of_reading_do_not_count(build, fmm):
    build.room()
    steps, pauses = fmm.bake.reading(bpy.context), 0
    try:
        while True:
            next(steps)
            time.sleep(0.5)
            pauses += 1
    except StopIteration as end:
        seconds = end.value.seconds
    assert pauses > 3
    assert 0 < seconds < pauses * 0.25


def test_colours_are_fitted_to_the_light_on_the_faces(build, command, read, tmp_path):
    build.room()
    arrays, solutions = read(), {}
    points = fmm_core.output_points(
        arrays.corner_position, arrays.corner_normal, arrays.corner_vertex, arrays.corner_triangle_centre
    )
    fit = fmm_core.VertexFit(points, arrays.corner_position, arrays.corner_normal, arrays.corner_triangles)
    scene = fmm_core.Scene(arrays.triangles, arrays.albedo, arrays.emission, arrays.two_sided)
    solution = fmm_core.solve(scene, SETTINGS)
    solutions["points"] = solution.irradiance(points.points, points.normals)
    solutions["fit"] = fit.values(solution.irradiance(fit.points, fit.normals, effort=fit.effort), solution.sight(fit))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"))
    for name, irradiance in solutions.items():
        out = tmp_path / f"{name}.blend"
        assert command("bake", tmp_path / "room.blend", "-o", out, "--colours", name) == (0, [])
        bpy.ops.wm.open_mainfile(filepath=str(out))
        expected = (arrays.corner_emission + arrays.corner_albedo * irradiance[points.inverse]) / math.pi
        for receiver in arrays.receivers:
            colours = baked(bpy.data.meshes[receiver.mesh])
            assert np.allclose(colours[:, :3], expected[receiver.rows], rtol=1e-5, atol=1e-6)
    assert np.abs(solutions["fit"] - solutions["points"]).max() > 0.01


def test_a_room_of_negative_scale_bakes_like_itself(build):
    glow = build.material("Glow", "ShaderNodeBsdfPrincipled", Base_Color=(0.5, 0.5, 0.5), Emission_Strength=1.0)
    room = build.cube("Room", glow, size=2.0, inward=True)
    found = []
    for scale in ((1, 1, 1), (-1, 1, 1), (-1, -1, -1)):
        room.scale = scale
        assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
        found.append(baked(room.data)[:, :3])
    assert found[0].min() > 1.5
    for mirrored in found[1:]:
        assert mirrored == pytest.approx(found[0], rel=1e-3)


def test_operator_and_command_line_agree(build, command, tmp_path):
    build.room()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"))
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    by_operator = all_baked()
    out, report, picture = tmp_path / "new" / "out.blend", tmp_path / "out.json", tmp_path / "out.png"
    before = (tmp_path / "room.blend").read_bytes()
    status, lines = command(
        "bake", tmp_path / "room.blend", "-o", out, "--report", report, "--preview", picture
    )  # fmt: skip
    assert (status, lines) == (0, [])
    assert (tmp_path / "room.blend").read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new", "out.json", "out.png", "room.blend"]
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["out.blend"]
    assert json.loads(report.read_text())["settings"]["particles"] == 300
    picture = bpy.data.images.load(str(picture))
    assert tuple(picture.size) == (512, 512)
    assert max(picture.pixels) > 0.5
    bpy.ops.wm.open_mainfile(filepath=str(out))
    for name, colours in all_baked().items():
        assert np.allclose(colours, by_operator[name], atol=1e-6)


def test_preview_of_a_lamp_is_the_same_however_bright(build, command, tmp_path):
    glow = build.light("Glow", (1.0, 1.0, 1.0))
    build.quad("Lamp", glow).rotation_euler = (0.5, 0.2, 0.3)
    pictures = []
    for strength in (1.0, 100.0):
        glow.node_tree.nodes["Emission"].inputs["Strength"].default_value = strength
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "lamp.blend"))
        path = tmp_path / f"{strength}.png"
        assert command("bake", "-o", tmp_path / "out.blend", "--preview", path) == (0, [])
        pictures.append(np.array(bpy.data.images.load(str(path)).pixels))
    assert pictures[0].max() == 1
    assert np.abs(pictures[0] - pictures[1]).max() < 0.01


def contents():
    """Everything of the open scene that a bake could have touched, without its own attribute."""
    blocks = {
        name: sorted(block.name_full for block in getattr(bpy.data, name))
        for name, prop in bpy.data.bl_rna.properties.items()
        if prop.type == "COLLECTION"
    }
    meshes = {}
    for mesh in bpy.data.meshes:
        positions = [tuple(vertex.co) for vertex in mesh.vertices]
        faces = [(tuple(face.vertices), face.material_index, face.use_smooth) for face in mesh.polygons]
        names = sorted(layer.name for layer in mesh.attributes if layer.name != "Radiosity")
        meshes[mesh.name] = positions, faces, names, [material.name for material in mesh.materials]
    objects = {obj.name: (obj.type, [list(row) for row in obj.matrix_world]) for obj in bpy.data.objects}
    scene = bpy.context.scene
    render = scene.render.engine, scene.render.resolution_x, scene.render.filepath, scene.view_settings.view_transform
    return blocks, meshes, objects, render, scene.camera, bpy.context.view_layer.material_override


def test_scene_is_unchanged_but_for_the_attribute(build, command, tmp_path):
    build.room()
    scene, out = tmp_path / "room.blend", tmp_path / "out.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    bpy.ops.wm.open_mainfile(filepath=str(scene))
    before = contents()
    assert command("bake", "-o", out, "--preview", tmp_path / "out.png") == (0, [])
    assert contents() == before
    bpy.ops.wm.open_mainfile(filepath=str(out))
    assert contents() == before
    assert all("Radiosity" in mesh.color_attributes for mesh in bpy.data.meshes)


def test_attribute_is_active_and_rendered(build):
    build.room()
    mesh = bpy.data.meshes["Floor"]
    mesh.color_attributes.new("Paint", "BYTE_COLOR", "CORNER")
    mesh.color_attributes.new("Radiosity", "BYTE_COLOR", "POINT")
    bpy.ops.fmm_radiosity.bake()
    attribute = mesh.color_attributes["Radiosity"]
    assert (attribute.data_type, attribute.domain) == ("FLOAT_COLOR", "CORNER")
    assert mesh.color_attributes.active_color.name == "Radiosity"
    assert mesh.color_attributes[mesh.color_attributes.render_color_index].name == "Radiosity"
    assert sorted(mesh.color_attributes.keys()) == ["Paint", "Radiosity"]


def test_smooth_meshes_get_one_colour_a_vertex(build):
    build.room()
    grey, red = build.material("Grey"), build.material("Dark red", Color=(0.4, 0, 0))
    build.ball("Smooth", grey).location = (2, 2, 1)
    patched = build.ball("Patched", grey, red)
    patched.location = (-1, 2, 1)
    for face in list(patched.data.polygons)[::2]:
        face.material_index = 1
    bpy.ops.fmm_radiosity.bake()
    assert bpy.data.meshes["Smooth"].color_attributes["Radiosity"].domain == "POINT"
    assert bpy.data.meshes["Patched"].color_attributes["Radiosity"].domain == "CORNER"
    assert len(baked(bpy.data.meshes["Smooth"])) == len(bpy.data.meshes["Smooth"].vertices)
    # The lower half sees the floor, which is lit.
    lower = [vertex.co.z < -0.1 for vertex in bpy.data.meshes["Smooth"].vertices]
    assert (baked(bpy.data.meshes["Smooth"])[lower] > 0).all()


def test_cancelling_leaves_the_earlier_bake(build, fmm):
    build.room()
    bpy.ops.fmm_radiosity.bake()
    before = all_baked()
    bpy.data.materials["Glow"].node_tree.nodes["Emission"].inputs["Strength"].default_value = 9.0
    for last in (0.0, 0.5, 0.8):
        with pytest.raises(fmm_core.Cancelled):
            fmm.bake.bake(bpy.context, SETTINGS, lambda fraction, text, last=last: fraction <= last)
    assert all((colours == before[name]).all() for name, colours in all_baked().items())


def test_failing_write_leaves_every_mesh(build, fmm, monkeypatch):
    build.room()
    bpy.ops.fmm_radiosity.bake()
    before = all_baked()
    result = fmm.bake.compute(fmm.bake.read(bpy.context), fmm_core.Settings(particles=500))
    layer, calls = fmm.attributes.layer, []

    def fail_at_last(*arguments):
        calls.append(arguments)
        if len(calls) == len(before):
            raise MemoryError
        return layer(*arguments)

    monkeypatch.setattr(fmm.attributes, "layer", fail_at_last)
    with pytest.raises(MemoryError):
        fmm.bake.write(result)
    monkeypatch.undo()
    bpy.data.meshes["Box"].name = "Renamed"
    with pytest.raises(fmm_core.Error, match="mesh 'Box' of object 'Box' is gone"):
        fmm.bake.write(result)
    bpy.data.meshes["Renamed"].name = "Box"
    assert all((colours == before[name]).all() for name, colours in all_baked().items())
    assert all(mesh.color_attributes.keys() == ["Radiosity"] for mesh in bpy.data.meshes)


def test_other_attributes_are_kept_whatever_their_name(build, fmm, monkeypatch):
    build.room()
    box, floor = bpy.data.meshes["Box"], bpy.data.meshes["Floor"]
    box.attributes.new("Radiosity (being written)", "FLOAT", "POINT").data[0].value = 7.0
    floor.color_attributes.new("Radiosity (being written)", "FLOAT_COLOR", "POINT").data[0].color = (1, 2, 3, 4)

    def check(*names):
        for mesh in (box, floor):
            assert sorted(mesh.attributes.keys()) == sorted([*before[mesh], *names])
        assert box.attributes["Radiosity (being written)"].data[0].value == 7.0
        assert tuple(floor.attributes["Radiosity (being written)"].data[0].color) == (1, 2, 3, 4)

    before = {mesh: mesh.attributes.keys() for mesh in (box, floor)}
    result = fmm.bake.compute(fmm.bake.read(bpy.context), SETTINGS)
    with monkeypatch.context() as patch:
        patch.setattr(fmm.attributes, "layer", lambda *_: ("CORNER", np.zeros(1, np.float32)))
        with pytest.raises(RuntimeError):
            fmm.bake.write(result)
    check()
    for _ in range(2):
        fmm.bake.write(result)
        check("Radiosity")


def test_file_saved_in_edit_mode_is_baked_whole(build, command, tmp_path):
    build.room()
    for name in ("Box", "Floor"):
        bpy.data.objects[name].select_set(True)
    bpy.context.view_layer.objects.active = bpy.data.objects["Box"]
    bpy.ops.object.mode_set(mode="EDIT")
    path = tmp_path / "edited.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    assert command("bake", path, "-o", path) == (0, [])
    bpy.ops.wm.open_mainfile(filepath=str(path))
    assert all(baked(mesh)[:, :3].any() for mesh in bpy.data.meshes)


def test_room_with_normals_outside_reflects_like_any_other(build):
    build.quad("Lamp", build.light(), z=1, down=True)
    build.cube("Box", size=0.5).location = (0.5, 0.5, -1)
    room, colours = build.cube("Room", size=4), []
    for _ in range(2):
        bpy.ops.fmm_radiosity.bake()
        colours.append(baked(bpy.data.meshes["Box"])[:, :3])
        room.data.flip_normals()
    assert (colours[0] > 0.01).all()
    assert np.allclose(*colours, rtol=0.05)


def test_undo_brings_the_earlier_colours_back(build):
    build.room()
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.fmm_radiosity.bake("EXEC_DEFAULT", True)
    assert "Radiosity" in bpy.data.meshes["Box"].color_attributes
    bpy.ops.ed.undo()
    assert "Radiosity" not in bpy.data.meshes["Box"].color_attributes


def test_operator_says_why_it_cannot_run(build):
    build.room()
    bpy.context.view_layer.objects.active = bpy.data.objects["Box"]
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="Object Mode"):
        bpy.ops.fmm_radiosity.bake()
    bpy.ops.object.mode_set(mode="OBJECT")


def test_there_is_nothing_to_show_before_a_bake(build, fmm):
    build.room()
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="Bake first"):
        bpy.ops.fmm_radiosity.show()
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    assert bpy.ops.fmm_radiosity.show() == {"FINISHED"}
    for mesh in bpy.data.meshes:
        mesh.color_attributes.remove(mesh.color_attributes["Radiosity"])
    assert bpy.ops.fmm_radiosity.show() == {"FINISHED"}, "the way back is open"
    assert not bpy.ops.fmm_radiosity.show.poll()


def test_operator_reports_errors_in_one_line(build):
    build.quad("Unlit")
    with pytest.raises(RuntimeError, match=r"^Error: nothing in scene 'Scene' gives off light[^\n]*\n?$"):
        bpy.ops.fmm_radiosity.bake()


@pytest.mark.parametrize("kind", ["attribute", "vertex group"])
def test_taken_name_is_an_error_before_the_solve(build, fmm, kind):
    build.room()
    if kind == "attribute":
        bpy.data.meshes["Box"].attributes.new("Radiosity", "FLOAT2", "CORNER")
    else:
        bpy.data.objects["Box"].vertex_groups.new(name="Radiosity")
    with pytest.raises(fmm_core.Error, match=rf"'Box' has an? {kind} 'Radiosity'"):
        fmm.bake.read(bpy.context)
