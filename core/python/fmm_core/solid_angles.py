# SPDX-License-Identifier: GPL-3.0-or-later
"""Irradiance from shapes of even radiance, in closed form, cut off at the receiver's horizon."""

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]


def cap(cosines: Points, sine_squared: Points) -> Points:
    """(M,) irradiance from a round cap of directions, as a share of what it is when it faces the receiver.

    cosines (M,) between the receiver's normal and the middle of the cap, which is sine_squared (M,) wide: the square of
    the sine of its half angle, above 0. For a narrow cap that is the cosine itself, where it is positive.
    Lagarde and de Rousiers, "Moving Frostbite to Physically Based Rendering" (2014), section 4.7.
    """
    sines = np.sqrt(np.maximum(1 - cosines**2, 1e-30))
    cotangent = np.sqrt(np.maximum(1 / sine_squared - 1, 0.0))
    y = np.clip(-cotangent * cosines / sines, -1.0, 1.0)
    along = sines * np.sqrt(1 - y**2)
    cut = (cosines * np.arccos(y) - cotangent * along) + np.arctan2(along, cotangent) / sine_squared
    whole = cosines**2 > sine_squared
    return np.where(whole, np.maximum(cosines, 0.0), np.maximum(cut / np.pi, 0.0))


def polygon(points: Points, normals: Points, corners: Points) -> Points:
    """(M,) irradiance at points (M, 3) with unit normals (M, 3) from convex polygons (M, K, 3) of radiance 1.

    Only the sides count from which the corners run counter-clockwise (Lambert's contour sum).
    """
    to = corners - points[:, None]
    height = np.einsum("mkx,mx->mk", to, normals)
    total, up, down = np.zeros(len(points)), np.zeros_like(points), np.zeros_like(points)
    for k in range(to.shape[1]):
        a, b = to[:, k - 1], to[:, k]
        above, before = height[:, k], height[:, k - 1]
        crosses = (above > 0) != (before > 0)
        share = np.where(crosses, before / np.where(crosses, before - above, 1.0), 0.0)[:, None]
        middle = a + share * (b - a)
        start = np.where((before > 0)[:, None], a, middle)
        end = np.where((above > 0)[:, None], b, middle)
        lies_above = (above > 0) | (before > 0)
        total += np.where(lies_above, _edge(start, end, normals), 0.0)
        up += np.where((crosses & (above > 0))[:, None], middle, 0.0)
        down += np.where((crosses & (before > 0))[:, None], middle, 0.0)
    # What the horizon cuts off is closed by an edge along it.
    total += np.where(up.any(axis=1) & down.any(axis=1), _edge(down, up, normals), 0.0)
    # Seen from behind the sum is negative.
    return np.maximum(-total / 2, 0.0)


def _edge(a: Points, b: Points, normals: Points) -> Points:
    """(M,) the angle between two vectors (M, 3), times the cosine of what stands upright on both."""
    across = np.cross(a, b)
    sine = np.linalg.norm(across, axis=1)
    angle = np.arctan2(sine, (a * b).sum(axis=1))
    return angle * (across * normals).sum(axis=1) / np.maximum(sine, 1e-300)
