# SPDX-License-Identifier: GPL-3.0-or-later
"""What keeps the energy of an exchange: nobody receives more than a hemisphere holds, nobody sends more than he has.

Patches that are hidden in part are told by few rays, so that those which a receiver sees may add up to more than its
hemisphere, and a receiver whose one point happens to lie close to a small patch takes it for all of its own surface:
light that is reflected again and again would grow.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .arrays import bounds
from .closed import signed_volume
from .particles import Particles
from .visibility import Occlusion

#: In an open scene rows that are further above 1 are made 1: a few rays do not make so much by chance, and to cut all
#: that is above would darken. In a closed scene all are that are no further from it: those below see backs.
CLOSE, CLOSED = 0.05, 0.3
#: Receivers and sources are balanced in turn so many times.
ROUNDS = 3
#: Sources are made to send no more than this many times what they did.
MORE = 2.0
#: What receives less than this share of a hemisphere is taken to lie inside others, and not to be seen.
SEEN = 0.3
#: A scene is closed when no more of its rays leave it.
LEAK = 1e-4
#: Rays over the hemisphere of a particle, at least and at most, and about how many together: emitters have as many.
LEAST_RAYS, MOST_RAYS, ALL_RAYS = 4, 512, 320_000
#: Random particles, and rays of each, that are enough to tell whether light can leave a scene.
FEW, FEW_RAYS = 4000, 16
#: Corners closer than this share of the scene are one.
SAME_CORNER = 1e-9


class Shares(NamedTuple):
    """Of the rays over the hemisphere of each particle, the shares (N,) that meet a front, and anything at all."""

    fronts: NDArray[np.float64]
    met: NDArray[np.float64]


def find_shares(occlusion: Occlusion, particles: Particles) -> Shares:
    """What the particles see; emitters, whose light is most of it, send more rays to tell."""
    fronts, met = np.empty(len(particles)), np.empty(len(particles))
    for emits in (False, True):
        rows = np.flatnonzero(particles.emits == emits)
        rays = int(np.clip(ALL_RAYS // max(1, len(rows)), LEAST_RAYS, MOST_RAYS))
        fronts[rows], met[rows] = occlusion.shares_met(particles.positions[rows], particles.normals[rows], rays)
    return Shares(fronts, met)


def received_balance(rows: NDArray[np.float64], closed: bool) -> NDArray[np.float64]:
    """Factors (M, 1) for receivers from what each gets (M, 1) where all surfaces have radiosity 1."""
    wrong = np.abs(rows - 1) < CLOSED if closed else np.zeros(rows.shape, bool)
    return 1.0 / np.where(wrong | (rows > 1 + CLOSE), rows, 1.0)


def source_groups(particles: Particles) -> NDArray[np.int64]:
    """(N,) one number for the points of all small parts of a patch, and for each other point."""
    origin, per_patch = particles.origin, particles.per_patch
    cut = np.bincount(origin)[origin] > 1
    return (per_patch * origin[:, None] + np.arange(per_patch) * ~cut[:, None]).ravel()


def sent_balance(
    rows: NDArray[np.float64],
    columns: NDArray[np.float64],
    shares: Shares | None,
    weights: NDArray[np.float64],
    groups: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Factors (N, 1) for sources of areas (N, 1) in groups (N,) from their rows and columns (N, 1).

    rows: what each receives where all surfaces have radiosity 1; columns: the share of its light that arrives. Both
    are the same by reciprocity, but for sums over points; rays tell between which bounds they lie.
    """
    goal = np.minimum(rows, 1.0)
    if shares is not None:
        goal = np.clip(goal, shares.fronts[:, None], shares.met[:, None])
    # Of the parts of a patch few rays meet any, and some are met by none: what these lack has arrived from the others.
    wanted, found = (np.bincount(groups, (weights * values)[:, 0]) for values in (goal, columns))
    return np.clip(wanted / np.maximum(found, np.finfo(float).tiny), 0.0, MORE)[groups, None]


def looks_closed(occlusion: Occlusion, particles: Particles) -> bool:
    """Whether light cannot leave the scene, by a few of its particles."""
    rows = np.random.default_rng(0).permutation(len(particles))[:FEW]
    return is_closed(Shares(*occlusion.shares_met(particles.positions[rows], particles.normals[rows], FEW_RAYS)))


def is_closed(shares: Shares) -> bool:
    """Whether light cannot leave the scene, by what its particles see.

    What sees no front at all is outside, or rests on another surface, and tells nothing.
    """
    lost = 1.0 - shares.fronts
    return bool(lost[shares.fronts > 0].sum() <= LEAK * len(lost))


def is_watertight(triangles: NDArray[np.float64]) -> bool:
    """Whether the fronts of triangles (T, 3, 3) look into a space without any opening: each edge has two sides."""
    low, high = bounds(triangles)
    triangles = triangles - (low + high) / 2
    steps = np.rint(triangles / (SAME_CORNER * (high - low).max())).astype(np.int64)
    _, corner = np.unique(steps.reshape(-1, 3), axis=0, return_inverse=True)
    starts = corner.reshape(-1, 3)
    ends = np.roll(starts, -1, axis=1)
    count = corner.max() + 1
    there, back = np.sort((starts * count + ends).ravel()), np.sort((ends * count + starts).ravel())
    return np.array_equal(there, back) and signed_volume(triangles) < 0
