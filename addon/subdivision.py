# SPDX-License-Identifier: GPL-3.0-or-later
"""More vertices where light needs them: the only module that changes the geometry of meshes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import bmesh
import numpy as np

from . import meshes

if TYPE_CHECKING:
    import bpy
    from mathutils import Matrix

#: An edge that is longer by rounding only stays.
_SLACK = 1 + 1e-5
#: Share of the mean brightness below which differences are not seen.
_DARK = 0.05
#: Of linear colours.
_LUMINANCE = (0.2126, 0.7152, 0.0722)


def receivers(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The selected objects with a mesh that can be changed, for each mesh the largest."""
    return _one_for_each_mesh(_selected(context))


def _selected(context: bpy.types.Context) -> list[bpy.types.Object]:
    return [obj for obj in context.selected_objects if obj.type == "MESH" and obj.data.is_editable]


def _one_for_each_mesh(objects: Iterable[bpy.types.Object]) -> list[bpy.types.Object]:
    """The largest of the objects that share a mesh, for each mesh."""
    by_size = sorted(objects, key=lambda obj: max(obj.matrix_world.to_scale(), key=abs) ** 2, reverse=True)
    found = {}
    for obj in by_size:
        found.setdefault(obj.data, obj)
    return list(found.values())


def expected_vertices(obj: bpy.types.Object, length: float) -> int:
    """Vertices that `subdivide` comes to: exact for triangles and quads of one size, near that for others.

    Raises fmm_core.Error naming a vertex that is not finite.
    """
    mesh = meshes.read_mesh(obj.data)
    position = meshes.World(obj.name, mesh, np.array(obj.matrix_world)).position

    def parts(corners: np.ndarray, others: np.ndarray) -> np.ndarray:
        ends = mesh.corner_vertex[corners], mesh.corner_vertex[others]
        return _parts(np.linalg.norm(position[ends[0]] - position[ends[1]], axis=-1), length)

    ends = np.sort(np.stack([mesh.corner_vertex, mesh.corner_vertex[mesh.following]], axis=1), axis=1)
    _, once = np.unique(ends, axis=0, return_index=True)
    on_edges = parts(np.arange(len(mesh.corner_vertex)), mesh.following) - 1
    quad = mesh.face_corners == 4
    around = on_edges[mesh.face_start[quad, None] + np.arange(4)]
    in_quads = np.maximum(around[:, 0], around[:, 2]) * np.maximum(around[:, 1], around[:, 3])
    triangles = mesh.triangle_corners[~quad[mesh.triangle_face]]
    sides = parts(triangles, np.roll(triangles, -1, axis=1)) - 1
    most = sides.max(axis=1, initial=0)
    # Sides inside a face belong to two triangles.
    inner = sides.sum() - on_edges[np.repeat(~quad, mesh.face_corners)].sum()
    return int(len(mesh.vertex) + on_edges[once].sum() + in_quads.sum() + (most * (most - 1) // 2).sum() + inner // 2)


def subdivide(obj: bpy.types.Object, length: float) -> int:
    """Halve the edges of the mesh of an object until none is longer than so many metres in the world.

    Returns how many vertices it has then.
    """
    edit = bmesh.new()
    try:
        edit.from_mesh(obj.data)
        _without_large_faces(edit)
        while long := [edge for edge in edit.edges if _length(edge, obj.matrix_world) > length * _SLACK]:
            _halve(edit, long)
        edit.to_mesh(obj.data)
        obj.data.update()
        return len(edit.verts)
    finally:
        edit.free()


def expected_refined(obj: bpy.types.Object, name: str, contrast: float, length: float) -> int:
    """Vertices that `refine` comes to; raises fmm_core.Error naming a vertex that is not finite."""
    mesh = meshes.read_mesh(obj.data)
    chosen = _contrasting(obj, mesh, name, contrast, length)
    quads = mesh.face_start[mesh.face_corners == 4, None] + np.arange(4)
    return int(len(mesh.vertex) + chosen.sum() + chosen[_corner_edges(obj.data)[quads]].all(axis=1).sum())


def refine(obj: bpy.types.Object, name: str, contrast: float, length: float) -> int:
    """Halve, once, the edges of faces along which the baked colours differ, down to so many metres in the world.

    name: of the colour attribute; contrast: the difference in brightness, relative to the brightness there, from which
    on an edge is halved. Returns the number of new vertices; raises fmm_core.Error naming a vertex that is not finite.
    """
    chosen = np.flatnonzero(_contrasting(obj, meshes.read_mesh(obj.data), name, contrast, length))
    if not len(chosen):
        return 0
    edit = bmesh.new()
    try:
        edit.from_mesh(obj.data)
        before = len(edit.verts)
        edit.edges.ensure_lookup_table()
        _halve(edit, [edit.edges[index] for index in chosen])
        edit.to_mesh(obj.data)
        obj.data.update()
        return len(edit.verts) - before
    finally:
        edit.free()


def copied(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Copies of the selected objects, selected in place of the originals, which are hidden; what shares a mesh shares
    its copy. Returns the largest for each mesh.
    """
    chosen = _selected(context)
    meshes = {mesh: mesh.copy() for mesh in {obj.data for obj in chosen}}
    copies = []
    for obj in chosen:
        copy = obj.copy()
        copy.data = meshes[obj.data]
        for collection in obj.users_collection:
            collection.objects.link(copy)
        obj.select_set(False)
        obj.hide_set(True)
        obj.hide_render = True
        copy.select_set(True)
        copies.append(copy)
    context.view_layer.objects.active = copies[0]
    return _one_for_each_mesh(copies)


def _parts(lengths: np.ndarray, length: float) -> np.ndarray:
    """Into how many parts edges are cut, a power of two; their squares may be larger than integers are."""
    return 2.0 ** np.ceil(np.log2(np.maximum(lengths / (length * _SLACK), 1.0)))


def _length(edge: bmesh.types.BMEdge, world: Matrix) -> float:
    a, b = edge.verts
    return (world.to_3x3() @ (a.co - b.co)).length


def _halve(edit: bmesh.types.BMesh, edges: list[bmesh.types.BMEdge]) -> None:
    bmesh.ops.subdivide_edges(edit, edges=edges, cuts=1, use_grid_fill=True, use_single_edge=True)
    _without_large_faces(edit)


def _without_large_faces(edit: bmesh.types.BMesh) -> None:
    """Cut faces of more than four corners, which halving their edges would leave whole."""
    bmesh.ops.triangulate(edit, faces=[face for face in edit.faces if len(face.verts) > 4])


def _contrasting(obj: bpy.types.Object, mesh: meshes.Mesh, name: str, contrast: float, length: float) -> np.ndarray:
    """(E,) bool: the edges that `refine` halves; none where the mesh of the object has no such attribute."""
    layer, chosen = obj.data.color_attributes.get(name), np.zeros(len(obj.data.edges), bool)
    if layer is None or not len(mesh.face_start):
        return chosen
    colours = meshes.get(layer.data, "color", np.float32, 4)[:, :3] @ _LUMINANCE
    brightness = colours if layer.domain == "CORNER" else colours[mesh.corner_vertex]
    other = brightness[mesh.following]
    differs = np.abs(brightness - other) > contrast * ((brightness + other) / 2 + _DARK * brightness.mean())
    faces = np.logical_or.reduceat(differs, mesh.face_start)
    chosen[_corner_edges(obj.data)[np.repeat(faces, mesh.face_corners)]] = True
    position = meshes.World(obj.name, mesh, np.array(obj.matrix_world)).position
    a, b = position[meshes.get(obj.data.edges, "vertices", np.int32, 2)].swapaxes(0, 1)
    return chosen & (np.linalg.norm(a - b, axis=1) > length * _SLACK)


def _corner_edges(mesh: bpy.types.Mesh) -> np.ndarray:
    """(C,) the edge that leads from each corner to the next one of its face."""
    return meshes.get(mesh.attributes[".corner_edge"].data, "value", np.int32)
