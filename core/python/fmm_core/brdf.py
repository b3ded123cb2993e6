# SPDX-License-Identifier: GPL-3.0-or-later
"""Reflection as a table: an isotropic BRDF over half-angle coordinates (section 1.1 of the paper), GGX or measured.

With h halfway between both directions: theta_h from the normal to h, theta_d from h to either direction, phi_d around h
(Rusinkiewicz, A New Change of Variables for Efficient BRDF Representation, 1998). Both directions change places as
phi_d grows by pi, so that a table over half a turn is reciprocal by itself.
"""

from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from . import patterns
from .errors import Error

Points = NDArray[np.float64]

#: theta_h by the square root of its share of a right angle, theta_d and phi_d in degrees: the grid of the MERL database
#: (Matusik, Pfister, Brand and McMillan, A Data-Driven Reflectance Model, 2003).
SHAPE = (90, 90, 180)
#: What its numbers are to be multiplied with, of each colour.
MERL_SCALE = np.array([1.0, 1.15, 1.66]) / 1500
#: Smaller roughness is too sharp for the grid, and for any mesh.
LEAST_ROUGHNESS = 0.1
#: Cosines below which a microfacet surface is not followed.
GRAZING = 1e-3
#: What counts as nothing, 1/sr.
FLOOR = 1e-12
#: More of it, 1/sr, is no measurement.
MOST = 1e9
#: Steps of theta_h by which directions are chosen, and share of the directions that are even by cosine.
STEPS, BY_COSINE = 720, 0.25
#: Cosines at which the albedo is found, and the directions of each.
ALBEDO_COSINES, ALBEDO_DIRECTIONS = 32, 2048
RIGHT = np.pi / 2


