# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps of Blender as lights of the core, with the numbers that Cycles gives them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import fmm_core
import numpy as np

from . import ray_flags
from .node_readers import plain
from .node_values import Unreadable, nowhere, output_of
from .textures import MissingImage

if TYPE_CHECKING:
    import bpy

# What Cycles makes of the narrowest spread, in radians.
_LEAST_SPREAD = math.radians(1.0)
# Cosine between axes that counts as 0.
_SQUARE = 1e-3
# Bounces from which on a limit makes no difference that is worth a word.
_MANY_BOUNCES = 8


def read_light(obj: bpy.types.Object, matrix: np.ndarray) -> tuple[fmm_core.Light | None, list[str]]:
    """The light of a lamp that stands where a matrix (4,4) in m puts it, or None where it lights no surface; and what
    was left out or replaced, in words.

    Raises fmm_core.Error naming lamp and value where one is out of bounds.
    """
    lamp = obj.data
    # Only there while Cycles is switched on.
    cycles = getattr(lamp, "cycles", None)
    if not obj.visible_diffuse or getattr(cycles, "is_portal", False):
        return None, []
    power, remarks = _power(lamp)
    if min(power) < 0:
        return None, ["has negative power, which is not simulated: left out"]
    if max(power) == 0:
        return None, []
    if _extent(lamp, matrix) == 0:
        return None, ["has a size or scale of 0: left out"]
    bounces = getattr(cycles, "max_bounces", _MANY_BOUNCES)
    if bounces < _MANY_BOUNCES:
        remarks.append(f"has a limit of {bounces} bounces, which is not simulated")
    remarks += ray_flags.linking_remarks(obj)
    if lamp.type == "AREA" and _is_sheared(matrix):
        remarks.append("is sheared: it shines at right angles to its shape, other than in Cycles")
    try:
        return _READERS[lamp.type](lamp, matrix, power), remarks
    except fmm_core.Error as error:
        raise fmm_core.Error(f"light '{obj.name}': {error}") from None


def _extent(lamp: bpy.types.Light, matrix: np.ndarray) -> float:
    """0 where an area lamp has no area, a cone is flat, or a lamp that looks somewhere has lost its direction."""
    if lamp.type == "POINT":
        return 1.0
    if lamp.type == "SPOT":
        return float(np.linalg.matrix_rank(matrix[:3, :3]) == 3)
    if lamp.type == "AREA":
        return float(np.linalg.norm(np.cross(matrix[:3, 0], matrix[:3, 1])) * lamp.size * _height(lamp))
    return float(np.linalg.norm(matrix[:3, 2]))


def _is_sheared(matrix: np.ndarray) -> bool:
    """Whether the axes of a matrix do not stand at right angles, as those of what a stretched parent turns."""
    axes = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)
    return bool(np.abs(axes.T @ axes - np.eye(3)).max() > _SQUARE)


def _height(lamp: bpy.types.AreaLight) -> float:
    return lamp.size_y if lamp.shape in ("RECTANGLE", "ELLIPSE") else lamp.size


def _power(lamp: bpy.types.Light) -> tuple[np.ndarray, list[str]]:
    """Watts, or W/m^2 of a sun, of each colour (3,)."""
    factor, remarks = _of_nodes(lamp)
    colour = np.array(lamp.color[:], np.float64)
    # From Blender 4.5 on a lamp has a temperature and an exposure.
    if getattr(lamp, "use_temperature", False):
        colour = colour * np.array(lamp.temperature_color[:], np.float64)
    return lamp.energy * 2.0 ** getattr(lamp, "exposure", 0.0) * colour * factor, remarks


def _of_nodes(lamp: bpy.types.Light) -> tuple[np.ndarray, list[str]]:
    """What the nodes of a lamp multiply its light by (3,)."""
    one = np.ones(3)
    if not lamp.use_nodes or lamp.node_tree is None:
        return one, []
    output = output_of(lamp.node_tree)
    links = output.inputs["Surface"].links if output is not None else ()
    if not links:
        return 0 * one, []
    shader = links[0].from_node
    if shader.bl_idname != "ShaderNodeEmission":
        return one, [f"its node '{shader.name}' is not simulated, its power and colour are used"]
    values, remarks = nowhere(), []

    def found(name: str, find: Callable[[bpy.types.NodeSocket], np.ndarray]) -> np.ndarray:
        socket = shader.inputs[name]
        try:
            return find(socket)[0]
        except (Unreadable, MissingImage):
            remarks.append(f"{name} of its node '{shader.name}' comes from another node, which is not read: its plain "
                           "value is used")  # fmt: skip
            return plain(socket)[0]

    return found("Strength", values.number) * found("Color", values.colour), remarks


def _is_normalised(lamp: bpy.types.Light) -> bool:
    """Whether its power stays the same whatever its size; from Blender 4.5 on that can be switched off."""
    return getattr(lamp, "normalize", True)


def _intensity(lamp: bpy.types.Light, power: np.ndarray) -> np.ndarray:
    """W/sr of a point or a spot lamp: a spot is a point lamp with a shade."""
    radius = lamp.shadow_soft_size
    return power / (4 * math.pi) * (1.0 if _is_normalised(lamp) or not radius else math.pi * radius**2)


def _point(lamp: bpy.types.PointLight, matrix: np.ndarray, power: np.ndarray) -> fmm_core.PointLight:
    return fmm_core.PointLight(
        matrix[:3, 3], _intensity(lamp, power), lamp.shadow_soft_size, lamp.use_soft_falloff, lamp.use_shadow
    )


def _spot(lamp: bpy.types.SpotLight, matrix: np.ndarray, power: np.ndarray) -> fmm_core.SpotLight:
    return fmm_core.SpotLight(
        matrix[:3, 3],
        _intensity(lamp, power),
        lamp.shadow_soft_size,
        lamp.use_soft_falloff,
        lamp.use_shadow,
        direction=-matrix[:3, 2],
        angle=min(lamp.spot_size, math.pi),
        blend=lamp.spot_blend,
        stretch=matrix[:3, :3],
    )


def _sun(lamp: bpy.types.SunLight, matrix: np.ndarray, power: np.ndarray) -> fmm_core.SunLight:
    angle = min(lamp.angle, math.pi)
    if not _is_normalised(lamp) and angle > 0:
        power = power * math.pi * math.sin(angle / 2) ** 2
    return fmm_core.SunLight(-matrix[:3, 2], power, angle, lamp.use_shadow)


def _area(lamp: bpy.types.AreaLight, matrix: np.ndarray, power: np.ndarray) -> fmm_core.AreaLight:
    ellipse = lamp.shape in ("DISK", "ELLIPSE")
    u, v = matrix[:3, 0] * lamp.size / 2, matrix[:3, 1] * _height(lamp) / 2
    normal = np.cross(u, v)
    # It shines down its own z axis, also where a negative scale has mirrored it.
    if normal @ matrix[:3, 2] > 0:
        v = -v
    area = 4 * np.linalg.norm(normal) * (math.pi / 4 if ellipse else 1.0)
    if _is_normalised(lamp):
        power = power / max(area, 1e-30)
    spread = min(max(lamp.spread, _LEAST_SPREAD), math.pi)
    return fmm_core.AreaLight(matrix[:3, 3], u, v, power / math.pi, ellipse, spread, lamp.use_shadow)


_READERS = {"POINT": _point, "SPOT": _spot, "SUN": _sun, "AREA": _area}
