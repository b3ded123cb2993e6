# SPDX-License-Identifier: GPL-3.0-or-later
"""Run in a process of its own: a glossy floor under one light after the other, as a camera sees it, baked twice.

python bake_gloss.py OUT.npz SAMPLES: for each light and material `LIGHT MATERIAL ours` and `dull` (C, 3) and `cycles`
(2, C, 3), radiance at the corners of the floor, by this project with and without gloss and by Cycles with two seeds.
"""

import importlib
import math
import sys

import bpy
import numpy as np
from bake_both import prepare_cycles
from bake_lights import emitter, grid, lamp, world

from addon import standalone

LIGHTS = {
    "area": lambda: lamp("AREA", energy=60, shape="SQUARE", size=0.5),
    "sun": lambda: lamp("SUN", turn=(-0.9, 0, 0), energy=3, angle=0.05),
    "emitter": emitter,
    "sky": lambda: world(strength=2.0),
    "wall": lambda: wall(),
}
MATERIALS = {
    "plastic": {"Base Color": (0.6, 0.3, 0.1, 1), "Roughness": 0.4},
    "metal": {"Base Color": (0.9, 0.6, 0.3, 1), "Metallic": 1.0, "Roughness": 0.3},
}


def wall():
    """A red wall behind the floor, and a lamp."""
    made = grid("Wall", 6, 0.8, 0.0, (0.7, 0.2, 0.2))
    made.location, made.rotation_euler = (0, 1.2, 0.8), (math.pi / 2, 0, 0)
    lamp("AREA", energy=60, shape="SQUARE", size=0.5)


def glossy_floor():
    """A floor of one Principled shader, which is returned, and a camera before it."""
    floor = grid("Floor", 12, 1.5, 0.0, (0.8, 0.8, 0.8))
    tree = floor.data.materials[0].node_tree
    node = tree.nodes.new("ShaderNodeBsdfPrincipled")
    output = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeOutputMaterial")
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    bpy.context.scene.collection.objects.link(camera)
    camera.location, camera.rotation_euler = (0.3, -3.0, 2.0), (1.0, 0.0, 0.1)
    bpy.context.scene.camera = camera
    return floor, node


def clear():
    """Take away what the light before has left."""
    bpy.context.scene.world = None
    for obj in list(bpy.data.objects):
        if obj.name not in ("Floor", "Camera"):
            bpy.data.objects.remove(obj)


def by_cycles(floor, seed):
    """Radiance (C, 3) towards the camera."""
    bpy.context.scene.cycles.seed = seed
    bpy.context.scene.render.bake.view_from = "ACTIVE_CAMERA"
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj == floor)
    bpy.context.view_layer.objects.active = floor
    found = floor.data.color_attributes
    found.active_color = found.get("Cycles") or found.new("Cycles", "FLOAT_COLOR", "CORNER")
    bpy.ops.object.bake(type="COMBINED")
    values = np.empty(4 * len(floor.data.loops), np.float32)
    floor.data.color_attributes["Cycles"].data.foreach_get("color", values)
    return values.reshape(-1, 4)[:, :3].astype(float)


def by_us(floor):
    """The same, with and without gloss; and whether each corner is away from the rim."""
    baking = importlib.import_module("fmm_radiosity.addon.bake")
    settings = importlib.import_module("fmm_core").Settings(probes=0)
    data = baking.read(bpy.context, colours="POINTS", view=True)
    result = baking.compute(data, settings)
    rows = next(receiver.rows for receiver in data.arrays.receivers if receiver.object == floor.name)
    away = (np.abs(data.arrays.corner_position[rows, :2]) < (1.4, 1.1)).all(axis=1)
    return result.layers["Radiosity View"][rows], result.colours[rows], away


def main(out, samples):
    package = standalone._load_extension()
    package.register()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    floor, node = glossy_floor()
    prepare_cycles(int(samples))
    found = {}
    for light, make in LIGHTS.items():
        clear()
        make()
        for material, inputs in MATERIALS.items():
            node.inputs["Metallic"].default_value = 0.0
            for name, value in inputs.items():
                node.inputs[name].default_value = value
            bpy.context.view_layer.update()
            ours, dull, away = by_us(floor)
            cycles = np.array([by_cycles(floor, seed) for seed in range(2)])
            name = f"{light} {material}"
            found |= {f"{name} ours": ours[away], f"{name} dull": dull[away], f"{name} cycles": cycles[:, away]}
    np.savez(out, **found)
    package.unregister()


if __name__ == "__main__":
    main(*sys.argv[1:])
