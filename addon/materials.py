# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials: what a surface reflects, gives off and lets through, at places on a mesh.

What is not simulated, or cannot be read, does not go by silently: remarks come beside the numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from fmm_core import Brdf, Error, Gloss

from . import not_simulated
from .node_readers import plain
from .node_values import Points, Unreadable, Values, output_of
from .tables import Tables
from .textures import Image, MissingImage
from .volumes import volume_node, without_nodes

if TYPE_CHECKING:
    import bpy

Array = np.ndarray

GREY = np.full((1, 3), 0.8)
BLACK = np.zeros((1, 3))
NONE, ALL = np.zeros(1), np.ones(1)

# Colours are single precision: far below its end, so that no sum of light gets there. The sun gives off 6e7 W/m^2.
MAX_EMISSION = 1e20
#: What shines and blocks nothing has to block so much, or no ray would find it.
GLOWING = 1 / 16

#: Least share of a shader that is mixed with others: so what is transparent at a place has a colour there all the same.
TRACE = 1e-6

#: Columns of `Surface.gloss`: four colours, then sums of which `gloss_of` takes means.
DIFFUSE, FACING, GRAZING, PLASTIC, LEVEL, SHINE, ROUGHNESS = (*(slice(k, k + 3) for k in (0, 3, 6, 9)), 12, 13, 14)
#: And the number of a measured table, counted from 1.
MEASURED = 15
GLOSS = 16

#: Shaders that reflect all of their colour, and how the socket is called.
_REFLECTING = {
    "ShaderNodeBsdfDiffuse": "Color",
    "ShaderNodeBsdfAnisotropic": "Color",
    "ShaderNodeBsdfGlossy": "Color",
    "ShaderNodeBsdfMetallic": "Base Color",
    "ShaderNodeBsdfSheen": "Color",
    "ShaderNodeBsdfToon": "Color",
    "ShaderNodeBsdfTranslucent": "Color",
    "ShaderNodeSubsurfaceScattering": "Color",
}
#: Those of them that shine.
_GLOSSY = {"ShaderNodeBsdfAnisotropic", "ShaderNodeBsdfGlossy", "ShaderNodeBsdfMetallic"}
#: Principled inputs that do more than is simulated, where they are above 0.
_LEFT_OUT = {
    "Transmission Weight": "the surface is taken as opaque",
    "Coat Weight": "left out",
    "Sheen Weight": "left out",
}


#: Of rough surfaces: share of the specular reflection of smooth ones, and of what its colour takes once more, because
#: light meets it several times. Measured in Cycles 4.2 under an even sky.
_ROUGHNESS = np.array([0.0, 0.2, 0.35, 0.5, 0.7, 1.0])
_SHINE_LEFT = np.array([1.0, 0.97, 0.83, 0.665, 0.46, 0.24])
_METAL_LOST = np.array([0.0, 0.01, 0.05, 0.145, 0.36, 0.83])


@dataclass(frozen=True)
class Surface:
    """What one material does to light at S places, or everywhere where S is 1.

    albedo (S, 3): share of the light that is reflected, diffuse and specular together; emission (S, 3): radiant
    exitance in W/m^2, pi times the radiance; opacity (S,): share of the light that does not pass straight through.
    colour (S, 3): the same without the specular layer of plastics, by which light is multiplied to be shown
    gloss (S, GLOSS): how it reflects towards an eye, to be taken apart by `gloss_of`
    All but opacity are those of the part that is there: of all of the surface it is `opacity` times as much.
    remarks: what was left out or replaced, in words
    """

    albedo: Array
    emission: Array
    opacity: Array
    colour: Array
    gloss: Array
    remarks: tuple[str, ...] = ()


#: How a material is found again: its name, the file of the library that it is from, and its number in this session.
Name = tuple[str, str | None, int]


def name_of(material: bpy.types.Material | None) -> Name | None:
    """How the original of a material is found again."""
    if material is None:
        return None
    original = material.original
    library = None if original.library is None else original.library.filepath
    return original.name, library, original.session_uid


def find(name: Name | None) -> bpy.types.Material | None:
    """The material of a name, or of a number if it was renamed; raises fmm_core.Error where it is gone."""
    import bpy

    if name is None:
        return None
    materials = bpy.data.materials
    found = materials.get(name[:2]) or next((each for each in materials if each.session_uid == name[2]), None)
    if found is None:
        raise Error(f"material '{name[0]}' was removed while it was read")
    return found


