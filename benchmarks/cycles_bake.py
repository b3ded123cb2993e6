# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh that is baked, and Cycles' bake of it into vertex colours; Blender is loaded only where a bake starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from common import Array, Cost
from fmm_core import OutputPoints, Scene, output_points
from numpy.typing import NDArray

if TYPE_CHECKING:
    import bpy

#: Corners of a vertex may turn this far from their mean, a share of 1, for it not to lie on a crease.
SMOOTH = np.cos(np.radians(30.0))
#: Share of the full angle that faces fill around a vertex that is not on a rim.
CLOSED = 0.75
#: Positions closer than this are one vertex, m.
WELD = 1e-6


@dataclass(frozen=True)
class Mesh:
    """Faces (F, K, 3) m, counter-clockwise from the front; albedo (F, 3); emission (F,) W/m^2."""

    faces: Array
    albedo: Array
    emission: Array

    @property
    def corners(self) -> Array:
        """(C, 3) m, face by face."""
        return self.faces.reshape(-1, 3)

    @cached_property
    def face_normals(self) -> Array:
        """(C, 3) the unit normal of each corner's face."""
        normals = np.cross(self.faces[:, 1] - self.faces[:, 0], self.faces[:, 2] - self.faces[:, 0])
        return np.repeat(normals / np.linalg.norm(normals, axis=1, keepdims=True), self.faces.shape[1], axis=0)

    @cached_property
    def corner_angles(self) -> Array:
        """(C,) rad: the angle of each corner's face there."""
        to_next = np.roll(self.faces, -1, axis=1) - self.faces
        to_next /= np.linalg.norm(to_next, axis=2, keepdims=True)
        return np.arccos(np.clip(-(to_next * np.roll(to_next, 1, axis=1)).sum(axis=2), -1, 1)).ravel()

    @cached_property
    def vertex_normals(self) -> Array:
        """(V, 3) the mean of the normals around each vertex by angle, unit, as Blender has it."""
        weighted = self.corner_angles[:, None] * self.face_normals
        mean = np.stack([np.bincount(self.corner_vertices, weighted[:, axis]) for axis in range(3)], axis=1)
        return mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-30)

    @cached_property
    def even(self) -> NDArray[np.bool_]:
        """(V,) whether no face around a vertex turns far from the mean."""
        turned = np.ones(self.vertex_count)
        cosines = (self.vertex_normals[self.corner_vertices] * self.face_normals).sum(axis=1)
        np.minimum.at(turned, self.corner_vertices, cosines)
        return turned > SMOOTH

    @cached_property
    def smooth(self) -> NDArray[np.bool_]:
        """(F,) faces that are shaded smooth: those that no crease touches."""
        return self.even[self.corner_vertices].reshape(self.faces.shape[:2]).all(axis=1)

    @cached_property
    def corner_normals(self) -> Array:
        """(C, 3) the unit normal that each corner is shaded with."""
        smooth = np.repeat(self.smooth, self.faces.shape[1])[:, None]
        return np.where(smooth, self.vertex_normals[self.corner_vertices], self.face_normals)

    @cached_property
    def corner_vertices(self) -> NDArray[np.int64]:
        """(C,) the vertex of each corner."""
        keys = np.rint(self.corners / WELD).astype(np.int64)
        return np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)

    @property
    def vertex_count(self) -> int:
        return int(self.corner_vertices.max()) + 1

    @property
    def triangles(self) -> NDArray[np.int64]:
        """(T, 3) corners of the triangles that the faces are cut into."""
        cuts = np.array([[0, i, i + 1] for i in range(1, self.faces.shape[1] - 1)])
        return (np.arange(len(self.faces))[:, None, None] * self.faces.shape[1] + cuts).reshape(-1, 3)

    def scene(self) -> Scene:
        """The same faces, cut into triangles."""
        cuts, triangles = self.faces.shape[1] - 2, self.corners[self.triangles]
        return Scene(triangles, np.repeat(self.albedo, cuts, axis=0), np.repeat(self.emission, cuts))

    def output_points(self) -> OutputPoints:
        """One point for all corners with the same vertex and normal, stepped into a face."""
        centres = np.repeat(self.faces.mean(axis=1), self.faces.shape[1], axis=0)
        return output_points(self.corners, self.corner_normals, self.corner_vertices, centres)

    def interior_corners(self) -> NDArray[np.int64]:
        """Corners of reflecting faces whose vertex lies on no crease and no rim, so that its light is well defined."""
        around = np.bincount(self.corner_vertices, self.corner_angles)
        good = self.even & (around > CLOSED * 2 * np.pi)
        reflects = np.repeat((self.albedo > 0).any(axis=1) & (self.emission == 0), self.faces.shape[1])
        return np.flatnonzero(good[self.corner_vertices] & reflects)


