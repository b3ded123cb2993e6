# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles that let a share of the light through, and rays that go on behind them."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arrays import numbers
from .errors import Error

#: Surfaces that a ray may meet; at the last one it ends.
MOST_MET = 64
#: Embree gives where a ray meets a triangle in single precision: so far behind it the ray goes on, in half scene sizes.
BEHIND = 5e-7
#: From one ray to the next, for each surface it passes: irrational and unrelated, so that what passes is even.
_STRIDES = np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0])


class Opacity:
    """Share of the light that each of T triangles stops; the rest passes straight through.

    values   (T,) in [0, 1]
    steps    (T,) or None: a triangle with n > 0 has a grid of n * n equal cells in place of its value
    cells    (sum of n * n,) opacity of the cells of those triangles, one triangle after the other. A triangle's edges
             are cut into n parts and lines drawn between them; cells come in rows along its edge from the first to the
             third corner, rows one after the other from there to the second corner.
    mean     (T,) over each triangle

    Raises `Error` naming the row and the value.
    """

    def __init__(self, values: ArrayLike, steps: ArrayLike | None = None, cells: ArrayLike = ()) -> None:
        self.mean, self.cells = _shares("opacity: triangle", values), _shares("opacity: cell", cells).astype(np.float32)
        self.steps = numbers("opacity steps", np.zeros(len(self.mean)) if steps is None else steps).astype(np.int64)
        counts = self.steps**2
        fits = self.mean.ndim == self.cells.ndim == 1 and self.steps.shape == self.mean.shape
        if not fits or (self.steps < 0).any() or counts.sum() != len(self.cells):
            raise Error(
                f"opacity: values {self.mean.shape}, steps {self.steps.shape} for {counts.sum()} cells, and cells "
                f"{self.cells.shape} do not fit"
            )
        self.starts = np.cumsum(counts) - counts
        mapped = np.flatnonzero(self.steps)
        if len(mapped):
            self.mean[mapped] = np.add.reduceat(self.cells.astype(np.float64), self.starts[mapped]) / counts[mapped]

    @property
    def is_whole(self) -> bool:
        """Whether nothing passes anywhere."""
        return bool((self.mean == 1).all())

    def arrays(self) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float32]]:
        """Values, steps and cells, which are all that it is."""
        return self.mean, self.steps, self.cells

    def same(self, other: "Opacity") -> bool:
        """Whether it is equal to another."""
        return all(np.array_equal(a, b) for a, b in zip(self.arrays(), other.arrays(), strict=True))

    def of(self, kept: NDArray[np.bool_]) -> "Opacity":
        """That of the triangles (T,) that are kept."""
        of_cells = np.repeat(kept, self.steps**2)
        return Opacity(self.mean[kept], self.steps[kept], self.cells[of_cells])

    def at(self, triangles: NDArray[np.int32], u: NDArray[np.float32], v: NDArray[np.float32]) -> NDArray[np.float64]:
        """(K,) at places u, v on triangles: shares of their second and third corners."""
        found, steps = self.mean[triangles], self.steps[triangles]
        mapped = np.flatnonzero(steps)
        if len(mapped):
            cell = cell_of(steps[mapped], u[mapped], v[mapped])
            found[mapped] = self.cells[self.starts[triangles[mapped]] + cell]
        return found


def cell_of(steps: NDArray[np.int64], u: NDArray[np.float32], v: NDArray[np.float32]) -> NDArray[np.int64]:
    """(K,) the cell of a grid of steps * steps cells that holds a place u, v on its triangle."""
    x, y = np.clip(u, 0, 1) * steps, np.clip(v, 0, 1) * steps
    row = np.minimum(x.astype(np.int64), steps - 1)
    column = np.minimum(y.astype(np.int64), steps - 1 - row)
    beyond = (x - row + y - column > 1) & (column < steps - 1 - row)
    # Row r has a cell at each of its n - r parts of an edge, and one between each two of them.
    return row * (2 * steps - row) + 2 * column + beyond


