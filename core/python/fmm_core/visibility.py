# SPDX-License-Identifier: GPL-3.0-or-later
"""Occlusion by embreex: the only module that traces rays."""

import ctypes
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from copy import copy
from importlib.metadata import PackageNotFoundError, version
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .arrays import largest, lengths
from .kept import SHARE_STEPS, KeptVisibility, Replaying
from .opacity import Opacity, SeeThrough
from .particles import SAME_PLACE, Particles
from .patterns import around, disc, shifts
from .progress import Tick, silent
from .scene import Scene
from .threads import run_blocks

# Blender on Linux carries an Embree of its own, to which embreex must not bind.
_flags = sys.getdlopenflags() if hasattr(os, "RTLD_DEEPBIND") else None
if _flags is not None:
    sys.setdlopenflags(_flags | os.RTLD_DEEPBIND)
try:
    import embreex.mesh_construction
    import embreex.rtcore_scene
finally:
    if _flags is not None:
        sys.setdlopenflags(_flags)

#: Distance between a surface and the end of a ray, in half scene sizes: some ten times embree's rounding error.
OFFSET = 2e-6
#: Embree may let a ray slip through the joint of two triangles: one that meets a triangle so near to its edge, in half
#: scene sizes, ten times embree's error, is asked again, as far beyond the edge.
RIM = 5e-7
#: A triangle of less than this share of its longest edge across has no plane in single precision: embree would meet it
#: anywhere, also from its own points, and rays leave it out.
FLAT = 1e-5
#: A ray to a lamp ends so much before it, in half scene sizes: a lamp may lie on a ceiling.
END = 4e-6
#: Length of a ray that leaves the scene, in half scene sizes: the box of the scene is less than 4 across.
OUTSIDE = 4.0
#: Receivers and sources are taken in blocks of about this many pairs: small enough that all cores end together.
BLOCK_PAIRS = 1 << 16
#: Rays that tell whether a point is inside an object.
BURIED_RAYS = 5
#: Rays that are traced together, where there are enough of them for all cores.
BATCH = 150_000
#: However few there are they make so many batches, the same on all machines: what is kept is found by them.
LEAST_BATCHES = 8
#: Triangles that are given to embree together, while nothing else of Python runs.
PIECE = 1 << 12
#: The embreex whose scenes hold the address of embree's own behind the head of a Python object.
KNOWN_EMBREEX = "4.4.0.post1"
#: Cells that rays are shot from in one block.
CELLS_PER_BLOCK = 16


class Met(NamedTuple):
    """What rays meet: particles and triangles (K,), -1 for none; where, and unit normals of the sides (K, 3), or 0."""

    particles: NDArray[np.int64]
    triangles: NDArray[np.int64]
    positions: NDArray[np.float64]
    normals: NDArray[np.float64]


