# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel Output and the presets change."""

import time
from pathlib import Path

import bpy
import numpy as np
import pytest
from fmm_core import Error, VertexFit, irradiance_of
from scenes import baked, of_corners


@pytest.fixture
def settings(empty):
    own = bpy.context.scene.fmm_radiosity
    own.particles = 300
    # Fits of different samples, and their limits, would differ a little.
    own.colours = "POINTS"
    return own


def bake():
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    return {mesh.name: baked(mesh)[:, :3].astype(float) for mesh in bpy.data.meshes}


def blacken():
    bpy.data.materials["Red"].node_tree.nodes["Diffuse BSDF"].inputs["Color"].default_value = (0, 0, 0, 1)
    blue = bpy.data.materials["Blue"].node_tree.nodes["Principled BSDF"].inputs
    blue["Base Color"].default_value, blue["Specular IOR Level"].default_value = (0, 0, 0, 1), 0.0


def test_light_alone_times_base_colour_is_the_full_colour(build, settings):
    build.room()
    full = bake()
    settings.content = "LIGHTING"
    light = bake()
    assert np.allclose(light["Box"] * (0.1, 0.3, 0.8), full["Box"], rtol=1e-4, atol=1e-6)
    assert full["Box"].max() > 0.01
    # What a lamp gives off itself is no light that arrives there.
    assert full["Lamp"].min() > 0.9
    assert light["Lamp"].max() < 0.5


def test_indirect_light_is_what_black_surfaces_do_not_send(build, settings):
    build.room()
    settings.content = "LIGHTING"
    light = bake()
    settings.content = "INDIRECT"
    indirect = bake()
    settings.content = "LIGHTING"
    blacken()
    direct = bake()
    assert indirect["Box"].max() > 0.01
    for name in ("Box", "Floor"):
        assert np.allclose(direct[name] + indirect[name], light[name], rtol=1e-3, atol=1e-5)


def test_domain_can_be_chosen(build, settings):
    build.room()
    corners = bake()["Box"]
    mesh = bpy.data.meshes["Box"]
    vertices = [loop.vertex_index for loop in mesh.loops]
    settings.domain = "POINT"
    points = bake()["Box"]
    assert (len(corners), len(points)) == (24, 8)
    for vertex in range(8):
        assert np.allclose(points[vertex], corners[np.equal(vertices, vertex)].mean(axis=0), atol=1e-6)
    build.ball("Ball", build.material("Grey")).location = (2, 2, 1)
    settings.domain = "CORNER"
    assert len(bake()["Ball"]) == len(bpy.data.meshes["Ball"].loops)
    assert bpy.data.meshes["Ball"].color_attributes["Radiosity"].domain == "CORNER"


def test_bytes_are_cut_at_white_after_the_exposure(build, settings):
    build.room()
    full = bake()
    settings.byte, settings.exposure = True, 3.0
    found = bake()
    assert bpy.data.meshes["Box"].color_attributes["Radiosity"].data_type == "BYTE_COLOR"
    expected = np.minimum(8 * full["Box"], 1.0)
    assert (found["Lamp"] == 1).all()
    assert expected.max() > 0.1
    # Half a step of 255 in sRGB, whose slope is at most 2.3 in linear values.
    assert np.abs(found["Box"] - expected).max() < 2.3 * 0.5 / 255


def test_another_name_leaves_the_earlier_bake(build, settings):
    build.room()
    before = bake()
    settings.attribute_name, settings.content = "Lichtkarte ü", "LIGHTING"
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    mesh = bpy.data.meshes["Box"]
    assert sorted(mesh.color_attributes.keys()) == ["Lichtkarte ü", "Radiosity"]
    assert mesh.color_attributes.active_color.name == "Lichtkarte ü"
    assert (baked(mesh)[:, :3] == before["Box"]).all()


@pytest.mark.parametrize("content", ["LIGHTING", "INDIRECT"])
def test_directional_light_says_the_same_as_the_colours_for_the_normals_of_the_mesh(build, settings, read, content):
    build.room()
    settings.content, settings.directional = content, True
    bake()
    arrays = read()
    for receiver in arrays.receivers:
        mesh = bpy.data.meshes[receiver.mesh]
        assert sorted(mesh.color_attributes.keys()) == ["Radiosity", *(f"Radiosity SH {k}" for k in range(4))]
        harmonics = np.stack([of_corners(mesh, f"Radiosity SH {k}")[:, :3] for k in range(4)], axis=1)
        irradiance = irradiance_of(harmonics, arrays.corner_normal[receiver.rows])
        assert irradiance / np.pi == pytest.approx(of_corners(mesh, "Radiosity")[:, :3], rel=1e-4, abs=1e-6)
    floor = np.stack([of_corners(bpy.data.meshes["Floor"], f"Radiosity SH {k}")[:, :3] for k in range(4)])
    # The lamp is above its first quarter; what the floor gets from the cube comes from all sides.
    assert (floor[2].sum(axis=0) > 0).all()
    assert np.abs(floor[[1, 3]]).max() > 0.1 * floor[2].max()


