# SPDX-License-Identifier: GPL-3.0-or-later
"""Things that move among others from frame to frame, and what is kept of the others' sums.

What stays has octrees, lists and rays of its own, and of its rays only those are traced again that pass where something
has moved to. What moves gets all of them anew in each frame. It sends its light by the rays over hemispheres that meet
it, so that no list of what stays has to know it.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .arrays import bounds
from .cutting import joined
from .multipole import Boxes, MultipoleSpace, Points, least_rays, particle_rays
from .particles import Particles, make_particles, strong_emitters, triangle_areas
from .progress import Tick, silent
from .scene import Scene
from .settings import Settings
from .spots import cut_by_spots
from .transport import Operator, Sums
from .visibility import Occlusion

if TYPE_CHECKING:
    from .solution import Solution

#: The share of the surface of a scene that may move or be touched by what does: where more is, all is made anew.
MOST = 0.3
#: What moves is expected to go on as it does for so many frames.
AHEAD = 8
#: Boxes that things may move in are larger than their way by this share of the scene, those that they are in by less.
MARGIN, CLOSE = 1e-3, 1e-5
#: What moves is put into so many boxes at most.
MOST_BOXES = 16
#: What is the same in all frames, besides.
SAME = ("triangle_indices", "albedo", "emission", "two_sided")


class Now(NamedTuple):
    """Where the things are that move, in one frame.

    frame   tells frames apart
    sums    those of all particles
    guests  (G,) weights of the particles of guests
    boxes   what these are in
    """

    frame: object
    sums: Sums
    guests: NDArray[np.float64]
    boxes: Boxes


class Kept:
    """A sum at points (M, 3) that stay over particles that stay, with things that move among them.

    fmm   the sum, as things were when it was asked last
    """

    def __init__(self, space: MultipoleSpace, receivers: tuple[Points, Points] | None, rays: float, tick: Tick) -> None:
        """receivers: points and normals (M, 3), or None for the particles themselves."""
        particles = space.sums.particles
        self.points, self.normals = receivers or (particles.positions, particles.normals)
        self.rays, self._sources = rays, space.sums.sources
        self.fmm, self._near = space.traced(receivers, self.points, self.normals, rays, tick)
        self._frame: object = None

    def among(self, now: Now) -> _binding.Correction:
        """Lets things move to where they are; returns what corrects the sum near particles that stay."""
        self._move(now)
        return self._near.among(self.fmm, now.sums.occlusion, now.boxes).correction(self._sources)

    def apply(self, strengths: Points, clear: bool, now: Now) -> Points:
        """Irradiance (M, C) with things where they are now, also after they were elsewhere."""
        return self._fmm(now).apply(strengths, clear)[0]

    def sent(self, areas: Points, now: Now) -> Points:
        """(N, 1) what each particle, guests last, sends for one unit of strength to points of areas (M, 1)."""
        return self._fmm(now).sent(areas[:, 0])[:, None]

    def _fmm(self, now: Now) -> _binding.Fmm:
        if self._frame is not now.frame:
            self._move(now)
        return self.fmm

    def _move(self, now: Now) -> None:
        self._frame = None
        self.fmm.move_to(list(now.boxes), now.guests)
        now.sums.occlusion.trace_moved(self.fmm, now.sums.surface)
        self._frame = now.frame


class Still:
    """What stays of a scene.

    moves       (T,) which triangles of the scene may move
    guests      (T,) these, and others that they touch, which are cut along the lines where they do
    boxes       what the former may move in
    order       (T,) the triangles of a frame, those that are no guests first
    particles   of these
    """

    def __init__(
        self,
        scene: Scene,
        moves: NDArray[np.bool_],
        guests: NDArray[np.bool_],
        boxes: Boxes,
        settings: Settings,
        last: MultipoleSpace,
    ) -> None:
        """last: the space of the frame before."""
        self.moves, self.guests, self.boxes, self._settings = moves, guests, boxes, settings
        self._near_reach, self._medium = last.sums.near_reach, last.sums.medium
        self._degree = settings.quadrature or (1 if last.sums.particles.per_patch == 1 else 2)
        self._area = triangle_areas(scene.triangles).sum()
        self.order = np.concatenate([np.flatnonzero(~guests), np.flatnonzero(guests)])
        self._scene, self._asked = scene.only(~guests), last.asked
        touched = ((guests & ~moves & _reached(scene, [box])) for box in boxes)
        self._beside = [np.array(bounds(scene.triangles[rows])) for rows in touched if rows.any()]
        occlusion = Occlusion(self._scene)
        self.particles = self._made(self._scene, occlusion)
        self._space = MultipoleSpace(self._sums(self.particles, occlusion), settings, [*boxes, *self._beside])
        self._exchange: Kept | None = None
        self._gather: tuple[NDArray[np.bool_], Kept] | None = None

    def _made(self, scene: Scene, occlusion: Occlusion) -> Particles:
        """The particles of a part of the scene, which gets its share of all."""
        count = self._settings.particles * triangle_areas(scene.triangles).sum() / self._area
        particles = make_particles(scene, max(1, round(count)), self._degree, occlusion.buried)
        return cut_by_spots(scene, particles, occlusion, self._settings.rays)[0]

    def _sums(self, particles: Particles, occlusion: Occlusion) -> Sums:
        return Sums(particles, occlusion, self._near_reach, None, self._medium)

    def frame(self, scene: Scene) -> tuple[Scene, "MovedSpace"]:
        """A frame of the scene, in `order`, and what makes its sums."""
        whole = scene.only(self.order)
        # Rays are traced in one box in all frames.
        whole.centre, whole.size = self._scene.centre, self._scene.size
        occlusion, close = Occlusion(whole), CLOSE * scene.size * np.array([[-1.0], [1.0]])
        boxes = [box + close for box in (*boxes_of(scene.triangles, self.moves), *self._beside)]
        particles = joined(self.particles, self._made(scene.only(self.guests), occlusion))
        return whole, MovedSpace(self._sums(particles, occlusion), self._settings, self, boxes)

    def exchange(self, tick: Tick) -> Kept:
        """The sum over what stays at its own particles."""
        if self._exchange is None:
            self._exchange = Kept(self._space, None, particle_rays(self._settings, len(self.particles)), tick)
        return self._exchange

    def gather(self, points: Points, normals: Points, rays: float, tick: Tick) -> tuple[NDArray[np.bool_], Kept] | None:
        """Which points (M,) stay, and the sum there; None where other ones were asked for in the frame before."""
        if self._gather is None or not _at(*self._gather, points, normals, rays):
            last, self._asked = self._asked, (points.copy(), normals.copy())
            if last is None or len(last[0]) != len(points):
                return None
            stays = _same_rows(last[0], points) & _same_rows(last[1], normals)
            if not stays.any():
                return None
            receivers = np.ascontiguousarray(points[stays]), np.ascontiguousarray(normals[stays])
            self._gather = stays, Kept(self._space, receivers, rays, tick)
        return self._gather

    def spent(self) -> int:
        """Rays that were traced among what stays, since this was asked last."""
        occlusion = self._space.sums.occlusion
        rays, occlusion.rays = occlusion.rays, 0
        return rays


def _at(stays: NDArray[np.bool_], kept: Kept, points: Points, normals: Points, rays: float) -> bool:
    """Whether a sum at those points that stay serves all points (M, 3)."""
    if len(stays) != len(points) or kept.rays != rays:
        return False
    return np.array_equal(points[stays], kept.points) and np.array_equal(normals[stays], kept.normals)


class _Corrections:
    """The corrections of receivers that stay, by sources that stay, and of the others by all."""

    def __init__(
        self, still: _binding.Correction, moved: _binding.Correction | None, sources: int, receivers: int
    ) -> None:
        self._still, self._moved = still, moved
        self._sources, self._receivers = sources, receivers

    def add(self, strengths: Points, irradiance: Points, clear: bool) -> None:
        self._still.add(strengths[: self._sources], irradiance[: self._receivers], clear)
        if self._moved is not None:
            self._moved.add(strengths, irradiance[self._receivers :], clear)

    def sent(self, areas: Points) -> Points:
        """(N,) what is added to what sources send to the particles, which have areas (N,)."""
        return np.append(self._still.sent(areas[: self._sources]), np.zeros(len(areas) - self._sources))


class MovedSpace(MultipoleSpace):
    """Sums of a frame; its particles are those that stay, and those of guests after them."""

    def __init__(self, sums: Sums, settings: Settings, still: Still, boxes: Boxes) -> None:
        super().__init__(sums, settings)
        self.still, self.order = still, still.order
        self._now = Now(object(), sums, sums.particles.weights[len(still.particles) :], boxes)

    def exchange(self, tick: Tick = silent) -> Operator:
        kept, particles = self.still.exchange(tick), self.sums.particles
        first = len(self.still.particles)
        moved = particles.positions[first:], particles.normals[first:]
        operator = self._operator(kept, moved, particle_rays(self.settings, len(particles)), tick)
        self.counts, self.pairs = kept.fmm.counts(), kept.fmm.outcomes()
        self.open = False
        self._closed, shares = self._seen()
        self._lit = operator.balanced(self._closed, shares, self._single)
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
        now, first = self._now, len(self.still.particles)
        correction = kept.among(now)
        self.sums.occlusion.rays += self.still.spent()
        # A sum has at least one point.
        fmm, other = self._fmm(moved, *moved, rays, tick) if len(moved[0]) else (None, None)

        def summation(strengths: Points, clear: bool) -> Points:
            found = kept.apply(strengths, clear, now)
            return found if fmm is None else np.concatenate([found, fmm.apply(strengths, clear)[0]])

        corrections = _Corrections(correction, other, first, len(kept.points))

        def mirrored(areas: Points) -> Points:
            # The kernel is the same both ways: what a particle sends to guests it gets from them.
            guests = np.where(np.arange(len(areas))[:, None] < first, 0.0, areas)
            arrived = summation(guests, True)
            corrections.add(guests, arrived, True)
            return arrived + kept.sent(areas[:first], now)

        return Operator(self.sums.particles, summation, corrections, mirrored)


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
    moves = _moving(before, scene)
    if not moves.any() or not _are_few(moves, scene):
        return False
    low, high = bounds(scene.triangles[~moves])
    return all((box[0] >= low).all() and (box[1] <= high).all() for box in boxes_of(scene.triangles, moves))


def next_frame(before: "Solution", scene: Scene) -> tuple[Scene, MovedSpace] | None:
    """A scene that `precedes` says follows a solution, with its triangles in another order, and what makes its sums.

    None where too much is touched by what moves. What was kept for the solution goes on to the frame: it takes rays to
    ask the solution again.
    """
    space, moves = before.space, _moving(before, scene)
    boxes = boxes_of(scene.triangles, moves)
    touched = _touched(scene, moves, boxes)
    if isinstance(space, MovedSpace) and np.array_equal(space.still.moves, moves):
        still = space.still
        on_its_way = all(_is_in(box, around) for box, around in zip(boxes, still.boxes, strict=True))
        if on_its_way and still.guests[touched].all():
            return still.frame(scene)
    swept, limits = [], bounds(scene.triangles[~moves])
    for last, now in zip(boxes_of(_triangles(before), moves), boxes, strict=True):
        then = now + AHEAD * (now - last)
        low, high = np.minimum.reduce([last[0], now[0], then[0]]), np.maximum.reduce([last[1], now[1], then[1]])
        grown = np.array([low - MARGIN * scene.size, high + MARGIN * scene.size])
        swept.append(np.clip(grown, *limits))
    guests = moves | _reached(scene, swept) if len(touched) else moves
    if not _are_few(guests, scene):
        return None
    return Still(scene, moves, guests, swept, before.used, space).frame(scene)


def _are_few(guests: NDArray[np.bool_], scene: Scene) -> bool:
    """Whether rays over hemispheres are enough to find these triangles (T,)."""
    areas = triangle_areas(scene.triangles)
    return areas[guests].sum() <= MOST * areas.sum() and not strong_emitters(scene)[guests].any()


def _touched(scene: Scene, moves: NDArray[np.bool_], boxes: Boxes) -> NDArray[np.int64]:
    """Numbers of the triangles that are touched by those (T,) that move and are in boxes."""
    beside = np.flatnonzero(_reached(scene, boxes) & ~moves)
    if len(beside) == 0:
        return beside
    both = np.concatenate([beside, np.flatnonzero(moves)])
    before, now = (_binding.contacts(np.ascontiguousarray(scene.triangles[rows]))[3] for rows in (beside, both))
    return beside[now[: len(beside)] & ~before]


def _reached(scene: Scene, boxes: Boxes) -> NDArray[np.bool_]:
    """(T,) which triangles reach into boxes."""
    low, high, close = scene.triangles.min(axis=1), scene.triangles.max(axis=1), CLOSE * scene.size
    found = np.zeros(len(low), bool)
    for box in boxes:
        found |= ((low <= box[1] + close) & (high >= box[0] - close)).all(axis=1)
    return found


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
