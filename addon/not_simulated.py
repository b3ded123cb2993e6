# SPDX-License-Identifier: GPL-3.0-or-later
"""What Cycles bakes and this does not, in words, where nothing else would tell of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .node_values import Unreadable, Values, output_of

if TYPE_CHECKING:
    import bpy

#: Shaders that scatter otherwise, of which only the colour counts.
_AS_DIFFUSE = {"ShaderNodeBsdfTranslucent", "ShaderNodeBsdfSheen", "ShaderNodeBsdfToon"}


def of_shader(node: bpy.types.Node, values: Values) -> list[str]:
    """Of one shader, whose inputs are found among values."""
    found = []
    if node.bl_idname in _AS_DIFFUSE:
        found.append(f"shader '{node.name}' is taken as diffuse reflection")
    rough = node.bl_idname == "ShaderNodeBsdfDiffuse" and node.inputs["Roughness"]
    if rough and (rough.is_linked or rough.default_value > 0):
        found.append(f"Roughness of shader '{node.name}' is not simulated, it scatters as a matt one")
    normal = _source(node, "Normal", values)
    if normal is not None and not _is_own(normal):
        found.append(f"Normal comes from '{normal.node.name}', which is not simulated: the mesh's own is used")
    return found


def of_output(tree: bpy.types.NodeTree, values: Values) -> list[str]:
    """Of what the output of a material has beside its surface."""
    output = output_of(tree)
    if output is None or _source(output, "Displacement", values) is None:
        return []
    return ["its displacement is not simulated, the mesh's own shape is used"]


def _source(node: bpy.types.Node, name: str, values: Values) -> bpy.types.NodeSocket | None:
    """The output that an input of a node gets its value from, or None."""
    socket = node.inputs.get(name)
    try:
        source = None if socket is None else values.within(socket, lambda source: source)
    except Unreadable:
        return None
    return source if source is not None and source.is_output else None


def _is_own(normal: bpy.types.NodeSocket) -> bool:
    """Whether a node hands on the normal of the mesh."""
    node = normal.node
    strength = node.inputs.get("Strength")
    flat = strength is not None and not strength.is_linked and strength.default_value == 0
    return flat or (node.bl_idname in ("ShaderNodeNewGeometry", "ShaderNodeTexCoord") and normal.name == "Normal")
