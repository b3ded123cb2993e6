# SPDX-License-Identifier: GPL-3.0-or-later
"""What Cycles bakes and this does not, in words, where nothing else would tell of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .node_values import Values

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
    return found