def read_material(
    material: bpy.types.Material | None, points: Points, images: dict[bpy.types.Image, Image], tables: Tables
) -> Surface:
    """A material at places on a mesh; no material is Blender's grey of 0.8, and a measured one reflects as its table.

    Raises fmm_core.Error naming material and value where a colour or strength is negative or not finite, or where the
    emission is above MAX_EMISSION.
    """
    if material is None:
        return Surface(GREY, BLACK, ALL, GREY, _gloss(diffuse=GREY))
    surface, number = _of_shader(material, points, images), tables.number(material)
    if number is None:
        return surface
    albedo = np.minimum(tables.found[number].mean_albedo, 1.0)[None]
    return replace(surface, albedo=albedo, colour=albedo, gloss=_gloss(facing=albedo, measured=number))


def _of_shader(material: bpy.types.Material, points: Points, images: dict[bpy.types.Image, Image]) -> Surface:
    """What the nodes of a material do."""
    if without_nodes(material):
        colour = np.array([material.diffuse_color[:3]], float)
        colour = _checked(colour, material, "Base Color")
        return Surface(colour, BLACK, ALL, colour, _gloss(diffuse=colour))
    socket = _surface_socket(material.node_tree)
    if is_air(material):
        return Surface(GREY, BLACK, NONE, GREY, _gloss(diffuse=GREY))
    if socket is None or not socket.is_linked:
        return Surface(
            GREY, BLACK, ALL, GREY, _gloss(diffuse=GREY), ("has no shader at its Surface output, grey 0.8 is used",)
        )
    shaders = _Shaders(material, Values(points, images))
    closure = shaders.closure(socket)
    shaders.remarks += not_simulated.of_output(material.node_tree, shaders.values)
    opacity = 1 - np.clip(closure.passes, 0, 1)
    glows = (closure.emission > 10 * TRACE * closure.emission.max()).any(axis=1)
    if (glows & (opacity < GLOWING)).any():
        shaders.remark(f"shines where it is transparent: {GLOWING:.0%} of the light is blocked there")
        opacity = np.where(glows, np.maximum(opacity, GLOWING), opacity)
    solid = np.where(opacity > 0, opacity, np.inf)[:, None]
    opacity = np.where(opacity > 10 * TRACE, np.where(opacity < 1 - 10 * TRACE, opacity, 1.0), 0.0)
    parts = closure.albedo / solid, closure.emission / solid, opacity, closure.colour / solid, closure.gloss / solid
    return Surface(*parts, tuple(shaders.remarks))


def shines(surface: Surface) -> bool:
    """Whether metal and gloss reflect more than half of what a surface reflects; of a measured one nobody knows."""
    shine, measured = surface.gloss[:, SHINE].mean(), surface.gloss[:, MEASURED].any()
    return not measured and bool(shine > surface.albedo.mean() / 2)


def is_air(material: bpy.types.Material | None) -> bool:
    """Whether a material has a volume and no surface."""
    if volume_node(material) is None:
        return False
    socket = _surface_socket(material.node_tree)
    return socket is None or not socket.is_linked


def _gloss(
    diffuse: Array = BLACK,
    facing: Array = BLACK,
    grazing: Array = BLACK,
    plastic: Array = BLACK,
    level: Array = NONE,
    roughness: Array = NONE,
    measured: int = -1,
) -> Array:
    """(S, GLOSS) of one shader; the arguments as `fmm_core.Gloss` has them."""
    weight = plastic.mean(axis=1) * level
    shine = facing.mean(axis=1) + weight
    count = max(len(part) for part in (diffuse, facing, grazing, plastic, level, roughness))
    parts = [np.broadcast_to(part, (count, 3)) for part in (diffuse, facing, grazing, plastic)]
    parts += [np.broadcast_to(part, count)[:, None] for part in (weight, shine, shine * roughness)]
    parts.append(np.full((count, 1), measured + 1.0))
    return np.concatenate(parts, axis=1)


@dataclass(frozen=True)
class _Closure:
    """What shaders together do, over all of the surface: albedo, emission, colour (S, 3), what passes (S,), gloss."""

    albedo: Array
    emission: Array
    passes: Array
    colour: Array
    gloss: Array


_DULL = np.zeros((1, GLOSS))
_NOTHING = _Closure(BLACK, BLACK, NONE, BLACK, _DULL)


