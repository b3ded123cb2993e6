# SPDX-License-Identifier: GPL-3.0-or-later
"""Particles that are there already: some of them cut, or those of two scenes put together."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .arrays import centroids, largest, lengths
from .particles import NO_PATCH, Particles, bisect

#: Parts of a patch that has less than this share of all area stay together: too few rays tell what each of them sends.
TOGETHER = 1e-4


def bisected(particles: Particles, rows: NDArray[np.int64]) -> Particles:
    """The same with some of the patches (K,) cut in two: whole ones of one side. The first half takes the place of the
    patch, the second one follows all.
    """
    leaves = np.flatnonzero(particles.edges < 0)
    leaf = np.empty(len(particles.areas), np.int64)
    leaf[particles.parts[leaves, 0]] = leaves
    corners, nodes, count = particles.patches[rows], leaf[rows], len(particles.areas)
    sides = lengths(np.roll(corners, -1, axis=1) - corners)
    edge = sides.argmax(axis=1)
    halves = bisect(corners, edge, np.full(len(rows), 0.5))
    new = np.concatenate([rows, count + np.arange(len(rows))])
    apart = np.tile(particles.areas[rows] > TOGETHER * particles.areas.sum(), 2)

    def both(values: NDArray, of_halves: NDArray) -> NDArray:
        found = np.concatenate([values, of_halves[len(rows) :]])
        found[rows] = of_halves[: len(rows)]
        return found

    def of_points(values: NDArray) -> NDArray:
        values = values.reshape(count, particles.per_patch, *values.shape[1:])
        return both(values, np.concatenate([values[rows], values[rows]])).reshape(-1, *values.shape[2:])

    positions = np.einsum("kc,pcx->pkx", particles.rule, halves)
    grown = 2 * len(rows)
    edges = np.concatenate([particles.edges, np.full(grown, -1, particles.edges.dtype)])
    fractions = np.concatenate([particles.fractions, np.full(grown, 0.5)])
    parts = np.concatenate([particles.parts, np.column_stack([new, np.full(grown, NO_PATCH)]).astype(np.uint32)])
    edges[nodes], fractions[nodes] = edge, 0.5
    parts[nodes] = len(particles.edges) + np.column_stack([np.arange(len(rows)), len(rows) + np.arange(len(rows))])
    every = particles.positions.reshape(count, particles.per_patch, 3)
    weights = of_points(particles.weights).reshape(-1, particles.per_patch)
    weights[new] *= 0.5
    return replace(
        particles,
        positions=both(every, positions).reshape(-1, 3),
        **{name: of_points(getattr(particles, name)) for name in ("normals", "hidden", "triangle", "emits")},
        weights=weights.ravel(),
        patches=both(particles.patches, halves),
        areas=both(particles.areas, np.tile(particles.areas[rows] / 2, 2)),
        radii=both(particles.radii, largest(lengths(halves - centroids(halves)[:, None]))),
        whole=both(particles.whole, np.ones(grown, bool)),
        origin=both(particles.origin, np.where(apart, new, np.tile(particles.origin[rows], 2))),
        edges=edges,
        fractions=fractions,
        parts=parts,
    )


def joined(first: Particles, second: Particles) -> Particles:
    """The particles of two scenes in one, with one rule: the triangles of the second follow those of the first."""
    own, others = len(first.solid), len(second.solid)
    parts = first.parts.copy(), second.parts.copy()
    # The triangles of both are the first nodes; what they are cut into follows.
    parts[0][first.edges >= 0] += np.uint32(others)
    parts[1][second.edges >= 0] += np.uint32(len(first.edges))
    patches = (second.edges < 0)[:, None] & (second.parts != NO_PATCH)
    parts[1][patches] += np.uint32(len(first.areas))

    def nodes(one: NDArray, other: NDArray) -> NDArray:
        return np.concatenate([one[:own], other[:others], one[own:], other[others:]])

    names = "positions", "normals", "weights", "hidden", "emits", "patches", "areas", "radii", "whole", "solid"
    both = {name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in names}
    return replace(
        first,
        **both,
        triangle=np.concatenate([first.triangle, own + second.triangle]),
        edges=nodes(first.edges, second.edges),
        fractions=nodes(first.fractions, second.fractions),
        parts=nodes(*parts),
        origin=np.concatenate([first.origin, len(first.areas) + second.origin]),
    )