class Brdf:
    """One table; its lobes are added up, each with a weight of its own.

    table   (90, 90, 180, L) float32, 1/sr, of L lobes
    """

    def __init__(self, table: NDArray[np.float32]) -> None:
        self.table = table
        # Highlights fall steeply: between the numbers it is their logarithm that changes evenly.
        self._logarithms = np.log(np.maximum(table, FLOOR)).reshape(-1, table.shape[-1])

    @classmethod
    def ggx(cls, roughness: float, facing: float) -> "Brdf":
        """Microfacets of a roughness, its square being alpha, in three lobes: (1 - s) and s times what perfect ones
        would reflect, and what those of a dielectric do that reflects `facing` of the light from straight ahead.

        GGX by Walter, Marschner, Li and Torrance (2007), masking and shadowing by Smith, correlated by height (Heitz
        2014); s = (1 - cos theta_d)^5 is that of Schlick (1994): F0 and F90 weigh the first two lobes. The third has
        Fresnel's own equations, from which Schlick's is a fifth off at 60 degrees.
        """
        theta_h, theta_d, phi_d = np.meshgrid(*_grid(), indexing="ij", sparse=True)
        alpha2 = max(roughness, LEAST_ROUGHNESS) ** 4
        up, side = np.cos(theta_d) * np.cos(theta_h), np.sin(theta_d) * np.cos(phi_d) * np.sin(theta_h)
        first, second = np.maximum(up - side, GRAZING), np.maximum(up + side, GRAZING)
        facets = alpha2 / (np.pi * (np.cos(theta_h) ** 2 * (alpha2 - 1) + 1) ** 2)
        seen = first * np.sqrt(alpha2 + (1 - alpha2) * second**2)
        seen += second * np.sqrt(alpha2 + (1 - alpha2) * first**2)
        perfect = facets * 0.5 / seen
        cosine = np.cos(theta_d)
        schlick = (1 - cosine) ** 5
        lobes = 1 - schlick, schlick, dielectric(cosine, facing)
        return cls(np.stack([perfect * lobe for lobe in lobes], axis=3).astype(np.float32))

    @classmethod
    def load(cls, path: Path | str) -> "Brdf":
        """A file of the MERL database: three lobes, one for each colour. Raises `Error` naming a file that is none."""
        try:
            with open(path, "rb") as file:
                shape = tuple(np.fromfile(file, "<i4", 3).tolist())
                values = np.fromfile(file, "<f8") if shape == SHAPE else np.zeros(0)
        except OSError as error:
            raise Error(f"'{path}' cannot be read: {error.strerror or error}") from None
        if values.size != 3 * np.prod(SHAPE):
            raise Error(f"'{path}' is no BRDF of the MERL database: expected {SHAPE} numbers of three colours")
        if not np.isfinite(values).all():
            raise Error(f"'{path}' has numbers that are not finite")
        # What could not be measured is negative there.
        table = np.maximum(np.moveaxis(values.reshape(3, *SHAPE), 0, 3) * MERL_SCALE, 0.0)
        if table.max() > MOST:
            raise Error(f"'{path}' reflects {table.max():g} per steradian, expected at most {MOST:g}")
        return cls(table.astype(np.float32))

    @property
    def lobes(self) -> int:
        return self.table.shape[-1]

    def values(self, incoming: Points, outgoing: Points, normals: Points) -> Points:
        """(..., L) 1/sr for unit directions away from a surface with unit normals, all (..., 3)."""
        half, theta_h = _half(incoming, outgoing, normals)
        theta_d, phi_d = _difference(incoming, half, normals)
        at = (
            SHAPE[0] * np.sqrt(theta_h / RIGHT),
            SHAPE[1] * theta_d / RIGHT,
            SHAPE[2] * (phi_d / np.pi % 1.0),
        )
        low = [np.minimum(x.astype(np.int64), count - 1) for x, count in zip(at, SHAPE, strict=True)]
        part = [np.clip(x - k, 0.0, 1.0) for x, k in zip(at, low, strict=True)]
        high = [np.minimum(low[0] + 1, SHAPE[0] - 1), np.minimum(low[1] + 1, SHAPE[1] - 1), (low[2] + 1) % SHAPE[2]]
        found = np.zeros((*theta_h.shape, self.lobes))
        for corner in range(8):
            chosen = [corner >> axis & 1 for axis in range(3)]
            i, j, k = (high[axis] if chosen[axis] else low[axis] for axis in range(3))
            share = np.prod([part[axis] if chosen[axis] else 1 - part[axis] for axis in range(3)], axis=0)
            found += share[..., None] * self._logarithms[(i * SHAPE[1] + j) * SHAPE[2] + k]
        return np.exp(found)

    def directions(self, outgoing: Points, normals: Points, shifts: Points, count: int) -> Points:
        """(M, count, 3) unit directions from which light goes to `outgoing` (M, 3), more where more of it does; some
        are below the horizon of the normals (M, 3).
        """
        even = max(1, round(BY_COSINE * count))
        made = patterns.disc(even, shifts)
        by_cosine = patterns.around(normals, np.sqrt(1 - made[..., 0]), made[..., 1])
        if count == even:
            return by_cosine
        made = patterns.disc(count - even, shifts)
        ends, sums, _ = self._facets
        cell = np.minimum(np.searchsorted(sums, made[..., 0], side="right"), STEPS) - 1
        into = (made[..., 0] - sums[cell]) / np.maximum(sums[cell + 1] - sums[cell], 1e-300)
        half = patterns.around(normals, ends[cell] + into * (ends[cell + 1] - ends[cell]), made[..., 1])
        cosine = np.einsum("mkx,mx->mk", half, outgoing)
        mirrored = 2 * cosine[..., None] * half - outgoing[:, None]
        return np.concatenate([by_cosine, mirrored], axis=1)

    def density(self, incoming: Points, outgoing: Points, normals: Points, count: int) -> Points:
        """(M, K) per steradian, with which `directions` of so many takes one of the directions (M, K, 3)."""
        even = max(1, round(BY_COSINE * count)) / count
        outgoing, normals = outgoing[:, None], normals[:, None]
        half, theta_h = _half(incoming, outgoing, normals)
        cell = np.minimum((STEPS * np.sqrt(theta_h / RIGHT)).astype(np.int64), STEPS - 1)
        facing = np.abs((incoming * half).sum(axis=2))
        by_facets = self._facets[2][cell] / (4 * np.maximum(facing, 1e-9))
        by_cosine = np.maximum((incoming * normals).sum(axis=2), 0.0) / np.pi
        return even * by_cosine + (1 - even) * by_facets + 1e-30

    @cached_property
    def _facets(self) -> tuple[Points, Points, Points]:
        """Cosines of theta_h (STEPS + 1,) between the steps; the shares of all h up to each; and how many a steradian
        (STEPS,): as the table has them where light comes from near by the eye, times the cosine.
        """
        ends = np.cos(RIGHT * (np.arange(STEPS + 1) / STEPS) ** 2)
        near = self.table[:, : SHAPE[1] // 2].mean(axis=(1, 2)).sum(axis=1)
        # Where nothing is reflected any direction will do.
        near = near if near.any() else np.ones_like(near)
        middles = (np.arange(STEPS) + 0.5) / STEPS
        weights = np.interp(SHAPE[0] * middles, np.arange(SHAPE[0]), near) * np.cos(RIGHT * middles**2)
        solid = 2 * np.pi * (ends[:-1] - ends[1:])
        weights /= max((weights * solid).sum(), 1e-300)
        return ends, np.append(0.0, np.cumsum(weights * solid)), weights

    def albedo(self, cosines: Points) -> Points:
        """(M, L) the share of light from all sides that goes to a direction of this cosine with the normal (M,); the
        same is reflected of light from there.
        """
        at, found = self._albedo
        return np.stack([np.interp(cosines, at, lobe) for lobe in found.T], axis=1)

    @property
    def mean_albedo(self) -> Points:
        """(L,) the share of light from all sides that is reflected."""
        at, found = self._albedo
        return 2 * (found * at[:, None])[1:-1].mean(axis=0)

    @cached_property
    def _albedo(self) -> tuple[Points, Points]:
        cosines = (np.arange(ALBEDO_COSINES) + 0.5) / ALBEDO_COSINES
        outgoing = np.stack([np.sqrt(1 - cosines**2), 0 * cosines, cosines], axis=1)
        normals = np.broadcast_to([0.0, 0.0, 1.0], outgoing.shape)
        shifts = patterns.shifts(np.arange(ALBEDO_COSINES))
        incoming = self.directions(outgoing, normals, shifts, ALBEDO_DIRECTIONS)
        density = self.density(incoming, outgoing, normals, ALBEDO_DIRECTIONS)
        weights = np.maximum(incoming[..., 2], 0.0) / density / ALBEDO_DIRECTIONS
        values = self.values(incoming, outgoing[:, None], normals[:, None])
        found = (values * weights[..., None]).sum(axis=1)
        ends = [0.0, *cosines, 1.0]
        return np.array(ends), np.concatenate([found[:1], found, found[-1:]])


def dielectric(cosines: Points, facing: float) -> Points:
    """Share of light that a dielectric reflects (Fresnel), which reflects `facing` of it from straight ahead."""
    ratio = (1 + np.sqrt(facing)) / (1 - np.sqrt(min(facing, 0.99)))
    inside = np.sqrt(ratio**2 - 1 + cosines**2)
    across = (cosines - inside) / (cosines + inside)
    along = (ratio**2 * cosines - inside) / (ratio**2 * cosines + inside)
    return (across**2 + along**2) / 2 if facing > 0 else np.zeros_like(cosines)


def _grid() -> tuple[Points, Points, Points]:
    return (
        RIGHT * (np.arange(SHAPE[0]) / SHAPE[0]) ** 2,
        RIGHT * np.arange(SHAPE[1]) / SHAPE[1],
        np.pi * np.arange(SHAPE[2]) / SHAPE[2],
    )


def _half(incoming: Points, outgoing: Points, normals: Points) -> tuple[Points, Points]:
    """h (..., 3), and its angle with the normals (...)."""
    half = incoming + outgoing
    half = half / np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-12)
    sine = np.linalg.norm(np.cross(half, normals), axis=-1)
    return half, np.minimum(np.arctan2(sine, np.abs((half * normals).sum(axis=-1))), RIGHT)


def _difference(incoming: Points, half: Points, normals: Points) -> tuple[Points, Points]:
    """Angle from h to a direction, and around h from the side that is away from the normal."""
    cosine = (incoming * half).sum(axis=-1)
    away = (normals * half).sum(axis=-1, keepdims=True) * half - normals
    around = np.cross(half, away)
    phi = np.arctan2((incoming * around).sum(axis=-1), (incoming * away).sum(axis=-1))
    return np.arccos(np.clip(cosine, 0.0, 1.0)), phi
