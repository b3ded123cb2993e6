# SPDX-License-Identifier: GPL-3.0-or-later
"""Run in a process of its own: makes a small scene, bakes it with this project and with Cycles, and saves both.

python material_scenes.py NAME SAMPLES OUT.npz: ours (C, 3), cycles (2, C, 3), W/m^2 at every corner of the object
"Floor" that is not on its rim, by seeds of their own; NAME is one of SCENES.
"""

import importlib
import math
import sys
from pathlib import Path

import bpy
import numpy as np

from addon import standalone

sys.path.insert(0, str(Path(__file__).parents[1] / "blender/inside"))
from bake_both import cycles_bake, prepare_cycles
from scenes import Build

build = Build()


def floor(cells=12, size=2.0, material=None):
    """A square about the origin, counter-clockwise from above."""
    places = np.linspace(-size / 2, size / 2, cells + 1)
    vertices = [(x, y, 0.0) for y in places for x in places]
    row = cells + 1
    faces = [(row * j + i, row * j + i + 1, row * j + i + row + 1, row * j + i + row)
             for j in range(cells) for i in range(cells)]  # fmt: skip
    return build.object("Floor", vertices, faces, material or build.material("White", Color=(0.7, 0.7, 0.7)))


def picture(pixels, name="Picture"):
    """An image of (H, W, 4) values in sRGB, the lowest row first."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=True)
    image.pixels.foreach_set(pixels.astype(np.float32).ravel())
    image.pack()
    return image


def painted(name, image, shader, socket, alpha=None, **inputs):
    """A material whose shader has an image at a socket, and its alpha at another."""
    material = build.material(name, shader, **inputs)
    tree = material.node_tree
    node, texture = next(n for n in tree.nodes if n.bl_idname == shader), tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    tree.links.new(texture.outputs["Color"], node.inputs[socket])
    if alpha:
        tree.links.new(texture.outputs["Alpha"], node.inputs[alpha])
    return material


def sheet(name, material, corners):
    """A quad whose UV map is the whole image."""
    obj = build.object(name, corners, [(0, 1, 2, 3)], material)
    obj.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", [0, 0, 1, 0, 1, 1, 0, 1])
    return obj


def lamp(corners, radiance=5.0):
    return build.object("Lamp", corners, [(0, 1, 2, 3)], build.light("Glow", (radiance,) * 3))


def lamp_above(size=0.5, height=2.0):
    h = size / 2
    return lamp([(-h, h, height), (h, h, height), (h, -h, height), (-h, -h, height)])


def wall():
    """A wall of four strong colours, one quad, beside a floor."""
    pixels = np.ones((8, 8, 4))
    pixels[..., :3] = 0.05
    pixels[:4, :4, 0] = pixels[4:, 4:, 1] = pixels[:4, 4:, 2] = 0.95
    image = picture(pixels)
    floor()
    sheet("Wall", painted("Paint", image, "ShaderNodeBsdfDiffuse", "Color"),
          [(-1.0, -1, 0), (-1.0, 1, 0), (-1.0, 1, 2), (-1.0, -1, 2)])  # fmt: skip
    lamp([(1.0, -0.5, 0.5), (1.0, 0.5, 0.5), (1.0, 0.5, 1.5), (1.0, -0.5, 1.5)])


def procedural():
    """A wall of bricks, half of it of coloured noise, beside a floor; only its corners are vertices."""
    floor()
    material = build.material("Paint")
    tree = material.node_tree
    bricks, noise = tree.nodes.new("ShaderNodeTexBrick"), tree.nodes.new("ShaderNodeTexNoise")
    spread = tree.nodes.new("ShaderNodeVectorMath")
    spread.operation, spread.inputs[1].default_value, spread.inputs[2].default_value = (
        "MULTIPLY_ADD",
        (1.6,) * 3,
        (-0.3,) * 3,
    )
    noise.inputs["Scale"].default_value, bricks.inputs["Scale"].default_value = 3.0, 2.0
    bricks.inputs["Color2"].default_value = (0.9, 0.1, 0.1, 1.0)
    tree.links.new(noise.outputs["Color"], spread.inputs[0])
    tree.links.new(spread.outputs[0], bricks.inputs["Color1"])
    tree.links.new(bricks.outputs["Color"], next(n for n in tree.nodes if n.type == "BSDF_DIFFUSE").inputs["Color"])
    build.object("Wall", [(-1.0, -1, 0), (-1.0, 1, 0), (-1.0, 1, 2), (-1.0, -1, 2)], [(0, 1, 2, 3)], material)
    lamp([(1.0, -0.5, 0.5), (1.0, 0.5, 0.5), (1.0, 0.5, 1.5), (1.0, -0.5, 1.5)])


def leaf(shader="ShaderNodeBsdfPrincipled", alpha="Alpha"):
    """A leaf with ragged edges, cut out of a quad by alpha, half way to a lamp."""
    x, y = np.meshgrid(*[(np.arange(64) + 0.5) / 32 - 1] * 2)
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    pixels = np.ones((64, 64, 4))
    pixels[..., :3] = 0.2, 0.6, 0.1
    pixels[..., 3] = radius < 0.6 + 0.3 * np.sin(5 * angle)
    floor()
    material = painted("Leaf", picture(pixels), shader, "Base Color", alpha, Roughness=1.0, Specular_IOR_Level=0.0)
    sheet("Leaf", material, [(-0.6, -0.6, 0.9), (0.6, -0.6, 1.0), (0.6, 0.6, 1.1), (-0.6, 0.6, 1.0)])
    lamp_above()


def veil():
    """The same place with a sheet whose alpha goes from 0 to 1."""
    pixels = np.ones((64, 64, 4))
    pixels[..., 3] = (np.arange(64) + 0.5) / 64
    floor()
    black = {"Specular_IOR_Level": 0.0}
    material = painted("Veil", picture(pixels), "ShaderNodeBsdfPrincipled", "Base Color", "Alpha", **black)
    sheet("Veil", material, [(-0.8, -0.8, 1.0), (0.8, -0.8, 1.0), (0.8, 0.8, 1.0), (-0.8, 0.8, 1.0)])
    lamp_above()


def screen():
    """A screen that shows a picture, upright beside a floor."""
    pixels = np.ones((8, 8, 4))
    pixels[..., :3] = 0.0
    pixels[:4, :4, 0] = pixels[4:, 4:, 1] = pixels[2:6, 4:, 2] = 1.0
    floor()
    material = painted("Screen", picture(pixels), "ShaderNodeEmission", "Color", Strength=3.0)
    sheet("Screen", material, [(-1.0, -1, 0.2), (-1.0, 1, 0.2), (-1.0, 1, 1.4), (-1.0, -1, 1.4)])


def plastic():
    """A box of shiny plastic around the floor, whose specular reflection is part of what it sends on."""
    floor(8, 1.8)
    box = build.cube("Box", build.material("Plastic", "ShaderNodeBsdfPrincipled", Base_Color=(0.6, 0.5, 0.3)),
                     size=2.0, inward=True)  # fmt: skip
    box.location = (0, 0, 0.9)
    lamp_above(height=1.8)


def round_shape():
    """A coarse ball shaded smooth, and a sheet with custom normals, under a lamp: both are called Floor."""
    ball = build.ball("Floor", build.material("White", Color=(0.7, 0.7, 0.7)), radius=0.6)
    ball.location = (0.1, 0.2, 0.6)
    lamp_above(size=1.0)


def bent_normals():
    """A flat floor whose normals are those of a hill."""
    obj = floor()
    obj.data.polygons.foreach_set("use_smooth", [True] * len(obj.data.polygons))
    normals = np.array([(0.5 * v.co.x, 0.5 * v.co.y, 1.0) for v in obj.data.vertices])
    obj.data.normals_split_custom_set_from_vertices((normals / np.linalg.norm(normals, axis=1)[:, None]).tolist())
    lamp_above()


def fog():
    """A closed room of three grey walls with a shining ceiling and a lamp, full of a medium that absorbs blue most."""
    floor(8, 1.8)
    box = build.cube("Box", build.material("Paint", Color=(0.6, 0.6, 0.6)), size=2.0, inward=True)
    box.location = (0, 0, 0.95)
    lamp_above(height=1.8)
    data = bpy.data.lights.new("Bulb", "POINT")
    data.energy, data.shadow_soft_size = 20.0, 0.1
    bulb = bpy.data.objects.new("Bulb", data)
    bulb.location = (0.5, 0.4, 1.2)
    bpy.context.scene.collection.objects.link(bulb)
    world = bpy.context.scene.world = bpy.data.worlds.new("Fog")
    if world.node_tree is None:
        world.use_nodes = True
    nodes = world.node_tree.nodes
    nodes.clear()
    volume, output = nodes.new("ShaderNodeVolumeAbsorption"), nodes.new("ShaderNodeOutputWorld")
    volume.inputs["Color"].default_value, volume.inputs["Density"].default_value = (0.9, 0.5, 0.2, 1.0), 1.2
    world.node_tree.links.new(volume.outputs["Volume"], output.inputs["Volume"])


def jelly():
    """A floor under a lamp and a block that lets all light in, and absorbs it inside."""
    floor(8, 1.8)
    material = build.material("Jelly")
    nodes = material.node_tree.nodes
    nodes.clear()
    volume, output = nodes.new("ShaderNodeVolumeAbsorption"), nodes.new("ShaderNodeOutputMaterial")
    volume.inputs["Color"].default_value, volume.inputs["Density"].default_value = (0.9, 0.5, 0.2, 1.0), 2.0
    material.node_tree.links.new(volume.outputs["Volume"], output.inputs["Volume"])
    block = build.cube("Block", material, size=0.8)
    block.location, block.rotation_euler = (0.2, 0.1, 0.7), (0.2, 0.3, 0.4)
    wall = build.object("Wall", [(-0.95, -1, 0.02), (-0.95, 1, 0.02), (-0.95, 1, 2), (-0.95, -1, 2)], [(0, 1, 2, 3)])
    wall.data.materials.append(build.material("Paint", Color=(0.8, 0.8, 0.8)))
    lamp_above()


#: What is made, what is compared, and settings by which shadows are finer than a percent.
PAIRS, RAYS = {"method": "direct", "particles": 4000}, {"method": "fmm", "particles": 6000, "rays": 2000}
SCENES = {
    "wall": (wall, "INDIRECT", {}),
    "procedural": (procedural, "INDIRECT", {}),
    "leaf": (leaf, "LIGHTING", PAIRS),
    "veil": (veil, "LIGHTING", RAYS),
    "screen": (screen, "LIGHTING", PAIRS),
    "plastic": (plastic, "LIGHTING", {}),
    "ball": (round_shape, "LIGHTING", {}),
    "fog": (fog, "LIGHTING", {}),
    "fog by rays": (fog, "LIGHTING", RAYS),
    "jelly": (jelly, "LIGHTING", RAYS),
    # Ours would see a little of the floor that they stand on.
    "bent normals": (bent_normals, "LIGHTING", {"effects": {"interreflection": False}}),
}


def main(name: str, samples: int, out: str) -> None:
    package = standalone._load_extension()
    package.register()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    make, content, effort = SCENES[name]
    make()
    bpy.context.scene.fmm_radiosity.content = content
    bake = importlib.import_module("fmm_radiosity.addon.bake")
    data = bake.read(bpy.context, colours="POINTS")
    result = bake.compute(data, importlib.import_module("fmm_core").Settings(**effort))
    assert not result.arrays.warnings, result.arrays.warnings
    rows = next(receiver.rows for receiver in result.arrays.receivers if receiver.object == "Floor")
    # A vertex on the rim of the floor may be a wall's as well.
    x, y, _ = np.abs(result.arrays.corner_position[rows]).T
    rows = np.arange(rows.start, rows.stop)[(x < x.max() - 1e-5) & (y < y.max() - 1e-5)]
    prepare_cycles(samples)
    passes = {"INDIRECT"} if content == "INDIRECT" else {"DIRECT", "INDIRECT"}
    cycles = np.array([cycles_bake(result.arrays, seed, passes)[rows] for seed in range(2)])
    ours = math.pi * result.colours[rows]
    np.savez(out, ours=ours, cycles=cycles)
    package.unregister()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3])
