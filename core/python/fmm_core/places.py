# SPDX-License-Identifier: GPL-3.0-or-later
"""Random places of what patches stand for."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .particles import NO_PATCH, Particles
from .patterns import ROOTS, inside, sequence

Points = NDArray[np.float64]


@dataclass(frozen=True)
class Places:
    """The surface that each patch stands for.

    triangles (P,) its own; patches (P, 3, 3), centres and normals (P, 3) of these; for groups of triangles their
    members in `members` (G,), by areas that add up to `ends` (G,), from `starts` (P,) over `areas` (P,), 0 for others
    """

    triangles: NDArray[np.int64]
    patches: Points
    centres: Points
    normals: Points
    corners: Points
    members: NDArray[np.int64]
    ends: Points
    starts: Points
    areas: Points

    @classmethod
    def of(cls, triangles: Points, particles: Particles) -> "Places":
        uncut = np.flatnonzero(particles.edges[: len(triangles)] < 0)
        patch, member = particles.parts[uncut].astype(np.int64).T.ravel(), np.tile(uncut, 2)
        there = patch != NO_PATCH
        there[there] = ~particles.whole[patch[there]]
        patch, member = patch[there], member[there]
        order = np.argsort(patch, kind="stable")
        patch, member = patch[order], member[order]
        areas = np.bincount(patch, particles.solid[member], len(particles.patches))
        return cls(
            triangles=particles.triangle[:: particles.per_patch],
            patches=particles.patches,
            centres=particles.patches.mean(axis=1),
            normals=np.ascontiguousarray(particles.normals[:: particles.per_patch]),
            corners=triangles,
            members=member,
            ends=np.cumsum(particles.solid[member]),
            starts=np.cumsum(areas) - areas,
            areas=areas,
        )

    def random(
        self, rows: NDArray[np.int64], count: int, rng: np.random.Generator
    ) -> tuple[NDArray[np.int64], Points, Points]:
        """Triangle (K,), place and unit normal (K, 3) of so many random places for each of some patches."""
        triangles, corners, normals, starts, areas = (
            np.repeat(values[rows], count, axis=0)
            for values in (self.triangles, self.patches, self.normals, self.starts, self.areas)
        )
        groups = np.flatnonzero(areas)
        if len(groups):
            at = starts[groups] + rng.random(len(groups)) * areas[groups]
            member = self.members[np.minimum(np.searchsorted(self.ends, at), len(self.members) - 1)]
            triangles[groups], corners[groups] = member, self.corners[member]
            a, b, c = corners[groups].transpose(1, 0, 2)
            flat = np.cross(b - a, c - a)
            flat /= np.linalg.norm(flat, axis=1, keepdims=True)
            # Normals of one group lie within a right angle.
            normals[groups] = flat * np.sign((flat * normals[groups]).sum(axis=1, keepdims=True))
        return triangles, inside(corners, sequence(len(corners), rng.random(2), ROOTS)), normals
