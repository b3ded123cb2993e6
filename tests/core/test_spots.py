# SPDX-License-Identifier: GPL-3.0-or-later
"""Spots of lamps that are smaller than patches: of windows, cones, and lamps close to a wall."""

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import PointLight, SpotLight, SunLight, spots
from fmm_core.particles import make_particles
from fmm_core.patch_lamps import PatchLamps
from fmm_core.visibility import Occlusion


def solve(triangles, settings, *lamps):
    return fmm_core.solve(fmm_core.Scene(triangles, 0.5, lights=lamps), settings)


@pytest.mark.parametrize("distance", [0.3, 0.1, 0.03])
def test_a_lamp_near_a_wall_sends_on_all_its_light_however_small_its_spot(distance):
    room = shapes.room((4, 4, 3)) - [2, 2, 0]
    # A quarter of a metre from particle to particle.
    lamp = PointLight((0.31, 0.23, 3 - distance), 1 / (4 * np.pi))
    solution = solve(room, fmm_core.Settings(particles=1500, probes=0), lamp)
    assert (solution.particles.weights * solution.radiosity[:, 0]).sum() == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize("size", [0.2, 0.08])
@pytest.mark.parametrize("particles", [None, 3000])
@pytest.mark.parametrize("angle", [0.0, 0.01])
def test_what_comes_in_at_a_window_is_what_arrives(size, particles, angle):
    sun = SunLight((-0.7, 0.07, -0.6), 10.0, angle)
    solution = solve(window_room(size), fmm_core.Settings(method="fmm", particles=particles, probes=0), sun)
    # Away from the window, whose rim takes some of what comes askew.
    particles, inside = solution.particles, solution.particles.positions[:, 0] < 0.99
    arrived = (particles.weights * solution._exchange.direct(solution._planned)[:, 0])[inside].sum()
    assert 0.98 < arrived / (-10.0 * sun.direction[0] * size**2) < 1.005


def window_room(size):
    """A room lit by what comes in at a square window in its wall at x = 1."""
    low, high = 0.5 - size / 2, 0.5 + size / 2
    parts = [(0, low, 0, 1), (high, 1, 0, 1), (low, high, 0, low), (low, high, high, 1)]
    wall = [shapes.quad([1, y, z], [1, y, top], [1, right, top], [1, right, z]) for y, right, z, top in parts]
    room = shapes.room()
    return np.concatenate([room[~(room[:, :, 0] == 1).all(axis=1)], *wall])


def test_a_corner_beside_a_spot_gets_its_light_from_the_lit_side(monkeypatch):
    # The spot goes from the floor up the wall at x = 0; the points are on that wall, just beside it.
    y = np.linspace(0.34, 0.372, 33)
    at = np.column_stack([0 * y, y, 0 * y + 1e-3]), np.tile([1.0, 0.0, 0.0], (len(y), 1))
    sun = SunLight((-2.0, 0.02, -1.0), 10.0, 0.01)

    def received(particles):
        settings = fmm_core.Settings(method="fmm", particles=particles, probes=0)
        return solve(window_room(0.25), settings, sun).irradiance(*at)

    exact, few = received(150_000), received(4000)
    monkeypatch.setattr(spots, "CUTS", 0)
    off = [np.linalg.norm(found - exact) for found in (few, received(4000), received(40_000))]
    assert off[0] < 0.6 * min(off[1:])


@pytest.mark.parametrize("angle", [0.1, 0.3])
def test_a_cone_that_is_narrower_than_a_patch_sends_on_all_its_light(angle):
    room = shapes.room((4, 4, 3)) - [2, 2, 0]
    lamp = SpotLight((0.31, 0.23, 2.5), 1.0, angle=angle, blend=0.0)
    solution = solve(room, fmm_core.Settings(particles=1500, probes=0), lamp)
    # Radiosity at an albedo of 0.5 is what was absorbed.
    absorbed = (solution.particles.weights * solution.radiosity[:, 0]).sum()
    assert absorbed == pytest.approx(2 * np.pi * (1 - np.cos(angle / 2)), rel=0.02)


def test_a_spot_of_a_fiftieth_of_a_patch_is_found():
    triangles = shapes.quad([-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0])
    scene = fmm_core.Scene(triangles, 0.5, 1.0)
    patches = PatchLamps(make_particles(scene, 2, 1), Occlusion(scene), 300)
    radius = np.sqrt(2 / 50 / np.pi)
    angle = 2 * np.arctan(radius / 3)
    places = np.random.default_rng(0).uniform(0.3, 0.7, (100, 2))
    lamps = [SpotLight((x, -y, 3.0), 1.0, radius=0.01, angle=angle, blend=0.0) for x, y in places]
    found = [patches.divided(lamp, np.arange(2)).any() for lamp in lamps]
    assert np.mean(found) > 0.98


@pytest.mark.parametrize("particles", [1200, 4000])
def test_patches_that_are_cut_small_send_on_all_their_light(particles):
    triangles = np.concatenate([shapes.room(), 0.2 * shapes.room()[:, ::-1] + [0.7, 0.7, 0.1]])
    lamp = SpotLight((0.31, 0.23, 0.9), 1.0, angle=0.3, blend=0.0)
    solution = solve(triangles, fmm_core.Settings(method="fmm", particles=particles, probes=0), lamp)
    absorbed = (solution.particles.weights * solution.radiosity[:, 0]).sum()
    assert absorbed == pytest.approx(2 * np.pi * (1 - np.cos(0.15)), rel=0.01)
