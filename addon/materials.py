# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials and world read as constants: what a diffuse surface reflects and gives off.

Textures, mixed shaders and everything glossy are outside of what a bake simulates. Nothing of that goes by silently:
each reader returns its remarks beside its numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fmm_core import Error

if TYPE_CHECKING:
    import bpy

Colour = tuple[float, float, float]

GREY: Colour = (0.8, 0.8, 0.8)
BLACK: Colour = (0.0, 0.0, 0.0)

# Colours are single precision: far below its end, so that no sum of light gets there. The sun gives off 6e7 W/m^2.
MAX_EMISSION = 1e20

# Principled inputs that make a surface other than opaque and diffuse, with the value that switches each off.
_NOT_DIFFUSE = {"Metallic": 0.0, "Transmission Weight": 0.0, "Alpha": 1.0}


@dataclass(frozen=True)
class Surface:
    """What one material does to light.

    albedo: reflected fraction per colour; emission: radiant exitance in W/m^2 per colour (pi times the radiance);
    remarks: what was left out or replaced, in words.
    """

    albedo: Colour
    emission: Colour
    remarks: tuple[str, ...] = ()


def read_material(material: bpy.types.Material | None) -> Surface:
    """The constants of a material; no material is Blender's grey of 0.8.

    Raises fmm_core.Error naming material and value where a colour or strength is negative or not finite, or where the
    emission is above MAX_EMISSION.
    """
    if material is None:
        return Surface(GREY, BLACK)
    if _without_nodes(material):
        return Surface(_colour(material.diffuse_color, material, "Base Color"), BLACK)
    shader = _shader_of(material.node_tree)
    if shader is None:
        return Surface(GREY, BLACK, ("has no shader at its Surface output, grey 0.8 is used",))
    reader = _READERS.get(shader.bl_idname)
    if reader is None:
        return Surface(GREY, BLACK, (f"shader '{shader.name}' is not simulated, grey 0.8 is used",))
    return reader(material, shader)


def world_remark(world: bpy.types.World | None) -> str | None:
    """A sentence about the light of the world background where it gives any, else None."""
    if world is None:
        return None
    if _without_nodes(world):
        lit = any(channel > 0 for channel in world.color)
    else:
        lit = _background_is_lit(_shader_of(world.node_tree))
    return f"the background of world '{world.name}' is not simulated yet: left out" if lit else None


def _without_nodes(datablock: bpy.types.Material | bpy.types.World) -> bool:
    # From Blender 5.0 on every material and world has nodes, and asking for use_nodes is deprecated.
    import bpy

    return datablock.node_tree is None or (bpy.app.version < (5, 0, 0) and not datablock.use_nodes)


def _shader_of(tree: bpy.types.NodeTree) -> bpy.types.Node | None:
    """The node at the Surface socket of the active output, reroutes followed; None where nothing is there."""
    outputs = [node for node in tree.nodes if node.bl_idname in ("ShaderNodeOutputMaterial", "ShaderNodeOutputWorld")]
    output = next((node for node in outputs if node.is_active_output), outputs[0] if outputs else None)
    if output is None:
        return None
    socket = output.inputs["Surface"]
    while socket.is_linked and socket.links:
        node = socket.links[0].from_node
        if node.bl_idname != "NodeReroute":
            return node
        socket = node.inputs[0]
    return None


def _background_is_lit(shader: bpy.types.Node | None) -> bool:
    if shader is None:
        return False
    if shader.bl_idname != "ShaderNodeBackground":
        return True
    colour, strength = shader.inputs["Color"], shader.inputs["Strength"]
    bright = colour.is_linked or any(channel > 0 for channel in colour.default_value[:3])
    return bright and (strength.is_linked or strength.default_value > 0)


def _principled(material: bpy.types.Material, shader: bpy.types.Node) -> Surface:
    albedo, remarks = _input(shader, "Base Color")
    emission, more = _emission(material, shader, "Emission Color", "Emission Strength")
    remarks += more
    for name, off in _NOT_DIFFUSE.items():
        socket = shader.inputs.get(name)
        if socket is not None and (socket.is_linked or socket.default_value != off):
            remarks.append(f"{name} is not simulated, the surface is taken as diffuse and opaque")
    return Surface(_colour(albedo, material, "Base Color"), emission, tuple(remarks))


def _diffuse(material: bpy.types.Material, shader: bpy.types.Node) -> Surface:
    albedo, remarks = _input(shader, "Color")
    return Surface(_colour(albedo, material, "Color"), BLACK, tuple(remarks))


def _emitter(material: bpy.types.Material, shader: bpy.types.Node) -> Surface:
    emission, remarks = _emission(material, shader, "Color", "Strength")
    return Surface(BLACK, emission, tuple(remarks))


def _emission(
    material: bpy.types.Material, shader: bpy.types.Node, colour_name: str, strength_name: str
) -> tuple[Colour, list[str]]:
    """Radiant exitance in W/m^2 of a colour and a strength socket, whose product is a radiance."""
    strength, remarks = _input(shader, strength_name)
    colour, more = _input(shader, colour_name)
    if not strength and not remarks:
        return BLACK, []
    _check(strength, material, strength_name)
    radiance = _colour(colour, material, colour_name)
    emission = tuple(math.pi * strength * channel for channel in radiance)
    if max(emission) > MAX_EMISSION:
        raise Error(f"material '{material.name}' gives off {max(emission):.3g} W/m^2: at most {MAX_EMISSION:g} can be "
                    "baked")  # fmt: skip
    return emission, remarks + more


def _input(shader: bpy.types.Node, name: str) -> tuple[object, list[str]]:
    """The plain value of an input, and a remark where a link would have overruled it."""
    socket = shader.inputs[name]
    if not socket.is_linked:
        return socket.default_value, []
    source = socket.links[0].from_node.name if socket.links else "a node"
    value = socket.default_value
    shown = f"{value:.3g}" if isinstance(value, float) else "({:.3g}, {:.3g}, {:.3g})".format(*value[:3])
    return value, [f"{name} comes from '{source}', which is not read yet: its plain value {shown} is used"]


def _colour(value: object, material: bpy.types.Material, name: str) -> Colour:
    return tuple(_check(channel, material, name) for channel in value[:3])


def _check(value: float, material: bpy.types.Material, name: str) -> float:
    if not math.isfinite(value) or value < 0:
        raise Error(f"material '{material.name}': {name} is {value:g}, it must be finite and not negative")
    return float(value)


_READERS = {
    "ShaderNodeBsdfPrincipled": _principled,
    "ShaderNodeBsdfDiffuse": _diffuse,
    "ShaderNodeEmission": _emitter,
}
