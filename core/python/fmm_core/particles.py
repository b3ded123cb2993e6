# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles to patches and Gaussian quadrature points (section 3 of the paper, eq 12)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arrays import ROUNDING
from .quadrature import triangle_rule
from .scene import Scene

#: Share of the particles that goes to emitters, by power; the rest follows area.
EMITTER_SHARE = 0.1
#: Patches are cut until their longest edge fits, but not where they are this many times smaller than they may be.
SLIVER = 50.0
#: Softening of the point kernel, in patch radii: far below any distance at which it is used unreplaced.
SOFTENING = 1e-3


@dataclass(frozen=True)
class Particles:
    """Quadrature points, `per_patch` consecutive ones a patch; two-sided triangles have patches on both sides.

    positions, normals (N, 3); weights (N,) in units of area; triangle (N,) row of the scene; emits (N,) whether that
    emits; per_patch int
    patches (P, 3, 3) corners; areas (P,); radii (P,) from centroid to farthest corner
    """

    positions: NDArray[np.float64]
    normals: NDArray[np.float64]
    weights: NDArray[np.float64]
    triangle: NDArray[np.int64]
    emits: NDArray[np.bool_]
    per_patch: int
    patches: NDArray[np.float64]
    areas: NDArray[np.float64]
    radii: NDArray[np.float64]

    @property
    def visibility_weights(self) -> NDArray[np.float64]:
        """(N,) what each particle may send, as a share of what a point in the open receives, in units of area.

        Emitters count for half of all light and everything else for the other half, whatever their power is now.
        """
        emitting = self.weights[self.emits].sum()
        return 0.5 * self.weights * np.where(self.emits, self.weights.sum() / emitting, 1.0)

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def softening(self) -> NDArray[np.float64]:
        """(N,) squared distance below which a particle's kernel stops growing."""
        return np.repeat((SOFTENING * self.radii) ** 2, self.per_patch)


def make_particles(scene: Scene, count: int, degree: int) -> Particles:
    """About `count` quadrature points of the given degree; at least one patch a triangle."""
    barycentric, shares = triangle_rule(degree)
    patches, triangle = _cut(scene, _edge_limits(scene, count / len(shares)))
    back = np.flatnonzero(scene.two_sided[triangle])
    patches = np.concatenate([patches, patches[back][:, [0, 2, 1]]])
    triangle = np.concatenate([triangle, triangle[back]])

    cross = np.cross(patches[:, 1] - patches[:, 0], patches[:, 2] - patches[:, 0])
    double_areas = np.linalg.norm(cross, axis=1)
    areas = double_areas / 2
    per_patch = len(shares)
    centroids = patches.mean(axis=1, keepdims=True)
    return Particles(
        positions=np.einsum("kc,pcx->pkx", barycentric, patches).reshape(-1, 3),
        normals=np.repeat(cross / double_areas[:, None], per_patch, axis=0),
        weights=(areas[:, None] * shares).ravel(),
        triangle=np.repeat(triangle, per_patch),
        emits=np.repeat(scene.emission.any(axis=1)[triangle], per_patch),
        per_patch=per_patch,
        patches=np.ascontiguousarray(patches),
        areas=areas,
        radii=np.linalg.norm(patches - centroids, axis=2).max(axis=1),
    )


def _edge_limits(scene: Scene, patch_count: float) -> NDArray[np.float64]:
    """(T,) longest edge that a patch of each triangle may have, so that about `patch_count` patches come out."""
    edges = scene.triangles - np.roll(scene.triangles, 1, axis=1)
    areas = np.linalg.norm(np.cross(edges[:, 1], edges[:, 2]), axis=1) / 2
    power = areas * scene.emission.sum(axis=1)
    share = (1 - EMITTER_SHARE) * areas / areas.sum() + EMITTER_SHARE * power / power.sum()
    # A right isosceles triangle of longest edge h has the area h^2 / 4; bisection makes them half as large on average.
    return np.sqrt(4 * 1.5 * areas / (share * patch_count))


def _cut(scene: Scene, limits: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Bisects longest edges until each patch fits; returns patches (P, 3, 3) and the triangle of each (P,)."""
    todo, owner = scene.triangles, np.arange(len(scene.triangles))
    done_patches, done_owners = [], []
    while len(todo):
        edges = np.roll(todo, -1, axis=1) - todo
        squared = (edges**2).sum(axis=2)
        largest = squared.max(axis=1)
        longest = (squared > (1 - ROUNDING) * largest[:, None]).argmax(axis=1)
        limit = limits[owner]
        areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
        large = (largest > (1 + ROUNDING) * limit**2) & (areas > limit**2 / SLIVER)
        done_patches.append(todo[~large])
        done_owners.append(owner[~large])
        todo, owner = _bisect(todo[large], longest[large]), np.tile(owner[large], 2)
    return np.concatenate(done_patches), np.concatenate(done_owners)


def _bisect(triangles: NDArray[np.float64], edge: NDArray[np.int64]) -> NDArray[np.float64]:
    """Both halves (2T, 3, 3) of each triangle, cut at the middle of the given edge."""
    rows = np.arange(len(triangles))
    a, b, c = (triangles[rows, (edge + i) % 3] for i in range(3))
    middle = (a + b) / 2
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
