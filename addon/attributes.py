# SPDX-License-Identifier: GPL-3.0-or-later
"""The only writer of Blender's meshes: colour attributes ("Radiosity" and more), on all meshes of a bake or on none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from fmm_core import Error

if TYPE_CHECKING:
    import bpy

    from .scene_arrays import Receiver

NAME = "Radiosity"
_UNFINISHED = "Radiosity (being written)"
#: Blender cuts longer names off.
_LONGEST_NAME = 63


@dataclass(frozen=True)
class Output:
    """What is written, and how.

    name: of the attribute; content: "FULL" radiance, or the "LIGHTING" or "INDIRECT" light alone; domain: "POINT" or
    "CORNER", or "AUTO" for the smaller one without loss; byte: 8 bits a channel, cut at white, in place of floats;
    exposure: stops that bytes are made brighter by; colours: "FIT" to the light on the faces, or that at the "POINTS"
    where the vertices are; directional: write four spherical harmonics of the light beside it;
    view: and the radiance towards the active camera, with gloss
    """

    name: str = NAME
    content: str = "FULL"
    domain: str = "AUTO"
    byte: bool = False
    exposure: float = 0.0
    colours: str = "FIT"
    directional: bool = False
    view: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """The attributes that are written, the main one first."""
        return self.name, *self.harmonics, *([self.view_name] if self.view else [])

    @property
    def view_name(self) -> str:
        """The attribute of the view."""
        return f"{self.name} View"

    @property
    def harmonics(self) -> tuple[str, ...]:
        """Those of the spherical harmonics."""
        return tuple(f"{self.name} SH {k}" for k in range(4)) if self.directional else ()


@dataclass(frozen=True)
class Layers:
    """Attributes to write: linear colours (C,3) of every corner, in the order of the receivers, for each of
    `output.names`; rendered: whether a renderer shall take the main one where a material names none, and none does so
    yet.
    """

    receivers: Sequence[Receiver]
    colours: Mapping[str, np.ndarray]
    output: Output
    rendered: bool = True


def check(receivers: Sequence[Receiver], output: Output) -> None:
    """Raise fmm_core.Error, naming the mesh, where the attribute could not be written; to be called before a solve."""
    if output.name[:1] in ("", ".", " "):
        raise Error(f"'{output.name}' is no name for a colour attribute: it needs one that does not start with a dot "
                    "or a space")  # fmt: skip
    for name in output.names:
        if len(name.encode()) > _LONGEST_NAME:
            raise Error(f"'{name}' is longer than the {_LONGEST_NAME} letters that the name of an attribute can have")
    _check_names(output.names)
    for receiver in receivers:
        _mesh_of(receiver, output)


def _check_names(names: Sequence[str]) -> None:
    """Raise fmm_core.Error where Blender keeps a name for something else than colours."""
    import bpy

    mesh = bpy.data.meshes.new(_UNFINISHED)
    try:
        for name in names:
            mesh.color_attributes[_add(mesh, "CORNER", False)].name = name
            if name not in mesh.color_attributes:
                raise Error(f"'{name}' is no name for a colour attribute: Blender keeps it for something else")
    finally:
        bpy.data.meshes.remove(mesh)


def write(parts: Sequence[Layers]) -> None:
    """Write colours, one foreach_set a mesh and attribute; the main attribute of the last part is made the active one
    and the one of renders.

    Attributes of an earlier bake are replaced. Raises fmm_core.Error naming the mesh that cannot be written; every mesh
    is then as it was.
    """
    wanted = [(_mesh_of(receiver, part.output), receiver, part) for part in parts for receiver in part.receivers]
    unfinished, rendered = [], [mesh.attributes.default_color_name for mesh, _, _ in wanted]
    try:
        for mesh, receiver, part in wanted:
            output = part.output
            for name, colours in part.colours.items():
                byte = output.byte and name == output.name
                domain, values = layer(receiver, colours[receiver.rows], output.domain)
                if byte:
                    values[:, :3] = np.minimum(values[:, :3] * 2.0**output.exposure, 1.0)
                unfinished.append((mesh, _add(mesh, domain, byte), name))
                mesh.color_attributes[unfinished[-1][1]].data.foreach_set("color", values.ravel())
    except Exception:
        for mesh, unnamed, _ in unfinished:
            _remove(mesh, unnamed)
        raise
    for mesh, unnamed, name in unfinished:
        _remove(mesh, name)
        mesh.color_attributes[unnamed].name = name
    for (mesh, receiver, part), before in zip(wanted, rendered, strict=True):
        index = mesh.color_attributes.find(part.output.name)
        mesh.color_attributes.active_color_index = index
        # Where a material reads the colours of renders, those of the bake are not to become them.
        if receiver.reads_rendered:
            mesh.attributes.default_color_name = before
        elif part.rendered:
            mesh.color_attributes.render_color_index = index
        mesh.update()


def activate(name: str) -> None:
    """Let 3D views show the colour attribute of that name, on all meshes that have it."""
    import bpy

    for mesh in bpy.data.meshes:
        index = mesh.color_attributes.find(name)
        if index >= 0 and mesh.is_editable:
            mesh.color_attributes.active_color_index = index
            mesh.update()


def layer(receiver: Receiver, colours: np.ndarray, domain: str = "AUTO") -> tuple[str, np.ndarray]:
    """Domain and values (N,4) float32 for the corner colours (C,3) of one mesh.

    "AUTO" is POINT where every face is smooth and the corners of each vertex agree, else CORNER: nothing is lost. A
    vertex whose corners differ gets their mean where POINT is asked for.
    """
    corners = np.ones((len(colours), 4), np.float32)
    corners[:, :3] = colours
    if domain == "POINT":
        return "POINT", _vertex_means(receiver, corners)
    if domain == "CORNER" or not receiver.smooth:
        return "CORNER", corners
    points = np.zeros((receiver.vertices, 4), np.float32)
    points[:, 3] = 1.0
    points[receiver.corner_vertex] = corners
    agree = (points[receiver.corner_vertex] == corners).all()
    return ("POINT", points) if agree else ("CORNER", corners)


def _vertex_means(receiver: Receiver, corners: np.ndarray) -> np.ndarray:
    """(V,4) means of the corners (C,4) of each vertex; black where a vertex has none."""
    counts = np.bincount(receiver.corner_vertex, minlength=receiver.vertices)
    sums = [np.bincount(receiver.corner_vertex, channel, receiver.vertices) for channel in corners.T]
    points = (np.stack(sums, axis=1) / np.maximum(counts, 1)[:, None]).astype(np.float32)
    points[:, 3] = 1.0
    return points


def _mesh_of(receiver: Receiver, output: Output) -> bpy.types.Mesh:
    """The datablock of a receiver, after checking that it still fits and that the names are free for colours."""
    import bpy

    mesh = bpy.data.meshes.get((receiver.mesh, None))
    if mesh is None:
        raise Error(f"mesh '{receiver.mesh}' of object '{receiver.object}' is gone")
    if mesh.is_editmode:
        raise Error(f"mesh '{receiver.mesh}' of object '{receiver.object}' is in Edit Mode")
    if (len(mesh.vertices), len(mesh.loops)) != (receiver.vertices, len(receiver.corner_vertex)):
        raise Error(f"mesh '{receiver.mesh}' of object '{receiver.object}' was changed during the bake")
    owner = bpy.data.objects.get((receiver.object, None))
    for name in output.names:
        taken = mesh.attributes.get(name)
        if taken is not None and name not in mesh.color_attributes:
            raise Error(
                f"mesh '{receiver.mesh}' has an attribute '{name}' of type {taken.data_type} for each "
                f"{taken.domain}: rename it"
            )
        if owner is not None and name in owner.vertex_groups:
            raise Error(f"object '{receiver.object}' has a vertex group '{name}': rename it")
    return mesh


def _add(mesh: bpy.types.Mesh, domain: str, byte: bool) -> str:
    """Add a colour attribute; returns its name, which Blender changes where another attribute has it already."""
    attribute = mesh.color_attributes.new(name=_UNFINISHED, type="BYTE_COLOR" if byte else "FLOAT_COLOR", domain=domain)
    if attribute is None:
        raise Error(f"Blender could not add a colour attribute to mesh '{mesh.name}'")
    return attribute.name


def _remove(mesh: bpy.types.Mesh, name: str) -> None:
    attribute = mesh.color_attributes.get(name)
    if attribute is not None:
        mesh.color_attributes.remove(attribute)
