# SPDX-License-Identifier: GPL-3.0-or-later
"""Subdividing before a bake, refining after it, and taking the colours elsewhere."""

import bpy
import numpy as np
import pytest
from scenes import baked


@pytest.fixture(autouse=True)
def few_particles(empty):
    bpy.context.scene.fmm_radiosity.particles = 300


def select(*names):
    # Blender 5.0 does not list new objects before.
    bpy.context.view_layer.update()
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj.name in names)
    bpy.context.view_layer.objects.active = bpy.data.objects[names[0]]
    bpy.context.view_layer.update()


def edges(obj):
    """World lengths of all edges."""
    ends = [[obj.matrix_world @ obj.data.vertices[i].co for i in edge.vertices] for edge in obj.data.edges]
    return np.array([(a - b).length for a, b in ends])


def area(obj):
    return sum(face.area for face in obj.data.polygons)


@pytest.mark.parametrize("shape", ["quad", "cube", "scaled", "ball", "six corners", "triangle"])
def test_subdivided_edges_are_short_and_the_count_was_foretold(build, fmm, shape):
    if shape == "quad":
        obj, exact = build.quad("Mesh"), True
    elif shape in ("cube", "scaled"):
        obj, exact = build.cube("Mesh"), True
        obj.scale = (3, 1, 0.5) if shape == "scaled" else (1, 1, 1)
    elif shape == "ball":
        obj, exact = build.ball("Mesh", radius=1.0), False
    elif shape == "triangle":
        obj, exact = build.object("Mesh", [(0, 0, 0), (1, 0, 0), (0.5, 0.8, 0)], [(0, 1, 2)]), True
    else:
        ring = [(np.cos(a), np.sin(a), 0) for a in np.arange(6) * np.pi / 3]
        obj, exact = build.object("Mesh", ring, [tuple(range(6))]), False
    bpy.context.view_layer.update()
    before, was = area(obj), len(obj.data.vertices)
    expected = fmm.subdivision.expected_vertices(obj, 0.13)
    select("Mesh")
    assert bpy.ops.fmm_radiosity.subdivide(edge_length=0.13) == {"FINISHED"}
    lengths = edges(obj)
    assert lengths.max() <= 0.13 * 1.0001
    assert was < len(obj.data.vertices)
    assert area(obj) == pytest.approx(before, rel=1e-5)
    assert max(len(face.vertices) for face in obj.data.polygons) <= 4
    if exact:
        assert len(obj.data.vertices) == expected
    else:
        assert 0.6 < len(obj.data.vertices) / expected < 1.6


def test_copies_leave_the_originals(build):
    obj = build.quad("Wall", build.material("Grey"))
    build.quad("Lamp", build.light(), z=1, down=True)
    select("Wall")
    assert bpy.ops.fmm_radiosity.subdivide(edge_length=0.25, copies=True) == {"FINISHED"}
    copy = bpy.context.view_layer.objects.active
    assert (len(obj.data.vertices), len(copy.data.vertices)) == (4, 25)
    assert (obj.hide_get(), obj.hide_render, copy.hide_render) == (True, True, False)
    assert copy.data.materials[:] == obj.data.materials[:]
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    assert "Radiosity" in copy.data.color_attributes
    assert "Radiosity" not in obj.data.color_attributes


def test_objects_that_share_a_mesh_share_its_copy(build):
    wall, lamp = build.quad("Wall", build.material("Grey")), build.quad("Lamp", build.light(), z=1, down=True)
    twin = wall.copy()
    bpy.context.scene.collection.objects.link(twin)
    twin.location.x = 2
    select("Wall", twin.name)
    assert bpy.ops.fmm_radiosity.subdivide(edge_length=0.25, copies=True) == {"FINISHED"}
    shown = [obj for obj in bpy.context.view_layer.objects if obj.visible_get() and obj is not lamp]
    assert len(shown) == 2
    assert shown[0].data is shown[1].data is not wall.data
    assert (len(wall.data.vertices), len(shown[0].data.vertices)) == (4, 25)
    assert sorted(obj.location.x for obj in shown) == [0, 2]


def test_the_largest_of_the_objects_that_share_a_mesh_counts(build):
    wall = build.quad("Wall", build.material("Grey"))
    twin = wall.copy()
    bpy.context.scene.collection.objects.link(twin)
    twin.scale = (4, 4, 4)
    bpy.context.view_layer.update()
    select("Wall", twin.name)
    assert bpy.ops.fmm_radiosity.subdivide(edge_length=1.0) == {"FINISHED"}
    assert len(wall.data.vertices) == 25


def test_too_many_vertices_are_refused(build):
    obj = build.quad("Wall")
    obj.scale = (1000, 1000, 1)
    bpy.context.view_layer.update()
    select("Wall")
    with pytest.raises(RuntimeError, match="longer edges"):
        bpy.ops.fmm_radiosity.subdivide(edge_length=0.01)
    assert len(obj.data.vertices) == 4


