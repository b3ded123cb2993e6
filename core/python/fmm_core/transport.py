# SPDX-License-Identifier: GPL-3.0-or-later
"""Linear operators from the particles' radiosity to irradiance at fixed receivers."""

from collections.abc import Callable
from copy import copy
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .arrays import ROUNDING
from .balance import (
    ROUNDS,
    SEEN,
    Shares,
    find_shares,
    is_closed,
    received_balance,
    sent_balance,
    source_groups,
)
from .fit import Sight, clear_sight, find_sight
from .particles import Particles
from .progress import Tick, silent
from .scene import Scene
from .visibility import Occlusion

#: A group of triangles is one source from so many of its radii on.
COARSE = 2.0


class Operator:
    """A sum over point sources, corrected where patches are so near that only their exact form factor will do.

    mirrored   where the receivers are the particles themselves: what each source (N, 1) sends for one unit of strength
               to receivers of areas (N, 1), by the sum alone
    """

    def __init__(
        self,
        particles: Particles,
        summation: Callable[[NDArray[np.float64], bool], NDArray[np.float64]],
        correction: _binding.Correction,
        mirrored: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None,
    ) -> None:
        self._particles, self._weights = particles, particles.weights[:, None]
        self._sum, self._correction, self._mirrored = summation, correction, mirrored
        self._received: NDArray[np.float64] | float = 1.0
        self._sent: NDArray[np.float64] | float = 1.0

    def received_balanced(self, closed: bool, lit: NDArray[np.bool_]) -> "Operator":
        """The same, in which no receiver gets more than a hemisphere holds (`balance.py`).

        closed: light cannot leave the scene; lit: (N, 1) which particles others can see.
        """
        self._received = 1.0
        self._received = received_balance(self._clear(lit), closed)
        return self

    def balanced(self, closed: bool, shares: Shares | None, single: bool = True) -> NDArray[np.bool_]:
        """Makes the exchange keep the energy (`balance.py`); returns which particles (N, 1) others can see.

        single: whether sources are balanced too.
        """
        everything = np.ones_like(self._weights)
        lit = self._clear(everything) > SEEN
        self.received_balanced(closed, lit)
        if not single:
            return lit
        rows, groups = self._clear(everything), source_groups(self._particles)
        for _ in range(ROUNDS):
            self._sent = self._sent_balance(rows, shares, groups)
            self.received_balanced(closed, lit)
        # Where receivers and sources cannot both be right yet, some light is lost rather than made.
        self._sent = np.minimum(self._sent, self._sent_balance(rows, shares, groups))
        return lit

    def _sent_balance(
        self, rows: NDArray[np.float64], shares: Shares | None, groups: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Factors (N, 1) for sources as the receivers are balanced now."""
        areas = self._weights * self._received
        columns = self._mirrored(areas) + self._correction.sent(areas[:, 0])[:, None]
        return sent_balance(rows, columns, shares, self._weights, groups)

    def apply(self, radiosity: NDArray) -> NDArray[np.float64]:
        """Irradiance (M, C) at the receivers for the particles' radiosity (N, C) in C channels, 1 or 3, both W/m^2;
        linear, so that a little less than nothing may be left where a correction subtracts what the sum has added.
        """
        return self._apply(radiosity, False)

    def _clear(self, radiosity: NDArray) -> NDArray[np.float64]:
        """The same if nothing were absorbed on the way."""
        return self._apply(radiosity, True)

    def _apply(self, radiosity: NDArray, clear: bool) -> NDArray[np.float64]:
        strengths = self._weights * self._sent * radiosity
        irradiance = self._sum(strengths, clear)
        self._correction.add(strengths, irradiance, clear)
        irradiance *= self._received
        return irradiance


def passing(
    starts: NDArray[np.float64], ends: NDArray[np.float64], boxes: list[NDArray[np.float64]]
) -> NDArray[np.bool_]:
    """(R,) which ways between starts and ends (R, 3) pass through boxes (2, 3)."""
    found, way = np.zeros(len(starts), bool), ends - starts
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for low, high in boxes:
            one, other = (low - starts) / way, (high - starts) / way
            # What does not move along an axis is between two faces all the way, or never.
            always = np.where((low <= starts) & (starts <= high), -np.inf, np.inf)
            enters = np.where(way == 0, always, np.minimum(one, other))
            leaves = np.where(way == 0, -always, np.maximum(one, other))
            found |= np.maximum(enters.max(axis=1), 0.0) <= np.minimum(leaves.min(axis=1), 1.0)
    return found


class Space(Protocol):
    """Makes operators from the particles of one scene to any receivers."""

    sums: "Sums"
    order: NDArray[np.int64] | None

    def exchange(self, tick: Tick = silent) -> Operator:
        """The operator from the particles to themselves."""

    def gather(
        self,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        radiosity: NDArray[np.float64],
        tick: Tick = silent,
        effort: float = 1.0,
    ) -> NDArray[np.float64]:
        """Irradiance (M, C) at any points for the particles' radiosity (N, C), by this share of the rays of the
        settings if rays are drawn at random.
        """


class Near:
    """Patches near points (M, 3) with normals (M, 3), and what these see of them.

    seen        what a sum has of them, as `Fmm.near_seen` of the core tells it, or None
    fractions   of each of their points, 1 where it is seen; asked: those that rays told
    """

    def __init__(
        self,
        field: _binding.NearField,
        ends: tuple[NDArray[np.float64], NDArray[np.float64]],
        particles: Particles,
        fmm: _binding.Fmm | None,
    ) -> None:
        self.field, self._ends, self._particles = field, ends, particles
        self.seen = None if fmm is None else fmm.near_seen(field, particles.per_patch)
        self.fractions = np.ones(particles.per_patch * len(field))
        self.asked = field.form_factors() > 0
        if self.seen is not None:
            counted, known = self.seen
            self.fractions[known] = counted[known]
            self.asked &= ~known

    def ask(self, occlusion: Occlusion, asked: NDArray[np.bool_]) -> None:
        """Finds by rays which are seen, of those that are to be asked."""
        self.fractions[asked] = occlusion.visible_targets(*self.ends(asked))

    def ends(self, asked: NDArray[np.bool_]) -> tuple[NDArray[np.float64], ...]:
        """Both ends (R, 3) of the rays to some, with their normals: points, normals, targets, normals."""
        (points, normals), particles, per_patch = self._ends, self._particles, self._particles.per_patch
        rows = np.repeat(np.arange(len(points)), per_patch * np.diff(self.field.starts()).astype(np.int64))[asked]
        patch_normals = np.repeat(particles.normals[self.field.patches() * per_patch], per_patch, axis=0)[asked]
        return points[rows], normals[rows], self.field.targets()[asked], patch_normals

    def among(self, fmm: _binding.Fmm, occlusion: Occlusion, boxes: list[NDArray[np.float64]]) -> "Near":
        """The same once a sum has things in boxes (2, 3): rays that pass there are traced again."""
        near = copy(self)
        near.seen = fmm.near_seen(self.field, self._particles.per_patch)
        counted, known = near.seen
        near.fractions = np.where(known, counted, self.fractions)
        places = np.flatnonzero(self.asked)
        x, _, y, _ = self.ends(self.asked)
        passes = np.zeros(len(self.asked), bool)
        passes[places[passing(x, y, boxes)]] = True
        near.ask(occlusion, passes)
        return near

    def correction(self, sources: _binding.Sources, visible: NDArray[np.uint64] | None = None) -> _binding.Correction:
        """Exact minus point kernel; `visible` or `seen` tells which points the sum has."""
        return _binding.Correction(self.field, *self._ends, sources, self.fractions, visible, self.seen)


class Sums:
    """What both methods share: the point sources, and exact form factors where a patch is near.

    occlusion   None where every surface in front of the horizon is seen
    room        None where something can be in the way; else whether the scene is a room without openings
    medium      what absorbs light on its way
    """

    def __init__(
        self,
        particles: Particles,
        occlusion: Occlusion | None,
        near_reach: float,
        room: bool | None,
        medium: _binding.Medium,
    ) -> None:
        self.particles, self.occlusion, self.near_reach = particles, occlusion, near_reach
        self._room, self.medium = room, medium
        self._sight: tuple[NDArray[np.float64], Sight] | None = None
        # A group of triangles has no exact form factor: what is so near is found by rays.
        self._reach = (1 + ROUNDING) * near_reach * particles.radii * particles.whole
        self.sources = _binding.Sources(
            particles.positions,
            particles.normals,
            particles.softening,
            particles.areas,
            particles.shares,
            medium,
        )

    @property
    def keeps_energy(self) -> bool:
        """Whether operators may be balanced: not where light goes through what is in its way."""
        return self.occlusion is not None or self._room is not None

    @cached_property
    def closed(self) -> bool:
        """Whether light cannot leave the scene."""
        if self._room is not None:
            return self._room
        return self.shares is not None and is_closed(self.shares)

    @cached_property
    def shares(self) -> Shares | None:
        """What the particles see, by rays; None where nothing can be in the way."""
        return find_shares(self.occlusion, self.particles) if self.occlusion else None

    @cached_property
    def surface(self) -> _binding.Surface | None:
        """What tells which particle stands for a point on a triangle; None where nothing is in the way."""
        return self.occlusion.surface(self.particles) if self.occlusion else None

    def apart(self, scene: Scene) -> tuple[Occlusion, _binding.Surface]:
        """Rays that are counted apart and never kept, also where nothing is in the way, and what they meet."""
        occlusion = Occlusion(scene) if self.occlusion is None else self.occlusion.apart()
        return occlusion, self.surface or occlusion.surface(self.particles)

    @property
    def reach(self) -> NDArray[np.float64]:
        """(N,) distance from a particle beyond which its patch is never near."""
        return self.particles.of_points(self._reach + self.particles.radii)

    @property
    def coarse(self) -> NDArray[np.float64]:
        """(N,) distance within which a particle stands for too much surface to be one source; 0 for a whole patch."""
        return self.particles.of_points(np.where(self.particles.whole, 0.0, COARSE * self.particles.radii))

    @property
    def rays(self) -> int:
        """Rays traced so far."""
        return self.occlusion.rays - self.occlusion.replayed if self.occlusion else 0

    @property
    def replayed(self) -> int:
        """Rays so far whose answers were kept."""
        return self.occlusion.replayed if self.occlusion else 0

    def sight(self, points: NDArray[np.float64], normals: NDArray[np.float64], corners: NDArray[np.float64]) -> Sight:
        """As `find_sight`; those that were asked for last are kept."""
        if self.occlusion is None:
            return clear_sight(len(points))
        if self._sight is None or not np.array_equal(self._sight[0], points):
            self._sight = points, find_sight(self.occlusion, points, normals, corners)
        return self._sight[1]

    def near(
        self,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        fmm: _binding.Fmm | None = None,
        open_space: bool = False,
    ) -> Near:
        """The patches near points (M, 3), as far as a sum leaves them to their exact form factors.

        open_space: nothing can be in the way, so that no ray is needed.
        """
        particles = self.particles
        asked_for = points, normals, particles.patches, self._reach, particles.rule
        field = _binding.NearField(*asked_for) if fmm is None or open_space else fmm.near_field(*asked_for)
        near = Near(field, (points, normals), particles, fmm)
        if self.occlusion is not None and not open_space:
            near.ask(self.occlusion, near.asked)
        return near

    def direct_operator(
        self, points: NDArray[np.float64], normals: NDArray[np.float64], symmetric: bool = False, tick: Tick = silent
    ) -> Operator:
        """The direct sum over all particles; `symmetric` where the receivers are the particles themselves."""
        visible = None
        if self.occlusion is not None:
            visible = self.occlusion.visible_pairs(points, normals, self.sources, symmetric, tick)

        def summation(strengths: NDArray[np.float64], clear: bool) -> NDArray[np.float64]:
            return self.sources.irradiance(points, normals, strengths, visible, clear)

        mirrored = (lambda areas: summation(areas, True)) if symmetric else None
        correction = self.near(points, normals).correction(self.sources, visible)
        return Operator(self.particles, summation, correction, mirrored)
