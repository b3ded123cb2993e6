# SPDX-License-Identifier: GPL-3.0-or-later
"""More vertices where light needs them: the only module that changes the geometry of meshes."""

from __future__ import annotations

from collections.abc import Sequence
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
    """The selected objects with a mesh that can be changed, one for each mesh."""
    found = {}
    for obj in context.selected_objects:
        if obj.type == "MESH" and obj.data.is_editable:
            found.setdefault(obj.data.name, obj)
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

    corner, following = np.arange(len(mesh.corner_vertex)), np.arange(1, len(mesh.corner_vertex) + 1)
    following[mesh.face_start + mesh.face_corners - 1] = mesh.face_start
    ends = np.sort(np.stack([mesh.corner_vertex, mesh.corner_vertex[following]], axis=1), axis=1)
    _, once = np.unique(ends, axis=0, return_index=True)
    on_edges = parts(corner, following) - 1
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


def refine(obj: bpy.types.Object, name: str, contrast: float, length: float) -> int:
    """Halve, once, the edges of faces along which the baked colours differ, down to so many metres in the world.

    name: of the colour attribute; contrast: the difference in brightness, relative to the brightness there, from which
    on an edge is halved. Returns the number of new vertices.
    """
    edit = bmesh.new()
    try:
        edit.from_mesh(obj.data)
        before = len(edit.verts)
        brightness = _brightness(edit, name)
        mean = np.mean([value for face in brightness.values() for value in face]) if brightness else 0.0
        chosen = set()
        for face, values in brightness.items():
            pairs = zip(values, values[1:] + values[:1], strict=True)
            if any(abs(a - b) > contrast * ((a + b) / 2 + _DARK * mean) for a, b in pairs):
                chosen.update(edge for edge in face.edges if _length(edge, obj.matrix_world) > length * _SLACK)
        if chosen:
            _halve(edit, list(chosen))
            edit.to_mesh(obj.data)
            obj.data.update()
        return len(edit.verts) - before
    finally:
        edit.free()


def copied(context: bpy.types.Context, objects: Sequence[bpy.types.Object]) -> list[bpy.types.Object]:
    """Copies of objects with meshes of their own, selected in place of the originals, which are hidden."""
    copies = []
    for obj in objects:
        copy = obj.copy()
        copy.data = obj.data.copy()
        for collection in obj.users_collection:
            collection.objects.link(copy)
        obj.select_set(False)
        obj.hide_set(True)
        obj.hide_render = True
        copy.select_set(True)
        copies.append(copy)
    context.view_layer.objects.active = copies[0]
    return copies


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


def _brightness(edit: bmesh.types.BMesh, name: str) -> dict[bmesh.types.BMFace, list[float]]:
    """Luminance at the corners of every face; nothing where the mesh has no such attribute."""
    for layers, of_corner in ((edit.loops.layers, True), (edit.verts.layers, False)):
        for kind in (layers.float_color, layers.color):
            layer = kind.get(name)
            if layer is not None:
                return {face: [_luminance((loop if of_corner else loop.vert)[layer]) for loop in face.loops]
                        for face in edit.faces}  # fmt: skip
    return {}


def _luminance(colour: Sequence[float]) -> float:
    return sum(weight * channel for weight, channel in zip(_LUMINANCE, colour, strict=False))
