# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene that was read, as plain numpy arrays."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from fmm_core import Brdf, Error, Light, Opacity, Sky, Volume

from .meshes import triangle_centres


class Dark(Error):
    """Nothing gives off light in a scene that could be baked otherwise; warnings: those of the scene."""

    def __init__(self, text: str, warnings: tuple[str, ...]) -> None:
        super().__init__(text)
        self.warnings = warnings


@dataclass(frozen=True)
class Receiver:
    """One mesh datablock that gets colours.

    mesh, object: names of the datablock and of the object it is baked for; rows: its corners among all corners of the
    scene; corner_vertex (C,) int: vertex of each corner, counted in the mesh; vertices: how many the mesh has;
    smooth: whether all of its faces are shaded smooth; reads_rendered: whether a material reads the colour attribute
    that renders take.
    """

    mesh: str
    object: str
    rows: slice
    corner_vertex: np.ndarray
    vertices: int
    smooth: bool
    reads_rendered: bool


@dataclass(frozen=True)
class SceneArrays:
    """A scene in world space, without anything of Blender in it; safe to hand to another thread.

    triangles (T,3,3) m, counter-clockwise from the front; albedo (T,3); emission (T,3) W/m^2; two_sided (T,) bool;
    opacity of the triangles.
    corner_* describe the C corners of all receivers, in mesh order: position (C,3) m, normal (C,3) unit, vertex (C,)
    int unique over the scene, albedo (C,3), and emission (C,3) W/m^2, and gloss (C, materials.GLOSS) where there is an
    eye. corner_triangles (R,3) are the corners of each triangle that the receivers are drawn with.
    lights: the lamps; sky: what the world sends, or None; medium (3,) 1/m: what it absorbs of light on its way;
    volumes: meshes that absorb light inside;
    eye (4,): where the camera is, homogeneous, or None; tables: those of measured materials; shade: as `fmm_core.Scene`
    has it.
    """

    triangles: np.ndarray
    albedo: np.ndarray
    emission: np.ndarray
    two_sided: np.ndarray
    opacity: Opacity
    corner_position: np.ndarray
    corner_normal: np.ndarray
    corner_vertex: np.ndarray
    corner_albedo: np.ndarray
    corner_emission: np.ndarray
    corner_gloss: np.ndarray
    corner_triangles: np.ndarray
    lights: tuple[Light, ...]
    sky: Sky | None
    medium: np.ndarray
    volumes: tuple[Volume, ...]
    receivers: tuple[Receiver, ...]
    warnings: tuple[str, ...]
    eye: np.ndarray | None = None
    tables: tuple[Brdf, ...] = ()
    shade: Opacity | None = None

    @cached_property
    def corner_triangle_centre(self) -> np.ndarray:
        """(C,3) m: centre of the largest triangle at each corner."""
        return triangle_centres(self.corner_position, self.corner_triangles)
