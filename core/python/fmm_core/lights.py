# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps: what lights a scene without being a surface of it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from . import patterns
from .errors import Error
from .lamp import Lamp, Matrix, Samples, Vector
from .solid_angles import cap, polygon

Points = NDArray[np.float64]

#: Corners of the polygon of equal area that stands for an ellipse.
ELLIPSE_CORNERS = 32


@dataclass(frozen=True)
class PointLight(Lamp):
    """A ball that shines evenly in all directions.

    position    m
    intensity   W/sr, of each colour or one number; the power is 4 pi times as much
    radius      m; 0 for a point, which casts hard shadows
    disc        instead of a ball it is a disc that faces each receiver, which is a little darker near by
    shadows     whether anything can be in its way
    Raises `Error` naming the field and the value.
    """

    position: Vector
    intensity: Vector | float
    radius: float = 0.0
    disc: bool = False
    shadows: bool = True

    power: ClassVar[str] = "intensity"

    def __post_init__(self) -> None:
        self._check(position="vector", intensity="colour", radius="length", disc="flag", shadows="flag")

    @property
    def is_small(self) -> bool:
        return self.radius == 0.0

    @property
    def extent(self) -> tuple[Points, float]:
        """Where it is, as `convexity.Planes.nothing_between` takes it."""
        return np.array([[*self.position, 1.0]]), self.radius

    def unshadowed(self, points: Points, normals: Points) -> Points:
        """(M,) irradiance at points (M, 3) with unit normals (M, 3) for an intensity of 1, with nothing in the way."""
        axes, distances = self._towards(points)
        cosines = (axes * normals).sum(axis=1)
        if self.is_small:
            return np.maximum(cosines, 0.0) / distances**2
        sines = self._sine_squared(distances)
        return cap(cosines, sines) * sines / self.radius**2

    def samples(self, points: Points, normals: Points, pattern: Points) -> Samples:
        """Points of the lamp by a pattern (M, K, 2) of `patterns`, seen from the receivers."""
        axes, distances = self._towards(points)
        if self.is_small:
            directions, lengths = axes[:, None], distances[:, None]
        else:
            sines = self._sine_squared(distances)
            directions, cosines = _in_cone(axes, sines, pattern)
            lengths = distances[:, None] / cosines if self.disc else self._to_ball(distances[:, None], cosines)
        weights = np.maximum(np.einsum("mkx,mx->mk", directions, normals), 0.0)
        return Samples(directions, lengths, weights, self._cone(directions))

    def scale(self, points: Points) -> Points:
        distances = self._towards(points)[1]
        return 1 / distances**2 if self.is_small else self._sine_squared(distances)

    def _towards(self, points: Points) -> tuple[Points, Points]:
        to = np.asarray(self.position) - points
        distances = np.maximum(np.linalg.norm(to, axis=1), 1e-30)
        return to / distances[:, None], distances

    def _sine_squared(self, distances: Points) -> Points:
        """Of half the angle under which it is seen; inside a ball it is all around."""
        if self.disc:
            return self.radius**2 / (self.radius**2 + distances**2)
        return np.minimum(1.0, (self.radius / distances) ** 2)

    def _to_ball(self, distances: Points, cosines: Points) -> Points:
        reach = np.sqrt(np.maximum(self.radius**2 - distances**2 * (1 - cosines**2), 0.0))
        return distances * cosines + np.where(distances > self.radius, -reach, reach)

    def _cone(self, directions: Points) -> Points:
        return np.ones(directions.shape[:2])


@dataclass(frozen=True)
class SpotLight(PointLight):
    """A `PointLight` that shines into a cone.

    direction   in which it shines
    angle       rad, of the whole cone
    blend       share of the cone, 0 to 1, over which its rim fades, by the cosine of the angle
    intensity   W/sr, inside of the part that does not fade
    stretch     (3, 3) what carries a round cone, its axis with it, into this one, whose axis is then `direction`
    """

    direction: Vector = (0.0, 0.0, -1.0)
    angle: float = math.pi / 4
    blend: float = 0.15
    stretch: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check(direction="direction", angle="whole angle", blend="share", stretch="matrix")

    @property
    def without_cone(self) -> PointLight:
        return PointLight(self.position, self.intensity, self.radius, self.disc, self.shadows)

    def unshadowed(self, points: Points, normals: Points) -> Points:
        """As that of a `PointLight`, where any of it may be in the cone, which `samples` tells."""
        axes, distances = self._towards(points)
        inside = self._cosines(axes) >= math.cos(self.angle / 2)
        if not self.is_small:
            # The round cone's space shows the lamp inside a ball that is at most so large.
            reach = np.sqrt(self._sine_squared(distances)) * np.linalg.norm(self._back, 2)
            reach /= np.linalg.norm(axes @ self._back.T, axis=1)
            inside = np.arccos(self._cosines(axes)) - self.angle / 2 <= np.arcsin(np.minimum(reach, 1.0))
        return np.where(inside, super().unshadowed(points, normals), 0.0)

    def _cone(self, directions: Points) -> Points:
        edge = math.cos(self.angle / 2)
        fade = np.clip((self._cosines(directions) - edge) / max(1e-12, (1 - edge) * self.blend), 0.0, 1.0)
        return fade**2 * (3 - 2 * fade)

    @property
    def _back(self) -> Points:
        """What carries directions to where the cone is round."""
        return np.linalg.inv(self.stretch)

    def _cosines(self, directions: Points) -> Points:
        """Of the angles, where the cone is round, between its axis and what goes against these directions (..., 3)."""
        axis, against = self._back @ np.asarray(self.direction), -directions @ self._back.T
        lengths = np.linalg.norm(axis) * np.linalg.norm(against, axis=-1)
        return np.clip(against @ axis / lengths, -1.0, 1.0)


