# SPDX-License-Identifier: GPL-3.0-or-later
"""What keeps the energy of an exchange: nobody receives more than a hemisphere holds, nobody sends more than he has.

Patches that are hidden in part are told by few rays, so that those which a receiver sees may add up to more than its
hemisphere, and light that is reflected again and again would grow. And a receiver whose one point happens to lie close
to a small patch takes it for all of its own surface.
"""

import numpy as np
from numpy.typing import NDArray

from .particles import Particles
from .visibility import Occlusion

#: In a closed scene rows that are no further from 1 are made 1: those below see backs, inside objects. In others only
#: those that are above: a few rays do not make more than that by chance, and to cut only one side would darken.
CLOSE = 0.05
#: Sources are let send this much more than they have: what is less evens out with what others send too little.
TOO_MUCH = 1.0
#: What receives less than this share of a hemisphere is taken to lie inside others, and not to be seen.
SEEN = 0.3
#: A scene is closed when no more of its rays leave it.
LEAK = 1e-4
#: Rays from each particle that tell, and particles asked at once.
RAYS, BLOCK = 16, 1024
#: Corners closer than this share of the scene are one.
SAME_CORNER = 1e-9


def received_balance(rows: NDArray[np.float64], closed: bool) -> NDArray[np.float64]:
    """Factors (M, 1) for receivers from what each gets (M, 1) where all surfaces have radiosity 1."""
    wrong = rows > 1 + CLOSE
    if closed:
        wrong |= rows > 1 - CLOSE
    return 1.0 / np.where(wrong, rows, 1.0)


def sent_balance(columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Factors (N, 1) for sources from the share (N, 1) of their light that arrives anywhere."""
    return 1.0 / np.where(columns > 1 + TOO_MUCH, columns, 1.0)


def is_closed(occlusion: Occlusion, particles: Particles) -> bool:
    """Whether light cannot leave the scene, by rays from a random selection of the particles.

    What sees nothing at all is outside, or rests on another surface, and tells nothing.
    """
    rng = np.random.default_rng(0)
    chosen = rng.permutation(len(particles))[: 16 * BLOCK]
    allowed = LEAK * RAYS * len(chosen)
    missed = 0
    for start in range(0, len(chosen), BLOCK):
        rows = chosen[start : start + BLOCK]
        lost = occlusion.missed(particles.positions[rows], particles.normals[rows], RAYS)
        missed += int(lost[lost < RAYS].sum())
        if missed > allowed:
            return False
    return True


def is_watertight(triangles: NDArray[np.float64]) -> bool:
    """Whether the fronts of triangles (T, 3, 3) look into a space without any opening: each edge has two sides."""
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    triangles = triangles - (low + high) / 2
    steps = np.rint(triangles / (SAME_CORNER * (high - low).max())).astype(np.int64)
    _, corner = np.unique(steps.reshape(-1, 3), axis=0, return_inverse=True)
    starts = corner.reshape(-1, 3)
    ends = np.roll(starts, -1, axis=1)
    count = corner.max() + 1
    there, back = np.sort((starts * count + ends).ravel()), np.sort((ends * count + starts).ravel())
    a, b, c = triangles.transpose(1, 0, 2)
    return np.array_equal(there, back) and (a * np.cross(b, c)).sum() < 0
