# SPDX-License-Identifier: GPL-3.0-or-later
"""Grey scenes are solved in one channel, with what three would give."""

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import _binding, accuracy

BLOCK = shapes.room((0.4, 0.3, 0.2))[:, ::-1] + [0.35, 0.35, 0.2]
TRIANGLES = np.concatenate([shapes.room(), BLOCK])
GREY = np.repeat(np.where(np.arange(24) < 2, 1.0, 0.0)[:, None], 3, axis=1)
#: As bright as grey: the particles are the same.
COLOURED = GREY * [1.9, 0.8, 0.3]
ALBEDO = np.linspace(0.2, 0.7, 24)[:, None] * np.ones(3)
POINTS = shapes.random_points(shapes.room(), 4)
SMALL = fmm_core.Settings(particles=200)
EACH = pytest.mark.parametrize(
    "settings",
    [
        fmm_core.Settings(particles=600, method="direct"),
        fmm_core.Settings(particles=600, method="direct", iteration="shooting"),
        fmm_core.Settings(particles=1500, method="fmm"),
        fmm_core.Settings(particles=1500, method="fmm", expansion="paper", truncation=3),
        fmm_core.Settings(
            particles=1500, method="fmm", expansion="whole", iteration="shooting", effects={"occlusion": False}
        ),
        fmm_core.Settings(particles=1500, visibility="cells"),
    ],
    ids=["direct", "direct shooting", "fmm", "paper", "whole shooting", "cells"],
)


def solve(albedo, emission, settings):
    solution = fmm_core.solve(fmm_core.Scene(TRIANGLES, albedo, emission), settings)
    return solution, solution.irradiance(*POINTS)


@EACH
def test_one_channel_gives_what_three_do(settings, monkeypatch):
    # By as few rays in both as there are at least, however long they take.
    monkeypatch.setattr(accuracy, "SHARE", 0.0)
    grey, irradiance = solve(ALBEDO, GREY, settings)
    not_quite = ALBEDO.copy()
    not_quite[-1, 2] += 1e-9
    coloured, expected = solve(not_quite, GREY, settings)
    assert (grey.report["counts"]["channels"], coloured.report["counts"]["channels"]) == (1, 3)
    assert irradiance.shape == expected.shape == (48, 3)
    assert grey.radiosity.shape == coloured.radiosity.shape
    for one, three in ((irradiance, expected), (grey.radiosity, coloured.radiosity)):
        assert three.max() > 0.1
        assert (one == one[:, :1]).all()
        assert one[:, :2] == pytest.approx(three[:, :2], rel=1e-12, abs=0)
        assert (one[:, 2] != three[:, 2]).any()
    # The direct method is not measured.
    if settings.method != "direct":
        measured, expected = (solution.report["error"]["measured_rms"] for solution in (grey, coloured))
        assert measured == pytest.approx(expected, rel=1e-6)


@EACH
def test_a_grey_solution_is_relit_in_colours_and_back(settings):
    grey, before = solve(ALBEDO, GREY, settings)
    expected = solve(ALBEDO, COLOURED, settings)[1]
    coloured = grey.relight(emission=COLOURED)
    assert coloured.report["counts"]["channels"] == 3
    assert np.ptp(expected, axis=1).min() > 0
    assert coloured.irradiance(*POINTS) == pytest.approx(expected, rel=1e-9, abs=0)
    back = coloured.relight(emission=GREY)
    assert back.report["counts"]["channels"] == 1
    assert back.irradiance(*POINTS) == pytest.approx(before, rel=1e-12, abs=0)


@pytest.mark.parametrize("settings", [SMALL, fmm_core.Settings(particles=200, method="fmm")], ids=["direct", "fmm"])
def test_coloured_lamps_and_skies_make_three_channels_and_grey_ones_do_not(settings):
    gradient = np.linspace(0.5, 1.5, 8)[:, None, None] * np.ones((8, 16, 3))
    lamp = fmm_core.PointLight((0.5, 0.5, 0.9), 2.0, radius=0.05)
    coloured_lamp = fmm_core.PointLight((0.5, 0.5, 0.9), (2.0, 1.0, 0.5), radius=0.05)
    scene = fmm_core.Scene(TRIANGLES[2:], 0.6, 0.0, lights=[lamp], sky=fmm_core.Sky(gradient))
    grey = fmm_core.solve(scene, settings)
    before = grey.irradiance(*POINTS)
    assert grey.report["counts"]["channels"] == 1
    assert before.min() >= 0
    assert before.max() > 0.1
    assert np.ptp(before, axis=1).max() <= 1e-12 * before.max()
    for change in ({"lights": [coloured_lamp]}, {"sky": fmm_core.Sky(gradient * [1.0, 2.0, 3.0])}):
        coloured = grey.relight(**change)
        assert coloured.report["counts"]["channels"] == 3
        # Red did not change.
        assert coloured.irradiance(*POINTS)[:, 0] == pytest.approx(before[:, 0], rel=1e-9, abs=0)
        assert np.ptp(coloured.irradiance(*POINTS), axis=1).max() > 0.1


@pytest.mark.parametrize("what", ["albedo", "emission"])
def test_one_coloured_triangle_makes_three_channels(what):
    arrays = {"albedo": ALBEDO.copy(), "emission": GREY.copy()}
    arrays[what][0, 1] *= 0.5
    solution = solve(**arrays, settings=SMALL)[0]
    assert solution.report["counts"]["channels"] == 3


def test_no_points_have_three_colours():
    for method in ("direct", "fmm"):
        solution = solve(0.5, 1.0, fmm_core.Settings(particles=200, method=method))[0]
        assert solution.irradiance(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0, 3)


@pytest.mark.parametrize("columns", [0, 2, 4])
def test_other_numbers_of_channels_are_refused(columns):
    points, normals = np.zeros((5, 3)), np.tile([0.0, 0.0, 1.0], (5, 1))
    sources = _binding.Sources(points, normals, np.ones(5), np.ones(5), np.ones(1))
    with pytest.raises(ValueError, match=r"^strengths: expected shape \(N, 1\) or \(N, 3\)$"):
        sources.irradiance(points, normals, np.ones((5, columns)))
