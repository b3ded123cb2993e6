# SPDX-License-Identifier: GPL-3.0-or-later
"""One mesh as plain arrays: in its own space, and carried into the world."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from fmm_core import Error

if TYPE_CHECKING:
    import bpy


@dataclass(frozen=True)
class Mesh:
    """One evaluated mesh in its own space: V vertices, C corners, F faces, T triangles."""

    vertex: np.ndarray  # (V,3)
    corner_vertex: np.ndarray  # (C,)
    corner_normal: np.ndarray  # (C,3)
    face_start: np.ndarray  # (F,) first corner
    face_corners: np.ndarray  # (F,) number of corners
    face_material: np.ndarray  # (F,) material slot
    smooth: bool
    triangle_corners: np.ndarray  # (T,3)
    triangle_face: np.ndarray  # (T,)

    @cached_property
    def following(self) -> np.ndarray:
        """(C,) the next corner of the same face."""
        following = np.arange(1, len(self.corner_vertex) + 1)
        following[self.face_start + self.face_corners - 1] = self.face_start
        return following


#: What a triangle takes in Blender: the numbers of three corners.
_TRIANGLE_BYTES = 12

#: m from the origin: of larger numbers the products of a solve no longer are finite.
FARTHEST = 1e15

#: Of Jenkins' hash, whose numbers are below the first one.
_ALL, _TURNS = 1 << 32, (14, 11, 25, 16, 4, 14, 24)


class About(NamedTuple):
    """What the node Object Info says of an object or copy: location and colour are (1, 3), all else (1,)."""

    location: np.ndarray
    colour: np.ndarray
    alpha: np.ndarray
    index: np.ndarray
    random: np.ndarray


def about(instance: bpy.types.DepsgraphObjectInstance) -> About:
    """What Cycles takes of an object or copy."""
    obj = instance.object
    colour, location = np.array([obj.color[:]], float), np.array([instance.matrix_world.translation[:]], float)
    random = instance.random_id % _ALL if instance.is_instance else _hash(obj.name)
    numbers = obj.pass_index, random / (_ALL - 1)
    return About(location, colour[:, :3], colour[:, 3], *(np.array([float(number)]) for number in numbers))


def _hash(name: str) -> int:
    """The number from 0 to 2**32 - 1 that Blender has for an object: its name in 32 bits, mixed by the last steps of
    Bob Jenkins' hash lookup3 (2006).
    """
    key = 0
    for byte in name.encode():
        key = (37 * key + byte) % _ALL
    start = 0xDEADBEEF + (2 << 2) + 13
    state = [(start + key) % _ALL, start % _ALL, start % _ALL]
    for step, turn in enumerate(_TURNS):
        # c by b, a by c, b by a, and so on.
        into, by = (2 - 2 * step) % 3, (1 - 2 * step) % 3
        turned = (state[by] << turn | state[by] >> 32 - turn) % _ALL
        state[into] = ((state[into] ^ state[by]) - turned) % _ALL
    return state[2]


class Asked(NamedTuple):
    """What materials ask of a mesh by name: UV maps, and attributes, each with whether it is one of colours; "" is that
    of renders.
    """

    uv: frozenset[str] = frozenset()
    attributes: frozenset[tuple[str, bool]] = frozenset()


class Layers:
    """What an evaluated mesh carries at its C corners, for its materials.

    position, world (C, 3) m in its own space and in the world's; normal (C, 3) unit, in its own; generated (C, 3) from
    0 to 1 over its texture space; about: of the object. Nothing of Blender is kept: the evaluated mesh may be gone when
    its materials are looked at.
    """

    def __init__(self, data: bpy.types.Mesh, mesh: Mesh, world: World, about: About, asked: Asked) -> None:
        self._mesh, self._world = mesh, world
        self.about, self.normal = about, mesh.corner_normal
        self._uv = {name: _uv(data, name) for name in asked.uv}
        self._attributes = {key: _attribute(data, *key) for key in asked.attributes}
        self._size = np.array(data.texspace_size, float)
        self._low = np.array(data.texspace_location, float) - self._size

    @cached_property
    def position(self) -> np.ndarray:
        return self._mesh.vertex[self._mesh.corner_vertex]

    @cached_property
    def world(self) -> np.ndarray:
        return self._world.position[self._mesh.corner_vertex]

    @cached_property
    def generated(self) -> np.ndarray:
        return (self.position - self._low) / np.where(self._size > 0, 2 * self._size, np.inf)

    def uv(self, name: str) -> np.ndarray | None:
        """(C, 3) a UV map, the one used for renders where it has no name; None where there is none."""
        return self._uv.get(name)

    def attribute(self, name: str, colour: bool) -> np.ndarray | None:
        """(C, 1, 3 or 4) an attribute, or one of colours, the one used for renders where it has no name; or None."""
        domain, values = self._attributes.get((name, colour)) or (None, None)
        if domain == "POINT":
            return values[self._mesh.corner_vertex]
        if domain == "FACE":
            return np.repeat(values, self._mesh.face_corners, axis=0)
        return values if domain == "CORNER" else None


def _uv(data: bpy.types.Mesh, name: str) -> np.ndarray | None:
    layers = data.uv_layers
    layer = layers.get(name) if name else next((each for each in layers if each.active_render), None)
    return None if layer is None else np.pad(get(layer.uv, "vector", np.float32, 2), ((0, 0), (0, 1)))


def _attribute(data: bpy.types.Mesh, name: str, colour: bool) -> tuple[str, np.ndarray] | None:
    """Domain and values of an attribute, or None."""
    kinds = {"FLOAT": ("value", 1), "INT": ("value", 1), "BOOLEAN": ("value", 1), "FLOAT2": ("vector", 2)}
    kinds |= {"FLOAT_VECTOR": ("vector", 3), "FLOAT_COLOR": ("color", 4), "BYTE_COLOR": ("color", 4)}
    layer = data.attributes.get(name or (data.attributes.default_color_name if colour else ""))
    if layer is None or layer.data_type not in kinds:
        return None
    name, width = kinds[layer.data_type]
    dtype = {"INT": np.int32, "BOOLEAN": bool}.get(layer.data_type, np.float32)
    values = get(layer.data, name, dtype, width).astype(np.float64).reshape(-1, width)
    return layer.domain, np.pad(values, ((0, 0), (0, 1))) if width == 2 else values


class World:
    """A mesh carried into world space: position (V,3) in m, corner_normal (C,3) unit, found when they are asked for."""

    def __init__(self, name: str, mesh: Mesh, matrix: np.ndarray) -> None:
        linear, offset = matrix[:3, :3], matrix[:3, 3]
        if not np.isfinite(matrix).all():
            raise Error(f"object '{name}': its transform has the value {matrix[~np.isfinite(matrix)][0]:g}")
        bad = np.flatnonzero(~np.isfinite(mesh.vertex).all(axis=1))
        if len(bad):
            value = ", ".join(f"{x:g}" for x in mesh.vertex[bad[0]])
            raise Error(f"object '{name}': vertex {bad[0]} is at ({value}), which is not finite")
        reach = np.abs(linear).sum(axis=1).max() * np.abs(mesh.vertex).max(initial=0.0) + np.abs(offset).max()
        if reach > FARTHEST:
            raise Error(f"object '{name}' reaches {reach:.3g} m from the origin, at most {FARTHEST:g} m can be baked")
        self._mesh, self._linear, self._offset = mesh, linear, offset
        self.mirrored = np.linalg.det(linear) < 0

    @cached_property
    def position(self) -> np.ndarray:
        return self._mesh.vertex @ self._linear.T + self._offset

    @cached_property
    def corner_normal(self) -> np.ndarray:
        # Normals go with the cofactors of the matrix, which exist for flattened objects too.
        a, b, c = self._linear.T
        cofactors = np.array([np.cross(b, c), np.cross(c, a), np.cross(a, b)])
        normal = self._mesh.corner_normal @ cofactors * (-1.0 if self.mirrored else 1.0)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        return np.where(length > 0, normal / np.where(length > 0, length, 1.0), (0.0, 0.0, 1.0))


def read_mesh(mesh: bpy.types.Mesh) -> Mesh:
    """Read an evaluated mesh into arrays, by ways that copy them whole; positions become float64."""
    mesh.calc_loop_triangles()
    faces, triangles = mesh.polygons, mesh.loop_triangles
    starts, materials = get(faces, "loop_start", np.int32), mesh.attributes.get("material_index")
    sharp = mesh.attributes.get("sharp_face")
    return Mesh(
        vertex=get(mesh.attributes["position"].data, "vector", np.float32, 3).astype(np.float64),
        corner_vertex=corner_vertices(mesh),
        corner_normal=get(mesh.corner_normals, "vector", np.float32, 3).astype(np.float64),
        face_start=starts,
        face_corners=np.diff(starts, append=np.int32(len(mesh.loops))),
        face_material=np.zeros(len(faces), np.int32) if materials is None else get(materials.data, "value", np.int32),
        smooth=sharp is None or not get(sharp.data, "value", bool).any(),
        triangle_corners=_triangle_corners(triangles),
        triangle_face=get(mesh.loop_triangle_polygons, "value", np.int32),
    )


def _triangle_corners(triangles: bpy.types.bpy_prop_collection) -> np.ndarray:
    """(T,3) the corners of triangles: Blender hands them out one by one, but has them in a row."""
    count = len(triangles)
    if count:
        first, last = triangles[0].as_pointer(), triangles[count - 1].as_pointer()
        if last - first == _TRIANGLE_BYTES * (count - 1):
            return np.frombuffer((ctypes.c_int32 * (3 * count)).from_address(first), np.int32).reshape(-1, 3).copy()
    return get(triangles, "loops", np.int32, 3)


def corner_vertices(mesh: bpy.types.Mesh) -> np.ndarray:
    """(C,) the vertex of each corner."""
    return get(mesh.attributes[".corner_vert"].data, "value", np.int32)


def get(collection: bpy.types.bpy_prop_collection, name: str, dtype: type, width: int = 1) -> np.ndarray:
    values = np.empty(len(collection) * width, dtype)
    collection.foreach_get(name, values)
    return values.reshape(-1, width) if width > 1 else values


def is_closed(mesh: Mesh) -> bool:
    """Whether every edge has exactly two faces that run along it in opposite directions."""
    start, end = mesh.corner_vertex.astype(np.int64), mesh.corner_vertex[mesh.following].astype(np.int64)
    forward = np.sort(start * len(mesh.vertex) + end)
    backward = np.sort(end * len(mesh.vertex) + start)
    return bool((forward == backward).all() and (np.diff(forward) > 0).all())


def triangle_centres(position: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(C,3) m: centre of the largest triangle at each corner, for corners at position (C,3) in m, and the corners of
    triangles (R,3).
    """
    at = position[triangles]
    # Halves of a square are equal up to rounding, which must not choose between them.
    order = np.argsort(_double_area(at).astype(np.float32), kind="stable")
    centres = position.copy()
    # The last one that is assigned to a corner stays.
    centres[triangles[order].ravel()] = np.repeat(at[order].mean(axis=1), 3, axis=0)
    return centres


def _double_area(triangles: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)


def with_area(triangles: np.ndarray) -> np.ndarray:
    """(T,) bool: whether a triangle is higher than the rounding of its coordinates."""
    a, b, c = triangles.swapaxes(0, 1)
    ab, bc, ca = b - a, c - b, a - c
    longest = np.sqrt(np.max([np.einsum("tx,tx->t", edge, edge) for edge in (ab, bc, ca)], axis=0))
    area = np.cross(ab, ca)
    rounding = 1e-12 * np.maximum(longest, np.abs(triangles).reshape(-1, 9).max(axis=1, initial=0.0))
    return np.sqrt(np.einsum("tx,tx->t", area, area)) > longest * rounding


def same_topology(mesh: Mesh, original: bpy.types.Mesh) -> bool:
    """Whether corners and vertices of an evaluated mesh are those of the datablock, one by one."""
    if (len(original.vertices), len(original.loops)) != (len(mesh.vertex), len(mesh.corner_vertex)):
        return False
    return bool((corner_vertices(original) == mesh.corner_vertex).all())
