# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames in which something moves: as right as a solve of each alone, by few rays, and only where that is sound."""

from dataclasses import replace

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import moving
from fmm_core.moving import AHEAD, MovedSpace
from fmm_core.progress import silent
from fmm_core.transport import passing
from hypothesis import given
from hypothesis import strategies as st
from test_visibility import ALBEDO, EMISSION, TWO_BLOCKS

ROOM = shapes.finer(TWO_BLOCKS, 3)
BALL = 0.09 * shapes.sphere(1.0, 3)
SETTINGS = fmm_core.Settings(method="fmm", probes=0)
#: Where the ball is in the first frame, and where it goes.
START, STEP = np.array([0.3, 0.3, 0.75]), np.array([0.03, 0.02, 0.0])


def scene(balls, **options):
    """The room with balls at places (K, 3), which move in front of its walls."""
    triangles = np.concatenate([ROOM, *(BALL + place for place in balls)])
    added = len(triangles) - len(ROOM)
    albedo = np.concatenate([np.repeat(ALBEDO, 64, axis=0), np.tile([0.7, 0.2, 0.1], (added, 1))])
    emission = np.concatenate([np.repeat(EMISSION, 64), np.zeros(added)])
    return fmm_core.Scene(triangles, **{"albedo": albedo, "emission": emission, **options})


def points(scene):
    return shapes.random_points(scene.triangles, 1)


def followed(frames, settings=SETTINGS):
    """The solution of each frame, and what its points receive, by what is left of the frames before."""
    solution, found = None, []
    for frame in frames:
        solution = fmm_core.solve(frame, settings, before=solution)
        found.append((solution, solution.irradiance(*points(frame))))
    return found


def off(found, right):
    return np.linalg.norm(found - right) / np.linalg.norm(right)


def rays(solution):
    return solution.report["counts"]["rays"]


@pytest.fixture(scope="module")
def ball():
    """Four frames of a ball that flies on, and each alone."""
    frames = [scene([START + k * STEP]) for k in range(4)]
    return frames, followed(frames), [fmm_core.solve(frame, SETTINGS) for frame in frames]


def test_frames_are_as_right_as_each_alone(ball):
    frames, found, alone = ball
    at = points(frames[3])
    exact = fmm_core.solve(frames[3], replace(SETTINGS, rays=3000, particles=20_000, truncation=6)).irradiance(*at)
    fresh, kept, earlier = alone[3].irradiance(*at), found[3][1], found[2][1]
    moved = np.arange(len(exact)) >= len(ROOM)
    for rows in (moved, ~moved):
        assert off(kept[rows], exact[rows]) < 1.3 * off(fresh[rows], exact[rows])
        assert off(kept[rows], exact[rows]) < 0.3 * off(earlier[rows], exact[rows])


def test_few_rays_are_traced_once_it_is_known_what_moves(ball):
    frames, found, alone = ball
    assert [isinstance(solution.space, MovedSpace) for solution, _ in found] == [False, True, True, True]
    # What moves asks as many as ever, what stays few.
    moving = 1 - len(ROOM) / len(frames[0].triangles)
    for (solution, _), other in zip(found[2:], alone[2:], strict=True):
        assert 0 < rays(solution) < (moving + 0.1) * rays(other)
        assert solution.report["visibility_kept"]


def test_what_is_kept_is_what_is_traced_anew():
    frames = [scene([START + k * STEP]) for k in range(3)]
    last = followed(frames)[-1][0].space
    sums, still = last.sums, last.still
    particles, first = sums.particles, len(still.particles)
    kept, strengths = (
        still.exchange(silent),
        particles.weights[:, None] * np.random.default_rng(0).random((len(particles), 3)),
    )

    def found(boxes):
        correction = kept.among(sums, particles.weights[first:], boxes)
        irradiance = kept.fmm.apply(strengths)[0]
        correction.add(np.ascontiguousarray(strengths[:first]), irradiance)
        return irradiance

    everywhere = [np.array([[-0.1] * 3, [1.1] * 3])]
    tight = moving.boxes_of(frames[2].triangles, still.moves)
    near, right, without = found(tight), found(everywhere), found([])
    # Which of two triangles a ray meets on the edge between them depends on what else there is.
    assert (near != right).any(axis=1).mean() < 0.02
    assert off(near, right) < 1e-4
    assert off(without, right) > 30 * off(near, right)


