# SPDX-License-Identifier: GPL-3.0-or-later
"""What is read from a scene."""

import math
from concurrent.futures import ThreadPoolExecutor

import bpy
import numpy as np
import pytest
from fmm_core import Error
from scenes import corner_normals


def warned(arrays, *parts):
    return any(all(part in text for part in parts) for text in arrays.warnings)


def areas(triangles):
    return np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1) / 2


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (-2, -3, -0.5), (1, 0.2, 4)])
def test_normals_stay_outside_whatever_the_scale(build, read, scale):
    cube = build.cube("Cube", build.light())
    cube.scale, cube.rotation_euler, cube.location = scale, (0.3, 0.5, 0.7), (3, -2, 1)
    arrays = read()
    outward = arrays.triangles.mean(axis=1) - (3, -2, 1)
    normals = corner_normals(arrays.triangles)
    assert (np.einsum("ti,ti->t", normals, outward) > 0).all()
    for corner, centre in zip(arrays.corner_normal, arrays.corner_triangle_centre, strict=True):
        assert np.dot(corner, centre - (3, -2, 1)) > 0
        assert np.linalg.norm(corner) == pytest.approx(1)
        assert np.abs(normals @ corner).max() == pytest.approx(1, abs=1e-5)
    volume = np.einsum("ti,ti->", arrays.triangles[:, 0], np.cross(arrays.triangles[:, 1], arrays.triangles[:, 2])) / 6
    assert volume == pytest.approx(abs(math.prod(scale)), rel=1e-5)


def test_flattened_object_keeps_its_normals(build, read):
    build.cube("Cube", build.light()).scale = (1, 1, 0)
    arrays = read()
    assert len(arrays.triangles) == 4
    assert np.isfinite(arrays.corner_normal).all()
    assert warned(arrays, "'Cube'", "4 faces without area")


def test_polygons_keep_their_area(build, read):
    circle = [(math.cos(2 * math.pi * i / 7), math.sin(2 * math.pi * i / 7), 0) for i in range(7)]
    arrow = [(0, 0, 1), (2, 0, 1), (0.5, 0.5, 1), (0, 2, 1)]
    build.object("Flat", circle + arrow, [tuple(range(7)), (7, 8, 9, 10)], build.light())
    arrays = read()
    assert len(arrays.triangles) == 5 + 2
    assert areas(arrays.triangles).sum() == pytest.approx(3.5 * math.sin(2 * math.pi / 7) + 1.0, rel=1e-6)
    assert len(arrays.corner_vertex) == 11


def test_corners_know_the_largest_triangle_beside_them(build, read):
    kite = [(0, 0, 1), (9, 0, 1), (1, 1, 1), (0, 9, 1)]
    build.object("Kite", kite, [(0, 1, 2, 3)], build.light()).scale = (2, 1, 1)
    arrays = read()
    centres = arrays.triangles.mean(axis=1)
    assert len(centres) == 2
    for corner, centre in zip(arrays.corner_position, arrays.corner_triangle_centre, strict=True):
        touching = (np.abs(arrays.triangles - corner).max(axis=2) < 1e-6).any(axis=1)
        largest = np.argmax(areas(arrays.triangles) * touching)
        assert centre == pytest.approx(centres[largest]) or np.ptp(areas(arrays.triangles)[touching]) < 1e-5


def test_rounding_does_not_choose_between_the_halves_of_a_square(build, read):
    places = [i / 10 for i in range(8)]
    vertices = [(x, y, 0) for y in places for x in places]
    faces = [(8 * j + i, 8 * j + i + 1, 8 * j + i + 9, 8 * j + i + 8) for j in range(7) for i in range(7)]
    build.object("Grid", vertices, faces, build.light())
    arrays = read()
    steps = (arrays.corner_triangle_centre - arrays.corner_position).reshape(len(faces), 4, 3)
    assert steps == pytest.approx(np.broadcast_to(steps[0], steps.shape), abs=1e-6)


def test_every_face_has_its_own_material(build, read):
    red = build.material("Red", Color=(0.5, 0.1, 0.2))
    glow = build.light("Glow", (1, 2, 4))
    inputs = {"Base_Color": (0.2, 0.3, 0.4), "Emission_Strength": 2.0, "Specular_IOR_Level": 0.0}
    both = build.material("Both", "ShaderNodeBsdfPrincipled", **inputs)
    vertices = [(x, y, 0) for x in range(4) for y in range(2)]
    faces = [(2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1) for i in range(3)]
    build.object("Strip", vertices, faces, red, glow, both, slots=[0, 1, 2])
    arrays = read()
    order = np.argsort(arrays.triangles[:, :, 0].mean(axis=1))
    assert np.allclose(arrays.albedo[order[::2]], [(0.5, 0.1, 0.2), (0, 0, 0), (0.2, 0.3, 0.4)], atol=1e-6)
    assert np.allclose(arrays.emission[order[::2]] / math.pi, [(0, 0, 0), (1, 2, 4), (2, 2, 2)], atol=1e-6)
    assert np.allclose(arrays.corner_albedo[::4], [(0.5, 0.1, 0.2), (0, 0, 0), (0.2, 0.3, 0.4)], atol=1e-6)