def test_directional_light_from_the_command_line(build, command, tmp_path):
    build.room()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"))
    out = tmp_path / "out.blend"
    assert command("bake", tmp_path / "room.blend", "-o", out, "--directional") == (0, [])
    bpy.ops.wm.open_mainfile(filepath=str(out))
    assert len(bpy.data.meshes["Box"].color_attributes) == 5


def test_the_view_is_the_full_colour_where_nothing_shines(build, settings, fmm):
    build.room()
    blue = bpy.data.materials["Blue"].node_tree.nodes["Principled BSDF"].inputs
    blue["Specular IOR Level"].default_value = 0.0
    settings.view = True
    with pytest.raises(RuntimeError, match="no camera"):
        bpy.ops.fmm_radiosity.bake()
    assert all("Radiosity" not in mesh.attributes for mesh in bpy.data.meshes)
    build.camera((2, -3, 3))
    for content in ("FULL", "INDIRECT"):
        settings.content = content
        bake()
        report = fmm.session.session.report
        assert (report["counts"]["tables"], report["effects"]["glossy"]["used"]) == (0, False)
        if content == "FULL":
            expected = {mesh.name: of_corners(mesh, "Radiosity") for mesh in bpy.data.meshes}
        for mesh in bpy.data.meshes:
            assert np.allclose(of_corners(mesh, "Radiosity View"), expected[mesh.name], rtol=1e-5, atol=1e-6)


def test_gloss_is_seen_by_the_camera(build, settings, fmm):
    build.room()
    blue = bpy.data.materials["Blue"].node_tree.nodes["Principled BSDF"].inputs
    blue["Metallic"].default_value = 1.0
    settings.view = True
    camera, found = build.camera((2, -3, 3)), []
    for place in ((2, -3, 3), (-3, 2, 1)):
        camera.location = place
        bake()
        found.append(of_corners(bpy.data.meshes["Box"], "Radiosity View")[:, :3])
        counts = fmm.session.session.report["counts"]
        assert counts["tables"] == 1
        assert counts["directed_rays"] > 0
    assert np.linalg.norm(found[0] - found[1]) > 0.1 * np.linalg.norm(found[0])
    dull = of_corners(bpy.data.meshes["Box"], "Radiosity")[:, :3]
    assert np.linalg.norm(found[0] - dull) > 0.1 * np.linalg.norm(dull)
    settings.without = {"glossy"}
    bake()
    assert fmm.session.session.report["counts"]["tables"] == 0
    assert np.allclose(of_corners(bpy.data.meshes["Box"], "Radiosity View")[:, :3], dull, rtol=1e-4, atol=1e-6)


def test_no_colours_but_those_that_are_asked_for(build, settings):
    build.room()
    bake()
    assert bpy.data.meshes["Box"].color_attributes.keys() == ["Radiosity"]


def test_a_name_that_leaves_no_room_is_an_error(build, fmm, settings):
    build.room()
    settings.attribute_name, settings.directional = 60 * "a", True
    with pytest.raises(Error, match="is longer than"):
        fmm.bake.read(bpy.context)


@pytest.mark.parametrize("name", ["", ".hidden", " 0001", "position", "material_index"])
def test_impossible_names_are_an_error_before_the_solve(build, fmm, settings, name):
    build.room()
    settings.attribute_name = name
    with pytest.raises(Error, match=f"'{name}'"):
        fmm.bake.read(bpy.context)
    assert all("Radiosity" not in mesh.attributes for mesh in bpy.data.meshes)
    assert sorted(mesh.name for mesh in bpy.data.meshes) == ["Box", "Floor", "Lamp"]


