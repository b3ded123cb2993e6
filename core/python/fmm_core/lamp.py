# SPDX-License-Identifier: GPL-3.0-or-later
"""What all kinds of lamps have in common, and how their fields are checked."""

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from .arrays import LARGEST, numbers
from .errors import Error

Points = NDArray[np.float64]
Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]


@dataclass(frozen=True)
class Samples:
    """Directions (M, K, 3), unit, from M receivers to K points of a lamp, `distances` (M, K) away.

    weights (M, K) what each would bring without any cone; cones (M, K) the share of it that the lamp's cone lets out
    """

    directions: Points
    distances: Points
    weights: Points
    cones: Points


class Lamp:
    """What all lamps have in common."""

    #: The field that relighting may change without a ray.
    power: ClassVar[str]

    @property
    def colour(self) -> Points:
        """(3,) the field that is called `power`."""
        return np.array(getattr(self, self.power))

    @property
    def is_far(self) -> bool:
        """Whether its light comes from infinitely far away."""
        return False

    def with_colour(self, colour: Points) -> "Lamp":
        """The same lamp with other power (3,)."""
        return replace(self, **{self.power: tuple(colour)})

    @property
    def geometry(self) -> tuple[Any, ...]:
        """Everything but the power: what rays find is the same for lamps of the same geometry."""
        return type(self), replace(self, **{self.power: 0.0})

    @property
    def is_small(self) -> bool:
        """Whether it is a single point, seen or not seen."""
        return False

    @property
    def has_narrow_cone(self) -> bool:
        """Whether receivers get light from small parts of it."""
        return False

    @property
    def is_round(self) -> bool:
        """Whether `samples` takes a pattern of a disc, or else of a square."""
        return True

    @property
    def without_cone(self) -> "Lamp":
        """The same lamp where nothing but the way it looks keeps light back, if it has a cone."""
        return self

    def scale(self, points: Points) -> Points:
        """(M,) what the weights of `samples` are to be multiplied by, to compare those of different receivers."""
        return np.ones(len(points))

    def moved(self, step: Points) -> "Lamp":
        """The same lamp elsewhere."""
        return replace(self, position=np.asarray(self.position) + step)

    def _check(self, **kinds: str) -> None:
        for name, kind in kinds.items():
            object.__setattr__(self, name, _CHECKS[kind](f"{type(self).__name__}.{name}", getattr(self, name)))


def _vector(name: str, value: Any) -> Vector:
    found = numbers(name, value)
    if found.shape != (3,):
        raise Error(f"{name}: expected three numbers, got shape {found.shape}")
    if not (np.abs(found) <= LARGEST).all():
        raise Error(f"{name} is {tuple(found.tolist())}, which is not finite")
    return tuple(found.tolist())


def _direction(name: str, value: Any) -> Vector:
    found = np.array(_vector(name, value))
    if not found.any():
        raise Error(f"{name} is 0, which is no direction")
    found /= np.abs(found).max()
    return tuple((found / np.linalg.norm(found)).tolist())


def _matrix(name: str, value: Any) -> Matrix:
    found = numbers(name, value)
    if found.shape != (3, 3):
        raise Error(f"{name}: expected shape (3, 3), got {found.shape}")
    rows = tuple(_vector(name, row) for row in found)
    if np.linalg.matrix_rank(found) < 3:
        raise Error(f"{name} is {found.tolist()}, which is flat")
    return rows


def _colour(name: str, value: Any) -> Vector:
    found = numbers(name, value)
    found = _vector(name, np.broadcast_to(found, 3) if found.shape == () else found)
    if min(found) < 0:
        raise Error(f"{name} is {min(found):g}, it must not be negative")
    return found


def _number(name: str, value: Any, low: float, high: float) -> float:
    found = numbers(name, value)
    if found.shape != ():
        raise Error(f"{name}: expected a number, got shape {found.shape}")
    if not low <= found <= high:
        raise Error(f"{name}: expected a number from {low:g} to {high:g}, got {found:g}")
    return float(found)


def _flag(name: str, value: Any) -> bool:
    if value not in (False, True):
        raise Error(f"{name}: expected True or False, got {value!r}")
    return bool(value)


_CHECKS = {
    "vector": _vector,
    "direction": _direction,
    "colour": _colour,
    "matrix": _matrix,
    "length": lambda name, value: _number(name, value, 0.0, LARGEST),
    "whole angle": lambda name, value: _number(name, value, 0.0, math.pi),
    "half angle": lambda name, value: _number(name, value, 1e-3, math.pi),
    "share": lambda name, value: _number(name, value, 0.0, 1.0),
    "flag": _flag,
}
