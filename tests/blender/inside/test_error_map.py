# SPDX-License-Identifier: GPL-3.0-or-later
"""The map of where colours are off, and the way back to them."""

import bpy
import numpy as np
import pytest
from scenes import baked


@pytest.fixture
def room(build):
    """A grey floor of many vertices under a lamp, with a block between them."""
    build.cube("Block", build.material("Grey"), size=0.3)
    bpy.data.objects["Block"].location = (0.5, 0.5, 0.3)
    build.quad("Floor", build.material("Floor"))
    build.quad("Lamp", build.light(), z=1, down=True)
    bpy.context.view_layer.update()
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj.name == "Floor")
    bpy.context.view_layer.objects.active = bpy.data.objects["Floor"]
    bpy.ops.fmm_radiosity.subdivide(edge_length=0.1)
    bpy.context.scene.fmm_radiosity.rays = 50
    return bpy.data.objects["Floor"].data


def test_map_is_shown_and_the_button_goes_back(room, fmm):
    with pytest.raises(RuntimeError, match="Bake first"):
        bpy.ops.fmm_radiosity.error_map()
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    before, report = baked(room), fmm.session.session.report
    assert bpy.ops.fmm_radiosity.error_map() == {"FINISHED"}
    shown = baked(room, "Radiosity Error")
    assert room.color_attributes["Radiosity Error"].data_type == "FLOAT_COLOR"
    assert room.attributes.active_color_name == "Radiosity Error"
    assert room.color_attributes[room.color_attributes.render_color_index].name == "Radiosity"
    assert np.array_equal(baked(room), before)
    views = [area.spaces.active.shading for area in bpy.context.screen.areas if area.type == "VIEW_3D"]
    assert [(view.type, view.color_type) for view in views] == [("SOLID", "VERTEX")] * max(1, len(views))
    assert fmm.session.session.report is report
    # Colours of the ramp, from dark to bright.
    assert np.ptp(shown[:, 1]) > 0.1
    assert 0 < fmm.session.session.map_top < 1
    # Where the map is shown the button shows the colours again, and finds no other map.
    assert bpy.ops.fmm_radiosity.error_map() == {"FINISHED"}
    assert room.attributes.active_color_name == "Radiosity"
    assert np.array_equal(baked(room, "Radiosity Error"), shown)


def test_map_is_of_the_colours_on_the_mesh_also_where_lights_have_changed_since(room, fmm):
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    assert bpy.ops.fmm_radiosity.error_map() == {"FINISHED"}
    shown, top = baked(room, "Radiosity Error"), fmm.session.session.map_top
    assert bpy.ops.fmm_radiosity.error_map() == {"FINISHED"}
    bpy.data.materials["Glow"].node_tree.nodes["Emission"].inputs["Strength"].default_value = 0.1
    bpy.data.materials["Floor"].node_tree.nodes["Diffuse BSDF"].inputs["Color"].default_value = (0.1, 0.1, 0.1, 1)
    assert bpy.ops.fmm_radiosity.error_map() == {"FINISHED"}
    assert fmm.session.session.map_top == top
    assert np.array_equal(baked(room, "Radiosity Error"), shown)


def test_map_leaves_relighting_without_rays_and_is_undone_in_one_step(room, fmm):
    bpy.context.preferences.edit.use_global_undo = True
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.fmm_radiosity.bake("EXEC_DEFAULT", True) == {"FINISHED"}
    assert bpy.ops.fmm_radiosity.error_map("EXEC_DEFAULT", True) == {"FINISHED"}
    bpy.ops.ed.undo()
    mesh = bpy.data.meshes["Floor"]
    assert "Radiosity" in mesh.color_attributes
    assert "Radiosity Error" not in mesh.color_attributes
    bpy.data.materials["Glow"].node_tree.nodes["Emission"].inputs["Strength"].default_value = 2.0
    assert bpy.ops.fmm_radiosity.relight() == {"FINISHED"}
    assert fmm.session.session.report["counts"]["rays"] == 0


@pytest.mark.parametrize(("taken", "why"), [(True, "'Radiosity Error' of type FLOAT"), (False, "'Light'.*bake first")])
def test_a_map_that_could_not_be_shown_is_refused_before_the_solve(room, fmm, monkeypatch, taken, why):
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    if taken:
        room.attributes.new("Radiosity Error", "FLOAT", "POINT")
    else:
        bpy.context.scene.fmm_radiosity.attribute_name = "Light"
    monkeypatch.setattr(fmm.error_map, "compute", lambda *_: pytest.fail("it was solved"))
    with pytest.raises(RuntimeError, match=f"^Error: .*{why}"):
        bpy.ops.fmm_radiosity.error_map()
    assert room.attributes.active_color_name == "Radiosity"


def test_map_of_another_geometry_is_refused(room):
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    room.vertices[0].co.z += 0.2
    with pytest.raises(RuntimeError, match="bake again"):
        bpy.ops.fmm_radiosity.error_map()
    assert "Radiosity Error" not in room.color_attributes