def test_paint_that_a_material_reads_without_a_name_stays_what_it_reads(build, settings):
    build.room()
    mesh, tree = bpy.data.meshes["Box"], bpy.data.materials["Blue"].node_tree
    paint = mesh.color_attributes.new(name="Paint", type="FLOAT_COLOR", domain="POINT")
    paint.data.foreach_set("color", np.tile([0.9, 0.1, 0.1, 1.0], 8))
    mesh.color_attributes.render_color_index = mesh.color_attributes.find("Paint")
    node = tree.nodes.new("ShaderNodeVertexColor")
    tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    mesh.update()
    first, again = bake(), bake()
    assert all(np.array_equal(again[name], first[name]) for name in ("Box", "Floor"))
    assert mesh.color_attributes[mesh.color_attributes.render_color_index].name == "Paint"
    assert mesh.color_attributes.active_color.name == "Radiosity"
    assert bpy.data.meshes["Floor"].attributes.default_color_name == ""
    assert first["Box"][:, 0].sum() > 2 * first["Box"][:, 2].sum()


def test_a_target_error_that_is_shown_as_0_is_none(fmm, settings):
    settings.target_error = 1e-9
    assert fmm.properties.settings_of(bpy.context.scene).target_error is None
    settings.target_error = 1e-3
    assert fmm.properties.settings_of(bpy.context.scene).target_error == pytest.approx(1e-3)


def test_selected_meshes_get_the_colours_that_they_have_in_the_whole_scene(build, settings):
    build.room()
    expected = bake()
    for mesh in bpy.data.meshes:
        mesh.color_attributes.remove(mesh.color_attributes["Radiosity"])
    settings.scope = "SELECTED"
    with pytest.raises(RuntimeError, match="select"):
        bpy.ops.fmm_radiosity.bake()
    bpy.data.objects["Box"].select_set(True)
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    assert [mesh.name for mesh in bpy.data.meshes if "Radiosity" in mesh.color_attributes] == ["Box"]
    assert np.allclose(baked(bpy.data.meshes["Box"])[:, :3], expected["Box"], rtol=1e-5)


@pytest.mark.parametrize("how", ["eye", "switch", "collection"])
def test_whole_scene_takes_what_the_viewport_hides_and_leaves_it_hidden(build, settings, how):
    build.room()
    expected = bake()
    lamp, layer = bpy.data.objects["Lamp"], bpy.context.view_layer
    collection = bpy.data.collections.new("Lamps")
    bpy.context.scene.collection.children.link(collection)
    bpy.context.scene.collection.objects.unlink(lamp)
    collection.objects.link(lamp)
    if how == "eye":
        lamp.hide_set(True)
    elif how == "switch":
        lamp.hide_viewport = True
    else:
        layer.layer_collection.children["Lamps"].hide_viewport = True

    def flags():
        item = layer.layer_collection.children["Lamps"]
        return lamp.hide_get(), lamp.hide_viewport, item.hide_viewport, collection.hide_viewport, lamp.visible_get()

    layer.update()
    before = flags()
    with pytest.raises(RuntimeError, match="gives off light"):
        bpy.ops.fmm_radiosity.bake()
    settings.scope = "SCENE"
    found = bake()
    assert flags() == before
    assert np.allclose(found["Box"], expected["Box"], rtol=1e-5)
    settings.scope = "VISIBLE"
    with pytest.raises(RuntimeError, match="gives off light"):
        bpy.ops.fmm_radiosity.bake()


def preset(name):
    return next(path / f"{name}.py" for path in map(Path, bpy.utils.preset_paths("fmm_radiosity"))
                if (path / f"{name}.py").exists())  # fmt: skip


def test_presets_are_there_and_can_be_loaded(settings, fmm):
    chosen = []
    for name in ("Draft", "Good", "Fine", "Paper_p2"):
        settings.particles = 7
        done = bpy.ops.script.execute_preset(filepath=str(preset(name)), menu_idname="FMM_RADIOSITY_PT_presets")
        assert done == {"FINISHED"}
        chosen.append((settings.truncation, settings.rays, settings.particles))
        fmm.properties.settings_of(bpy.context.scene)
    assert chosen == [(2, 50, 0), (4, 200, 0), (6, 1500, 0), (2, 200, 0)]
    settings.rays = 333
    assert bpy.ops.fmm_radiosity.preset_add(name="My own") == {"FINISHED"}
    settings.rays = 10
    bpy.ops.script.execute_preset(filepath=str(preset("My_own")), menu_idname="FMM_RADIOSITY_PT_presets")
    assert settings.rays == 333
    assert bpy.ops.fmm_radiosity.preset_add(name="My own", remove_name=True) == {"FINISHED"}
    with pytest.raises(StopIteration):
        preset("My_own")


