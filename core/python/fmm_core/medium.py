# SPDX-License-Identifier: GPL-3.0-or-later
"""What absorbs light on its way, besides the surfaces."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _binding
from .arrays import LARGEST, numbers
from .closed import signed_volume
from .errors import Error


@dataclass(frozen=True)
class Volume:
    """A closed mesh that absorbs light inside, and is not seen otherwise.

    triangles (T, 3, 3), counter-clockwise from outside; absorption (3,) or a constant, 1/m
    Raises `Error` where a value is not finite, the mesh has no inside, or it would give light.
    """

    triangles: NDArray[np.float64]
    absorption: NDArray[np.float64]

    def __post_init__(self) -> None:
        corners = numbers("volume", self.triangles)
        if corners.ndim != 3 or corners.shape[1:] != (3, 3) or not np.isfinite(corners).all():
            raise Error(f"volume: expected finite triangles of shape (T, 3, 3), got {corners.shape}")
        corners = np.ascontiguousarray(corners)
        if not (size := signed_volume(corners)) > 0:
            raise Error(f"volume: its triangles hold {size:g} m^3, expected a closed mesh seen from outside")
        object.__setattr__(self, "triangles", corners)
        object.__setattr__(self, "absorption", absorption("volume", self.absorption))

    def moved(self, offset: NDArray[np.float64]) -> "Volume":
        """The same elsewhere."""
        return replace(self, triangles=self.triangles + offset)

    def with_absorption(self, value: NDArray[np.float64]) -> "Volume":
        """The same mesh with another absorption."""
        return replace(self, absorption=value)

    def same(self, other: "Volume") -> bool:
        """Whether another one is the same."""
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in ("triangles", "absorption"))


def absorption(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """(3,) 1/m from these or from a constant. Raises `Error` with the name where they are none."""
    found = numbers(name, values)
    if found.shape not in ((), (3,)):
        raise Error(f"{name}: expected an absorption of shape (3,) or a constant, got {found.shape}")
    wrong = ~((found >= 0) & (found <= LARGEST))
    if wrong.any():
        raise Error(f"{name}: it absorbs {found[wrong][0]:g} per metre, expected a number of at least 0")
    found = np.array(np.broadcast_to(found, (3,)))
    found.setflags(write=False)
    return found


def checked_volumes(volumes: Sequence[Volume]) -> tuple[Volume, ...]:
    """Those that absorb anything. Raises `Error` where something else is among them."""
    wrong = next((each for each in volumes if not isinstance(each, Volume)), None)
    if wrong is not None:
        raise Error(f"volumes: expected Volume, got {type(wrong).__name__}")
    return tuple(volume for volume in volumes if volume.absorption.any())


def left(
    medium: _binding.Medium, points: NDArray[np.float64], directions: NDArray[np.float64], distances: ArrayLike
) -> NDArray[np.float64]:
    """(..., 3) shares of light that are left on the way to points (..., 3) from so many metres away (...) along unit
    directions (..., 3); the points may lack axes that the directions have.
    """
    if medium.is_clear:
        return np.broadcast_to(1.0, directions.shape)
    flat = np.ascontiguousarray(directions, np.float64).reshape(-1, 3)
    starts = np.ascontiguousarray(np.broadcast_to(points, directions.shape)).reshape(-1, 3)
    far = np.ascontiguousarray(np.broadcast_to(distances, directions.shape[:-1])).reshape(-1)
    return medium.left(starts, flat, far).reshape(directions.shape)
