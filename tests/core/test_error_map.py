# SPDX-License-Identifier: GPL-3.0-or-later
"""Where colours are off, against where they are."""

import fmm_core
import numpy as np
import pytest
import shapes


@pytest.fixture(scope="module")
def shadow():
    """A floor under a small lamp, with a plate between them: corners, output points, and the scene."""
    cells = 16
    u, v = np.meshgrid(*[np.arange(cells) / cells] * 2)
    low = np.stack([u, v, 0 * u], axis=-1).reshape(-1, 1, 1, 3)
    floor = (low + shapes.quad([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]) / cells).reshape(-1, 3, 3)
    plate = shapes.quad([0.3, 0.3, 0.2], [0.3, 0.7, 0.2], [0.7, 0.7, 0.2], [0.7, 0.3, 0.2])
    lamp = shapes.quad([0.45, 0.45, 1.0], [0.45, 0.55, 1.0], [0.55, 0.55, 1.0], [0.55, 0.45, 1.0])
    triangles = np.concatenate([floor, plate, plate[:, ::-1] + [0, 0, 0.01], lamp])
    emission = np.where(np.arange(len(triangles)) < len(triangles) - 2, 0.0, 100.0)
    corners = floor.reshape(-1, 3)
    normals = np.repeat(shapes.normals(floor), 3, axis=0)
    vertices = np.unique(np.rint(1e6 * corners), axis=0, return_inverse=True)[1].ravel()
    output = fmm_core.output_points(corners, normals, vertices, np.repeat(floor.mean(axis=1), 3, axis=0))
    mesh = output, corners, normals, np.arange(len(corners)).reshape(-1, 3)
    return mesh, fmm_core.Scene(triangles, 0.5, emission)


def test_the_map_tells_where_colours_are_off(shadow):
    mesh, scene = shadow
    fit, check = fmm_core.VertexFit(*mesh), fmm_core.VertexFit(*mesh, seed=1)
    solution = fmm_core.solve(scene, fmm_core.Settings(method="fmm", particles=2000, rays=30, probes=0))
    values = fit.values(solution.irradiance(fit.points, fit.normals, effort=fit.effort), solution.sight(fit))
    apart = solution.apart()
    found = apart.irradiance(check.points, check.normals, effort=4 * check.effort)
    shown = check.errors(values, found, apart.sight(check))
    exact = fmm_core.solve(scene, fmm_core.Settings(method="direct", particles=6000, probes=0))
    true = check.errors(values, exact.irradiance(check.points, check.normals), apart.sight(check))
    assert np.corrcoef(shown, true)[0, 1] > 0.95
    assert np.sqrt((shown**2).mean() / (true**2).mean()) == pytest.approx(1.0, abs=0.1)
    # The lamp is small: the plate's shadow ends where straight lines from the middle of the lamp meet its rim.
    edge = np.abs(np.abs(mesh[0].points[:, :2] - 0.5).max(axis=1) - 0.25)
    assert shown[edge < 0.06].mean() > 3 * shown[edge > 0.12].mean()


def test_asking_apart_leaves_relighting_without_rays(shadow):
    mesh, scene = shadow
    fit, check = fmm_core.VertexFit(*mesh), fmm_core.VertexFit(*mesh, seed=1)
    solution = fmm_core.solve(scene, fmm_core.Settings(method="fmm", particles=500, rays=30, probes=0))
    before = solution.irradiance(fit.points, fit.normals, effort=fit.effort)
    rays = solution.report["counts"]["rays"]
    solution.apart().irradiance(check.points, check.normals)
    assert solution.report["counts"]["rays"] == rays
    relit = solution.relight(2 * scene.emission)
    assert relit.irradiance(fit.points, fit.normals, effort=fit.effort) == pytest.approx(2 * before, rel=1e-3)
    assert relit.report["counts"]["rays"] == 0
