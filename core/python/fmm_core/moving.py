# SPDX-License-Identifier: GPL-3.0-or-later
"""Things that move among others from frame to frame, and what is kept of the others' sums.

What stays has octrees, lists and rays of its own, and of its rays only those are traced again that pass where something
has moved to. What moves gets all of them anew in each frame. It sends its light by the rays over hemispheres that meet
it, so that no list of what stays has to know it.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .arrays import bounds
from .balance import looks_closed
from .multipole import Boxes, MultipoleSpace, Points, least_rays, particle_rays
from .particles import Particles, joined, make_particles, strong_emitters, triangle_areas
from .progress import Tick, silent
from .scene import Scene
from .settings import Settings
from .transport import Operator, Sums
from .visibility import Occlusion

if TYPE_CHECKING:
    from .solution import Solution

#: The share of the surface of a scene that may move: where more do, all is made anew.
MOST = 0.3
#: What moves is expected to go on as it does for so many frames.
AHEAD = 8
#: Boxes that things may move in are larger than their way by this share of the scene, those that they are in by less.
MARGIN, CLOSE = 1e-3, 1e-5
#: What moves is put into so many boxes at most.
MOST_BOXES = 16
#: What is the same in all frames, besides.
SAME = ("triangle_indices", "albedo", "emission", "two_sided")


class Kept:
    """A sum at points (M, 3) that stay over particles that stay, as it is without what moves.

    fmm   the sum, as things were when `among` was called last
    """

    def __init__(self, space: MultipoleSpace, receivers: tuple[Points, Points] | None, rays: float, tick: Tick) -> None:
        """receivers: points and normals (M, 3), or None for the particles themselves."""
        particles = space.sums.particles
        self.points, self.normals = receivers or (particles.positions, particles.normals)
        self.rays, self._sources = rays, space.sums.sources
        self.fmm, self._near = space.traced(receivers, self.points, self.normals, rays, tick)

    def among(self, sums: Sums, guests: NDArray[np.float64], boxes: Boxes) -> _binding.Correction:
        """Lets things move to boxes, which have particles of such weights (G,) and are part of `sums`; returns what
        corrects the sum near particles that stay.
        """
        self.fmm.move_to(list(boxes), guests)
        sums.occlusion.trace_moved(self.fmm, sums.surface)
        return self._near.among(self.fmm, sums.occlusion, boxes).correction(self._sources)


class Still:
    """What stays of a scene.

    moves       (T,) which triangles of the scene may move
    boxes       what they may move in
    order       (T,) the triangles of a frame, those that stay first
    particles   of the triangles that stay
    """

    def __init__(
        self, scene: Scene, moves: NDArray[np.bool_], boxes: Boxes, settings: Settings, last: MultipoleSpace
    ) -> None:
        """last: the space of the frame before."""
        self.moves, self.boxes, self._settings = moves, boxes, settings
        self._near_reach, self._medium = last.sums.near_reach, last.sums.medium
        self._degree = settings.quadrature or (1 if last.sums.particles.per_patch == 1 else 2)
        self._area = triangle_areas(scene.triangles).sum()
        self.order = np.concatenate([np.flatnonzero(~moves), np.flatnonzero(moves)])
        self._scene, self._asked = scene.only(~moves), last.asked
        occlusion = Occlusion(self._scene)
        self.particles = self._made(self._scene, occlusion)
        self._space = MultipoleSpace(self._sums(self.particles, occlusion), settings, boxes)
        self._exchange: Kept | None = None
        self._gather: tuple[NDArray[np.bool_], Kept] | None = None

    def _made(self, scene: Scene, occlusion: Occlusion) -> Particles:
        """The particles of a part of the scene, which gets its share of all."""
        count = self._settings.particles * triangle_areas(scene.triangles).sum() / self._area
        return make_particles(scene, max(1, round(count)), self._degree, occlusion.buried)

    def _sums(self, particles: Particles, occlusion: Occlusion) -> Sums:
        return Sums(particles, occlusion, self._near_reach, None, self._medium)

    def frame(self, scene: Scene) -> tuple[Scene, "MovedSpace"]:
        """A frame of the scene, in `order`, and what makes its sums."""
        whole = scene.only(self.order)
        # Rays are traced in one box in all frames.
        whole.centre, whole.size = self._scene.centre, self._scene.size
        occlusion, close = Occlusion(whole), CLOSE * scene.size * np.array([[-1.0], [1.0]])
        boxes = [box + close for box in boxes_of(scene.triangles, self.moves)]
        particles = joined(self.particles, self._made(scene.only(self.moves), occlusion))
        return whole, MovedSpace(self._sums(particles, occlusion), self._settings, self, boxes)

    def exchange(self, tick: Tick) -> Kept:
        """The sum over what stays at its own particles."""
        if self._exchange is None:
            self._exchange = Kept(self._space, None, particle_rays(self._settings, len(self.particles)), tick)
        return self._exchange

    def gather(self, points: Points, normals: Points, rays: float, tick: Tick) -> tuple[NDArray[np.bool_], Kept] | None:
        """Which points (M,) stay, and the sum there; None where other ones were asked for in the frame before."""
        if self._gather is None:
            if self._asked is None or len(self._asked[0]) != len(points):
                return None
            stays = _same_rows(self._asked[0], points) & _same_rows(self._asked[1], normals)
            if not stays.any():
                return None
            receivers = np.ascontiguousarray(points[stays]), np.ascontiguousarray(normals[stays])
            self._gather = stays, Kept(self._space, receivers, rays, tick)
        stays, kept = self._gather
        same = len(stays) == len(points) and kept.rays == rays
        same = same and np.array_equal(points[stays], kept.points) and np.array_equal(normals[stays], kept.normals)
        return self._gather if same else None


class _Corrections:
    """The corrections of receivers that stay, by sources that stay, and of the others by all."""

    def __init__(self, still: _binding.Correction, moved: _binding.Correction, sources: int, receivers: int) -> None:
        self._still, self._moved = still, moved
        self._sources, self._receivers = sources, receivers

    def add(self, strengths: Points, irradiance: Points, clear: bool) -> None:
        self._still.add(strengths[: self._sources], irradiance[: self._receivers], clear)
        self._moved.add(strengths, irradiance[self._receivers :], clear)


class MovedSpace(MultipoleSpace):
    """Sums of a frame; its particles are those that stay, and those that move after them."""

    def __init__(self, sums: Sums, settings: Settings, still: Still, boxes: Boxes) -> None:
        super().__init__(sums, settings)
        self.still, self.order, self._now = still, still.order, boxes

    def exchange(self, tick: Tick = silent) -> Operator:
        kept, particles = self.still.exchange(tick), self.sums.particles
        first = len(self.still.particles)
        moved = particles.positions[first:], particles.normals[first:]
        operator = self._operator(kept, moved, particle_rays(self.settings, len(particles)), tick)
        self.counts, self.pairs = kept.fmm.counts(), kept.fmm.outcomes()
        self._closed = looks_closed(self.sums.occlusion, particles)
        self._lit = operator.balanced(self._closed, None, single=False)
        return operator

    def gather(
        self, points: Points, normals: Points, radiosity: Points, tick: Tick = silent, effort: float = 1.0
    ) -> Points:
        rays = least_rays(effort * self.settings.rays)
        known = self.still.gather(points, normals, rays, tick) if len(points) else None
        if known is None:
            return super().gather(points, normals, radiosity, tick, effort)
        stays, kept = known
        if not self._has(points, normals, rays):
            moved = np.ascontiguousarray(points[~stays]), np.ascontiguousarray(normals[~stays])
            operator = self._operator(kept, moved, rays, tick)
            operator.received_balanced(self._closed, self._lit)
            self._gathered = points.copy(), normals.copy(), rays, operator
        irradiance = np.empty((len(points), radiosity.shape[1]))
        order = np.concatenate([np.flatnonzero(stays), np.flatnonzero(~stays)])
        irradiance[order] = self._gathered[3].apply(radiosity)
        return irradiance

    def _operator(self, kept: Kept, moved: tuple[Points, Points], rays: float, tick: Tick) -> Operator:
        """At the points of a kept sum, and at points and normals (M, 3) that move after them."""
        particles, first = self.sums.particles, len(self.still.particles)
        correction = kept.among(self.sums, particles.weights[first:], self._now)
        fmm, other = self._fmm(moved, *moved, rays, tick)

        def summation(strengths: Points, clear: bool) -> Points:
            return np.concatenate([kept.fmm.apply(strengths, clear)[0], fmm.apply(strengths, clear)[0]])

        return Operator(particles, summation, _Corrections(correction, other, first, len(kept.points)))


def precedes(before: "Solution", scene: Scene) -> bool:
    """Whether a scene differs from one that was solved by where some things are, and lamps, and little of it moves."""
    space, last = before.space, before.scene
    if not isinstance(space, MultipoleSpace) or space.sums.occlusion is None or before.kept is not None:
        return False
    if before.used.visibility != "rays" or before.used.target_error is not None:
        return False
    if any(one.opacity is not None or one.shade is not None or one.absorbs for one in (last, scene)):
        return False
    if len(last.triangles) != len(scene.triangles) or not np.array_equal(last.origin, scene.origin):
        return False
    now = scene if space.order is None else scene.only(space.order)
    if not all(np.array_equal(getattr(last, name), getattr(now, name)) for name in SAME):
        return False
    moves, areas = _moving(before, scene), triangle_areas(scene.triangles)
    if areas[moves].sum() > MOST * areas.sum() or strong_emitters(scene)[moves].any():
        return False
    low, high = bounds(scene.triangles[~moves])
    return all((box[0] >= low).all() and (box[1] <= high).all() for box in boxes_of(scene.triangles, moves))


def next_frame(before: "Solution", scene: Scene) -> tuple[Scene, MovedSpace]:
    """A scene that `precedes` says follows a solution, with its triangles in another order, and what makes its sums.

    What was kept for the solution goes on to the frame: the solution is not to be asked any more.
    """
    space, moves = before.space, _moving(before, scene)
    boxes = boxes_of(scene.triangles, moves)
    if isinstance(space, MovedSpace) and np.array_equal(space.still.moves, moves):
        still = space.still
        if all(_is_in(box, around) for box, around in zip(boxes, still.boxes, strict=True)):
            return still.frame(scene)
    swept, limits = [], bounds(scene.triangles[~moves])
    for last, now in zip(boxes_of(_triangles(before), moves), boxes, strict=True):
        then = now + AHEAD * (now - last)
        low, high = np.minimum.reduce([last[0], now[0], then[0]]), np.maximum.reduce([last[1], now[1], then[1]])
        grown = np.array([low - MARGIN * scene.size, high + MARGIN * scene.size])
        swept.append(np.clip(grown, *limits))
    return Still(scene, moves, swept, before.used, space).frame(scene)


def boxes_of(triangles: Points, moves: NDArray[np.bool_]) -> list[Points]:
    """Boxes (2, 3) around the triangles (T, 3, 3) that move, one around those that follow one another."""
    rows = np.flatnonzero(moves)
    if len(rows) == 0:
        return []
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    if len(runs) > MOST_BOXES:
        runs = np.array_split(rows, MOST_BOXES)
    return [np.array(bounds(triangles[run])) for run in runs]


def _triangles(solution: "Solution") -> Points:
    """Those of its scene (T, 3, 3), as it was given."""
    order = solution.space.order
    return solution.scene.triangles if order is None else solution.scene.triangles[np.argsort(order)]


def _moving(before: "Solution", scene: Scene) -> NDArray[np.bool_]:
    """(T,) which triangles have moved since, or before that."""
    moved = (_triangles(before) != scene.triangles).any(axis=(1, 2))
    return moved | before.space.still.moves if isinstance(before.space, MovedSpace) else moved


def _is_in(box: Points, around: Points) -> bool:
    return bool((box[0] >= around[0]).all() and (box[1] <= around[1]).all())


def _same_rows(one: Points, other: Points) -> NDArray[np.bool_]:
    return (one == other).all(axis=1)
