# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours of vertices that represent the light on the faces between them best, by least squares."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arrays import ROUNDING, numbers
from .errors import Error
from .evaluation import OutputPoints
from .particles import bisect, triangle_areas
from .quadrature import triangle_rule
from .visibility import Occlusion

#: Samples for each triangle, up to so many in all; where there are many triangles each has one.
SAMPLES_EACH, MOST_SAMPLES = 3, 300_000
#: But never fewer than so many in all: large triangles are cut into pieces.
LEAST_SAMPLES = 2000
#: Weight of the differences along a triangle's edges, against that of the errors on the triangle.
SMOOTHNESS = 0.03
#: Weight of a sample inside an object: it decides only where there is no other.
BURIED = 1e-4
#: A vertex may leave the range of the samples around it by this share of the range: beyond, the fit overshoots.
OVERSHOOT = 0.1
#: How far a sample is lifted off its triangle at most where normals are smooth, in lengths of the longest edge.
LIFT = 0.1
#: All samples together have so many times the rays that the output points would have: they are averaged.
FULL_EFFORT = 1.5
#: Conjugate gradients end at this residual, relative to the right-hand side, or after so many steps.
TOLERANCE, MOST_STEPS = 1e-4, 200

#: How far a sample looks towards a corner: at the corner itself it would meet whatever begins there.
LOOK = 0.98

Rows = NDArray[np.float64]


@dataclass(frozen=True)
class Sight:
    """What samples see around them.

    buried (S,) whether a sample is inside an object; joined (S, 3) whether nothing stands between a sample and each
    corner of its triangle: a sample says nothing of a corner behind a wall
    """

    buried: NDArray[np.bool_]
    joined: NDArray[np.bool_]


def clear_sight(count: int) -> Sight:
    """Those of so many samples where nothing is in the way."""
    return Sight(np.zeros(count, bool), np.ones((count, 3), bool))


def find_sight(occlusion: Occlusion, points: Rows, normals: Rows, corners: Rows) -> Sight:
    """Those of points with normals (S, 3) on triangles with corners (S, 3, 3)."""
    buried, joined = occlusion.buried(points, normals), np.empty((len(points), 3), bool)
    for corner in range(3):
        ends = points + LOOK * (corners[:, corner] - points)
        joined[:, corner] = occlusion.visible_targets(points, normals, ends, normals)
    return Sight(buried, joined)


class _Groups:
    """Rows of a table in groups, of which there are `count`; some may be empty."""

    def __init__(self, groups: NDArray[np.int64], rows: NDArray[np.int64], count: int) -> None:
        order = np.argsort(groups, kind="stable")
        groups, self._rows, self._count = groups[order], rows[order], count
        self._starts = np.flatnonzero(np.diff(groups, prepend=-1))
        self._present = groups[self._starts]

    def reduced(self, function: np.ufunc, table: Rows, empty: float) -> Rows:
        """What a function of two makes of the rows (R, 3) of each group, and `empty` where there are none."""
        found = np.full((self._count, 3), empty)
        for column in range(3):
            found[self._present, column] = function.reduceat(table[self._rows, column], self._starts)
        return found


@dataclass(frozen=True)
class _System:
    """What a fit is solved with, the same for any light.

    sight, blocks (3, 3, T) of each triangle's corners, weighted (S, 3) shares of the corners in each sample, diagonal
    (M, 1) of the blocks; known (M,) whether any sample sees an output point; samples around each output point that see
    it, those on each triangle that are not buried, and the triangles of each output point
    """

    sight: Sight
    blocks: Rows
    weighted: Rows
    diagonal: Rows
    known: NDArray[np.bool_]
    around: _Groups
    on: _Groups
    of: _Groups