class _Tracer:
    """An embree scene of triangles (T, 3, 3), given to it in pieces; its `run` numbers them as if they were one."""

    def __init__(self, corners: NDArray[np.float32]) -> None:
        self._scene = embreex.rtcore_scene.EmbreeScene()
        starts = range(0, len(corners), PIECE)
        make = embreex.mesh_construction.TriangleMesh
        edges = np.roll(corners, -1, axis=1) - corners
        twice, longest = lengths(np.cross(edges[:, 0], edges[:, 1])), largest(lengths(edges))
        # Embree leaves out what has no place.
        solid = np.where((twice < FLAT * longest**2)[:, None, None], np.float32(np.nan), corners)
        self._meshes = [make(self._scene, solid[start : start + PIECE]) for start in starts]
        _commit(self._scene)
        self._corners = corners
        # `RIM` as a share of the least altitude.
        self._rims = RIM * longest / np.maximum(twice, np.float32(1e-30))

    def run(
        self,
        origins: NDArray[np.float32],
        directions: NDArray[np.float32],
        dists: NDArray[np.float32] | None = None,
        query: str = "INTERSECT",
        output: bool = False,
    ) -> Any:
        """As that of embreex, for "OCCLUDED" and "INTERSECT"; the latter asks again at rims."""
        if query == "OCCLUDED":
            return self._scene.run(origins, directions, dists=dists, query=query)
        met = self._met(origins, directions, dists)
        u, v = met["u"], met["v"]
        rays = np.flatnonzero(np.minimum(np.minimum(u, v), 1 - u - v) < self._rims[met["primID"]])
        rays = rays[met["primID"][rays] >= 0]
        if len(rays):
            aside = self._beside({name: met[name][rays] for name in met}, origins[rays], directions[rays])
            again = self._met(origins[rays], aside, dists if dists is None else dists[rays])
            for name, values in met.items():
                values[rays] = again[name]
        return met if output else met["primID"]

    def _met(
        self, origins: NDArray[np.float32], directions: NDArray[np.float32], dists: NDArray[np.float32] | None
    ) -> dict[str, NDArray]:
        met = self._scene.run(origins, directions, dists=dists, query="INTERSECT", output=True)
        met["primID"] = np.where(met["primID"] < 0, -1, met["primID"] + PIECE * met["geomID"])
        return {name: met[name] for name in ("primID", "u", "v", "tfar")}

    def _beside(
        self, met: dict[str, NDArray], origins: NDArray[np.float32], directions: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Directions (R, 3) to places beyond the nearest edges of the triangles that rays met."""
        shares = np.column_stack([1 - met["u"] - met["v"], met["u"], met["v"]])
        rows, opposite = np.arange(len(shares)), shares.argmin(axis=1)
        first, second, third = (self._corners[met["primID"], (opposite + i) % 3] for i in range(3))
        along = third - second
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), np.float32(1e-30))
        across = second - first
        across -= (across * along).sum(axis=1, keepdims=True) * along
        height = np.maximum(np.linalg.norm(across, axis=1, keepdims=True), np.float32(1e-30))
        beyond = shares[rows, opposite][:, None] * height + 2 * RIM
        return directions + beyond / height * across / np.maximum(met["tfar"], RIM)[:, None]


class Occlusion:
    """Shadow rays against the triangles of a scene, in single precision inside a unit box.

    rays    how many have been asked so far, those included whose answers were kept
    kept    answers of earlier solves, and where those of this one go, or None
    whole   whether nothing lets any light through
    shading what stands in the way of lamps and sky, which is asked for by `transmitted`
    size    the longest side of the box around the triangles
    frame   centre, scale and offset of the box that rays are traced in
    """

    def __init__(self, scene: Scene, kept: KeptVisibility | None = None) -> None:
        self._centre = scene.centre
        self.size, self._scale = scene.size, scene.size / 2
        self.frame = tuple(self._centre), self._scale, OFFSET
        self.triangles, self._two_sided = scene.triangles, scene.two_sided
        edges = scene.triangles[:, 1:] - scene.triangles[:, :1]
        self._normals = np.cross(edges[:, 0], edges[:, 1])
        self.rays = 0
        self.shading = scene.shading
        self.whole = scene.opacity is None
        self._scene = self._tracer(scene.triangles, scene.opacity)
        self._unkept = self._scene
        if kept is not None:
            self._scene = kept.around(self._scene)
        # What stands in the way of lamps alone is not kept.
        shaded = scene.shade is not None and len(scene.shade.triangles)
        self._shade = self._tracer(*scene.shade) if shaded else None

    def _tracer(self, triangles: NDArray[np.float64], opacity: Opacity | None) -> _Tracer | SeeThrough:
        tracer = _Tracer(((triangles - self._centre) / self._scale).astype(np.float32))
        # The first call commits the scene, which must not happen in several threads at once.
        one = np.ones((1, 3), np.float32)
        tracer.run(0 * one, one, dists=one[:, 0], query="OCCLUDED")
        return tracer if opacity is None else SeeThrough(tracer, opacity)

    def apart(self) -> "Occlusion":
        """The same triangles, for rays that are counted apart and never kept."""
        other = copy(self)
        other._scene, other.rays = self._unkept, 0
        return other

    @property
    def replayed(self) -> int:
        """Rays whose answers were kept."""
        return self._scene.replayed if isinstance(self._scene, Replaying) else 0

    def _occluded(
        self, origins: NDArray[np.float32], directions: NDArray[np.float32], tracer: Any = None
    ) -> NDArray[np.bool_]:
        if len(origins) == 0:
            return np.zeros(0, dtype=bool)
        reach = np.ones(len(origins), dtype=np.float32)
        return (tracer or self._scene).run(origins, directions, dists=reach, query="OCCLUDED") == 0

    def visible_pairs(
        self,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        sources: _binding.Sources,
        symmetric: bool = False,
        tick: Tick = silent,
    ) -> NDArray[np.uint64]:
        """Bits (M * words,) that say which sources each receiver sees, one ray a facing pair.

        symmetric: the receivers are the sources themselves, so that each pair needs one ray only.
        tick: called with the fraction done.
        """
        words = sources.words
        bits = np.zeros(len(points) * words, dtype=np.uint64)

        def block(rows: slice) -> int:
            after = rows.start if symmetric else None
            receivers = points[rows], normals[rows]
            pairs, origins, directions = _binding.facing_rays(*receivers, sources, after, *self.frame)
            occluded = self._occluded(origins, directions)
            _binding.mark_visible(bits[rows.start * words : rows.stop * words], len(sources), pairs, occluded)
            return len(pairs)

        self.run_blocks(block, len(points), BLOCK_PAIRS // max(1, len(sources)), tick)
        if symmetric:
            _binding.symmetrise(bits, len(sources))
        return bits

    def buried(self, points: NDArray[np.float64], normals: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(M,) whether most rays from a point meet the backs of one-sided triangles: it is inside an object."""
        fronts, met = self.shares_met(points, normals, BURIED_RAYS)
        return met - fronts > 0.5

    def shares_met(
        self, points: NDArray[np.float64], normals: NDArray[np.float64], rays: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(M,) each: of so many rays over the hemisphere of each point, even by cosine, which share meets a front or a
        two-sided triangle, and which share meets anything.
        """
        fronts, met = np.zeros(len(points)), np.zeros(len(points))

        def block(rows: slice) -> int:
            spread = disc(rays, shifts(np.arange(rows.start, rows.stop)))
            directions = around(normals[rows], np.sqrt(1 - spread[..., 0]), spread[..., 1]).reshape(-1, 3)
            origins = np.repeat(self._lifted(points[rows], normals[rows]).astype(np.float32), rays, axis=0)
            triangles = self._scene.run(origins, directions.astype(np.float32), query="INTERSECT")
            behind = (self._normals[triangles] * directions).sum(axis=1) > 0
            hit = triangles >= 0
            met[rows] = hit.reshape(-1, rays).mean(axis=1)
            fronts[rows] = (hit & ~(behind & ~self._two_sided[triangles])).reshape(-1, rays).mean(axis=1)
            return len(origins)

        self.run_blocks(block, len(points), BLOCK_PAIRS // rays)
        return fronts, met

    def surface(self, particles: Particles) -> _binding.Surface:
        """The triangles, with what tells which particle stands for a point on them."""
        bisections = particles.edges, particles.fractions, particles.parts
        sources = particles.rule, particles.hidden
        return _binding.Surface(self.triangles, bisections, *sources, SAME_PLACE * self.size)

    def occlude(
        self,
        fmm: _binding.Fmm,
        sources: tuple[NDArray[np.float64], ...],
        patches: tuple[NDArray[np.float64], NDArray[np.float64]],
        effort: tuple[float, float, float, float, int],
        boxes: list[NDArray[np.float64]],
    ) -> None:
        """Makes the visible lists of a fast multipole sum among the triangles (section 5 of the paper).

        sources: areas, weights, reach, coarse and radii (N,) as `Occluded` of the core has them; patches (P, 3, 3) of
        the sources, and where these are on each; effort as its `VisibilityOptions`;
        boxes (2, 3) that things may move in later.
        """
        fmm.occlude(list(sources), patches, self.frame, effort, boxes)

    def trace(
        self,
        fmm: _binding.Fmm,
        surface: _binding.Surface,
        points: int,
        rays: int,
        tick: Tick = silent,
    ) -> None:
        """Traces the rays that a sum wants after `occlude`: for so many receivers up to about so many each."""

        def link(leaves: slice) -> int:
            count = 0
            for second in (False, True):
                slots, origins, directions = fmm.link_rays(leaves.start, leaves.stop, second)
                fmm.block(slots, self._occluded(origins, directions))
                count += len(slots)
            return count

        def gather(leaves: slice) -> int:
            points, origins, directions = fmm.gather_rays(leaves.start, leaves.stop)
            fmm.take_hits(surface, (leaves.start, leaves.stop), points, directions, *self._met(origins, directions))
            return len(points)

        for work, leaves, start in ((link, fmm.linked_leaves(), 0.3), (gather, fmm.open_leaves(), 0.6)):
            # A leaf's rays are known once they are made: about half of its points' directions are open.
            size = BATCH * max(1, leaves) // max(1, points * rays // 2)
            size = min(max(1, size), max(1, leaves // LEAST_BATCHES))
            self.rays += run_blocks(work, leaves, size, lambda done, start=start: tick(start + 0.3 * done))

    def trace_moved(self, fmm: _binding.Fmm, surface: _binding.Surface) -> None:
        """Traces those rays of a traced sum that pass where things have moved to, after `move_to`."""

        def link(leaves: slice) -> int:
            slots, origins, directions = fmm.moved_link_rays(leaves.start, leaves.stop)
            fmm.block(slots, self._occluded(origins, directions))
            return len(slots)

        def gather(leaves: slice) -> int:
            *rays, origins, directions = fmm.moved_gather_rays(leaves.start, leaves.stop)
            hits = self._met(origins, directions)
            fmm.take_moved_hits(surface, (leaves.start, leaves.stop), (*rays, directions), *hits)
            return len(origins)

        for work, leaves in ((link, fmm.linked_leaves()), (gather, fmm.open_leaves())):
            self.run_blocks(work, leaves, leaves // LEAST_BATCHES)

    def _met(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> tuple[NDArray, NDArray, NDArray]:
        """What rays meet: triangles, -1 for none, and where on them, u and v."""
        if len(origins) == 0:
            return np.zeros(0, np.int32), np.zeros(0, np.float32), np.zeros(0, np.float32)
        met = self._scene.run(origins, directions, query="INTERSECT", output=True)
        return met["primID"], met["u"], met["v"]

    def find_cells(self, fmm: _binding.Fmm, tick: Tick = silent) -> None:
        """Turns the lists of a fast multipole sum into visible ones by pairs of cells, as in section 5 of the paper."""

        def shoot_and_detect(cells: slice) -> int:
            slots, origins, directions = fmm.shoot(cells.start, cells.stop)
            fmm.detect(slots, self._occluded(origins, directions))
            return len(slots)

        count = fmm.find_cells(self.frame)
        self.rays += run_blocks(shoot_and_detect, count, CELLS_PER_BLOCK, lambda done: tick(0.2 + 0.6 * done))
        fmm.generate()

    def visible_targets(
        self,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        targets: NDArray[np.float64],
        target_normals: NDArray[np.float64],
    ) -> NDArray[np.bool_]:
        """(K,) whether each point sees its target; all four (K, 3), both ends lifted off along their normals."""
        seen = np.empty(len(points), dtype=bool)

        def block(rows: slice) -> int:
            seen[rows] = self.sees(points[rows], normals[rows], targets[rows], target_normals[rows])
            return rows.stop - rows.start

        self.run_blocks(block, len(points), BLOCK_PAIRS)
        return seen

    def sees(
        self,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        targets: NDArray[np.float64],
        target_normals: NDArray[np.float64],
    ) -> NDArray[np.bool_]:
        """The same for a few, to be called by what `run_blocks` runs."""
        return self.clear(*_binding.rays_between((points, normals), (targets, target_normals), self.frame))

    def clear(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> NDArray[np.bool_]:
        """(R,) whether rays (R, 3) in the `frame` meet nothing on their way, to be called by what `run_blocks` runs."""
        return ~self._occluded(origins, directions)

    def transmitted(
        self,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        directions: NDArray[np.float64],
        distances: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """(R,) the share of light that gets from so far away (R,), or from outside of the scene, to points (R, 3) with
        unit normals (R, 3), along unit directions (R, 3); to be called by what `run_blocks` runs.
        """
        origins = self._lifted(points, normals).astype(np.float32)
        # All ends beyond the scene are as good, and single precision does not reach far.
        reach = np.clip(distances / self._scale - END, 0.0, OUTSIDE)
        # The lift of the start must not lift the end, which may lie on a surface: rays along it would end behind.
        ends = (points - self._centre) / self._scale + directions * reach[:, None]
        directions = (ends - origins).astype(np.float32)
        tracer = self._shade or self._scene
        if len(self.shading.triangles) == 0:
            return np.ones(len(origins))
        if self.shading.opacity is None or len(origins) == 0:
            return 1.0 - self._occluded(origins, directions, tracer)
        whole = np.ones(len(origins), np.float32)
        return _on_grid(tracer.run(origins, directions, dists=whole, query="TRANSMITTED")).astype(np.float64)

    def met(
        self,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        directions: NDArray[np.float64],
        surface: _binding.Surface,
    ) -> Met:
        """What rays from points (K, 3) meet along directions (K, 3), to be called by what `run_blocks` runs."""
        flat = directions.astype(np.float32)
        triangles, u, v = self._met(self._lifted(points, normals).astype(np.float32), flat)
        particles, positions, sides = surface.met(triangles, u, v, flat)
        return Met(particles, triangles, positions, sides)

    def run_blocks(self, work: Callable[[slice], int], count: int, size: int, tick: Tick = silent) -> None:
        """Runs `work` on slices of so many rows, several at once; it returns how many rays it asked."""
        self.rays += run_blocks(work, count, max(1, size), tick)

    def _lifted(self, points: NDArray[np.float64], normals: NDArray[np.float64]) -> NDArray[np.float64]:
        return (points - self._centre) / self._scale + OFFSET * normals


def _on_grid(shares: NDArray[np.float32]) -> NDArray[np.float32]:
    """How much light, as far as it matters: so it takes half as much to keep."""
    return np.round(np.clip(shares, 0, 1) * np.float32(SHARE_STEPS)) / np.float32(SHARE_STEPS)


def _commit(scene: embreex.rtcore_scene.EmbreeScene) -> None:
    """Builds an embree scene while other threads run: embreex keeps the interpreter for it, but has nothing left to do
    for a scene that is built. Does nothing where that is not known to work.
    """
    with suppress(PackageNotFoundError, OSError, AttributeError):
        if version("embreex") == KNOWN_EMBREEX:
            commit = ctypes.CDLL(embreex.rtcore_scene.__file__).rtcCommitScene
            commit(ctypes.c_void_p.from_address(id(scene) + object.__basicsize__))