def cell_centres(steps: int) -> NDArray[np.float64]:
    """(steps * steps, 2) u and v of the middle of each cell."""
    row = np.repeat(np.arange(steps), 2 * (steps - np.arange(steps)) - 1)
    along = np.arange(steps * steps) - row * (2 * steps - row)
    third = np.where(along % 2, 2 / 3, 1 / 3)
    return np.column_stack([row + third, along // 2 + third]) / steps


class SeeThrough:
    """Stands in for an embree scene: the same `run`, whose rays pass through what is transparent.

    A ray passes where a number of its own in [0, 1) is at least the opacity there. The numbers follow from the ray's
    place among those that are asked together, so that the same questions get the same answers and neighbours differ
    evenly: of n rays in a row about n times the opacity are stopped.
    """

    def __init__(self, tracer: Any, opacity: Opacity) -> None:
        self._tracer, self._opacity = tracer, opacity

    def run(
        self,
        origins: NDArray[np.float32],
        directions: NDArray[np.float32],
        dists: NDArray[np.float32] | None = None,
        query: str = "INTERSECT",
        output: bool = False,
    ) -> Any:
        """As that of embreex; of all that it may return, what `visibility.py` reads.

        There is one query more, "TRANSMITTED": (K,) the share of light that passes along each ray.
        """
        count = len(origins)
        if query == "OCCLUDED":
            answer = self._tracer.run(origins, directions, dists=dists, query=query)
            # Most rays meet nothing at all.
            asked = np.flatnonzero(answer == 0)
            triangles, _, _ = self._met(asked, origins[asked], directions[asked], dists[asked])
            answer[asked] = np.where(triangles >= 0, 0, -1)
            return answer
        if query == "TRANSMITTED":
            return self._transmitted(origins, directions, dists)
        ends = np.full(count, np.inf, np.float32) if dists is None else dists
        triangles, u, v = self._met(np.arange(count), origins, directions, ends)
        return {"primID": triangles, "u": u, "v": v} if output else triangles

    def _met(
        self,
        numbers: NDArray[np.int64],
        origins: NDArray[np.float32],
        directions: NDArray[np.float32],
        ends: NDArray[np.float32],
    ) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]:
        """What stops each ray: triangle, or -1, and u and v there; numbers (K,) tell the rays apart."""
        count = len(origins)
        triangles, u, v = np.full(count, -1, np.int32), np.zeros(count, np.float32), np.zeros(count, np.float32)

        def stop(passed: int, rays: NDArray[np.int64], met: dict[str, NDArray]) -> NDArray[np.bool_]:
            own = (numbers[rays] + 0.5) * _STRIDES[passed % len(_STRIDES)] % 1.0
            stopped = own < self._opacity.at(met["primID"], met["u"], met["v"])
            if passed == MOST_MET - 1:
                stopped[:] = True
            triangles[rays[stopped]] = met["primID"][stopped]
            u[rays[stopped]], v[rays[stopped]] = met["u"][stopped], met["v"][stopped]
            return stopped

        self._walk(origins, directions, ends, stop)
        return triangles, u, v

    def _transmitted(
        self, origins: NDArray[np.float32], directions: NDArray[np.float32], ends: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        shares = np.ones(len(origins), np.float32)

        def stop(passed: int, rays: NDArray[np.int64], met: dict[str, NDArray]) -> NDArray[np.bool_]:
            shares[rays] *= 1 - self._opacity.at(met["primID"], met["u"], met["v"])
            if passed == MOST_MET - 1:
                shares[rays] = 0.0
            return shares[rays] == 0

        self._walk(origins, directions, ends, stop)
        return shares

    def _walk(
        self,
        origins: NDArray[np.float32],
        directions: NDArray[np.float32],
        ends: NDArray[np.float32],
        stop: Callable[[int, NDArray[np.int64], dict[str, NDArray]], NDArray[np.bool_]],
    ) -> None:
        """Follows rays from triangle to triangle, up to MOST_MET: stop(passed, rays, what each met) ends some."""
        rays, last = np.arange(len(origins)), np.full(len(origins), -1, np.int32)
        step = np.float32(BEHIND) / np.linalg.norm(directions, axis=1)
        for passed in range(MOST_MET):
            if len(rays) == 0:
                return
            # Embree takes infinite distances for none.
            reach = np.minimum(ends, np.float32(1e30))
            met = self._tracer.run(origins, directions, dists=reach, query="INTERSECT", output=True)
            hit = met["primID"] >= 0
            # A straight ray meets a flat triangle once: what it meets again is rounding.
            new = np.flatnonzero(hit & (met["primID"] != last))
            hit[new] = ~stop(passed, rays[new], {name: met[name][new] for name in ("primID", "u", "v")})
            distance = met["tfar"] + step
            on = np.flatnonzero(hit & (ends > distance))
            origins = origins[on] + distance[on, None] * directions[on]
            ends, directions, step = ends[on] - distance[on], directions[on], step[on]
            rays, last = rays[on], met["primID"][on]


def _shares(name: str, values: ArrayLike) -> NDArray[np.float64]:
    shares = numbers(name, values)
    wrong = np.argwhere(~((shares >= 0) & (shares <= 1)))
    if len(wrong):
        raise Error(f"{name} {wrong[0][0]} is {shares[tuple(wrong[0])]:g}, it must lie from 0 to 1")
    return shares
