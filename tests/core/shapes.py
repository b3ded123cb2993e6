# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes for tests: triangles (T, 3, 3), fronts counter-clockwise."""

import numpy as np
from numpy.typing import NDArray

Triangles = NDArray[np.float64]


def quad(a, b, c, d) -> Triangles:
    """Two triangles; the front is the side from which a, b, c, d run counter-clockwise."""
    corners = np.array([a, b, c, d], dtype=float)
    return corners[[[0, 1, 2], [0, 2, 3]]]


def room(size=(1.0, 1.0, 1.0)) -> Triangles:
    """The twelve triangles of a box seen from inside, origin at one corner."""
    faces = []
    for axis in range(3):
        u, v, w = np.roll(np.eye(3), -axis, axis=0)[[0, 1, 2]]
        faces.append(quad(0 * u, v, v + w, w))
        faces.append(quad(u, u + w, u + v + w, u + v))
    return np.concatenate(faces) * np.asarray(size)


def subdivided_room(per_side: int) -> Triangles:
    """The unit cube seen from inside, each face a grid of 2 * per_side**2 triangles."""
    cells = np.stack(np.meshgrid(*[np.arange(per_side)] * 2), axis=-1).reshape(-1, 2) / per_side
    faces = []
    for a, b, _, d in (face.reshape(6, 3)[[0, 1, 2, 5]] for face in room().reshape(6, 2, 3, 3)):
        u, v = (b - a) / per_side, (d - a) / per_side
        for s, t in cells:
            corner = a + s * (b - a) + t * (d - a)
            faces.append(quad(corner, corner + u, corner + u + v, corner + v))
    return np.concatenate(faces)


def quarters(triangles: Triangles) -> NDArray[np.float64]:
    """(4, T, 3, 3) the quarters of each triangle, cut at the middles of its edges."""
    a, b, c = triangles.transpose(1, 0, 2)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = ([a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca])
    return np.stack([np.stack(part, axis=1) for part in parts])


def finer(triangles: Triangles, times: int) -> Triangles:
    """Quarters of quarters, so many times; those of one triangle follow each other."""
    for _ in range(times):
        triangles = np.stack(quarters(triangles), axis=1).reshape(-1, 3, 3)
    return triangles


def sphere(radius: float, subdivisions: int, inward: bool = False) -> Triangles:
    """An octahedron subdivided and pushed to the sphere."""
    axes = np.eye(3)
    faces = []
    for x in (1, -1):
        for y in (1, -1):
            for z in (1, -1):
                face = [x * axes[0], y * axes[1], z * axes[2]]
                faces.append(face if x * y * z > 0 else face[::-1])
    triangles = np.array(faces)
    for _ in range(subdivisions):
        triangles = np.concatenate(quarters(triangles))
        triangles /= np.linalg.norm(triangles, axis=2, keepdims=True)
    return radius * (triangles[:, ::-1] if inward else triangles)


def normals(triangles: Triangles) -> NDArray[np.float64]:
    """(T, 3) unit normals."""
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return cross / np.linalg.norm(cross, axis=1, keepdims=True)


def corner_points(triangles: Triangles, step: float = 1e-3) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points a step inside every corner, with the faces' normals."""
    points = triangles + step * (triangles.mean(axis=1, keepdims=True) - triangles)
    return points.reshape(-1, 3), np.repeat(normals(triangles), 3, axis=0)


def random_points(triangles: Triangles, each: int, seed: int = 0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Uniform random points on every triangle, with the faces' normals."""
    shares = np.random.default_rng(seed).dirichlet([1, 1, 1], size=(len(triangles), each))
    points = np.einsum("tkc,tcx->tkx", shares, triangles)
    return points.reshape(-1, 3), np.repeat(normals(triangles), each, axis=0)