def test_material_of_the_object_goes_before_that_of_the_mesh(build, read):
    lamp = build.quad("Lamp", build.light())
    other = build.quad("Other", build.material("Grey"), z=1)
    other.material_slots[0].link = "OBJECT"
    other.material_slots[0].material = build.material("Green", Color=(0, 0.5, 0))
    arrays = read()
    assert [0, 0.5, 0] in arrays.albedo.round(6).tolist()
    assert lamp.name == arrays.receivers[0].object


def test_no_material_is_grey(build, read):
    build.quad("Lamp", build.light())
    build.quad("Bare", z=1)
    assert read().albedo[2:].round(6).tolist() == [[0.8] * 3] * 2


def test_open_meshes_are_two_sided(build, read):
    build.quad("Lamp", build.light())
    build.cube("Closed").location = (0, 0, 3)
    build.object("Turned", [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 2, 3)])
    arrays = read()
    assert arrays.two_sided.tolist() == [True] * 2 + [False] * 12 + [True] * 4


@pytest.mark.parametrize("inward", [False, True])
def test_closed_rooms_are_two_sided(build, read, inward):
    build.quad("Lamp", build.light(), down=True)
    build.cube("Room", inward=inward, size=4)
    build.cube("Box", size=0.5).location = (-1, -1, -1)
    assert read().two_sided.tolist() == [True] * 2 + [True] * 12 + [False] * 12


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (-1, -1, 1), (-1, -1, -1)])
@pytest.mark.parametrize("inward", [False, True])
def test_what_is_inside_out_shows_its_backs_to_what_is_outside(build, read, inward, scale):
    build.quad("Lamp", build.light(), z=2)
    build.cube("Box", inward=inward).scale = scale
    assert read().two_sided.tolist() == [True] * 2 + [inward] * 12


def test_a_room_that_holds_all_there_is_shows_no_backs(build, read):
    build.cube("Room", build.light(), size=4, inward=True)
    assert not read().two_sided.any()


def test_a_part_of_a_mesh_may_be_inside_out(build, read):
    build.quad("Lamp", build.light(), z=2)
    parts = [build.cube("Box"), build.cube("Flipped", size=0.5, inward=True)]
    parts[1].location.x = 2
    with bpy.context.temp_override(active_object=parts[0], selected_editable_objects=parts):
        bpy.ops.object.join()
    assert read().two_sided.tolist() == [True] * 26
    # One within the other is the inner side of a wall.
    for vertex in parts[0].data.vertices[8:]:
        vertex.co.x -= 2
    assert read().two_sided.tolist() == [True] * 2 + [False] * 24


@pytest.mark.parametrize("thing_inward", [False, True])
@pytest.mark.parametrize("walls", [[False], [False, True]])
def test_things_may_be_joined_to_the_room_that_they_are_in(build, read, walls, thing_inward):
    build.quad("Lamp", build.light(), z=9)
    parts = [build.cube(f"Wall {i}", size=3 - i, inward=inward) for i, inward in enumerate(walls)]
    parts.append(build.cube("Thing", size=0.5, inward=thing_inward))
    with bpy.context.temp_override(active_object=parts[0], selected_editable_objects=parts):
        bpy.ops.object.join()
    # A solid in a room with thick walls, and a cavity in a solid, are what they seem.
    clear = thing_inward == (len(walls) == 1)
    assert read().two_sided.tolist() == [True] * 2 + [not clear] * 12 * len(parts)


def test_neighbours_in_contact_are_one_sided(build, read):
    build.quad("Lamp", build.light(), z=-0.5)
    build.cube("Left").location = (0.5, 0.5, 0)
    build.cube("Right").location = (1.5, 0.5, 0)
    assert read().two_sided.tolist() == [True] * 2 + [False] * 24