class VertexFit:
    """Samples on the faces, and the fit of the output points' values to what is found there.

    points, normals (S, 3) where the light is to be found
    corners         (S, 3, 3) the corners of each sample's triangle
    effort          share of the usual rays that a sample needs, because several of them make a colour
    count           of output points, M
    """

    def __init__(
        self,
        output: OutputPoints,
        positions: ArrayLike,
        normals: ArrayLike,
        triangles: ArrayLike,
        seed: int | None = None,
    ) -> None:
        """positions (C, 3) and unit normals (C, 3) of the mesh corners that `output` was made from; triangles (T, 3)
        the corners of each triangle, between which a renderer interpolates; seed: of samples in random places of the
        triangles, as `errors` wants them. Raises `Error` naming the array.
        """
        positions, normals = numbers("positions", positions), numbers("normals", normals)
        triangles = np.asarray(triangles, np.int64).reshape(-1, 3)
        if not len(positions) == len(normals) == len(output.inverse):
            raise Error("VertexFit: positions and normals differ in length from the corners of the output points")
        if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(positions):
            raise Error(f"triangles: expected corners from 0 to {len(positions) - 1}")
        self.count = len(output.points)
        self._owners, self._areas = output.inverse[triangles], triangle_areas(positions[triangles])
        self._triangle, self._shares, self._weights = _samples(positions[triangles], self._areas, seed)
        self.effort = min(1.0, FULL_EFFORT * self.count / max(1, len(self._triangle)))
        rows = triangles[self._triangle]
        self.corners = positions[rows]
        self.points, self.normals = _placed(self.corners, normals[rows], self._shares)
        self._system: _System | None = None

    def values(self, irradiance: Rows, sight: Sight) -> Rows:
        """Values (M, 3) of the output points for what is found at the samples (S, 3), none of them negative."""
        if self._system is None or self._system.sight is not sight:
            self._system = self._seen(sight)
        return self._limited(self._solved(irradiance, self._system), irradiance, self._system)

    def errors(self, values: Rows, irradiance: Rows, sight: Sight) -> NDArray[np.float64]:
        """(M,) how far values (M, 3) of the output points are off around each, W/m^2: the RMS difference between what
        a renderer interpolates and what was found at samples (S, 3), for which those of another seed than that of the
        values are wanted. 0 where no sample sees an output point.
        """
        owners = self._owners[self._triangle]
        squared = ((np.einsum("sc,scx->sx", self._shares, values[owners]) - irradiance) ** 2).sum(axis=1)
        weights = self._weights[:, None] * self._shares * (sight.joined & ~sight.buried[:, None])
        total = self._summed(owners, weights)
        return np.sqrt(self._summed(owners, weights * squared[:, None]) / _nonzero(total))

    def _seen(self, sight: Sight) -> _System:
        buried, joined = sight.buried, sight.joined
        owners = self._owners[self._triangle]
        counts = joined & ~buried[:, None]
        known = np.bincount(owners[counts], minlength=self.count) > 0
        # A corner that no sample sees lies under an object: the light runs on to it as if there were none.
        shares = self._shares * (joined | ~known[owners])
        total = shares.sum(axis=1)
        weights = self._weights * total * np.where(buried, BURIED, 1.0)
        shares /= np.where(total > 0, total, 1.0)[:, None]
        pairs = weights[:, None, None] * shares[:, :, None] * shares[:, None, :]
        count = len(self._owners)
        blocks = np.stack([np.bincount(self._triangle, pair, count) for pair in pairs.reshape(-1, 9).T])
        blocks = blocks.reshape(3, 3, -1) + SMOOTHNESS * self._regular * (3 * np.eye(3) - 1)[..., None]
        seen = np.flatnonzero(counts)
        return _System(
            sight,
            blocks,
            weights[:, None] * shares,
            _nonzero(self._summed(self._owners, np.einsum("iit->ti", blocks)))[:, None],
            known,
            _Groups(owners.ravel()[seen], seen // 3, self.count),
            _Groups(self._triangle[~buried], np.flatnonzero(~buried), count),
            _Groups(self._owners.ravel(), np.arange(3 * count) // 3, self.count),
        )

    def _solved(self, irradiance: Rows, system: _System) -> Rows:
        """Least squares, each sample by the shares of the corners of its triangle in it."""
        owners, weighted = self._owners[self._triangle], system.weighted
        right = np.stack([self._summed(owners, weighted * colour[:, None]) for colour in irradiance.T], axis=1)
        start = right / _nonzero(self._summed(owners, weighted))[:, None]
        # Rows of one corner each: sums along them are several times as fast as products of small matrices.
        corners = np.ascontiguousarray(self._owners.T)

        def of_one(values: NDArray[np.float64]) -> NDArray[np.float64]:
            at = values[corners]
            products = np.stack([(row * at).sum(axis=0) for row in system.blocks])
            return self._summed(corners, products)

        def apply(values: Rows) -> Rows:
            return np.stack([of_one(colour) for colour in values.T], axis=1)

        return _conjugate_gradients(apply, right, system.diagonal, start)

    def _summed(self, owners: NDArray[np.int64], values: Rows) -> Rows:
        return np.bincount(owners.ravel(), values.ravel(), self.count)

    @cached_property
    def _regular(self) -> Rows:
        """(T,) areas for the smoothness, so that triangles without any still tie their corners together."""
        return np.maximum(self._areas, 1e-6 * self._areas.mean())

    def _limited(self, found: Rows, irradiance: Rows, system: _System) -> Rows:
        """Values that do not overshoot: within the range of the samples that see a vertex, or somewhat beyond it,
        and never black where these are not.

        A vertex under an object is not brighter than the darkest triangle around it: under a wall, light of one side
        would show on the other.
        """
        low = system.around.reduced(np.minimum, irradiance, 0.0)
        high = system.around.reduced(np.maximum, irradiance, 0.0)
        slack = OVERSHOOT * (high - low)
        brightest = system.on.reduced(np.maximum, irradiance, np.inf)
        darkest = system.of.reduced(np.minimum, brightest, np.inf)
        high = np.where(system.known[:, None], high + slack, darkest)
        return np.clip(found, np.maximum(low - slack, low / 2), high)


def _samples(triangles: Rows, areas: Rows, seed: int | None) -> tuple[NDArray[np.int64], Rows, Rows]:
    """Triangle (S,), barycentric coordinates (S, 3) and area (S,) of each sample.

    Large triangles are cut into pieces; a piece has the three points of a rule that is exact for squares of linear
    functions, or one in the middle where it is small; with a seed as many random ones.
    """
    rng = None if seed is None else np.random.default_rng(seed)
    count = max(len(triangles), min(SAMPLES_EACH * len(triangles), MOST_SAMPLES), LEAST_SAMPLES)
    each = (1 + ROUNDING) * areas.sum() / count
    pieces, owner, size = np.broadcast_to(np.eye(3), (len(triangles), 3, 3)), np.arange(len(triangles)), areas
    found = []
    while len(pieces):
        large = size > 2 * SAMPLES_EACH * each
        for degree, chosen in ((2, ~large & (size > 2 * each)), (1, ~large & (size <= 2 * each))):
            points, weights = triangle_rule(degree)
            inside = np.broadcast_to(points, (np.count_nonzero(chosen), *points.shape))
            if rng is not None:
                inside = rng.dirichlet(np.ones(3), inside.shape[:2])
            shares = np.einsum("pkc,pcx->pkx", inside, pieces[chosen]).reshape(-1, 3)
            found.append((np.repeat(owner[chosen], len(points)), shares, (size[chosen, None] * weights).ravel()))
        pieces, owner, size = pieces[large], np.tile(owner[large], 2), np.tile(size[large] / 2, 2)
        corners = pieces @ triangles[owner[: len(pieces)]]
        longest = ((np.roll(corners, -1, axis=1) - corners) ** 2).sum(axis=2).astype(np.float32).argmax(axis=1)
        pieces = bisect(pieces, longest, np.full(len(pieces), 0.5))
    triangle, shares, weights = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return triangle, shares, weights


def _placed(corners: Rows, normals: Rows, shares: Rows) -> tuple[Rows, Rows]:
    """Points and unit normals (S, 3) of samples in triangles with corners and normals (S, 3, 3).

    Where normals are smooth a point is lifted to about the curved surface that they speak of, so that its own triangle
    does not cover it (Hanika, "Hacking the shadow terminator", Ray Tracing Gems II, 2021).
    """
    points = np.einsum("sc,scx->sx", shares, corners)
    mean = np.einsum("sc,scx->sx", shares, normals)
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    mean = np.where(length > 1e-6, mean / np.maximum(length, 1e-6), normals[:, 0])
    heights = np.maximum(((corners - points[:, None]) * normals).sum(axis=2), 0.0)
    lift = np.einsum("sc,scx->sx", shares * heights, normals)
    most = LIFT * np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1, keepdims=True)
    return points + lift * np.minimum(1.0, most / _nonzero(np.linalg.norm(lift, axis=1, keepdims=True))), mean


def _conjugate_gradients(apply: Callable[[Rows], Rows], right: Rows, diagonal: Rows, start: Rows) -> Rows:
    """The solution (M, 3) of apply(x) = right for a positive matrix with this diagonal (M, 1), the colours together."""
    values = start
    residual = right - apply(values)
    direction = step = residual / diagonal
    product, wanted = (residual * step).sum(axis=0), TOLERANCE**2 * (right**2 / diagonal).sum(axis=0)
    for _ in range(MOST_STEPS):
        if (product <= wanted).all():
            break
        image = apply(direction)
        length = product / _nonzero((direction * image).sum(axis=0))
        values, residual = values + length * direction, residual - length * image
        step = residual / diagonal
        before, product = product, (residual * step).sum(axis=0)
        direction = step + product / _nonzero(before) * direction
    return values


def _nonzero(values: Rows) -> Rows:
    return np.where(values > 0, values, 1.0)
