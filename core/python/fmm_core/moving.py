# SPDX-License-Identifier: GPL-3.0-or-later
"""What rays met, kept for a solve of a scene in which some things have moved."""

from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .kept import HIT_STEPS, KeptVisibility, steps
from .scene import Scene

#: Boxes around what has moved; where more things have, neighbours in the scene share one.
MOST_BOXES = 16
#: So far a box goes beyond what has moved, in half scene sizes: far more than rays are off by rounding.
MARGIN = 1e-5
#: Odd, with their bits mixed: the multipliers of splitmix64 (Steele, Lea and Flood, 2014).
_MIX = np.array([0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB], np.uint64)

Columns = tuple[NDArray, ...]


class MovingVisibility:
    """The answers of the rays of the last solve, by the rays themselves, for the frames of an animation.

    Give one object to one `solve` after another. In a scene of as many triangles as the last one a ray's answer holds
    where the ray passes none of the boxes around the triangles that are elsewhere now, there and where they were. All
    is traced anew where the scene as a whole has another size or place, or lets light through.
    """

    def __init__(self) -> None:
        self._scene: Scene | None = None
        self._known: dict[str, tuple[NDArray[np.uint64], Columns]] = {}
        self._asked: dict[str, list[tuple[NDArray[np.uint64], Columns]]] = {}
        self._boxes = np.zeros((0, 2, 3), np.float32)
        self._corners = np.zeros((0, 3, 3), np.float32)
        self._lock = Lock()

    def take(self, scene: Scene) -> list[str]:
        """Makes it that of a scene; no warnings."""
        last, self._scene = self._scene, scene
        self._known = {query: _sorted(parts) for query, parts in self._asked.items()}
        self._asked = {}
        if last is None or not _comparable(last, scene):
            self._known = {}
            return []
        self._corners = _in_box(last.triangles, scene)
        self._boxes = _boxes(self._corners, _in_box(scene.triangles, scene))
        return []

    def first(self, scene: Scene) -> Scene:
        """The scene whose lights particles are made for: its own."""
        return scene

    def around(self, tracer: Any) -> "Moving":
        """An embree scene that is asked only for what is not known."""
        return Moving(tracer, self)

    def find(
        self, query: str, keys: NDArray[np.uint64], origins: NDArray[np.float32], directions: NDArray[np.float32]
    ) -> tuple[NDArray[np.int64], Columns]:
        """Rows of the rays whose answers hold, and these."""
        if query not in self._known:
            return np.zeros(0, np.int64), ()
        known, columns = self._known[query]
        order = np.argsort(keys)
        at = np.minimum(np.searchsorted(known, keys[order]), len(known) - 1)
        there = known[at] == keys[order]
        rows, at = order[there], at[there]
        answers = tuple(column[at] for column in columns)
        reach = np.ones(len(rows), np.float32)
        if query != "OCCLUDED":
            reach = self._distances(answers, origins[rows], directions[rows])
        holds = ~_pass(self._boxes, origins[rows], directions[rows], reach)
        return rows[holds], tuple(answer[holds] for answer in answers)

    def _distances(
        self, answers: Columns, origins: NDArray[np.float32], directions: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """How far rays went in the last scene, in their own lengths."""
        far = np.full(len(origins), np.inf, np.float32)
        if len(answers) == 3:
            hit = np.flatnonzero(answers[0] >= 0)
            a, b, c = self._corners[answers[0][hit]].transpose(1, 0, 2)
            u, v = (answer[hit, None] / np.float32(HIT_STEPS) for answer in answers[1:])
            along = directions[hit]
            met = ((a + u * (b - a) + v * (c - a) - origins[hit]) * along).sum(axis=1)
            far[hit] = met / (along * along).sum(axis=1)
        return far

    def keep(self, query: str, keys: NDArray[np.uint64], columns: Columns) -> None:
        """Keeps answers for the next scene."""
        with self._lock:
            self._asked.setdefault(query, []).append((keys, columns))


#: Either way in which a solve uses what rays have met before.
Kept = KeptVisibility | MovingVisibility


class Moving:
    """Stands in for an embree scene: the same `run`, for the questions of `visibility.py`.

    replayed   rays answered without tracing them, so far
    """

    def __init__(self, tracer: Any, kept: MovingVisibility) -> None:
        self._tracer, self._kept = tracer, kept
        self._lock = Lock()
        self.replayed = 0

    def run(
        self,
        origins: NDArray[np.float32],
        directions: NDArray[np.float32],
        dists: NDArray[np.float32] | None = None,
        query: str = "INTERSECT",
        output: bool = False,
    ) -> Any:
        """As that of embreex; of all that it may return, what `visibility.py` reads."""
        name, count = f"{query} {output}" if output else query, len(origins)
        keys = _keys(origins, directions)
        rows, answers = self._kept.find(name, keys, origins, directions)
        new = np.ones(count, bool)
        new[rows] = False
        asked = np.flatnonzero(new)
        if len(asked) or not len(rows):
            ends = None if dists is None else dists[asked]
            met = self._tracer.run(origins[asked], directions[asked], dists=ends, query=query, output=output)
            met = (met["primID"], steps(met["u"]), steps(met["v"])) if output else (met,)
            answers = _together(count, (rows, answers), (asked, met)) if len(rows) else met
        else:
            answers = _together(count, (rows, answers))
        with self._lock:
            self.replayed += len(rows)
        self._kept.keep(name, keys, answers)
        if not output:
            return answers[0]
        u, v = (share / np.float32(HIT_STEPS) for share in answers[1:])
        return {"primID": answers[0], "u": u, "v": v}


def _together(count: int, *parts: tuple[NDArray[np.int64], Columns]) -> Columns:
    """Columns of so many rows from those of some of them each."""
    columns = tuple(np.empty(count, column.dtype) for column in parts[0][1])
    for rows, values in parts:
        for column, value in zip(columns, values, strict=True):
            column[rows] = value
    return columns


def _keys(origins: NDArray[np.float32], directions: NDArray[np.float32]) -> NDArray[np.uint64]:
    """(K,) a number for each ray, another one for another ray but for one pair in 2**64."""
    words = np.concatenate([origins, directions], axis=1).astype(np.float32).view(np.uint64)
    keys = np.zeros(len(words), np.uint64)
    for column, factor in zip(words.T, _MIX, strict=True):
        keys = (keys ^ column) * factor
        keys ^= keys >> np.uint64(29)
    return keys * _MIX[1] ^ keys >> np.uint64(32)


def _sorted(parts: list[tuple[NDArray[np.uint64], Columns]]) -> tuple[NDArray[np.uint64], Columns]:
    keys = np.concatenate([keys for keys, _ in parts])
    order = np.argsort(keys)
    columns = zip(*(columns for _, columns in parts), strict=True)
    return keys[order], tuple(np.concatenate(column)[order] for column in columns)


def _comparable(last: Scene, scene: Scene) -> bool:
    """Whether a ray of a scene is the same ray in another one, and meets the same triangles by number."""
    whole = last.opacity is None and scene.opacity is None
    same = all(np.array_equal(getattr(last, name), getattr(scene, name)) for name in ("centre", "size", "origin"))
    return whole and same and len(last.triangles) == len(scene.triangles)


def _in_box(triangles: NDArray[np.float64], scene: Scene) -> NDArray[np.float32]:
    """Where rays are traced: see `Occlusion`."""
    return ((triangles - scene.centre) / (scene.size / 2)).astype(np.float32)


def _boxes(last: NDArray[np.float32], now: NDArray[np.float32]) -> NDArray[np.float32]:
    """(B, 2, 3) low and high corners of boxes around all triangles (T, 3, 3) that are not the same, at both places."""
    moved = np.flatnonzero((last != now).any(axis=(1, 2)))
    if len(moved) == 0:
        return np.zeros((0, 2, 3), np.float32)
    gaps = np.diff(moved)
    widest = np.sort(np.argsort(gaps)[::-1][: MOST_BOXES - 1])
    cuts = widest[gaps[widest] > 1] + 1
    corners = np.concatenate([last[moved], now[moved]], axis=1)
    runs = np.split(corners, cuts)
    return np.array([[run.min(axis=(0, 1)) - MARGIN, run.max(axis=(0, 1)) + MARGIN] for run in runs], np.float32)


def _pass(
    boxes: NDArray[np.float32],
    origins: NDArray[np.float32],
    directions: NDArray[np.float32],
    reach: NDArray[np.float32],
) -> NDArray[np.bool_]:
    """(K,) whether rays get into one of the boxes before their ends."""
    found = np.zeros(len(origins), bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / directions
        for low, high in boxes:
            first, second = (low - origins) * inverse, (high - origins) * inverse
            # Not a number is where a ray runs in the margin's very face.
            enter, leave = np.fmin(first, second).max(axis=1), np.fmax(first, second).min(axis=1)
            found |= (np.maximum(enter, 0) <= leave) & (enter <= reach)
    return found
