# SPDX-License-Identifier: GPL-3.0-or-later
"""Points spread evenly over a disc, a square or a hemisphere, other ones for each receiver."""

import numpy as np
from numpy.typing import NDArray

from . import _binding

Points = NDArray[np.float64]

#: From one point to the next, of a whole turn (Vogel's spiral).
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
#: From one point to the next, of the sides of a square (Roberts' R2 sequence).
R2 = np.array([0.7548776662466927, 0.5698402909980532])
#: The same of the sides of a cube.
R3 = np.array([0.8191725133961645, 0.6710436067037893, 0.5497004779019703])
#: The same of a cube of five dimensions.
R5 = 1.1347241384015194 ** -np.arange(1.0, 6.0)
#: The same of a square, beside what goes on by the golden ratio (Richtmyer's sequence).
ROOTS = np.sqrt([2.0, 3.0]) % 1.0


def shifts(rows: NDArray[np.int64]) -> Points:
    """(M, 2) two numbers in [0, 1) for each receiver, far apart for receivers next to each other."""
    return ((rows[:, None] + 0.5) * R2) % 1.0


def disc(count: int, shift: Points) -> Points:
    """(M, count, 2) along Vogel's spiral in the unit disc: the square of the radius, and the angle in radians."""
    k = np.arange(count)
    squares = (k + shift[:, :1]) / count
    angles = 2 * np.pi * (GOLDEN * k + shift[:, 1:])
    return np.stack(np.broadcast_arrays(squares, angles), axis=2)


def disc_rim(count: int, shift: Points) -> Points:
    """(M, count, 2) like `disc`, next to its rim."""
    angles = 2 * np.pi * (np.arange(count) + shift[:, 1:]) / count
    return np.stack(np.broadcast_arrays(0.98, angles), axis=2)


def square(count: int, shift: Points) -> Points:
    """(M, count, 2) in the unit square, as the spiral is in the disc."""
    k = np.arange(count)
    parts = (k + shift[:, :1]) / count, (GOLDEN * k + shift[:, 1:]) % 1.0
    return np.stack(parts, axis=2)


def square_rim(count: int, shift: Points) -> Points:
    """(M, count, 2) like `square`, next to its rim."""
    along = 4 * (np.arange(count) + shift[:, 1:]) / count
    x = np.clip(np.abs((along + 0.5) % 4 - 2) - 0.5, 0.0, 1.0)
    y = np.clip(np.abs((along + 3.5) % 4 - 2) - 0.5, 0.0, 1.0)
    return 0.01 + 0.98 * np.stack([x, y], axis=2)


def triangles(corners: Points, cuts: int) -> Points:
    """(P, 4**cuts, 3) the centres of the equal pieces of triangles (P, 3, 3) that are cut in four so many times."""
    pieces = corners[:, None]
    for _ in range(cuts):
        middles = (pieces + np.roll(pieces, -1, axis=2)) / 2
        at_corners = [np.stack([pieces[:, :, k], middles[:, :, k], middles[:, :, k - 1]], axis=2) for k in range(3)]
        pieces = np.concatenate([*at_corners, middles], axis=1)
    return pieces.mean(axis=2)


def around(axes: Points, cosines: Points, angles: Points) -> Points:
    """(M, K, 3) unit vectors about unit axes (M, 3), of a cosine with them and an angle about them (M, K)."""
    cosines, angles = (np.ascontiguousarray(values, np.float64) for values in np.broadcast_arrays(cosines, angles))
    found = _binding.around(np.ascontiguousarray(axes), cosines.ravel(), angles.ravel())
    return found.reshape(*cosines.shape, 3)


def inside(corners: Points, numbers: Points) -> Points:
    """(K, 3) the points of triangles (K, 3, 3) for numbers (K, 2) in [0, 1), even where these are."""
    root, other = np.sqrt(numbers[:, :1]), numbers[:, 1:]
    a, b, c = corners.transpose(1, 0, 2)
    return (1 - root) * a + root * ((1 - other) * b + other * c)


def sequence(count: int, start: Points, step: Points) -> Points:
    """(count, D) numbers even in [0, 1), the first of which are at start (D,)."""
    return whole_turns_off(start + np.arange(count)[:, None] * step)


def whole_turns_off(turns: Points) -> Points:
    return turns - np.floor(turns)