def gridded(triangles: Array, vertices: int) -> tuple[Array, NDArray[np.int64]]:
    """Parallelograms, given as two triangles each, in about so many square cells: faces (F, 4, 3), triangle (F,)."""
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1).sum()
    size = np.sqrt(area / 2 / vertices)
    faces, owners = [], []
    for number in range(0, len(triangles), 2):
        a, b, d = triangles[number, 0], triangles[number, 1], triangles[number + 1, 2]
        m, n = (max(1, round(np.linalg.norm(end - a) / size)) for end in (b, d))
        u, v = np.arange(m + 1)[:, None, None] / m, np.arange(n + 1)[None, :, None] / n
        grid = a + u * (b - a) + v * (d - a)
        cells = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=2).reshape(-1, 4, 3)
        faces.append(cells)
        owners.append(np.full(len(cells), number))
    return np.concatenate(faces), np.concatenate(owners)


def bake(mesh: Mesh, samples: Sequence[int], threads: int) -> tuple[Array, list[Cost]]:
    """Irradiance (B, C, 3) W/m^2 at the corners by Cycles, and the cost, of a bake for each number of samples.

    Each bake has a seed of its own. Backs are black, as the core takes them; that does not make Cycles slower.
    """
    import bpy

    from addon.cycles import unbiased

    bpy.ops.wm.read_factory_settings(use_empty=True)
    unbiased(bpy.context.scene)
    bpy.context.scene.render.threads_mode = "FIXED"
    bpy.context.scene.render.threads = threads
    obj = build(mesh)
    irradiance, costs = np.empty((len(samples), len(mesh.corners), 3)), []
    for seed, count in enumerate(samples):
        bpy.context.scene.cycles.samples, bpy.context.scene.cycles.seed = count, seed
        start = Cost.now()
        bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"})
        costs.append(Cost.now().since(start))
        irradiance[seed] = np.pi * baked_colours(obj.data)
    return irradiance, costs


def baked_colours(mesh: bpy.types.Mesh) -> Array:
    """(C, 3) of the active colour attribute."""
    attribute = mesh.color_attributes.active_color
    values = np.empty(4 * len(attribute.data), np.float32)
    attribute.data.foreach_get("color", values)
    return values.reshape(-1, 4)[:, :3].astype(float)


def build(mesh: Mesh) -> bpy.types.Object:
    """One object with a float colour attribute at its corners, selected and active."""
    import bpy

    first = np.unique(mesh.corner_vertices, return_index=True)[1]
    data = bpy.data.meshes.new("Mesh")
    data.from_pydata(mesh.corners[first].tolist(), [], mesh.corner_vertices.reshape(mesh.faces.shape[:2]).tolist())
    surfaces, slots = np.unique(np.column_stack([mesh.albedo, mesh.emission]), axis=0, return_inverse=True)
    for surface in surfaces.tolist():
        data.materials.append(material(surface[:3], surface[3]))
    data.polygons.foreach_set("use_smooth", mesh.smooth)
    data.polygons.foreach_set("material_index", slots.reshape(-1).astype(np.int32))
    data.color_attributes.active_color = data.color_attributes.new("Cycles", "FLOAT_COLOR", "CORNER")
    obj = bpy.data.objects.new("Object", data)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    return obj


def material(albedo: Sequence[float], emission: float) -> bpy.types.Material:
    """Diffuse, or an emitter of so many W/m^2, on the front; black on the back."""
    import bpy

    result = bpy.data.materials.new("Surface")
    if result.node_tree is None:
        result.use_nodes = True
    nodes, links = result.node_tree.nodes, result.node_tree.links
    nodes.clear()
    if emission:
        front = nodes.new("ShaderNodeEmission")
        front.inputs["Strength"].default_value = emission / np.pi
    else:
        front = nodes.new("ShaderNodeBsdfDiffuse")
    front.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0) if emission else (*albedo, 1.0)
    mix, back, geometry = map(nodes.new, ("ShaderNodeMixShader", "ShaderNodeBsdfDiffuse", "ShaderNodeNewGeometry"))
    back.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    links.new(geometry.outputs["Backfacing"], mix.inputs[0])
    links.new(front.outputs[0], mix.inputs[1])
    links.new(back.outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return result