@dataclass(frozen=True)
class SunLight(Lamp):
    """Light from far away.

    direction    in which it shines
    irradiance   W/m^2 on a surface that faces it, of each colour or one number
    angle        rad, under which it is seen, from rim to rim; 0 for hard shadows
    shadows      whether anything can be in its way
    Raises `Error` naming the field and the value.
    """

    direction: Vector
    irradiance: Vector | float
    angle: float = 0.0
    shadows: bool = True

    power: ClassVar[str] = "irradiance"

    def __post_init__(self) -> None:
        self._check(direction="direction", irradiance="colour", angle="whole angle", shadows="flag")

    @property
    def is_far(self) -> bool:
        """Whether its light comes from infinitely far away."""
        return True

    @property
    def is_small(self) -> bool:
        return self.angle == 0.0

    @property
    def extent(self) -> tuple[Points, float]:
        """Where it is, as `convexity.Planes.nothing_between` takes it."""
        return np.array([[*(-np.asarray(self.direction)), 0.0]]), math.sin(self.angle / 2)

    def moved(self, step: Points) -> "SunLight":
        return self

    def unshadowed(self, points: Points, normals: Points) -> Points:
        """(M,) irradiance at points (M, 3) with unit normals (M, 3) for an irradiance of 1, with nothing in the way."""
        cosines = -normals @ np.asarray(self.direction)
        if self.is_small:
            return np.maximum(cosines, 0.0)
        return cap(cosines, np.full(len(points), math.sin(self.angle / 2) ** 2))

    def samples(self, points: Points, normals: Points, pattern: Points) -> Samples:
        """Points of the lamp by a pattern (M, K, 2) of `patterns`, seen from the receivers."""
        axes = np.broadcast_to(-np.asarray(self.direction), points.shape)
        directions = axes[:, None]
        if not self.is_small:
            directions = _in_cone(axes, np.full(len(points), math.sin(self.angle / 2) ** 2), pattern)[0]
        weights = np.maximum(np.einsum("mkx,mx->mk", directions, normals), 0.0)
        return Samples(directions, np.full(weights.shape, np.inf), weights, np.ones(weights.shape))


