# SPDX-License-Identifier: GPL-3.0-or-later
"""What an error is measured against: light found by random rays, noisy, but right on the average."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .direct_light import Receivers
from .emitters import choosable
from .medium import left
from .patterns import GOLDEN, R2, R3, R5, around, sequence, whole_turns_off
from .places import Places
from .scene import Scene
from .transport import Sums
from .visibility import Met

Points = NDArray[np.float64]

#: Rays that are traced together at most; there are as many for each of so many threads.
RAYS_PER_BLOCK, SHARED = 24_576, 2
#: Light varies over patches that are nearer than so many of their radii: a ray that meets one goes on from the very
#: place, up to so many times.
NEAR, PLACES = 2.0, 3
#: So many rays go on from the first places for each that met any or none, but no more than so many from each place.
ON, MOST_ON = 0.5, 8
#: Points times emitters from which on all points choose alike, which takes less memory.
MOST_CHOSEN = 1 << 20


class Reference:
    """Irradiance from given radiosity by rays alone, without boxes, expansions or lists.

    Rays go over the hemisphere evenly by cosine, and to random points of the strong emitters. Both find the light of
    these, and are weighted by the power heuristic (Veach and Guibas, SIGGRAPH 1995): no sample exceeds the emission,
    and the less likely way to find an emitter does not spoil the other.

    rays   traced so far
    """

    def __init__(self, scene: Scene, sums: Sums, lamps: Receivers, direct: Points) -> None:
        """lamps: the particles as lamps shine on them; direct (N, 3): their irradiance from there, and from the sky."""
        self._scene, self._particles, self._lamps = scene, sums.particles, lamps
        self._occlusion, self._surface = sums.apart(scene)
        self._places = Places.of(scene.triangles, sums.particles)
        self._order = _binding.tree_order(self._places.centres, self._places.normals).astype(np.int64)
        self._emitters, self._medium = choosable(scene, sums.particles, direct), sums.medium
        self._near = self._particles.of_points((NEAR * self._particles.radii) ** 2)

    @property
    def rays(self) -> int:
        return self._occlusion.rays

    def irradiance(
        self,
        points: Points,
        normals: Points,
        radiosity: Points,
        missing: Points,
        direct: Points,
        rays: NDArray[np.int64],
        seed: int,
    ) -> tuple[Points, Points]:
        """(2, M, 3) W/m^2 at points with normals (M, 3), by so many rays (M,) of each kind: from the radiosity (N, 3)
        of the particles, and from what that lacks; and the variance (M,) of what single rays tell of the former.
        Another seed: an independent estimate.

        missing   (N, 3) what the radiosity lacks on average over each patch; rays that meet near ones go on to find
        what leaves the very places that they come to
        direct    (N, 3) irradiance of the particles from lamps and sky
        """
        found, unlike = np.empty((2, len(points), 3)), np.empty(len(points))
        both, bounds = np.hstack([radiosity, missing]), _bounds(rays)

        def block(part: slice) -> int:
            rows = slice(bounds[part.start], bounds[part.stop])
            rng, counts = np.random.default_rng([seed, rows.start]), rays[rows]
            owners = np.repeat(np.arange(len(counts)), counts)
            starts, across = points[rows][owners], normals[rows][owners]
            choice, choice_on = self._choice(points[rows], normals[rows]), self._choice(points[rows], None)
            samples = _samples(across, counts, rng.random((len(counts), 5)))
            received, met, passed, traced = self._received(starts, across, samples, both, choice, owners)
            more, rays_on = self._further(starts, met, passed, both, direct, rng, choice_on, owners)
            received[:, 3:] += more
            mean = _means(received, counts)
            found[:, rows] = mean[:, :3], mean[:, 3:]
            squares = _means((received[:, :3] ** 2).sum(axis=1), counts)
            unlike[rows] = squares - (mean[:, :3] ** 2).sum(axis=1)
            return traced + rays_on

        self._occlusion.run_blocks(block, len(bounds) - 1, 1)
        return found, np.maximum(unlike, 0.0)

    def _choice(self, points: Points, normals: Points | None) -> Points:
        """(M, E) or (1, E): how points with normals (M, 3) choose emitters; without, places near the points."""
        if len(self._emitters) * len(points) > MOST_CHOSEN:
            return self._emitters.anywhere()
        return self._emitters.around(points, normals)

    def _further(
        self,
        starts: Points,
        met: Met,
        passed: Points,
        both: Points,
        direct: Points,
        rng: np.random.Generator,
        choice: Points,
        owners: NDArray[np.int64],
    ) -> tuple[Points, int]:
        """By how much more arrives (K, 3) at the starts (K, 3) of rays, from near places that they have met, than both
        say of the particles there, and the number of rays traced; of what leaves a place, passed (K, 3) arrives.
        Emitters are chosen as owners (K,) of the rays do.
        """
        scene, particles = self._scene, self._particles
        more, rows, traced = np.zeros_like(passed), np.arange(len(passed)), 0
        for place in range(PLACES):
            between = met.positions - starts
            hit = np.flatnonzero((met.particles >= 0) & (_dot(between, between) < self._near[met.particles]))
            if len(hit) == 0:
                break
            if place == 0:
                # One ray tells little of what leaves a place, and few places can be asked by several.
                each = min(MOST_ON, max(1, int(ON * len(rows)) // len(hit)))
                hit, passed = np.repeat(hit, each), passed / each
            rows, passed, chosen = rows[hit], passed[hit], met.particles[hit]
            starts, normals = met.positions[hit], met.normals[hit]
            # Of two triangles at one place the one that the particle is on.
            whole = particles.whole[chosen // particles.per_patch]
            triangles = np.where(whole, particles.triangle[chosen], met.triangles[hit])
            known = both[chosen, :3] + both[chosen, 3:]
            # What follows each other comes from one point mostly.
            upwards, turns = sequence(len(hit), rng.random(2), R2).T
            directions = around(normals, np.sqrt(1 - upwards)[:, None], 2 * np.pi * turns[:, None])[:, 0]
            samples = _Samples(directions, sequence(len(hit), rng.random(3), R3))
            received, met, there, rays = self._received(starts, normals, samples, both, choice, owners[rows])
            more_lit, shadows = self._lamps.unlike(scene, chosen, starts, normals, rng, self._occlusion)
            irradiance = received[:, :3] + received[:, 3:] + direct[chosen] + more_lit
            lacking = scene.emission[triangles] + scene.albedo[triangles] * irradiance - known
            np.add.at(more, rows, passed * lacking)
            passed = passed * scene.albedo[triangles] * there
            traced += rays + shadows
        return more, traced

    def residual(self, radiosity: Points, samples: int, seed: int) -> Points:
        """(N, 3) by how much emission + albedo * irradiance exceeds the radiosity (N, 3) on average over what each
        particle stands for, by so many rays of each kind from random places there; of what lamps send, only by how much
        it exceeds what the particles get.
        """
        particles, scene = self._particles, self._scene
        of_patches = np.empty((len(particles.patches), 3))
        bounds = _bounds(np.full(len(of_patches), samples))

        def block(part: slice) -> int:
            rows = self._order[bounds[part.start] : bounds[part.stop]]
            rng, counts = np.random.default_rng([seed, part.start]), np.full(len(rows), samples)
            triangles, points, normals = self._places.random(rows, samples, rng)
            # Neighbours ask in other directions, and tell more together.
            given = _samples(normals, counts, sequence(len(rows), rng.random(5), R5))
            choice = self._choice(self._places.centres[rows], self._places.normals[rows])
            owners = np.repeat(np.arange(len(rows)), samples)
            received, _, _, traced = self._received(points, normals, given, radiosity, choice, owners)
            chosen = particles.per_patch * np.repeat(rows, samples)
            more, shadows = self._lamps.unlike(scene, chosen, points, normals, rng, self._occlusion)
            of_patches[rows] = _means(scene.emission[triangles] + scene.albedo[triangles] * (received + more), counts)
            return traced + shadows

        self._occlusion.run_blocks(block, len(bounds) - 1, 1)
        shares = particles.weights.reshape(-1, particles.per_patch)
        shares = shares / shares.sum(axis=1, keepdims=True)
        of_patches -= (shares[:, :, None] * radiosity.reshape(-1, particles.per_patch, 3)).sum(axis=1)
        return np.repeat(of_patches, particles.per_patch, axis=0)

    def evened(self, values: Points, count: int) -> Points:
        """Means (N, 3), by area, of values (N, 3) of the particles over so many neighbouring patches at a time."""
        particles, number = self._particles, np.empty(len(self._order), np.int64)
        number[self._order] = np.arange(len(number)) // count
        number = particles.of_points(number)
        areas = np.maximum(np.bincount(number, particles.weights), np.finfo(float).tiny)
        weighed = (particles.weights[:, None] * values).T
        return np.stack([np.bincount(number, row) / areas for row in weighed], axis=1)[number]

    def _received(
        self,
        points: Points,
        normals: Points,
        samples: "_Samples",
        radiosity: Points,
        choice: Points,
        rows: NDArray[np.int64],
    ) -> tuple[Points, Met, Points, int]:
        """One sample (K, 3 k) of what each point receives, what its ray meets, what is left (K, 3) of the light from
        there, and the number of rays traced.

        Emitters are chosen as rows (K,) of the choice have it, or all alike where that has one row; radiosity (N, 3 k),
        of which the first three columns have the emission of the scene, and others none.
        """
        met = self._occlusion.met(points, normals, samples.directions, self._surface)
        rows = rows if len(choice) > 1 else np.zeros_like(rows)
        start = points, normals, rows.astype(np.uint32), choice
        received = self._emitters.met(start, (met.particles, met.positions, met.normals), radiosity)
        passed = self._left(points, met.positions)
        if not self._medium.is_clear:
            received *= np.tile(passed, radiosity.shape[1] // 3)

        occlusion = self._occlusion
        asked, origins, directions, light = self._emitters.aim(start, samples.ends, occlusion.frame)
        seen = occlusion.clear(origins, directions)
        asked, light = asked[seen], light[seen]
        _, scale, _ = occlusion.frame
        arrived = light * self._left(points[asked], points[asked] + scale * directions[seen])
        received[asked, :3] += arrived
        return received, met, passed, len(points) + len(seen)

    def _left(self, points: Points, ends: Points) -> Points:
        """(K, 3) shares of light that are left on the way to points from ends (K, 3)."""
        if self._medium.is_clear:
            return np.broadcast_to(1.0, points.shape)
        between = ends - points
        distances = np.maximum(np.linalg.norm(between, axis=1), np.finfo(float).tiny)
        return left(self._medium, points, between / distances[:, None], distances)


def _bounds(rays: NDArray[np.int64]) -> NDArray[np.int64]:
    """Of points with so many rays (M,) each the first ones of blocks of about as many rays, the same on all machines,
    and the end.
    """
    ends, count = np.cumsum(rays), rays.sum()
    blocks = SHARED * math.ceil(count / (SHARED * RAYS_PER_BLOCK))
    inner = np.searchsorted(ends, np.arange(1, blocks) * (count / max(1, blocks)), side="right")
    return np.unique(np.concatenate([[0], inner, [len(rays)]]))


def _means(values: Points, counts: NDArray[np.int64]) -> Points:
    """Of values of rays, so many (M,) of each point after each other, the mean of each point."""
    sums = np.add.reduceat(values, np.cumsum(counts) - counts)
    return (sums.T / counts).T


def _dot(a: Points, b: Points) -> Points:
    """(K,) of rows (K, 3)."""
    return np.einsum("kx,kx->k", a, b)


@dataclass(frozen=True)
class _Samples:
    """Of rays: directions (K, 3) even by cosine, and numbers (K, 3) even in [0, 1) that tell what is aimed at."""

    directions: Points
    ends: Points


def _samples(normals: Points, counts: NDArray[np.int64], turns: Points) -> _Samples:
    """For points with so many rays (M,) each, about the unit normals (K, 3) of these: along Vogel's spiral, and in
    order of what they aim at, shifted by turns (M, 5) in [0, 1).
    """
    number = np.arange(len(normals)) - np.repeat(np.cumsum(counts) - counts, counts)
    turns, steps = np.repeat(turns, counts, axis=0), number[:, None]
    squares, at = ((number + turns[:, k]) / np.repeat(counts, counts) for k in (0, 2))
    angles = 2 * np.pi * (GOLDEN * number + turns[:, 1])
    ends = np.column_stack([at, whole_turns_off(turns[:, 3:] + steps * R2)])
    return _Samples(around(normals, np.sqrt(1 - squares)[:, None], angles[:, None])[:, 0], ends)
