# SPDX-License-Identifier: GPL-3.0-or-later
"""Run in a process of its own: a plane with a blocker above it under one light after the other, baked twice.

python bake_lights.py OUT.npz FACES SAMPLES [NAME ...]: for each light `name ours` (C, 3) and `name cycles` (2, C, 3),
W/m^2 at the corners of the plane and of the blocker, by this project and by Cycles with two seeds.
"""

import importlib
import math
import sys
from pathlib import Path

import bpy
import numpy as np
from bake_both import cycles_bake, inside, prepare_cycles

from addon import standalone

HALF = 1.5


def grid(name, faces, half, height, colour):
    """A square of faces * faces faces."""
    at = np.linspace(-half, half, faces + 1)
    vertices = [(x, y, height) for y in at for x in at]
    n = faces + 1
    quads = [
        (n * j + i, n * j + i + 1, n * (j + 1) + i + 1, n * (j + 1) + i) for j in range(faces) for i in range(faces)
    ]
    return mesh(name, vertices, quads, "ShaderNodeBsdfDiffuse", (*colour, 1.0))


def mesh(name, vertices, faces, shader, colour, strength=None):
    data = bpy.data.meshes.new(name)
    data.from_pydata(vertices, [], faces)
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    node = nodes.new(shader)
    node.inputs["Color"].default_value = colour
    if strength is not None:
        node.inputs["Strength"].default_value = strength
    material.node_tree.links.new(node.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    data.materials.append(material)
    obj = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def lamp(kind, place=(0.4, -0.3, 2.0), turn=(0.25, 0.15, 0.4), scale=(1, 1, 1), link=True, **fields):
    data = bpy.data.lights.new(kind, kind)
    data.color = (1.0, 0.8, 0.5)
    for name, value in fields.items():
        setattr(data, name, value)
    obj = bpy.data.objects.new(kind, data)
    obj.location, obj.rotation_euler, obj.scale = place, turn, scale
    if link:
        bpy.context.scene.collection.objects.link(obj)
    return obj


def instanced():
    """A collection with a lamp, shown twice, turned and stretched."""
    group = bpy.data.collections.new("Group")
    group.objects.link(lamp("AREA", (0, 0, 1), (0.1, 0, 0), link=False, energy=40, size=0.4))
    for place, scale in (((0.5, 0, 1), (2, 0.5, 1)), ((-0.6, 0.3, 0.9), (0.7, 1, -1))):
        holder = bpy.data.objects.new("Holder", None)
        holder.instance_type, holder.instance_collection = "COLLECTION", group
        holder.location, holder.scale = place, scale
        holder.rotation_euler = (0, math.pi if scale[2] < 0 else 0.2, 0.3)
        bpy.context.scene.collection.objects.link(holder)


def world(node=None, strength=1.0, colour=(0.6, 0.8, 1.0, 1.0), **fields):
    """A background: a colour, or what a node gives."""
    data = bpy.data.worlds.new("World")
    data.use_nodes = True
    background = next(n for n in data.node_tree.nodes if n.bl_idname == "ShaderNodeBackground")
    background.inputs["Color"].default_value, background.inputs["Strength"].default_value = colour, strength
    if node is not None:
        source = data.node_tree.nodes.new(node)
        for name, value in fields.items():
            setattr(source, name, value)
        data.node_tree.links.new(source.outputs[0], background.inputs["Color"])
    bpy.context.scene.world = data


def unseen():
    """An image of a sky that cameras see as another one."""
    world("ShaderNodeTexEnvironment", image=image())
    tree = bpy.context.scene.world.node_tree
    path, mixed, shown = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("LightPath", "MixShader", "Background"))
    output = tree.get_output_node("CYCLES")
    tree.links.new(path.outputs["Is Camera Ray"], mixed.inputs[0])
    tree.links.new(output.inputs["Surface"].links[0].from_socket, mixed.inputs[1])
    tree.links.new(shown.outputs[0], mixed.inputs[2])
    tree.links.new(mixed.outputs[0], output.inputs["Surface"])


def image():
    """A sky that is blue on one side, with a few bright pixels on the other."""
    pixels = np.zeros((32, 64, 4), np.float32)
    pixels[16:] = (0.3, 0.5, 0.9, 1.0)
    pixels[16:, 40:] *= 0.3
    pixels[22:24, 12:15] = (60.0, 50.0, 30.0, 1.0)
    made = bpy.data.images.new("Sky", 64, 32, float_buffer=True)
    made.pixels.foreach_set(pixels.ravel())
    made.filepath_raw, made.file_format = str(Path(sys.argv[1]).with_name("sky.exr")), "OPEN_EXR"
    made.save()
    return bpy.data.images.load(made.filepath_raw)


def emitter():
    """A sheet that shines from both sides, upright beside the blocker."""
    corners = [(-0.7, -0.4, 0.3), (-0.7, 0.5, 0.3), (-0.8, 0.5, 1.0), (-0.8, -0.4, 1.0)]
    return mesh("Sheet", corners, [(0, 1, 2, 3)], "ShaderNodeEmission", (1.0, 0.8, 0.5, 1.0), 5.0)


