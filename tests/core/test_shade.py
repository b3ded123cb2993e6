# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces that stop the light of lamps and sky, and that of other surfaces, to different shares."""

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import KeptVisibility, Opacity, PointLight, Sky, SunLight
from fmm_core.effects import plan

FLOOR = shapes.quad([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0])
ROOF = shapes.quad([0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1])
HOUSE = np.concatenate([FLOOR, ROOF])
UP = np.broadcast_to([0.0, 0.0, 1.0], (50, 3))
PLACES = np.pad(np.random.default_rng(0).random((50, 2)), ((0, 0), (0, 1)))
SUN = SunLight((0.0, 0.0, -1.0), 2.0)


def irradiance(triangles, method="fmm", **fields):
    scene = fmm_core.Scene(triangles, **fields)
    settings = fmm_core.Settings(method=method, particles=400, probes=0)
    return fmm_core.solve(scene, settings).irradiance(PLACES, UP)[:, 0]


@pytest.mark.parametrize("method", ["fmm", "direct"])
@pytest.mark.parametrize("shade", [[1.0, 1.0, 0.0, 0.0], [0.0] * 4])
def test_light_of_a_lamp_passes_what_does_not_shade_it(method, shade):
    """And is reflected by it all the same: the floor gets what it would get with a lamp that no roof could shade."""
    free = SunLight((0.0, 0.0, -1.0), 2.0, shadows=False)
    fields = {"albedo": 0.5, "two_sided": True}
    found = irradiance(HOUSE, method, lights=[SUN], shade=shade, **fields)
    assert found == pytest.approx(irradiance(HOUSE, method, lights=[free], **fields), rel=1e-6)
    assert found.min() > 2.01
    assert irradiance(HOUSE, method, lights=[SUN], **fields).max() < 1e-6


@pytest.mark.parametrize("method", ["fmm", "direct"])
def test_what_shades_lamps_alone_lets_the_light_of_surfaces_through(method):
    """A roof between a floor and a shining ceiling, with a lamp on either side."""
    triangles = np.concatenate([HOUSE, ROOF + [0, 0, 1]])
    emission, roof = np.repeat([0.0, 0.0, 1.0], 2), np.repeat([1.0, 0.0, 1.0], 2)
    fields = {"albedo": np.repeat([0.5, 0.5, 0.0], 2), "lights": [PointLight((0.5, 0.5, z), 1.0) for z in (1.5, 0.9)]}
    found = irradiance(triangles, method, emission=emission, opacity=roof, shade=1.0, **fields)
    below = irradiance(np.delete(triangles, [2, 3], 0), method, emission=emission[[0, 1, 4, 5]],
                       albedo=[0.5, 0.5, 0.0, 0.0], lights=fields["lights"][1:])  # fmt: skip
    assert found == pytest.approx(below, rel=0.01)
    without = irradiance(triangles, method, emission=emission, opacity=roof, **fields)
    assert (without > 1.2 * found).all()


def test_shade_may_be_a_share_and_have_cells():
    half = irradiance(HOUSE, lights=[SUN], albedo=0.0, shade=[1.0, 1.0, 0.25, 0.25])
    assert half == pytest.approx(1.5, rel=1e-3)
    # The first half of the roof is clear, the other one stops all.
    cells = Opacity(np.ones(4), [0, 0, 1, 1], [0.0, 1.0])
    found = irradiance(HOUSE, lights=[SUN], albedo=0.0, shade=cells)
    assert set(np.round(found, 6)) == {0.0, 2.0}


def test_the_sky_comes_into_a_room_through_what_does_not_shade_it():
    room = shapes.room()
    ceiling = (room[..., 2] == 1).all(axis=1)
    scene = fmm_core.Scene(room, 0.0, sky=Sky(1.0), shade=np.where(ceiling, 0.0, 1.0))
    effects = plan(scene, fmm_core.Settings())
    assert effects["sky"].used
    assert effects["occlusion"].used
    solution = fmm_core.solve(scene, fmm_core.Settings(particles=400, probes=0, rays=2000))
    found = solution.irradiance([[0.5, 0.5, 0.0]], [[0, 0, 1]])[0, 0]
    # Howell, A Catalog of Radiation Heat Transfer Configuration Factors, B-3, of four quarters of the ceiling.
    side = 0.5 / np.sqrt(1.25)
    assert found / np.pi == pytest.approx(4 * (2 * side * np.arctan(side)) / (2 * np.pi), rel=0.01)
    harmonics = solution.harmonics([[0.5, 0.5, 0.0]], [[0, 0, 1]])
    assert fmm_core.irradiance_of(harmonics, np.array([[0.0, 0.0, 1.0]]))[0, 0] == pytest.approx(found, rel=0.03)


def test_other_shade_is_another_scene_and_relight_keeps_it():
    scenes = [fmm_core.Scene(HOUSE + [1e4, 0, 0], 0.5, lights=[SUN], shade=shade) for shade in (0.0, 0.0, 1.0, None)]
    first, same, other, none = scenes
    assert first.same_geometry(same)
    assert not first.same_geometry(other)
    assert not first.same_geometry(none)
    settings, kept, found = fmm_core.Settings(particles=400, probes=0), KeptVisibility(), []
    for scene in (none, first):
        solution = fmm_core.solve(scene, settings, kept=kept)
        found.append(solution.irradiance(PLACES + [1e4, 0, 0], UP)[:, 0])
    assert found[0].max() < 1e-6 < found[1].min()
    brighter = solution.relight(lights=[SunLight((0.0, 0.0, -1.0), 4.0)])
    assert brighter.irradiance(PLACES + [1e4, 0, 0], UP)[:, 0] == pytest.approx(2 * found[1], rel=1e-6)


@pytest.mark.parametrize(
    ("shade", "message"), [([1.0, 1.0], "shade: expected 4 rows"), (2.0, "opacity: triangle 0 is 2"), ("x", "shade")]
)
def test_wrong_shade_is_refused(shade, message):
    with pytest.raises(fmm_core.Error, match=message):
        fmm_core.Scene(HOUSE, lights=[SUN], shade=shade)
