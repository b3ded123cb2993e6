# SPDX-License-Identifier: GPL-3.0-or-later
"""Directional light: what four harmonics say for tilted normals, judged by closed forms and by many rays."""

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import PointLight, Sky, SunLight, irradiance_of, matched, patterns
from fmm_core.harmonics import Tilted
from fmm_core.incident import Incident
from test_visibility import ALBEDO, EMISSION, TWO_BLOCKS

FLOOR = shapes.quad([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0])
SETTINGS = fmm_core.Settings(particles=2000, probes=0)


def tilted(normals, degrees, turn):
    cosines = np.full((len(normals), 1), np.cos(np.radians(degrees)))
    return patterns.around(normals, cosines, np.full((len(normals), 1), turn))[:, 0]


def error(found, exact):
    return np.linalg.norm(found - exact) / np.linalg.norm(exact)


class Leaning(Tilted):
    """The irradiance of other normals at the same points, under the same horizon."""

    outputs = 1

    def __init__(self, normals, others):
        super().__init__(normals)
        self._others = others

    def total(self, rows, directions, flux):
        cosines = np.einsum("mkx,mx->mk", directions, self._others[rows])
        return np.maximum(cosines, 0.0)[:, None] @ flux


@pytest.mark.parametrize("degrees", [0, 20, 40])
def test_an_even_sky_is_exact_for_tilted_normals(degrees):
    solution = fmm_core.solve(fmm_core.Scene(FLOOR, 0.5, sky=Sky([1.0, 2.0, 0.5])), SETTINGS)
    points, normals = shapes.random_points(FLOOR, 8)
    harmonics = matched(solution.harmonics(points, normals), normals, solution.irradiance(points, normals))
    # A tilted normal sees the part of the sky that is above both horizons.
    expected = np.pi * (1 + np.cos(np.radians(degrees))) / 2 * np.array([1.0, 2.0, 0.5])
    for turn in range(4):
        found = irradiance_of(harmonics, tilted(normals, degrees, turn))
        assert found == pytest.approx(np.broadcast_to(expected, found.shape), rel=0.01)


@pytest.mark.parametrize(
    "light", [SunLight((0.3, -0.2, -1.0), 2.0), PointLight((0.5, 0.4, 1.5), (3.0, 2.0, 1.0), radius=0.1)]
)
def test_a_lamp_is_a_plain_cosine(light):
    solution = fmm_core.solve(fmm_core.Scene(FLOOR, 0.0, lights=[light]), SETTINGS)
    points, normals = shapes.random_points(FLOOR, 8)
    harmonics = solution.harmonics(points, normals)
    for degrees in (0, 20, 40):
        others = tilted(normals, degrees, 0.7)
        expected = light.unshadowed(points, others)[:, None] * light.colour
        assert irradiance_of(harmonics, others) == pytest.approx(expected, rel=1e-3)


@pytest.fixture(scope="module")
def blocks():
    """A room with two blocks, solved, with points away from their gaps and what is found there."""
    solution = fmm_core.solve(fmm_core.Scene(TWO_BLOCKS, ALBEDO, EMISSION), SETTINGS)
    points, normals = shapes.random_points(TWO_BLOCKS, 20)
    above = points[:, 2] > 0.02
    points, normals = points[above], normals[above]
    irradiance = solution.irradiance(points, normals)
    return solution, points, normals, irradiance, solution.harmonics(points, normals)


def test_the_own_normal_has_the_irradiance_itself(blocks):
    solution, _, normals, irradiance, harmonics = blocks
    assert irradiance_of(matched(harmonics, normals, irradiance), normals) == pytest.approx(irradiance, rel=1e-9)
    # Rays alone find it too, with their own noise.
    assert error(irradiance_of(harmonics, normals), irradiance) < 0.03
    assert solution.report["counts"]["directed_rays"] > 200 * len(normals)


@pytest.mark.parametrize(("degrees", "bound"), [(20, 0.03), (40, 0.05)])
def test_tilted_normals_have_about_their_irradiance(blocks, degrees, bound):
    solution, points, normals, irradiance, harmonics = blocks
    incident = Incident(solution._planned, solution._space.sums, solution.radiosity)
    for turn in (0.3, 2.4, 4.5):
        others = tilted(normals, degrees, turn)
        expected = incident.gather(points, normals, Leaning(normals, others), 2000)[:, 0]
        assert error(irradiance_of(matched(harmonics, normals, irradiance), others), expected) < bound
        assert error(irradiance, expected) > 2 * bound


def test_light_that_rays_did_not_find_comes_from_all_sides():
    normals = np.array([[0.0, 0.6, 0.8]])
    harmonics = matched(np.zeros((1, 4, 3)), normals, np.ones((1, 3)))
    assert irradiance_of(harmonics, normals) == pytest.approx(1.0)
    assert irradiance_of(harmonics, np.array([[0.0, 0.8, -0.6]])) == pytest.approx(0.5)


def test_wrong_shapes_are_refused():
    with pytest.raises(fmm_core.Error, match="harmonics: expected"):
        irradiance_of(np.zeros((2, 3, 3)), np.zeros((2, 3)))
    solution = fmm_core.solve(fmm_core.Scene(FLOOR, 0.5, 1.0), SETTINGS)
    with pytest.raises(fmm_core.Error, match="normals: expected 1 rows"):
        solution.harmonics([[0, 0, 0]], [[0, 0, 1], [0, 0, 1]])
