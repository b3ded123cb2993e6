# SPDX-License-Identifier: GPL-3.0-or-later
"""Error of interpolated colours over the faces: light at the vertices, and colours fitted to the faces.

uv run python benchmarks/vertex_fit.py [--json] [--small]

The room with two blocks at three densities, its floor running under the blocks. What is shown on the faces, linear over
each triangle, is judged at random points of them by a finer gather. Points inside the blocks are left out.
"""

import argparse
from dataclasses import replace

import numpy as np
from common import Array, Cost, Row, print_rows
from cycles_bake import Mesh
from fmm_core import OutputPoints, Settings, Solution, VertexFit, solve
from fmm_core.settings import RAYS
from numpy.typing import NDArray
from scenes import cornell_mesh

VERTICES = (1_000, 4_000, 16_000)
SMALL = (300, 900)
#: Points on the faces that are judged.
JUDGED = 30_000
#: The truth is gathered with so many times the rays.
FINER = 6


def on_faces(mesh: Mesh, count: int) -> tuple[Array, Array, NDArray[np.int64], Array]:
    """Random points, even by area, and their normals (N, 3), the corners (N, 3) around each, and their shares."""
    rng, rows = np.random.default_rng(0), mesh.triangles
    corners = mesh.corners[rows]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = rows[rng.choice(len(rows), count, p=areas / areas.sum())]
    shares = rng.dirichlet([1, 1, 1], count)
    points, normals = (np.einsum("nc,ncx->nx", shares, of[chosen]) for of in (mesh.corners, mesh.corner_normals))
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True), chosen, shares


def at_vertices(solution: Solution, _mesh: Mesh, output: OutputPoints) -> Array:
    return solution.irradiance(output.points, output.normals)


def fitted(solution: Solution, mesh: Mesh, output: OutputPoints) -> Array:
    fit = VertexFit(output, mesh.corners, mesh.corner_normals, mesh.triangles)
    return fit.values(solution.irradiance(fit.points, fit.normals, effort=fit.effort), solution.sight(fit))


def run(vertices: int, judged: int) -> Row:
    """Both errors and costs at one density."""
    mesh = cornell_mesh(vertices)
    scene, output, settings = mesh.scene(), mesh.output_points(), Settings(method="fmm", probes=0)
    points, normals, corners, shares = on_faces(mesh, judged)
    finer = solve(scene, replace(settings, rays=FINER * RAYS))
    shown = ~finer._space.sums.occlusion.buried(points, normals)
    truth = finer.irradiance(points[shown], normals[shown])
    corners, shares = output.inverse[corners[shown]], shares[shown]
    row: Row = {"vertices": mesh.vertex_count, "triangles": len(mesh.triangles)}
    for name, colours in (("points", at_vertices), ("fit", fitted)):
        solution, start = solve(scene, settings), Cost.now()
        values = colours(solution, mesh, output)
        cost = Cost.now().since(start)
        difference = np.einsum("nc,ncx->nx", shares, values[corners]) - truth
        row[f"{name}_l2_error"] = float(np.linalg.norm(difference) / np.linalg.norm(truth))
        row[f"{name}_seconds"], row[f"{name}_core_seconds"] = cost
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print the rows as JSON")
    parser.add_argument("--small", action="store_true", help="a few seconds' run, to see that all works")
    options = parser.parse_args()
    judged = JUDGED // 10 if options.small else JUDGED
    print_rows([run(vertices, judged) for vertices in (SMALL if options.small else VERTICES)], options.json)


if __name__ == "__main__":
    main()
