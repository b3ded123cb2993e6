# SPDX-License-Identifier: GPL-3.0-or-later
"""Nobody receives more than a hemisphere holds, nobody sends more than he has, and closed rooms lose nothing."""

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core.balance import find_shares, is_closed, is_watertight, looks_closed
from fmm_core.particles import make_particles
from fmm_core.visibility import Occlusion

ROOM = shapes.room()
#: Its fronts look out.
BLOCK = shapes.room((0.4, 0.3, 0.5))[:, ::-1] + [0.3, 0.4, 0.0]
WINDOW = np.concatenate([ROOM[:-2], shapes.quad([0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1])[:1]])


def by_all(occlusion, particles):
    return is_closed(find_shares(occlusion, particles))


@pytest.mark.parametrize("tell", [by_all, looks_closed])
def test_a_room_is_closed_with_a_block_in_it_and_open_through_a_window(tell):
    def closed(triangles):
        scene = fmm_core.Scene(triangles, 0.5, 1.0)
        return tell(Occlusion(scene), make_particles(scene, 6000, 1))

    assert closed(ROOM)
    assert closed(np.concatenate([ROOM, BLOCK]))
    assert not closed(WINDOW)
    # A slit of a two-hundredth of a wall.
    slit = np.concatenate([ROOM[:-2], shapes.quad([0, 0, 1], [0, 1, 1], [0.995, 1, 1], [0.995, 0, 1])])
    assert not closed(slit)
    assert not closed(np.concatenate([BLOCK, BLOCK + [1.0, 0, 0]]))


def test_a_mesh_is_watertight_by_its_edges():
    assert is_watertight(ROOM * (1 + 1e-15 * np.random.default_rng(0).uniform(-1, 1, ROOM.shape)))
    assert is_watertight(shapes.sphere(1.0, 2, inward=True) + 3.0)
    for open_one in (WINDOW, BLOCK, ROOM[:-1], shapes.sphere(1.0, 2)):
        assert not is_watertight(open_one)


@pytest.mark.parametrize("method", ["direct", "fmm"])
def test_a_window_still_lets_light_out(method):
    settings = fmm_core.Settings(method=method, probes=0)
    half = ROOM[:-1]
    lost = {}
    for name, room in (("room", ROOM), ("window", half)):
        solution = fmm_core.solve(fmm_core.Scene(room, 0.9, 1.0), settings)
        lost[name] = 10 - np.average(solution.radiosity[:, 0], weights=solution.particles.weights)
    # A twelfth of the area is gone: a chance of 1/12 to leave at each bounce makes about 1 / (1 - 0.9 * 11 / 12).
    assert abs(lost["room"]) < 1e-3
    assert 10 - lost["window"] == pytest.approx(1 / (1 - 0.9 * 11 / 12), rel=0.03)


@pytest.mark.parametrize("method", ["direct", "fmm"])
def test_meshes_that_run_through_each_other_do_not_make_light_grow(method):
    rng = np.random.default_rng(5)
    pieces = [ROOM] + [shapes.room((0.5, 0.4, 0.6))[:, ::-1] + rng.uniform(0, 0.5, 3) for _ in range(4)]
    triangles = np.concatenate(pieces)
    # A room of radiosity 1 / (1 - 0.999), with blocks that shine less: nothing in it is brighter.
    emission = np.where(np.arange(len(triangles)) < len(ROOM), 1.0, 0.5)
    settings = fmm_core.Settings(method=method, particles=600, probes=0)
    solution = fmm_core.solve(fmm_core.Scene(triangles, 0.999, emission), settings)
    assert solution.report["warnings"] == []
    assert solution.radiosity.max() <= 1000 * (1 + 1e-3)


def test_a_large_patch_does_not_take_a_small_lamp_for_its_own_size():
    floor = shapes.quad([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0])
    # Face down, just above the only point of a patch.
    lamp = 1e-3 * shapes.quad([-1, -1, 0], [-1, 1, 0], [1, 1, 0], [1, -1, 0])
    settings = fmm_core.Settings(method="direct", particles=8, quadrature=1, probes=0)
    emission = np.array([0, 0, 1.0, 1.0])
    apart = fmm_core.solve(fmm_core.Scene(np.concatenate([floor, lamp + [0.5, 0.5, 9]]), 0.0, emission), settings)
    below = apart.particles.positions[apart.particles.triangle == 0][0] + [0, 0, 3e-4]
    solution = fmm_core.solve(fmm_core.Scene(np.concatenate([floor, lamp + below]), 0.5, emission), settings)
    particles = solution.particles
    received = particles.weights * solution.irradiance(particles.positions, particles.normals)[:, 0]
    exchanged = particles.weights * (solution.radiosity[:, 0] - emission[particles.triangle]) / 0.5
    assert received.sum() > 100 * 4e-6
    assert exchanged.sum() <= 4e-6 * 1.06


@pytest.mark.parametrize("method", ["direct", "fmm"])
def test_what_is_sent_across_a_narrow_gap_is_what_arrives(method):
    low = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    # Four times as many patches on the other side, whose middle one has its point right above.
    ab, bc, ca = (low + np.roll(low, -1, axis=0)) / 2
    a, b, c = low
    high = np.array([[a, ca, ab], [b, ab, bc], [c, bc, ca], [ab, ca, bc]]) + [0, 0, 4e-4]
    settings = fmm_core.Settings(method=method, particles=1, quadrature=1, probes=0, effects={"occlusion": True})
    solution = fmm_core.solve(fmm_core.Scene(np.concatenate([low[None], high]), 0.5, 1.0), settings)
    operator, weights = solution._exchange.operator, solution.particles.weights
    operator._received = operator._sent = 1.0
    arrives = [weights @ operator.apply(one[:, None])[:, 0] for one in np.diag(1 / weights)]
    sent = operator._mirrored(weights[:, None])[:, 0] + operator._correction.sent(weights)
    assert sent == pytest.approx(np.array(arrives), abs=1e-6)


@pytest.mark.parametrize("method", ["direct", "fmm"])
def test_walls_that_are_there_twice_are_as_bright_as_once(method):
    # Three walls once more, cut along the other diagonal, so that no triangle is there twice.
    again = ROOM[:6].reshape(3, 2, 3, 3)
    a, b, c, d = again[:, 0, 0], again[:, 0, 1], again[:, 0, 2], again[:, 1, 2]
    doubled = np.concatenate([np.stack([b, c, d], axis=1), np.stack([b, d, a], axis=1)])
    lamp = shapes.quad([0.3, 0.3, 0.6], [0.3, 0.7, 0.6], [0.7, 0.7, 0.6], [0.7, 0.3, 0.6])
    light = {}
    for name, walls in (("once", ROOM), ("twice", np.concatenate([ROOM, doubled]))):
        triangles = np.concatenate([walls, lamp])
        emission = (np.arange(len(triangles)) >= len(walls)).astype(float)
        scene = fmm_core.Scene(triangles, 0.6, emission, two_sided=emission > 0)
        solution = fmm_core.solve(scene, fmm_core.Settings(method=method, particles=1200, probes=0))
        assert len(solution.scene.triangles) == len(triangles)
        light[name] = solution.irradiance(*shapes.random_points(ROOM, 10))
        received = solution.received * solution.particles.weights[:, None]
        light[name + " in all"] = received.sum()
    assert np.linalg.norm(light["twice"] - light["once"]) <= 0.02 * np.linalg.norm(light["once"])
    assert light["twice in all"] == pytest.approx(light["once in all"], rel=0.01)