def test_expected_cost_follows_the_counted_rays_and_the_last_bake(build, fmm, settings):
    steps = 60
    grid = [(x / steps, y / steps, 0.0) for y in range(steps + 1) for x in range(steps + 1)]
    row = steps + 1
    faces = [(j * row + i, j * row + i + 1, (j + 1) * row + i + 1, (j + 1) * row + i)
             for j in range(steps) for i in range(steps)]  # fmt: skip
    build.object("Ground", grid, faces, build.material("Grey"))
    build.quad("Lamp", build.light(), z=0.7, down=True)
    build.cube("Box", build.material("Red"), size=0.2).location = (0.5, 0.5, 0.3)
    build.cube("Room", build.material("Wall"), size=1.2, inward=True).location = (0.5, 0.5, 0.5)
    settings.particles = 0
    scene, layer = bpy.context.scene, bpy.context.view_layer
    layer.update()
    expected = fmm.estimate.of_scene(scene, layer)
    assert expected.colours == row * row + 4 + 8 + 8
    bake()
    report = fmm.session.session.report
    assert 0.7 < expected.rays / report["counts"]["rays"] < 1.4
    after = fmm.estimate.of_scene(scene, layer)
    assert after.seconds == pytest.approx(report["seconds"]["total"], rel=1e-6)
    settings.rays = 2000
    assert fmm.estimate.of_scene(scene, layer).rays > 4 * expected.rays


def test_expected_cost_counts_what_is_baked(build, fmm, settings):
    build.room()
    scene, layer, box = bpy.context.scene, bpy.context.view_layer, bpy.data.objects["Box"]

    def expected(scope):
        settings.scope = scope
        layer.update()
        return fmm.estimate.of_scene(scene, layer)

    whole = expected("VISIBLE")
    assert whole.colours == 4 + 16 + 8
    assert expected("SELECTED").colours == 0
    box.select_set(True)
    selected = expected("SELECTED")
    assert selected.colours == 8
    assert selected.seconds < whole.seconds
    box.hide_set(True)
    assert expected("VISIBLE").colours == 4 + 16
    assert expected("SCENE") == whole
    box.hide_render = True
    assert expected("SCENE").colours == 4 + 16


def test_the_total_is_what_the_clock_says(build, fmm, settings, monkeypatch):
    build.room()
    settings.colours, fitted = "FIT", VertexFit.values

    def slow(*arguments):
        time.sleep(0.5)
        return fitted(*arguments)

    monkeypatch.setattr(VertexFit, "values", slow)
    for rays in (True, False):
        start = time.perf_counter()
        bake()
        took, report = time.perf_counter() - start, fmm.session.session.report
        assert report["seconds"]["total"] == pytest.approx(took, abs=0.1)
        assert report["seconds"]["evaluate"] > 0.5
        assert (report["counts"]["rays"] > 0) == rays


def test_report_can_be_read_as_a_text(build, fmm, settings):
    build.room()
    fmm.session.session.report = None
    with pytest.raises(RuntimeError, match="Bake first"):
        bpy.ops.fmm_radiosity.show_report()
    bpy.data.materials["Red"].node_tree.nodes["Diffuse BSDF"].inputs["Color"].default_value = (2, 0, 0, 1)
    bake()
    for _ in range(2):
        assert bpy.ops.fmm_radiosity.show_report() == {"FINISHED"}
    text = bpy.data.texts["Radiosity Report"].as_string()
    report = fmm.session.session.report
    assert len(bpy.data.texts) == 1
    assert f"{report['counts']['triangles']}" in text
    assert report["warnings"]
    assert all(warning in text for warning in report["warnings"])


def test_a_target_error_alone_chooses_the_settings_and_serves_the_next_bake(build, fmm, settings):
    build.room()
    settings.particles, settings.target_error = 0, 0.02
    settings.truncation, settings.rays, settings.measure = 9, 77, False
    bake()
    report = fmm.session.session.report
    assert (report["settings"]["truncation"], report["settings"]["target_error"]) == (3, pytest.approx(0.02))
    assert report["rounds"][-1]["measured_rms"] <= 0.02
    assert f"round {len(report['rounds'])}: p " in fmm.report.summary(report)
    assert "\nRounds\n  " in fmm.report.text(report)
    bake()
    assert fmm.session.session.report["counts"]["rays"] == 0