class _Shaders:
    """Turns the shaders of one material into a closure."""

    def __init__(self, material: bpy.types.Material, values: Values) -> None:
        self.material, self.values = material, values
        self.remarks = values.remarks

    def remark(self, text: str) -> None:
        if text not in self.remarks:
            self.remarks.append(text)

    def closure(self, socket: bpy.types.NodeSocket) -> _Closure:
        """Of the shader at a socket; nothing where none is linked."""
        try:
            return self.values.within(socket, self._closure)
        except Unreadable as error:
            self.remark(f"shader '{error}' is made of itself: left out there")
            return _NOTHING

    def _closure(self, source: bpy.types.NodeSocket | None) -> _Closure:
        if source is None or not source.is_output:
            return _NOTHING
        node, kind = source.node, source.node.bl_idname
        for text in not_simulated.of_shader(node, self.values):
            self.remark(text)
        if kind == "ShaderNodeMixShader":
            factor = np.clip(self.number(node, "Fac"), TRACE, 1 - TRACE)
            return _sum((1 - factor, self.closure(node.inputs[1])), (factor, self.closure(node.inputs[2])))
        if kind == "ShaderNodeAddShader":
            return _sum((ALL, self.closure(node.inputs[0])), (ALL, self.closure(node.inputs[1])))
        if kind == "ShaderNodeBsdfTransparent":
            colour = self.colour(node, "Color")
            if np.ptp(colour, axis=1).max() > TRACE:
                self.remark(f"the colour of shader '{node.name}' is not simulated, its mean is used")
            return _Closure(BLACK, BLACK, colour.mean(axis=1), BLACK, _DULL)
        if kind == "ShaderNodeEmission":
            return _Closure(BLACK, self.emission(node, "Color", "Strength"), NONE, BLACK, _DULL)
        if kind == "ShaderNodeBsdfPrincipled":
            return self.principled(node)
        if kind in _GLOSSY:
            return self.glossy(node, _REFLECTING[kind])
        if kind in _REFLECTING:
            return _reflecting(self.colour(node, _REFLECTING[kind]))
        if kind == "ShaderNodeHoldout":
            return _NOTHING
        self.remark(f"shader '{node.name}' is not simulated, grey 0.8 is used")
        return _reflecting(GREY)

    def glossy(self, node: bpy.types.Node, name: str) -> _Closure:
        """Reflects its colour; metal all of what comes along the surface."""
        colour, roughness = self.colour(node, name), self.number(node, "Roughness")
        grazing = np.ones((1, 3)) if node.bl_idname == "ShaderNodeBsdfMetallic" else colour
        return _Closure(colour, BLACK, NONE, colour, _gloss(facing=colour, grazing=grazing, roughness=roughness))

    def principled(self, node: bpy.types.Node) -> _Closure:
        """The specular layer reflects its mean share, what it lets through the base reflects; metal reflects it all."""
        base, metallic = self.colour(node, "Base Color"), np.clip(self.number(node, "Metallic"), 0, 1)[:, None]
        level, ior, rough = (self.number(node, name) for name in ("Specular IOR Level", "IOR", "Roughness"))
        left = np.interp(rough, _ROUGHNESS, _SHINE_LEFT)[:, None]
        shine = left * mean_reflectance(level, ior)[:, None]
        tint = self.colour(node, "Specular Tint") if shine.any() else BLACK
        plastic = base * (1 - shine) + tint * shine
        # Schlick's reflectance, averaged over the hemisphere by cosine.
        dark = 1 - np.minimum(base, 1)
        metal = base * (1 - dark * np.interp(rough, _ROUGHNESS, _METAL_LOST)[:, None]) + dark * left / 21
        for name, instead in _LEFT_OUT.items():
            socket = node.inputs.get(name)
            if socket is not None and (socket.is_linked or socket.default_value > 0):
                self.remark(f"{name} is not simulated, {instead}")
        albedo, emission = (1 - metallic) * plastic + metallic * metal, self.emission(node, *_PRINCIPLED_EMISSION)
        opacity = np.clip(self.number(node, "Alpha"), TRACE, 1)
        gloss = _gloss(
            (1 - metallic) * base,
            metallic * base,
            metallic * np.ones((1, 3)),
            (1 - metallic) * tint,
            facing_reflectance(level, ior),
            rough,
        )
        solid, clear = _Closure(albedo, emission, NONE, base, gloss), _Closure(BLACK, BLACK, ALL, BLACK, _DULL)
        return _sum((opacity, solid), (1 - opacity, clear))

    def emission(self, node: bpy.types.Node, colour: str, strength: str) -> Array:
        """Radiant exitance (S, 3) in W/m^2 of a colour and a strength socket, whose product is a radiance."""
        factor = self.number(node, strength)
        if not factor.any():
            return BLACK
        found = math.pi * factor[:, None] * self.colour(node, colour)
        if found.max() > MAX_EMISSION:
            raise Error(f"material '{self.material.name}' gives off {found.max():.3g} W/m^2: at most "
                        f"{MAX_EMISSION:g} can be baked")  # fmt: skip
        return found

    def colour(self, node: bpy.types.Node, name: str) -> Array:
        """(S, 3) of an input."""
        return self._input(node, name, self.values.colour)

    def number(self, node: bpy.types.Node, name: str) -> Array:
        """(S,) of an input."""
        return self._input(node, name, self.values.number)

    def _input(self, node: bpy.types.Node, name: str, find: object) -> Array:
        """What is found for an input, or its plain value with a remark where a link cannot be read."""
        socket = node.inputs[name]
        try:
            value = find(socket)
        except (Unreadable, MissingImage) as error:
            value = plain(socket)
            shown = ", ".join(f"{part:.3g}" for part in value.ravel())
            why = f"comes from '{error}', which is not read" if isinstance(error, Unreadable) else f"is lost, {error}"
            self.remark(f"{name} {why}: its plain value {f'({shown})' if value.size > 1 else shown} is used")
        if socket.is_linked and np.isfinite(value).all():
            return np.maximum(value, 0.0)
        return _checked(value, self.material, name)


