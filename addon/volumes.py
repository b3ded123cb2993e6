# SPDX-License-Identifier: GPL-3.0-or-later
"""What absorbs light on its way: the volume of the world, and of materials the inside of meshes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import fmm_core
import numpy as np

from .node_values import Unreadable, nowhere, output_of
from .textures import MissingImage

if TYPE_CHECKING:
    import bpy


def read_volume(owner: bpy.types.World | bpy.types.Material | None) -> tuple[np.ndarray, list[str]]:
    """Absorption (3,) in 1/m of the volume of a world or a material, and what of it is left out, in words.

    Raises fmm_core.Error naming the owner where a density or colour is none.
    """
    node = volume_node(owner)
    if node is None:
        return np.zeros(3), []
    if node.bl_idname not in _ABSORPTION:
        return np.zeros(3), [f"its volume '{node.name}' is not simulated: left out"]
    try:
        absorption, remarks = _ABSORPTION[node.bl_idname](node.inputs)
    except (Unreadable, MissingImage):
        linked = ", ".join(socket.name for socket in node.inputs if socket.is_linked)
        return np.zeros(3), [f"its volume '{node.name}' is not the same everywhere ({linked}): left out"]
    if not (np.isfinite(absorption) & (absorption >= 0)).all():
        kind = owner.bl_rna.identifier.lower()
        raise fmm_core.Error(f"{kind} '{owner.name}': its volume absorbs {absorption.min():g} per metre")
    return absorption, remarks


def volume_of(name: str, triangles: np.ndarray, absorption: np.ndarray, closed: bool) -> fmm_core.Volume:
    """What is inside an object's triangles (T,3,3), whichever way they face.

    Raises fmm_core.Error naming the object where there is no inside.
    """
    size = fmm_core.signed_volume(triangles)
    if not closed or size == 0:
        raise fmm_core.Error(f"object '{name}': its mesh is not closed, its volume is left out")
    return fmm_core.Volume(triangles if size > 0 else triangles[:, ::-1], absorption)


def volume_node(owner: bpy.types.World | bpy.types.Material | None) -> bpy.types.Node | None:
    """The shader at the Volume output of a world or a material, or None."""
    if owner is None or without_nodes(owner):
        return None
    output = output_of(owner.node_tree)
    try:
        source = None if output is None else nowhere().source(output.inputs["Volume"])
    except Unreadable:
        return None
    return source.node if source is not None and source.is_output else None


def _of_absorption(inputs: bpy.types.NodeInputs) -> tuple[np.ndarray, list[str]]:
    """Cycles: what a colour lacks to 1, times the density."""
    return _value(inputs, "Density") * np.maximum(1 - _value(inputs, "Color"), 0.0), []


def _of_principled(inputs: bpy.types.NodeInputs) -> tuple[np.ndarray, list[str]]:
    """Cycles scatters the colour, and absorbs of the rest what the root of the absorption colour lacks to 1."""
    density, colour = _value(inputs, "Density"), _value(inputs, "Color")
    kept = np.sqrt(np.maximum(_value(inputs, "Absorption Color"), 0.0))
    left_out = {
        "scatters light": density * colour.max(),
        "glows": _value(inputs, "Emission Strength"),
        "burns": _value(inputs, "Blackbody Intensity"),
    }
    remarks = [f"its volume {what}, which is not simulated" for what, amount in left_out.items() if amount > 0]
    return density * np.maximum(1 - colour, 0.0) * np.maximum(1 - kept, 0.0), remarks


def without_nodes(owner: bpy.types.World | bpy.types.Material) -> bool:
    """Whether the nodes of a world or a material, if any, do not count."""
    # From Blender 5.0 on all have nodes, and asking for use_nodes is deprecated.
    import bpy

    return owner.node_tree is None or (bpy.app.version < (5, 0, 0) and not owner.use_nodes)


#: Volumes that can be read.
_ABSORPTION = {"ShaderNodeVolumeAbsorption": _of_absorption, "ShaderNodeVolumePrincipled": _of_principled}


def _value(inputs: bpy.types.NodeInputs, name: str) -> np.ndarray:
    """Of a number, or (3,) of a colour; raises Unreadable or MissingImage where it is not the same everywhere."""
    socket, values = inputs[name], nowhere()
    value = (values.number if socket.type == "VALUE" else values.colour)(socket)[0]
    return np.maximum(value, 0.0) if socket.is_linked and np.isfinite(value).all() else value
