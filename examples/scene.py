# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials, camera and saving, the same for all example scenes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy
from mathutils import Vector

Colour = Sequence[float]


def start() -> None:
    """Open an empty scene with a square picture of 512 x 512."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.preferences.filepaths.save_version = 0
    render = bpy.context.scene.render
    render.engine = "CYCLES"
    render.resolution_x = render.resolution_y = 512
    bpy.context.scene.view_settings.view_transform = "Standard"


def diffuse(name: str, albedo: Colour) -> bpy.types.Material:
    """A matt material of linear albedo."""
    return _material(name, "ShaderNodeBsdfDiffuse", albedo)


def light(name: str, radiance: Colour) -> bpy.types.Material:
    """A material that gives off linear radiance, W/m^2/sr."""
    strength = max(radiance)
    material = _material(name, "ShaderNodeEmission", [channel / strength for channel in radiance])
    material.node_tree.nodes["Shader"].inputs["Strength"].default_value = strength
    return material


def camera(position: Sequence[float], target: Sequence[float], focal_length: float, sensor: float) -> None:
    """Add the camera of the scene; focal length and sensor width in mm."""
    data = bpy.data.cameras.new("Camera")
    data.lens, data.sensor_width = focal_length, sensor
    obj = bpy.data.objects.new("Camera", data)
    obj.location = position
    obj.rotation_euler = (Vector(target) - Vector(position)).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.scene.camera = obj


def save(path: Path) -> int:
    """Save the scene compressed; returns its number of vertices."""
    bpy.ops.wm.save_as_mainfile(filepath=str(path.absolute()), compress=True)
    return sum(len(mesh.vertices) for mesh in bpy.data.meshes)


def _material(name: str, shader: str, colour: Colour) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    if material.node_tree is None:
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    node = nodes.new(shader)
    node.name = "Shader"
    node.inputs["Color"].default_value = (*colour, 1.0)
    links.new(node.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    material.diffuse_color = (*colour, 1.0)
    return material