def test_instances_block_light_and_are_baked_once(build, read):
    build.quad("Lamp", build.light())
    group = bpy.data.collections.new("Group")
    group.objects.link(build.cube("Part", link=False))
    for i in range(3):
        holder = bpy.data.objects.new(f"Holder {i}", None)
        holder.instance_type, holder.instance_collection, holder.location = "COLLECTION", group, (5 * i, 0, 0)
        bpy.context.scene.collection.objects.link(holder)
    arrays = read()
    assert len(arrays.triangles) == 2 + 3 * 12
    assert [receiver.mesh for receiver in arrays.receivers] == ["Lamp", "Part"]
    assert warned(arrays, "mesh 'Part'", "'Holder 0', 'Holder 1', 'Holder 2'", "those of 'Holder 0'")


def test_copies_with_one_name_are_counted(build, read):
    build.quad("Lamp", build.light())
    part, group = build.cube("Part", link=False), bpy.data.collections.new("Group")
    group.objects.link(part)
    group.objects.link(bpy.data.objects.new("Twin", part.data))
    holder = bpy.data.objects.new("Holder", None)
    holder.instance_type, holder.instance_collection = "COLLECTION", group
    bpy.context.scene.collection.objects.link(holder)
    assert warned(read(), "mesh 'Part' appears 2 times in 'Holder': its colours are those of the first")


def test_mirrored_copy_is_named_apart(build, read):
    build.quad("Lamp", build.light())
    group = bpy.data.collections.new("Group")
    group.objects.link(build.cube("Src"))
    holder = bpy.data.objects.new("Mirror", None)
    holder.instance_type, holder.instance_collection, holder.scale = "COLLECTION", group, (-1, 1, 1)
    bpy.context.scene.collection.objects.link(holder)
    assert warned(read(), "mesh 'Src' is shared by 'Src', 'Mirror': its colours are those of 'Src'")


def test_linked_duplicates_are_baked_for_the_first(build, read):
    lamp = build.quad("Lamp", build.light())
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Twin", lamp.data))
    arrays = read()
    assert len(arrays.triangles) == 4
    assert len(arrays.receivers) == 1
    assert warned(arrays, "mesh 'Lamp'", "'Lamp', 'Twin'", "those of 'Lamp'")


def test_modifier_that_adds_faces_is_named(build, read):
    build.quad("Lamp", build.light())
    build.cube("Round").modifiers.new("Smoother", "SUBSURF")
    arrays = read()
    assert len(arrays.triangles) == 2 + 48
    assert [receiver.object for receiver in arrays.receivers] == ["Lamp"]
    assert warned(arrays, "'Round'", "'Smoother'", "apply it")


def test_modifier_that_only_moves_is_baked_where_it_puts_the_mesh(build, read):
    build.quad("Lamp", build.light())
    build.quad("Moved").modifiers.new("Push", "DISPLACE")
    arrays = read()
    moved = arrays.receivers[1]
    assert moved.object == "Moved"
    assert np.abs(arrays.corner_position[moved.rows, 2]).min() > 0.1


def test_text_blocks_light_but_gets_no_colours(build, read):
    build.quad("Lamp", build.light())
    text = bpy.data.curves.new("Words", "FONT")
    text.body = "ab"
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Words", text))
    arrays = read()
    assert len(arrays.triangles) > 50
    assert len(arrays.receivers) == 1
    assert warned(arrays, "'Words'", "convert it")


def test_hidden_objects_are_left_out(build, read):
    build.quad("Lamp", build.light())
    build.quad("Not rendered", z=1).hide_render = True
    build.quad("Not shown", z=2).hide_set(True)
    group = bpy.data.collections.new("Not rendered either")
    group.hide_render = True
    group.objects.link(build.quad("Grouped", z=3, link=False))
    bpy.context.scene.collection.children.link(group)
    arrays = read()
    assert len(arrays.triangles) == 2
    assert [text for text in arrays.warnings if "hidden" in text] == [
        "object 'Not shown' is hidden in the viewport: left out"
    ]


def test_what_cannot_be_read_is_named_and_not_black(build, read):
    build.quad("Lamp", build.light())
    wood = build.material("Wood {1}", Color=(0.3, 0.4, 0.5))
    shader = next(node for node in wood.node_tree.nodes if node.type == "BSDF_DIFFUSE")
    wood.node_tree.links.new(wood.node_tree.nodes.new("ShaderNodeAmbientOcclusion").outputs[0], shader.inputs["Color"])
    build.quad("Plank", wood, z=1)
    arrays = read()
    assert warned(arrays, "material 'Wood {1}'", "'Plank'", "Color comes from 'Ambient Occlusion'", "(0.3, 0.4, 0.5)")
    assert arrays.albedo[2:4] == pytest.approx(np.tile([0.3, 0.4, 0.5], (2, 1)))


