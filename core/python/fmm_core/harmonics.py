# SPDX-License-Identifier: GPL-3.0-or-later
"""Light by its direction in four spherical harmonics, for surfaces whose normals a texture tilts.

Real harmonics up to l = 1, in the order 1, y, z, x, of the incident radiance in W/(m^2 sr). As Ramamoorthi and Hanrahan
have it (An Efficient Representation for Irradiance Environment Maps, SIGGRAPH 2001), irradiance on a normal n is

    E(n) = pi Y0 L0 + 2 pi / 3 Y1 (n_y L1 + n_z L2 + n_x L3)        Y0 = 0.282095, Y1 = 0.488603

The coefficients are not those of a plain projection, whose E(n) is a quarter too dark under a small lamp above. They
are the ones whose E is right for the surface's own normal, and closest to the truth for normals tilted from it.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import patterns
from .arrays import numbers
from .errors import Error

Points = NDArray[np.float64]

#: pi Y0, and 2 pi / 3 Y1.
CONSTANT, LINEAR = math.pi * math.sqrt(1 / (4 * math.pi)), 2 * math.pi / 3 * math.sqrt(3 / (4 * math.pi))
#: Axes in the order of the harmonics.
ORDER = [1, 2, 0]
#: Degrees by which the normals are tilted that the coefficients are fitted to, and how many there are around.
TILTS, AROUND = (20.0, 40.0), 64
#: Light is made brighter to match the irradiance by so much at most; what is still missing comes from all sides.
MOST = 2.0


def irradiance_of(harmonics: ArrayLike, normals: ArrayLike) -> Points:
    """(M, 3) W/m^2 that coefficients (M, 4, 3) say for unit normals (M, 3)."""
    harmonics, normals = numbers("harmonics", harmonics), numbers("normals", normals)
    if harmonics.shape[1:] != (4, 3) or normals.shape != (len(harmonics), 3):
        raise Error(f"harmonics: expected (M, 4, 3) and normals (M, 3), got {harmonics.shape} and {normals.shape}")
    return CONSTANT * harmonics[:, 0] + LINEAR * np.einsum("mk,mkc->mc", normals[:, ORDER], harmonics[:, 1:])


def matched(harmonics: Points, normals: Points, irradiance: Points) -> Points:
    """Coefficients (M, 4, 3) changed so that they say an irradiance (M, 3) for unit normals (M, 3)."""
    said = irradiance_of(harmonics, normals)
    factor = np.clip(irradiance / np.where(said > 0, said, np.inf), 0.0, MOST)
    found = harmonics * factor[:, None]
    missing = irradiance - factor * said
    # A bright hemisphere above: half of its irradiance stays when the normal lies in the plane.
    found[:, 0] += missing / 2 / CONSTANT
    found[:, 1:] += normals[:, ORDER, None] * missing[:, None] / 2 / LINEAR
    return found


class Tilted:
    """The response (`incident.py`) whose outputs are the four coefficients for receivers with unit normals (M, 3)."""

    outputs = 4

    def __init__(self, normals: Points) -> None:
        self._normals = normals

    def directions(self, rows: slice, shifts: Points, count: int) -> Points:
        """Even over the hemisphere: what comes from the side tells most of tilted normals."""
        made = patterns.disc(count, shifts)
        return patterns.around(self._normals[rows], 1 - made[..., 0], made[..., 1])

    def density(self, _rows: slice, directions: Points, _count: int) -> Points:
        """One over the hemisphere."""
        return np.full(directions.shape[:2], 1 / (2 * np.pi))

    def total(self, rows: slice, directions: Points, flux: Points) -> Points:
        """The coefficients of light from these directions."""
        cosines = self._cosines(rows, directions)
        along, up = (np.interp(cosines, _COSINES, slope) for slope in _SLOPES)
        # The light as it comes, and what has to be added along the normal; and that of the normal itself.
        weights = np.stack([cosines - along * cosines - up, up], axis=1)
        lone = weights @ flux
        slopes = (directions * along[..., None]).transpose(0, 2, 1) @ flux
        slopes += self._normals[rows, :, None] * lone[:, 1:]
        return np.concatenate([lone[:, :1] / CONSTANT, slopes[:, ORDER] / LINEAR], axis=1)

    def _cosines(self, rows: slice, directions: Points) -> Points:
        return (directions @ self._normals[rows, :, None])[..., 0]


def _slopes() -> Points:
    """(2, K) of light of one W/m^2 from each of `_COSINES`: how fast irradiance grows as the normal leans.

    The least-squares fit of E(n + t) - E(n) = slope . t to the tilted normals all around; by symmetry the slope is a
    multiple of the direction of the light, and another one of the normal.
    """
    tilt, turn = np.meshgrid(np.radians(TILTS), 2 * np.pi * np.arange(AROUND) / AROUND)
    sines, cosines = np.sin(tilt).ravel(), np.cos(tilt).ravel()
    normals = np.stack([sines * np.cos(turn.ravel()), sines * np.sin(turn.ravel()), cosines], axis=1)
    sine = np.sqrt(1 - _COSINES**2)
    light = np.stack([sine, 0 * sine, _COSINES], axis=1)
    more = np.maximum(light @ normals.T, 0.0) - _COSINES[:, None]
    slope = more @ np.linalg.pinv(normals - [0.0, 0.0, 1.0]).T
    along = slope[:, 0] / np.maximum(sine, 1e-9)
    # Straight above, where there is no other direction, the slope is that of a plain cosine.
    along[-1] = 1.0
    return np.stack([along, slope[:, 2] - along * _COSINES])


_COSINES = np.linspace(0.0, 1.0, 257)
_SLOPES = _slopes()
