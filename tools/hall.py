# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene of many vertices: a hall of pillars under lamps."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Vector


def build() -> None:
    """Two rows of pillars with arches of light between them, under a ceiling with lamps."""
    materials = {
        name: material(name, colour)
        for name, colour in {"Floor": (0.5, 0.42, 0.35), "Wall": (0.75, 0.72, 0.66), "Cloth": (0.6, 0.08, 0.06)}.items()
    }
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 6, 2), scale=(8, 16, 4))
    room = bpy.context.object
    room.data.flip_normals()
    room.data.materials.append(materials["Wall"])
    room.data.materials.append(materials["Floor"])
    for face in room.data.polygons:
        face.material_index = int(face.normal.z > 0.9)
    for row in range(5):
        for x in (-2.2, 2.2):
            bpy.ops.mesh.primitive_cylinder_add(vertices=24, radius=0.35, depth=3.9, location=(x, 3 * row, 1.97))
            for face in bpy.context.object.data.polygons:
                face.use_smooth = abs(face.normal.z) < 0.5
            bpy.context.object.data.materials.append(materials["Wall"])
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 6, 0.02), scale=(1.6, 14, 0.03))
    bpy.context.object.data.materials.append(materials["Cloth"])
    for row in range(4):
        bpy.ops.mesh.primitive_plane_add(size=1, location=(0, 1.5 + 3 * row, 3.95), scale=(1.2, 1.2, 1))
        bpy.context.object.name = "Lamp"
        bpy.context.object.rotation_euler.x = np.pi
        bpy.context.object.data.materials.append(material("Lamp", (1.0, 0.85, 0.6), 6.0))
    data = bpy.data.cameras.new("Camera")
    camera = bpy.data.objects.new("Camera", data)
    data.lens = 22
    camera.location = (0.9, -1.6, 1.6)
    camera.rotation_euler = (Vector((-0.4, 6, 1.5)) - camera.location).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera


def material(name: str, colour: tuple[float, float, float], strength: float | None = None) -> bpy.types.Material:
    """A matt material, or one that gives off light."""
    found = bpy.data.materials.get(name)
    if found is not None:
        return found
    made = bpy.data.materials.new(name)
    if made.node_tree is None:
        made.use_nodes = True
    nodes = made.node_tree.nodes
    nodes.clear()
    shader = nodes.new("ShaderNodeBsdfDiffuse" if strength is None else "ShaderNodeEmission")
    shader.inputs["Color"].default_value = (*colour, 1.0)
    if strength is not None:
        shader.inputs["Strength"].default_value = strength
    made.node_tree.links.new(shader.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return made
