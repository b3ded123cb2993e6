# SPDX-License-Identifier: GPL-3.0-or-later
"""The only writer of Blender's meshes: the colour attribute "Radiosity", on all meshes of a bake or on none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from fmm_core import Error

if TYPE_CHECKING:
    import bpy

    from .export import Receiver

NAME = "Radiosity"
_UNFINISHED = "Radiosity (being written)"


def check(receivers: Sequence[Receiver]) -> None:
    """Raise fmm_core.Error, naming the mesh, where the attribute could not be written; to be called before a solve."""
    for receiver in receivers:
        _mesh_of(receiver)


def write(receivers: Sequence[Receiver], colours: np.ndarray) -> None:
    """Write the corner colours of a bake, one foreach_set a mesh, and make them the active and the render colours.

    colours (C,3): linear radiance of every corner, in the order of the receivers. An attribute of an earlier bake is
    replaced. Raises fmm_core.Error naming the mesh that cannot be written; every mesh is then as it was.
    """
    meshes = [_mesh_of(receiver) for receiver in receivers]
    unfinished = []
    try:
        for mesh, receiver in zip(meshes, receivers, strict=True):
            domain, values = layer(receiver, colours[receiver.rows])
            unfinished.append((mesh, _add(mesh, domain)))
            mesh.color_attributes[unfinished[-1][1]].data.foreach_set("color", values.ravel())
    except Exception:
        for mesh, name in unfinished:
            _remove(mesh, name)
        raise
    for mesh, name in unfinished:
        _finish(mesh, name)


def layer(receiver: Receiver, colours: np.ndarray) -> tuple[str, np.ndarray]:
    """Domain and values (N,4) float32 that carry the corner colours (C,3) of one mesh without loss.

    The domain is POINT where every face is smooth and the corners of each vertex agree, else CORNER.
    """
    corners = np.ones((len(colours), 4), np.float32)
    corners[:, :3] = colours
    if not receiver.smooth:
        return "CORNER", corners
    points = np.zeros((receiver.vertices, 4), np.float32)
    points[:, 3] = 1.0
    points[receiver.corner_vertex] = corners
    agree = (points[receiver.corner_vertex] == corners).all()
    return ("POINT", points) if agree else ("CORNER", corners)


def _mesh_of(receiver: Receiver) -> bpy.types.Mesh:
    """The datablock of a receiver, after checking that it still fits and that the name is free for colours."""
    import bpy

    mesh = bpy.data.meshes.get((receiver.mesh, None))
    if mesh is None:
        raise Error(f"mesh '{receiver.mesh}' of object '{receiver.object}' is gone")
    if mesh.is_editmode:
        raise Error(f"mesh '{receiver.mesh}' of object '{receiver.object}' is in Edit Mode")
    if (len(mesh.vertices), len(mesh.loops)) != (receiver.vertices, len(receiver.corner_vertex)):
        raise Error(f"mesh '{receiver.mesh}' of object '{receiver.object}' was changed during the bake")
    taken = mesh.attributes.get(NAME)
    if taken is not None and NAME not in mesh.color_attributes:
        raise Error(f"mesh '{receiver.mesh}' has an attribute '{NAME}' of type {taken.data_type}: rename it")
    owner = bpy.data.objects.get((receiver.object, None))
    if owner is not None and NAME in owner.vertex_groups:
        raise Error(f"object '{receiver.object}' has a vertex group '{NAME}': rename it")
    return mesh


def _add(mesh: bpy.types.Mesh, domain: str) -> str:
    """Add a colour attribute; returns its name, which Blender changes where another attribute has it already."""
    attribute = mesh.color_attributes.new(name=_UNFINISHED, type="FLOAT_COLOR", domain=domain)
    if attribute is None:
        raise Error(f"Blender could not add a colour attribute to mesh '{mesh.name}'")
    return attribute.name


def _finish(mesh: bpy.types.Mesh, unfinished: str) -> None:
    _remove(mesh, NAME)
    mesh.color_attributes[unfinished].name = NAME
    index = mesh.color_attributes.find(NAME)
    mesh.color_attributes.active_color_index = index
    mesh.color_attributes.render_color_index = index
    mesh.update()


def _remove(mesh: bpy.types.Mesh, name: str) -> None:
    attribute = mesh.color_attributes.get(name)
    if attribute is not None:
        mesh.color_attributes.remove(attribute)
