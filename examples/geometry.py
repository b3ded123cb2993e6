# SPDX-License-Identifier: GPL-3.0-or-later
"""Evenly divided surfaces for the example scenes, as lists of vertices and faces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import bpy

# isort: split
# Outside of Blender these two exist only once bpy is loaded.
import bmesh
from mathutils import Matrix, Vector
from mathutils.geometry import delaunay_2d_cdt

WELD = 1e-4
# Least height of a triangle, as a share of its longest edge.
THINNEST = 1e-3
Polygon = Sequence[Sequence[float]]


@dataclass
class Surface:
    """A mesh in the making: vertices, faces (indices) and the material slot of each face."""

    vertices: list[Vector] = field(default_factory=list)
    faces: list[tuple[int, ...]] = field(default_factory=list)
    slots: list[int] = field(default_factory=list)

    def add(self, vertices: Sequence[Vector], faces: Sequence[Sequence[int]], slot: int, facing: Vector) -> None:
        """Add one flat patch, turned so that its faces look along `facing`."""
        first = len(self.vertices)
        self.vertices += vertices
        for face in faces:
            a, b, c = (vertices[i] for i in face[:3])
            turned = face if (b - a).cross(c - a).dot(facing) > 0 else tuple(reversed(face))
            self.faces.append(tuple(first + i for i in turned))
            self.slots.append(slot)

    def object(self, name: str, materials: Sequence[bpy.types.Material], smooth: bool = False) -> bpy.types.Object:
        """Weld the patches along their rims, pair triangles into quads, and link the object to the open scene.

        Raises ValueError where a triangle is a sliver.
        """
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata(self.vertices, [], self.faces)
        for material in materials:
            mesh.materials.append(material)
        mesh.polygons.foreach_set("material_index", self.slots)
        mesh.polygons.foreach_set("use_smooth", [smooth] * len(self.faces))
        edit = bmesh.new()
        edit.from_mesh(mesh)
        bmesh.ops.remove_doubles(edit, verts=edit.verts, dist=WELD)
        bmesh.ops.join_triangles(edit, faces=edit.faces, angle_face_threshold=0.01, angle_shape_threshold=0.5)
        edit.to_mesh(mesh)
        edit.free()
        _check_slivers(mesh)
        obj = bpy.data.objects.new(name, mesh)
        bpy.context.scene.collection.objects.link(obj)
        return obj


def divisions(length: float, cell: float) -> int:
    """How many cells of about `cell` fit a length."""
    return max(1, round(length / cell))


def grid(corners: Sequence[Vector], nu: int, nv: int) -> tuple[list[Vector], list[tuple[int, ...]]]:
    """A quad, given by four corners in turn, cut into nu cells along its first edge and nv along its second."""
    a, b, c, d = corners
    vertices = [a.lerp(b, i / nu).lerp(d.lerp(c, i / nu), j / nv) for j in range(nv + 1) for i in range(nu + 1)]
    row = nu + 1
    starts = [j * row + i for j in range(nv) for i in range(nu)]
    return vertices, [(start, start + 1, start + row + 1, start + row) for start in starts]


def perforated(
    corners: Sequence[Vector], nu: int, nv: int, holes: Sequence[Polygon], cell: float
) -> tuple[list[Vector], list[tuple[int, ...]]]:
    """A horizontal quad cut like `grid`, with convex holes (x, y) left open and cells that follow their rims.

    A mesh that is cut where another one stands on it shows no shadow that creeps out from under that one.
    """
    if not holes:
        return grid(corners, nu, nv)
    height = corners[0].z
    vertices, _ = grid(corners, nu, nv)
    flat = [vertex.xy for vertex in vertices if not _near(vertex.xy, holes, 0.35 * cell)]
    rims = []
    for hole in holes:
        rim = _divided(hole, cell)
        rims += [(len(flat) + i, len(flat) + (i + 1) % len(rim)) for i in range(len(rim))]
        flat += rim
    points, _, triangles, *_ = delaunay_2d_cdt(flat, rims, [], 0, 1e-6)
    shapes = ([points[i] for i in t] for t in triangles)
    kept = [t for t, shape in zip(triangles, shapes, strict=True) if not _left_open(shape, holes)]
    return [Vector((*point, height)) for point in points], kept


def _left_open(triangle: Sequence[Vector], holes: Sequence[Polygon]) -> bool:
    # Along the outline rounding bends rows of vertices a little, and slivers bridge the bends.
    middle = sum(triangle, Vector((0, 0))) / 3
    return thinness(triangle) < THINNEST or any(_inside(middle, hole) for hole in holes)


def thinness(triangle: Sequence[Vector]) -> float:
    """Height of a triangle as a share of its longest edge."""
    a, b, c = (point.to_3d() for point in triangle)
    return (b - a).cross(c - a).length / max((b - a).length_squared, (c - b).length_squared, (a - c).length_squared)


def box(
    surface: Surface, footprint: Polygon, low: float, high: float, cell: float, slots: Sequence[int | None]
) -> None:
    """Add an upright prism over a convex footprint; slots of its sides, top and bottom, None to leave one open."""
    sides, top, bottom = slots
    middle = sum((Vector(p) for p in footprint), Vector((0, 0))) / len(footprint)
    rings = {z: [Vector((*p, z)) for p in footprint] for z in (low, high)}
    count = len(footprint)
    for i in range(count):
        j = (i + 1) % count
        corners = [rings[low][i], rings[low][j], rings[high][j], rings[high][i]]
        outward = Vector(((Vector(footprint[i]) + Vector(footprint[j])) / 2 - middle).to_3d())
        nu = divisions((corners[1] - corners[0]).length, cell)
        surface.add(*grid(corners, nu, divisions(high - low, cell)), sides, outward)
    for slot, z, facing in ((top, high, 1.0), (bottom, low, -1.0)):
        if slot is not None:
            a, b, c, _ = rings[z]
            nu, nv = divisions((b - a).length, cell), divisions((c - b).length, cell)
            surface.add(*grid(rings[z], nu, nv), slot, Vector((0, 0, facing)))


def _check_slivers(mesh: bpy.types.Mesh) -> None:
    mesh.calc_loop_triangles()
    for triangle in mesh.loop_triangles:
        corners = [mesh.vertices[i].co for i in triangle.vertices]
        if thinness(corners) < THINNEST:
            raise ValueError(f"{mesh.name}: the triangle at {tuple(corners[0])} is a sliver")


def add_globe(name: str, material: bpy.types.Material, centre: Vector, radius: float) -> None:
    """Link a smooth sphere of triangles to the open scene."""
    mesh = bpy.data.meshes.new(name)
    edit = bmesh.new()
    bmesh.ops.create_icosphere(edit, subdivisions=4, radius=radius, matrix=Matrix.Translation(centre))
    for face in edit.faces:
        face.smooth = True
    edit.to_mesh(mesh)
    edit.free()
    mesh.materials.append(material)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, mesh))


def regular_polygon(x: float, y: float, radius: float, sides: int) -> list[tuple[float, float]]:
    """Corners of a regular polygon about (x, y)."""
    angles = [2 * math.pi * i / sides for i in range(sides)]
    return [(x + radius * math.cos(angle), y + radius * math.sin(angle)) for angle in angles]


def rectangle(x: float, y: float, width: float, depth: float) -> list[tuple[float, float]]:
    """Corners of a rectangle about (x, y)."""
    return [(x + i * width / 2, y + j * depth / 2) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


def _divided(polygon: Polygon, cell: float) -> list[Vector]:
    rim = []
    for p, q in _sides(polygon):
        count = divisions((q - p).length, cell)
        rim += [p.lerp(q, i / count) for i in range(count)]
    return rim


def _sides(polygon: Polygon) -> list[tuple[Vector, Vector]]:
    points = [Vector(point) for point in polygon]
    return list(zip(points, points[1:] + points[:1], strict=True))


def _inside(point: Vector, polygon: Polygon) -> bool:
    turns = [(q - p).cross(point - p) for p, q in _sides(polygon)]
    return all(turn > 0 for turn in turns) or all(turn < 0 for turn in turns)


def _near(point: Vector, polygons: Sequence[Polygon], distance: float) -> bool:
    return any(_inside(point, polygon) or _gap(point, polygon) < distance for polygon in polygons)


def _gap(point: Vector, polygon: Polygon) -> float:
    def to_segment(p: Vector, q: Vector) -> float:
        along = max(0.0, min(1.0, (point - p).dot(q - p) / (q - p).length_squared))
        return (point - p.lerp(q, along)).length

    return min(to_segment(p, q) for p, q in _sides(polygon))
