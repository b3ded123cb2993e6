# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes to bake, and readers of what came out."""

import bpy

# isort: split
# Exists only once bpy is loaded.
import bmesh
import numpy as np


class Build:
    """Makes the objects of a test."""

    def material(self, name="Grey", shader="ShaderNodeBsdfDiffuse", **inputs):
        material = bpy.data.materials.new(name)
        if material.node_tree is None:
            material.use_nodes = True
        nodes = material.node_tree.nodes
        nodes.clear()
        node, output = nodes.new(shader), nodes.new("ShaderNodeOutputMaterial")
        for socket, value in inputs.items():
            value = (*value, 1.0) if isinstance(value, tuple) else value
            node.inputs[socket.replace("_", " ")].default_value = value
        material.node_tree.links.new(node.outputs[0], output.inputs["Surface"])
        return material

    def light(self, name="Glow", radiance=(1.0, 1.0, 1.0)):
        return self.material(name, "ShaderNodeEmission", Color=radiance, Strength=1.0)

    def object(self, name, vertices, faces, *materials, slots=None, smooth=False, link=True):
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata(vertices, [], faces)
        for material in materials:
            mesh.materials.append(material)
        if slots is not None:
            mesh.polygons.foreach_set("material_index", slots)
        mesh.polygons.foreach_set("use_smooth", [smooth] * len(faces))
        obj = bpy.data.objects.new(name, mesh)
        if link:
            bpy.context.scene.collection.objects.link(obj)
        return obj

    def quad(self, name="Quad", *materials, z=0.0, down=False, **options):
        """A unit square in the plane of height z, looking up, or down."""
        vertices = [(0, 0, z), (1, 0, z), (1, 1, z), (0, 1, z)]
        return self.object(name, vertices, [(3, 2, 1, 0) if down else (0, 1, 2, 3)], *materials, **options)

    def cube(self, name="Cube", *materials, size=1.0, inward=False, **options):
        """A closed cube about the origin that looks out, or in."""
        h = size / 2
        vertices = [(x, y, z) for x in (-h, h) for y in (-h, h) for z in (-h, h)]
        faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        faces = [tuple(reversed(face)) for face in faces] if inward else faces
        return self.object(name, vertices, faces, *materials, **options)

    def ball(self, name, *materials, radius=0.3):
        """A smooth sphere about the origin."""
        ball = self.object(name, [], [], *materials)
        edit = bmesh.new()
        bmesh.ops.create_icosphere(edit, subdivisions=3, radius=radius)
        for face in edit.faces:
            face.smooth = True
        edit.to_mesh(ball.data)
        edit.free()
        return ball

    def camera(self, place):
        """The active camera."""
        camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        camera.location = place
        bpy.context.scene.collection.objects.link(camera)
        bpy.context.scene.camera = camera
        return camera

    def room(self):
        """A coloured floor, a cube on it, and a lamp above."""
        self.quad("Lamp", self.light("Glow", (3.0, 2.0, 1.0)), z=2.0, down=True)
        red = self.material("Red", Color=(0.7, 0.2, 0.1))
        blue = self.material("Blue", "ShaderNodeBsdfPrincipled", Base_Color=(0.1, 0.3, 0.8))
        floor = [(x, y, 0.0) for y in range(-1, 3) for x in range(-1, 3)]
        faces = [(4 * j + i, 4 * j + i + 1, 4 * j + i + 5, 4 * j + i + 4) for j in range(3) for i in range(3)]
        self.object("Floor", floor, faces, red, blue, slots=[i % 2 for i in range(9)])
        box = self.cube("Box", blue, size=0.5)
        box.location, box.rotation_euler = (0.4, 0.6, 0.5), (0.1, 0.2, 0.3)


def corner_normals(triangles):
    """Unit normals (T,3) of triangles by their winding."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def baked(mesh, name="Radiosity"):
    """Colours (N,4) of the attribute."""
    attribute = mesh.color_attributes[name]
    values = np.empty(len(attribute.data) * 4, np.float32)
    attribute.data.foreach_get("color", values)
    return values.reshape(-1, 4)


def of_corners(mesh, name):
    """The same at every corner (C,4)."""
    values = baked(mesh, name)
    if mesh.color_attributes[name].domain == "CORNER":
        return values
    return values[[loop.vertex_index for loop in mesh.loops]]