def test_unknown_shader_is_named_and_grey(build, read):
    build.quad("Lamp", build.light())
    build.quad("Pane", build.material("Glass", "ShaderNodeBsdfGlass"), z=1)
    arrays = read()
    assert warned(arrays, "material 'Glass'", "'Pane'", "not simulated")
    assert arrays.albedo[-1] == pytest.approx((0.8, 0.8, 0.8))


def test_negative_strength_is_an_error(build, read):
    build.quad("Lamp", build.material("Dark", "ShaderNodeEmission", Strength=-2.0))
    with pytest.raises(Error, match=r"material 'Dark': Strength is -2"):
        read()


@pytest.mark.parametrize("sides", [3, 4, 9])
@pytest.mark.parametrize("faces", [1, 50])
def test_triangles_are_those_that_blender_hands_out_one_by_one(build, fmm, sides, faces):
    turns = 2 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([np.cos(turns), np.sin(turns), 0 * turns])
    places = np.concatenate([ring + [0, 0, face] for face in range(faces)])
    mesh = build.object("Rings", places, np.arange(faces * sides).reshape(-1, sides).tolist()).data
    found = fmm.meshes.read_mesh(mesh).triangle_corners
    assert found.tolist() == [list(triangle.loops) for triangle in mesh.loop_triangles]
    assert len(found) == faces * (sides - 2)


@pytest.fixture
def painted_room(build):
    """A room whose floor has the colours of an attribute, which a group reads."""
    build.room()
    paint = bpy.data.meshes["Floor"].color_attributes.new("Paint", "FLOAT_COLOR", "CORNER")
    paint.data.foreach_set("color", np.linspace(0, 1, 4 * len(paint.data)))
    group = bpy.data.node_groups.new("Painted", "ShaderNodeTree")
    group.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    node, end = group.nodes.new("ShaderNodeVertexColor"), group.nodes.new("NodeGroupOutput")
    node.layer_name = "Paint"
    group.links.new(node.outputs["Color"], end.inputs["Color"])
    tree = bpy.data.meshes["Floor"].materials[0].node_tree
    holder = tree.nodes.new("ShaderNodeGroup")
    holder.node_tree = group
    shader = next(each for each in tree.nodes if each.bl_idname.startswith("ShaderNodeBsdf"))
    tree.links.new(holder.outputs["Color"], shader.inputs[0])


def test_materials_are_read_in_steps_whatever_becomes_of_the_objects(painted_room, fmm, read, monkeypatch):
    expected = read()
    monkeypatch.setattr("bl_ext.user_default.fmm_radiosity.addon.sampling.CHUNK", 8)
    reading = fmm.export.read_meshes(bpy.context.evaluated_depsgraph_get())
    steps = reading.painting()
    next(steps)
    for kind in (bpy.data.objects, bpy.data.meshes):
        for block in list(kind):
            kind.remove(block)
    bpy.context.view_layer.update()
    assert sum(1 for _ in steps) > 10
    found = reading.arrays()
    assert len(np.unique(found.corner_albedo)) > 4
    for name in ("triangles", "emission", "corner_position", "corner_normal", "corner_albedo"):
        assert (getattr(found, name) == getattr(expected, name)).all(), name


def test_a_material_that_is_removed_while_it_is_read_is_named(painted_room, fmm):
    steps = fmm.export.read_meshes(bpy.context.evaluated_depsgraph_get()).painting()
    next(steps)
    bpy.data.materials.remove(bpy.data.materials["Red"])
    with pytest.raises(Error, match=r"^material 'Red' was removed while it was read$"):
        list(steps)


def test_a_material_that_is_renamed_while_it_is_read_is_found_again(painted_room, fmm, read):
    expected = read()
    reading = fmm.export.read_meshes(bpy.context.evaluated_depsgraph_get())
    steps = reading.painting()
    next(steps)
    bpy.data.materials["Red"].name = "Scarlet"
    list(steps)
    assert (reading.arrays().corner_albedo == expected.corner_albedo).all()


def test_what_was_read_is_put_together_in_a_thread_after_the_scene_is_gone(painted_room, fmm, read):
    expected = read()
    assert len(np.unique(expected.corner_albedo)) > 4
    reading = fmm.export.read_scene(bpy.context.evaluated_depsgraph_get())
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with ThreadPoolExecutor(1) as pool:
        found = pool.submit(reading.arrays).result()
    for name in ("triangles", "albedo", "emission", "two_sided", "corner_position", "corner_normal", "corner_albedo"):
        assert (getattr(found, name) == getattr(expected, name)).all(), name
    assert found.receivers[0].mesh == expected.receivers[0].mesh