def test_refining_cuts_where_the_shadow_ends(build, fmm):
    grey = build.material("Grey")
    floor = build.quad("Floor", grey)
    floor.scale, floor.location = (4, 4, 1), (-2, -2, 0)
    build.quad("Lamp", build.light("Glow", (40.0, 40.0, 40.0)), z=2, down=True).scale = (0.2, 0.2, 1)
    build.quad("Blocker", grey, z=0.5, down=True)
    bpy.context.view_layer.update()
    select("Floor")
    bpy.ops.fmm_radiosity.subdivide(edge_length=0.26)
    with pytest.raises(RuntimeError, match="bake first"):
        bpy.ops.fmm_radiosity.refine()
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    before = len(floor.data.vertices)
    expected = fmm.subdivision.expected_refined(floor, "Radiosity", 0.3, 0.2)
    assert bpy.ops.fmm_radiosity.refine(contrast=0.3, edge_length=0.2) == {"FINISHED"}
    made = len(floor.data.vertices) - before
    assert 8 < made < 2 * before
    assert before + made == expected
    # None of the far corner, all within reach of the blocker's shadow.
    new = np.array([floor.matrix_world @ vertex.co for vertex in floor.data.vertices[before:]])
    assert np.abs(new[:, :2] - 0.5).max() < 1.5
    assert bpy.ops.fmm_radiosity.refine(contrast=0.3, edge_length=0.5) == {"FINISHED"}
    assert len(floor.data.vertices) == before + made
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}


def test_refining_to_too_many_vertices_is_refused(build, monkeypatch):
    floor = build.quad("Floor", build.material("Grey"))
    build.quad("Lamp", build.light(), z=0.3, down=True).scale = (0.2, 0.2, 1)
    select("Floor")
    bpy.ops.fmm_radiosity.subdivide(edge_length=0.26)
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    monkeypatch.setattr("bl_ext.user_default.fmm_radiosity.operators.on_meshes.MOST_VERTICES", 30)
    objects = len(bpy.data.objects)
    with pytest.raises(RuntimeError, match=r"would come to \d+ vertices, more than 30: choose longer edges"):
        bpy.ops.fmm_radiosity.refine(contrast=0.01, edge_length=0.01, copies=True)
    assert (len(floor.data.vertices), len(bpy.data.objects)) == (25, objects)


def test_undo_takes_back_a_subdivision(build):
    build.quad("Wall")
    bpy.context.view_layer.update()
    select("Wall")
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.fmm_radiosity.subdivide("EXEC_DEFAULT", True, edge_length=0.1)
    assert len(bpy.data.meshes["Wall"].vertices) > 100
    bpy.ops.ed.undo()
    assert len(bpy.data.meshes["Wall"].vertices) == 4


@pytest.mark.parametrize("name", ["subdivide", "refine"])
def test_a_vertex_nowhere_is_named(build, name):
    obj = build.quad("Broken")
    obj.data.color_attributes.new("Radiosity", "FLOAT_COLOR", "POINT")
    obj.data.vertices[2].co.y = float("nan")
    select("Broken")
    with pytest.raises(RuntimeError, match=r"^Error: object 'Broken': vertex 2 is at [^\n]*\n?$"):
        getattr(bpy.ops.fmm_radiosity, name)()


def test_more_vertices_than_integers_are_refused(build):
    build.quad("Land").scale = (1e6, 1e6, 1)
    select("Land")
    with pytest.raises(RuntimeError, match="longer edges"):
        bpy.ops.fmm_radiosity.subdivide(edge_length=1e-5)


def test_why_nothing_can_be_subdivided(build):
    build.quad("Wall").select_set(False)
    with pytest.raises(RuntimeError, match="Select a mesh first"):
        bpy.ops.fmm_radiosity.subdivide()


@pytest.mark.parametrize("content", ["FULL", "LIGHTING"])
def test_light_node_renders_the_full_colour(build, fmm, content):
    """Both ways of writing, through the node, come to the emission that the full colours are."""
    red = build.material("Red", "ShaderNodeBsdfPrincipled", Base_Color=(0.7, 0.2, 0.1))
    wall = build.quad("Wall", red)
    build.quad("Lamp", build.light("Glow", (3.0, 3.0, 3.0)), z=1, down=True)
    bpy.ops.fmm_radiosity.bake()
    full = baked(wall.data)[:, :3].mean(axis=0)
    bpy.context.scene.fmm_radiosity.content = content
    bpy.ops.fmm_radiosity.bake()
    select("Wall")
    before = [link.from_node.name for link in red.node_tree.links]
    # Once more for other colours sets up the same node.
    for each in ("LIGHTING", "FULL", content):
        bpy.context.scene.fmm_radiosity.content = each
        assert bpy.ops.fmm_radiosity.add_nodes() == {"FINISHED"}
    assert [link.from_node.name for link in red.node_tree.links] == before
    assert [group.name for group in bpy.data.node_groups] == ["Radiosity Light"]
    (node,) = (node for node in red.node_tree.nodes if node.type == "GROUP")
    output = next(node for node in red.node_tree.nodes if node.type == "OUTPUT_MATERIAL")
    red.node_tree.links.new(node.outputs["Shader"], output.inputs["Surface"])
    assert np.allclose(_cycles_emission(wall), full, rtol=2e-3)


def _cycles_emission(obj):
    """Mean emission (3,) of a mesh as Cycles bakes it to its vertices."""
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    obj.data.color_attributes.new("Cycles", "FLOAT_COLOR", "CORNER")
    obj.data.color_attributes.active_color_name = "Cycles"
    bpy.ops.object.bake(type="EMIT", target="VERTEX_COLORS")
    values = np.empty(4 * len(obj.data.loops), np.float32)
    obj.data.color_attributes["Cycles"].data.foreach_get("color", values)
    return values.reshape(-1, 4)[:, :3].mean(axis=0)