_PRINCIPLED_EMISSION = "Emission Color", "Emission Strength"


def _reflecting(colour: Array) -> _Closure:
    return _Closure(colour, BLACK, NONE, colour, _gloss(diffuse=colour))


def _sum(*parts: tuple[Array, _Closure]) -> _Closure:
    """Closures added up, each times a weight (S,)."""
    albedo, emission, colour, gloss = (
        sum(weight[:, None] * getattr(closure, name) for weight, closure in parts)
        for name in ("albedo", "emission", "colour", "gloss")
    )
    return _Closure(albedo, emission, sum(weight * closure.passes for weight, closure in parts), colour, gloss)


def gloss_of(gloss: Array, towards: Array, tables: tuple[Brdf, ...]) -> Gloss:
    """Rows (S, GLOSS) as the core takes them, for directions (S, 3) to the eye, with the tables that they number."""
    weight, shine = gloss[:, PLASTIC].mean(axis=1), gloss[:, SHINE]
    level = gloss[:, LEVEL] / np.where(weight > 0, weight, np.inf)
    roughness = gloss[:, ROUGHNESS] / np.where(shine > 0, shine, np.inf)
    colours = (gloss[:, part] for part in (DIFFUSE, FACING, GRAZING, PLASTIC))
    return Gloss(towards, *colours, level, roughness, gloss[:, MEASURED] - 1, tables)


def facing_reflectance(level: Array, ior: Array) -> Array:
    """(S,) share of light from straight ahead that a smooth dielectric reflects."""
    ior = np.maximum(ior, 1 / np.maximum(ior, 1e-3))
    return np.clip(((ior - 1) / (ior + 1)) ** 2 * 2 * level, 0.0, 0.99)


def mean_reflectance(level: Array, ior: Array) -> Array:
    """(S,) share of diffuse light that a smooth dielectric of this index of refraction and specular level reflects.

    By the fit of Kulla and Conty, Revisiting Physically Based Shading at Imageworks (2017).
    """
    facing = facing_reflectance(level, ior)
    ior = (1 + np.sqrt(facing)) / (1 - np.sqrt(facing))
    return np.clip((ior - 1) / (4.08567 + 1.00071 * ior), 0.0, 1.0)


def _checked(values: Array, material: bpy.types.Material, name: str) -> Array:
    wrong = values[~(np.isfinite(values) & (values >= 0))]
    if wrong.size:
        raise Error(f"material '{material.name}': {name} is {wrong[0]:g}, it must be finite and not negative")
    return values


def _surface_socket(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket | None:
    """The Surface socket of the active output."""
    output = output_of(tree)
    return None if output is None else output.inputs["Surface"]
