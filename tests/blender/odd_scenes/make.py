# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes small .blend files of odd content, each named after what is odd about it.

python make.py FOLDER
"""

import math
import sys
from pathlib import Path

import bpy

# isort: split
# Exists only once bpy is loaded.
import bmesh

sys.path.insert(0, str(Path(__file__).parents[1] / "inside"))
from scenes import Build

build = Build()


def link(name, data, collection=None):
    """An object with some data, or an empty."""
    obj = bpy.data.objects.new(name, data)
    (collection or bpy.context.scene.collection).objects.link(obj)
    return obj


def lit():
    """What most scenes have: a floor and a lamp."""
    build.quad("Lamp", build.light("Glow", (5.0, 5.0, 5.0)), z=2.0, down=True)
    return build.quad("Floor", build.material("Grey", Color=(0.6, 0.6, 0.6)))


def nothing(folder):
    pass


def empty_collections(folder):
    lit()
    outer = bpy.data.collections.new("Outer")
    outer.children.link(bpy.data.collections.new("Inner"))
    bpy.context.scene.collection.children.link(outer)
    holder = link("Instance of nothing", None)
    holder.instance_type, holder.instance_collection = "COLLECTION", bpy.data.collections["Inner"]


def only_empties_and_cameras(folder):
    link("Empty", None)
    link("Camera", bpy.data.cameras.new("Camera"))
    link("Speaker", bpy.data.speakers.new("Speaker"))
    link("Lattice", bpy.data.lattices.new("Lattice"))
    link("Armature", bpy.data.armatures.new("Armature"))


def library(folder, name):
    """A file with a cube called Part."""
    build.cube("Part", build.material("Blue", Color=(0.1, 0.2, 0.7)), size=0.3)
    path = folder / name
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return path


def linked(path):
    with bpy.data.libraries.load(str(path), link=True) as (_, into):
        into.objects = ["Part"]
    bpy.context.scene.collection.objects.link(into.objects[0])
    return into.objects[0]


def linked_library(folder):
    path = library(folder, "parts.blend")
    lit()
    linked(path)


def missing_library(folder):
    path = library(folder, "lost.blend")
    lit()
    linked(path)
    path.unlink()


def library_override(folder):
    path = library(folder, "overridden.blend")
    lit()
    linked(path).override_create(remap_local_usages=True).location = (0.5, 0.5, 1.0)


def missing_image(folder):
    floor = lit()
    tree = floor.data.materials[0].node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image = bpy.data.images.new("Lost", 4, 4)
    image.source, image.filepath = "FILE", "//lost.png"
    tree.links.new(texture.outputs[0], tree.nodes[0].inputs["Color"])


def hidden_objects(folder):
    lit()
    build.cube("Not rendered").hide_render = True
    build.cube("Hidden").hide_set(True)
    build.cube("Off").hide_viewport = True
    collection = bpy.data.collections.new("Excluded")
    bpy.context.scene.collection.children.link(collection)
    link("Excluded", bpy.data.meshes["Hidden"], collection)
    bpy.context.view_layer.layer_collection.children["Excluded"].exclude = True


def everything_hidden(folder):
    lit()
    for obj in bpy.context.scene.objects:
        obj.hide_render = True


def no_materials(folder):
    lit()
    build.quad("No slot", z=0.5)
    build.quad("Empty slot", z=1.0).data.materials.append(None)
    build.quad("Slot out of range", bpy.data.materials["Grey"], z=1.5).data.polygons[0].material_index = 7
    bare = bpy.data.materials.new("No nodes")
    build.quad("No nodes", bare, z=1.2)
    empty = build.material("Empty tree")
    empty.node_tree.nodes.clear()
    build.quad("Empty tree", empty, z=1.7)


def no_light(folder):
    build.quad("Dark", build.material("Grey"))


def node_loops(folder):
    floor = lit()
    tree = floor.data.materials[0].node_tree
    first, second = tree.nodes.new("ShaderNodeInvert"), tree.nodes.new("ShaderNodeInvert")
    tree.links.new(first.outputs[0], second.inputs["Color"])
    tree.links.new(second.outputs[0], first.inputs["Color"])
    tree.links.new(second.outputs[0], tree.nodes[0].inputs["Color"])
    group = tree.nodes.new("ShaderNodeGroup")
    tree.links.new(group.outputs[0] if group.outputs else first.outputs[0], tree.nodes[0].inputs["Roughness"])


def curves(folder):
    lit()
    for name, bevel in (("Tube", 0.1), ("Wire", 0.0)):
        curve = bpy.data.curves.new(name, "CURVE")
        curve.dimensions, curve.bevel_depth, curve.resolution_u = "3D", bevel, 3
        spline = curve.splines.new("BEZIER")
        spline.bezier_points.add(2)
        for i, point in enumerate(spline.bezier_points):
            point.co = (0.3 * i, 0.2 * i * i, 0.5)
        link(name, curve)


def surfaces(folder):
    lit()
    bpy.ops.surface.primitive_nurbs_surface_sphere_add(radius=0.2, location=(0.5, 0.5, 1.0))
    bpy.context.object.data.resolution_u = bpy.context.object.data.resolution_v = 2


def text(folder):
    lit()
    font = bpy.data.curves.new("Text", "FONT")
    font.body, font.extrude, font.resolution_u = "Hi\n", 0.1, 1
    link("Text", font)
    link("No text", bpy.data.curves.new("No text", "FONT")).data.body = ""


def metaballs(folder):
    lit()
    ball = bpy.data.metaballs.new("Blob")
    ball.elements.new().radius, ball.resolution, ball.render_resolution = 0.5, 0.1, 0.1
    link("Blob", ball)
    link("Blob.001", ball).location.z = 0.2


def instances_of_instances(folder):
    lit()
    inner, outer = bpy.data.collections.new("Inner"), bpy.data.collections.new("Outer")
    inner.objects.link(build.cube("Stone", size=0.1, link=False))
    for i in range(3):
        held = link(f"Held {i}", None, outer)
        held.instance_type, held.instance_collection, held.location.x = "COLLECTION", inner, 0.2 * i
    for i in range(3):
        holder = link(f"Holder {i}", None)
        holder.instance_type, holder.instance_collection = "COLLECTION", outer
        holder.location, holder.rotation_euler.z, holder.scale.x = (0, 0.2 * i, 0.3), 0.4 * i, (-1) ** i
    parent = build.quad("Points", z=1.0)
    parent.instance_type = "VERTS"
    build.cube("On points", size=0.05).parent = parent


def geometry_nodes(folder):
    floor = lit()
    tree = bpy.data.node_groups.new("Scatter", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    start, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    points, put = tree.nodes.new("GeometryNodeMeshToPoints"), tree.nodes.new("GeometryNodeInstanceOnPoints")
    cone, join = tree.nodes.new("GeometryNodeMeshCone"), tree.nodes.new("GeometryNodeJoinGeometry")
    put.inputs["Scale"].default_value = (0.1, 0.1, 0.1)
    tree.links.new(start.outputs[0], points.inputs[0])
    tree.links.new(points.outputs[0], put.inputs["Points"])
    tree.links.new(cone.outputs["Mesh"], put.inputs["Instance"])
    tree.links.new(put.outputs[0], join.inputs[0])
    tree.links.new(start.outputs[0], join.inputs[0])
    tree.links.new(join.outputs[0], end.inputs[0])
    floor.modifiers.new("Scatter", "NODES").node_group = tree
    build.quad("No tree", z=0.5).modifiers.new("Nothing", "NODES")


def shape_keys(folder):
    floor = lit()
    floor.shape_key_add(name="Basis")
    up = floor.shape_key_add(name="Up")
    up.data[0].co.z, up.value = 0.4, 0.7
    relative = floor.shape_key_add(name="Muted")
    relative.data[1].co.z, relative.value, relative.mute = 9.0, 1.0, True


def huge_ngon(folder):
    lit()
    count = 5000
    star = [((0.3 + 0.2 * (i % 2)) * math.cos(2 * math.pi * i / count) + 0.5,
             (0.3 + 0.2 * (i % 2)) * math.sin(2 * math.pi * i / count) + 0.5, 0.5) for i in range(count)]  # fmt: skip
    build.object("Star", star, [tuple(range(count))])


def zero_scale(folder):
    lit()
    build.cube("Flat", size=0.4).scale.z = 0.0
    build.cube("Line", size=0.4).scale = (0.0, 0.0, 1.0)
    build.cube("Point", size=0.4).scale = (0.0, 0.0, 0.0)
    build.cube("Tiny", size=0.4).scale = (1e-12, 1e-12, 1e-12)


def drivers(folder):
    floor = lit()
    strength = bpy.data.materials["Glow"].node_tree.nodes[0].inputs["Strength"].driver_add("default_value").driver
    strength.expression = "2 + 1"
    floor.driver_add("location", 2).driver.expression = "nonsense +"
    floor.driver_add("rotation_euler", 2).driver.expression = "frame / 10"


def loose_geometry(folder):
    lit()
    build.object("Points", [(0, 0, 0), (1, 1, 1)], [])
    mesh = bpy.data.meshes.new("Wire")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 1), (2, 3)], [(0, 1, 2)])
    link("Wire", mesh)
    link("No vertices", bpy.data.meshes.new("No vertices"))


def degenerate_faces(folder):
    lit()
    vertices = [(0, 0, 1), (0.5, 0, 1), (1, 0, 1), (0, 1, 1), (0, 0, 1)]
    build.object("Bad", vertices, [(0, 1, 2), (0, 2, 3), (0, 4, 1), (0, 3, 2)])


def not_finite(folder):
    lit()
    build.quad("Broken", z=0.5).data.vertices[2].co.x = math.nan


def far_and_huge(folder):
    lit()
    build.cube("Sky box", size=1e6)
    build.cube("Far", size=0.1).location.x = 1e7


def armature(folder):
    lit()
    cube = build.cube("Skin", size=0.4)
    rig = link("Rig", bpy.data.armatures.new("Rig"))
    modifier = cube.modifiers.new("Rig", "ARMATURE")
    modifier.object = rig
    cube.modifiers.new("Bevel", "BEVEL").show_viewport = False
    cube.modifiers.new("No target", "SHRINKWRAP")
    cube.modifiers.new("Cut", "BOOLEAN").object = bpy.data.objects["Floor"]


def hair(folder):
    floor = lit()
    floor.modifiers.new("Hair", "PARTICLE_SYSTEM")
    floor.particle_systems[0].settings.type = "HAIR"
    link("New hair", bpy.data.hair_curves.new("New hair"))
    link("Cloud", bpy.data.volumes.new("Cloud"))
    link("Dots", bpy.data.pointclouds.new("Dots"))


def names(folder):
    lit()
    build.quad("名前 ß \t\n end", build.material("μ {0} %s"), z=0.5)
    build.quad("x" * 63, build.material("y" * 63), z=0.7)


def shared_meshes(folder):
    floor = lit()
    for i in range(3):
        link(f"Copy {i}", floor.data).location = (0.3 * i, 0, 0.2 * (i + 1))
    other = bpy.data.scenes.new("Other")
    other.collection.objects.link(floor)


def name_taken(folder):
    lit().data.attributes.new("Radiosity", "FLOAT", "POINT")


def sheared_and_mirrored(folder):
    lit()
    parent = link("Parent", None)
    parent.scale, parent.rotation_euler = (1.0, -3.0, 0.2), (0.3, 0.4, 0.5)
    child = build.cube("Child", size=0.3)
    child.parent, child.rotation_euler = parent, (0.7, 0.1, 0.9)


def dense_mesh(folder):
    lit()
    ball = build.object("Ball", [], [])
    edit = bmesh.new()
    bmesh.ops.create_icosphere(edit, subdivisions=3, radius=0.3)
    for face in edit.faces[: len(edit.faces) // 2]:
        face.normal_flip()
    edit.to_mesh(ball.data)
    edit.free()


#: Every scene, by its name.
SCENES = {
    make.__name__: make
    for make in (
        nothing, empty_collections, only_empties_and_cameras, linked_library, missing_library, library_override,
        missing_image, hidden_objects, everything_hidden, no_materials, no_light, node_loops, curves, surfaces, text,
        metaballs, instances_of_instances, geometry_nodes, shape_keys, huge_ngon, zero_scale, drivers, loose_geometry,
        degenerate_faces, not_finite, far_and_huge, armature, hair, names, shared_meshes, name_taken,
        sheared_and_mirrored, dense_mesh,
    )
}  # fmt: skip


def main(folder: str) -> None:
    for name, make in SCENES.items():
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        make(Path(folder))
        bpy.ops.wm.save_as_mainfile(filepath=str(Path(folder) / f"{name}.blend"))


if __name__ == "__main__":
    main(sys.argv[1])