def wall():
    """A bright wall beside the blocker, which the sun shines on."""
    corners = [(1.2, -1.5, 0.01), (1.2, 1.5, 0.01), (0.9, 1.5, 2.0), (0.9, -1.5, 2.0)]
    mesh("Wall", corners, [(3, 2, 1, 0)], "ShaderNodeBsdfDiffuse", (0.9, 0.9, 0.9, 1.0))


def box(low, high, shader="ShaderNodeBsdfDiffuse", strength=None, inwards=True):
    """A closed box whose faces look inwards or outwards."""
    corners = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face[::-1] if inwards else face for face in faces]
    mesh("Box", corners, faces, shader, (0.9, 0.9, 0.9, 1.0), strength)


def hide(obj, *rays):
    """Hide an object from rays."""
    for name in rays:
        setattr(obj, f"visible_{name}", False)


LIGHTS = {
    "point": lambda: lamp("POINT", energy=100, shadow_soft_size=0.0),
    "soft point": lambda: lamp("POINT", energy=100, shadow_soft_size=0.2, use_soft_falloff=True),
    "ball": lambda: lamp("POINT", energy=100, shadow_soft_size=0.2, use_soft_falloff=False, scale=(2, 1, 1)),
    "sun": lambda: lamp("SUN", energy=3, angle=0.15),
    "spot": lambda: lamp("SPOT", energy=200, spot_size=1.1, spot_blend=0.4, shadow_soft_size=0.1),
    "wide spot": lambda: lamp("SPOT", scale=(2, 1, 1), energy=200, spot_size=1.1, spot_blend=0.4, shadow_soft_size=0.1),
    "tall spot": lambda: lamp("SPOT", scale=(1, 1, 2), energy=200, spot_size=1.1, spot_blend=0.4, shadow_soft_size=0.0),
    "odd spot": lambda: lamp("SPOT", scale=(1, 2, 0.5), energy=200, spot_size=0.8, spot_blend=0.7, shadow_soft_size=0),
    "square": lambda: lamp("AREA", energy=60, shape="SQUARE", size=0.5),
    "rectangle": lambda: lamp("AREA", energy=60, shape="RECTANGLE", size=0.3, size_y=0.5, scale=(2, 1.2, 3)),
    "disk": lambda: lamp("AREA", energy=60, shape="DISK", size=0.5),
    "ellipse": lambda: lamp("AREA", energy=60, shape="ELLIPSE", size=0.3, size_y=0.7, spread=1.5),
    "instances": instanced,
    "emitter": emitter,
    "pane": lambda: (lamp("AREA", energy=60, size=0.5), hide(bpy.data.objects["Blocker"], "shadow")),
    "shade": lambda: (lamp("SUN", energy=3, angle=0.15), wall(), hide(bpy.data.objects["Blocker"], "diffuse")),
    "hidden emitter": lambda: (lamp("AREA", energy=60, size=0.5), hide(emitter(), "diffuse")),
    "hidden blocker": lambda: (emitter(), hide(bpy.data.objects["Blocker"], "diffuse", "shadow")),
    "box inside out": lambda: (lamp("SUN", energy=3, angle=0.15), box((0.9, -1.4, 0.3), (1.4, 1.4, 2.0))),
    "glow inside out": lambda: box((-1.2, -0.4, 0.3), (-0.7, 0.3, 0.9), "ShaderNodeEmission", 5.0),
    "room of a cube": lambda: (lamp("AREA", energy=60, size=0.5), box((-2, -2, -0.5), (2, 2, 2.5), inwards=False)),
    "even sky": lambda: world(strength=2.0),
    "sky texture": lambda: world("ShaderNodeTexSky", 0.2, sky_type="NISHITA", sun_elevation=0.9, sun_rotation=0.5),
    "image": lambda: world("ShaderNodeTexEnvironment", image=image()),
    "unseen image": unseen,
}


def clear():
    """Take away what the light before has left."""
    bpy.context.scene.world = None
    blocker = bpy.data.objects["Blocker"]
    blocker.visible_diffuse = blocker.visible_shadow = True
    for obj in list(bpy.data.objects):
        if obj.name not in ("Floor", "Blocker"):
            bpy.data.objects.remove(obj)


def bake(name):
    """Irradiance by both, where neither is at an edge."""
    clear()
    LIGHTS[name]()
    bpy.context.view_layer.update()
    baking = importlib.import_module("fmm_radiosity.addon.bake")
    data = baking.read(bpy.context, colours="POINTS")
    result = baking.compute(data, importlib.import_module("fmm_core").Settings())
    arrays = result.arrays
    ours = (np.pi * result.colours - arrays.corner_emission) / np.maximum(arrays.corner_albedo, 1e-9)
    cycles = np.array([cycles_bake(arrays, seed) for seed in range(2)])
    good = inside(arrays)
    return ours[good], cycles[:, good]


def main(out, faces, samples, *names):
    package = standalone._load_extension()
    package.register()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    grid("Floor", int(faces), HALF, 0.0, (0.6, 0.4, 0.2))
    grid("Blocker", max(2, int(faces) // 4), 0.4, 0.5, (0.3, 0.5, 0.7)).rotation_euler = (0.1, 0.2, 0.3)
    prepare_cycles(int(samples))
    found = {}
    for name in names or LIGHTS:
        found[f"{name} ours"], found[f"{name} cycles"] = bake(name)
    np.savez(out, **found)
    package.unregister()


if __name__ == "__main__":
    main(*sys.argv[1:])