def test_other_light_needs_no_ray(ball):
    frames, found, _ = ball
    solution = found[-1][0]
    assert solution.serves(frames[3])
    assert not solution.serves(frames[2])
    brighter = solution.relight(emission=2 * frames[3].emission)
    assert rays(brighter) == 0
    assert brighter.irradiance(*points(frames[3])) == pytest.approx(2 * found[-1][1], rel=1e-3)


def test_what_leaves_its_way_or_moves_later_is_followed_as_well():
    far = START + (AHEAD + 2) * STEP
    other = np.array([0.75, 0.2, 0.8])
    frames = [[START, other], [START + STEP, other], [far, other], [far, other + STEP], [far + STEP, other + 2 * STEP]]
    frames = [scene(places) for places in frames]
    for number, (solution, found) in enumerate(followed(frames)):
        at = points(frames[number])
        assert off(found, fmm_core.solve(frames[number], SETTINGS).irradiance(*at)) < 0.02
        assert isinstance(solution.space, MovedSpace) == (number > 0)


CHANGES = {
    "the settings": lambda: (scene([START + STEP]), replace(SETTINGS, rays=100)),
    "an albedo": lambda: (scene([START + STEP], albedo=0.5), SETTINGS),
    "a mesh": lambda: (scene([START + STEP, START + 10 * STEP]), SETTINGS),
    "most of the scene": lambda: (
        fmm_core.Scene(scene([START]).triangles * 1.001, scene([START]).albedo, scene([START]).emission),
        SETTINGS,
    ),
    "what is outside": lambda: (scene([START + [0.0, 0.0, 3.0]]), SETTINGS),
    "transparency": lambda: (scene([START + STEP], opacity=0.5), SETTINGS),
    "a medium": lambda: (scene([START + STEP], medium=0.1), SETTINGS),
    "a target": lambda: (scene([START + STEP]), replace(SETTINGS, target_error=0.05)),
}


@pytest.mark.parametrize("change", CHANGES)
def test_other_changes_make_a_solve_of_its_own(ball, change):
    _, _, alone = ball
    frame, settings = CHANGES[change]()
    found = fmm_core.solve(frame, settings, before=alone[0])
    assert not isinstance(found.space, MovedSpace)
    assert found.irradiance(*points(frame)) == pytest.approx(fmm_core.solve(frame, settings).irradiance(*points(frame)))


def test_a_lamp_of_triangles_that_moves_makes_a_solve_of_its_own(ball):
    frames, _, alone = ball
    triangles = frames[0].triangles.copy()
    triangles[frames[0].emission.any(axis=1)] -= [0.0, 0.0, 0.01]
    moved = fmm_core.Scene(triangles, frames[0].albedo, frames[0].emission)
    assert not alone[0].precedes(moved)


def test_what_comes_before_is_checked():
    with pytest.raises(fmm_core.Error, match="before: expected Solution or None, got str"):
        fmm_core.solve(scene([START]), SETTINGS, before="yesterday")


places = st.tuples(*[st.floats(-2, 2)] * 3)


@given(start=places, end=places, low=places, size=st.tuples(*[st.floats(0, 1)] * 3))
def test_ways_pass_boxes_that_they_have_places_in(start, end, low, size):
    box = np.array([low, np.add(low, size)])
    way = np.linspace(start, end, 101)
    inside = ((way >= box[0]) & (way <= box[1])).all(axis=1).any()
    found = passing(np.array([start]), np.array([end]), [box])[0]
    assert found or not inside
    grown = box + np.array([[-0.05], [0.05]]) * np.linalg.norm(np.subtract(end, start))
    assert not found or ((way >= grown[0]) & (way <= grown[1])).all(axis=1).any()