@dataclass(frozen=True)
class AreaLight(Lamp):
    """A flat lamp that shines from one side, that of u x v.

    position   m, of its middle
    u, v       m, from the middle to the middles of two sides of a rectangle, or to two ends of the axes of an ellipse
    radiance   W/(m^2 sr), of each colour or one number
    ellipse    whether it is the ellipse inside of the rectangle
    spread     rad, at most pi: what leaves at half this angle from its normal or more is held back, and the less, the
               nearer to the normal; 0 is not possible
    shadows    whether anything can be in its way
    Raises `Error` naming the field and the value.
    """

    position: Vector
    u: Vector
    v: Vector
    radiance: Vector | float
    ellipse: bool = False
    spread: float = math.pi
    shadows: bool = True

    power: ClassVar[str] = "radiance"

    def __post_init__(self) -> None:
        self._check(position="vector", u="vector", v="vector", radiance="colour", ellipse="flag", spread="half angle",
                    shadows="flag")  # fmt: skip
        if not np.linalg.norm(np.cross(self.u, self.v)) > 0:
            raise Error(f"AreaLight: u {self.u} and v {self.v} span no area")

    @property
    def has_narrow_cone(self) -> bool:
        return self.spread < math.pi

    @property
    def is_round(self) -> bool:
        return self.ellipse and not self.has_narrow_cone

    @property
    def extent(self) -> tuple[Points, float]:
        """Where it is, as `convexity.Planes.nothing_between` takes it."""
        corners = self._place(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]))
        return np.column_stack([corners, np.ones(4)]), 0.0

    @property
    def _normal(self) -> Points:
        normal = np.cross(self.u, self.v)
        return normal / np.linalg.norm(normal)

    def unshadowed(self, points: Points, normals: Points) -> Points:
        """(M,) irradiance at points (M, 3) with unit normals (M, 3) for a radiance of 1, with nothing in the way; that
        of the part in reach of its spread, which `samples` goes over.
        """
        if self.is_round:
            angles = 2 * np.pi * np.arange(ELLIPSE_CORNERS) / ELLIPSE_CORNERS
            size = np.sqrt(2 * np.pi / ELLIPSE_CORNERS / math.sin(2 * np.pi / ELLIPSE_CORNERS))
            at = np.broadcast_to(
                size * np.stack([np.cos(angles), np.sin(angles)], axis=1), (len(points), len(angles), 2)
            )
        else:
            low, high = self._part(points)
            at = np.stack([low, np.stack([high[:, 0], low[:, 1]], axis=1), high,
                           np.stack([low[:, 0], high[:, 1]], axis=1)], axis=1)  # fmt: skip
        lit = (points - np.asarray(self.position)) @ self._normal > 0
        lit &= np.ptp(at, axis=1).min(axis=1) > 0
        return np.where(lit, polygon(points, normals, self._place(at)), 0.0)

    def scale(self, points: Points) -> Points:
        low, high = self._part(points)
        return np.prod(high - low, axis=1)

    def samples(self, points: Points, normals: Points, pattern: Points) -> Samples:
        """Points of the lamp by a pattern (M, K, 2) of `patterns`, seen from the receivers."""
        if self.is_round:
            radius, angle = np.sqrt(pattern[..., 0]), pattern[..., 1]
            at = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=2)
        else:
            low, high = self._part(points)
            at = low[:, None] + pattern * (high - low)[:, None]
        to = self._place(at) - points[:, None]
        distances = np.maximum(np.linalg.norm(to, axis=2), 1e-30)
        directions = to / distances[..., None]
        leaving = np.maximum(-directions @ self._normal, 0.0)
        weights = np.maximum(np.einsum("mkx,mx->mk", directions, normals), 0.0) * leaving / distances**2
        cones = np.ones(weights.shape)
        if self.has_narrow_cone:
            if self.ellipse:
                cones *= (at**2).sum(axis=2) <= 1
            widest, tangents = math.tan(self.spread / 2), np.sqrt(1 - leaving**2) / np.maximum(leaving, 1e-30)
            cones = cones * np.maximum(widest - tangents, 0.0) / (widest - self.spread / 2)
        return Samples(directions, distances, weights, cones)

    def _part(self, points: Points) -> tuple[Points, Points]:
        """The least and the greatest u and v (M, 2), from -1 to 1, of the part of it that reaches each point."""
        low, high = np.full((len(points), 2), -1.0), np.full((len(points), 2), 1.0)
        if not self.has_narrow_cone:
            return low, high
        to = points - np.asarray(self.position)
        height = to @ self._normal
        foot = to - height[:, None] * self._normal
        across = np.stack([self.u, self.v])
        middle = foot @ np.linalg.pinv(across)
        # In skewed coordinates a circle reaches as far as the dual of the axes says.
        reach = np.linalg.norm(np.linalg.pinv(across), axis=0) * math.tan(self.spread / 2)
        around = np.maximum(height, 0.0)[:, None] * reach
        return np.clip(middle - around, -1, 1), np.clip(middle + around, -1, 1)

    def _place(self, at: Points) -> Points:
        return np.asarray(self.position) + at @ np.stack([self.u, self.v])


Light = PointLight | SpotLight | SunLight | AreaLight


def checked_lights(lights: Sequence[Light]) -> tuple[Light, ...]:
    """The lights of a scene; raises `Error` where one is something else."""
    try:
        lights = tuple(lights)
    except TypeError:
        raise Error(f"lights: expected a sequence of lights, got {type(lights).__name__}") from None
    for row, light in enumerate(lights):
        if not isinstance(light, Light):
            raise Error(f"lights: number {row} is no light but {type(light).__name__}")
    return lights


def _in_cone(axes: Points, sine_squared: Points, pattern: Points) -> tuple[Points, Points]:
    """Directions (M, K, 3) evenly over a cone about unit axes (M, 3), and their cosines with it (M, K)."""
    # 1 - cos of the half angle, without taking the difference of two nearly equal numbers.
    depth = sine_squared / (1 + np.sqrt(1 - sine_squared))
    cosines = 1 - depth[:, None] * pattern[..., 0]
    return patterns.around(axes, cosines, pattern[..., 1]), cosines
