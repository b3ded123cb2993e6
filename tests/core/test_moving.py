# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames in which something moves: as right as a solve of each alone, by few rays, and only where that is sound."""

from dataclasses import replace

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core.balance import ALL_RAYS, MOST_RAYS
from fmm_core.moving import AHEAD, Kept, MovedSpace, Now
from fmm_core.progress import silent
from fmm_core.transport import passing
from hypothesis import example, given
from hypothesis import strategies as st
from test_visibility import LAMP, block

EMPTY = shapes.finer(np.concatenate([shapes.room(), LAMP]), 3)
ROOM = np.concatenate([EMPTY, shapes.finer(block([0.55, 0.2, 0.2], [0.8, 0.45, 0.5]), 2)])
BALL = 0.09 * shapes.sphere(1.0, 3)
SETTINGS = fmm_core.Settings(method="fmm", probes=0)
#: Where the ball is in the first frame, and where it goes.
START, STEP = np.array([0.3, 0.4, 0.3]), np.array([0.04, 0.05, 0.0])


def scene(balls, **options):
    """The room with balls at places (K, 3), which move in front of its walls."""
    mesh = np.concatenate([np.zeros((0, 3, 3)), *(BALL + place for place in balls)])
    return with_mesh(ROOM, mesh, **options)


def with_mesh(room, mesh, **options):
    """Walls, two of which are red and the seventh a lamp, each cut in 128, and a mesh (K, 3, 3)."""
    triangles = np.concatenate([room, mesh])
    wall = np.arange(len(triangles)) // 128
    albedo = np.where(wall[:, None] < 2, [0.7, 0.3, 0.2], [0.6, 0.6, 0.6])
    return fmm_core.Scene(triangles, **{"albedo": albedo, "emission": np.where(wall == 6, 10.0, 0.0)} | options)


def flying(k, **options):
    return with_mesh(EMPTY, BALL + START + k * STEP, **options)


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


def truly_off(found, exact, rows):
    """The same by two independent estimates (2, M, 3) of what is right, at some of the rows."""
    one, other = exact[:, rows]
    return np.sqrt(max(0.0, ((found[rows] - one) * (found[rows] - other)).sum()) / (one * other).sum())


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
    exact = alone[3].estimates(*at, 1000, 100_000)
    fresh, kept, earlier = alone[3].irradiance(*at), found[3][1], found[0][1]
    moved = np.arange(len(kept)) >= len(ROOM)
    for rows in (moved, ~moved):
        assert truly_off(kept, exact, rows) < 1.3 * truly_off(fresh, exact, rows)
    # The shadow has moved on by more than it is wide.
    left = ~moved & (np.linalg.norm(earlier - kept, axis=1) > 0.2 * np.linalg.norm(kept, axis=1))
    assert np.count_nonzero(left) > 20
    assert truly_off(kept, exact, left) < 0.3 * truly_off(earlier, exact, left)


def test_few_rays_are_traced_once_it_is_known_what_moves(ball):
    frames, found, alone = ball
    assert [isinstance(solution.space, MovedSpace) for solution, _ in found] == [False, True, True, True]
    for solution, frame in zip(alone, frames, strict=True):
        solution.irradiance(*points(frame))
    # What stays is found in the second frame.
    assert rays(found[1][0]) > rays(alone[1])
    # What moves asks as many as ever, what stays few, but for what all particles see, which is told anew.
    moving = 1 - len(ROOM) / len(frames[0].triangles)

    def others(solution):
        return rays(solution) - sum(min(ALL_RAYS, MOST_RAYS * n) for n in np.bincount(solution.particles.emits))

    for (solution, _), other in zip(found[2:], alone[2:], strict=True):
        assert 0 < others(solution) < (moving + 0.1) * others(other)
        assert solution.report["visibility_kept"]


#: Where a ball flies in the open, close under the lamp, and on the floor.
WAYS = {"open": START, "lamp": np.array([0.5, 0.5, 0.89]), "floor": np.array([0.3, 0.6, 0.09])}


@pytest.mark.parametrize("way", WAYS)
def test_what_is_kept_is_what_is_traced_anew(way):
    frames = [scene([WAYS[way] + k * STEP]) for k in range(3)]
    last = followed(frames)[-1][0].space
    sums, kept = last.sums, last.still.exchange(silent)
    particles, first = sums.particles, len(last.still.particles)
    strengths = particles.weights[:, None] * np.random.default_rng(0).random((len(particles), 3))

    def found(boxes):
        correction = kept.among(Now(object(), sums, particles.weights[first:], boxes))
        irradiance = kept.fmm.apply(strengths)[0]
        correction.add(np.ascontiguousarray(strengths[:first]), irradiance)
        return irradiance

    everywhere = [np.array([[-0.1] * 3, [1.1] * 3])]
    tight = last._now.boxes
    near, right, without = found(tight), found(everywhere), found([])
    # Which of two triangles a ray meets on the edge between them depends on what else there is.
    assert (near != right).any(axis=1).mean() < 0.02
    assert off(near, right) < 1e-4
    assert off(without, right) > 30 * off(near, right)
    # Back to nothing, as before anything moved, and once more.
    before = Kept(last.still._space, None, kept.rays, silent)
    irradiance = before.fmm.apply(strengths[:first])[0]
    before._near.correction(before._sources).add(np.ascontiguousarray(strengths[:first]), irradiance)
    assert (found([]) == without).all()
    assert off(without, irradiance) < 1e-12
    assert (found(tight) == near).all()


def test_other_light_needs_no_ray(ball):
    frames, found, _ = ball
    solution = found[-1][0]
    assert solution.serves(frames[3])
    assert not solution.serves(frames[2])
    brighter = solution.relight(emission=2 * frames[3].emission)
    assert rays(brighter) == 0
    assert brighter.irradiance(*points(frames[3])) == pytest.approx(2 * found[-1][1], rel=1e-3)


def test_what_leaves_its_way_or_moves_later_is_followed_as_well():
    start, step, other = np.array([0.3, 0.3, 0.75]), np.array([0.03, 0.02, 0.0]), np.array([0.75, 0.2, 0.8])
    far = start + (AHEAD + 2) * step
    ways = [[start, other], [start + step, other], [far, other], [far, other + step], [far + step, other + 2 * step]]
    frames = [with_mesh(EMPTY, np.concatenate([BALL + place for place in places])) for places in ways]
    for number, (solution, found) in enumerate(followed(frames)):
        assert isinstance(solution.space, MovedSpace) == (number > 0)
        if number in (2, 4):
            right = fmm_core.solve(frames[number], SETTINGS).irradiance(*points(frames[number]))
            assert off(found, right) < 0.02


def turned(k):
    """A box that turns in place."""
    angle = 0.2 * k
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return shapes.finer(block([-0.1, -0.1, -0.1], [0.1, 0.1, 0.1]), 2) @ turn.T + [0.5, 0.7, 0.4]


def swelling(k):
    """A ball whose upper half grows, while the lower one stays."""
    ball = BALL.copy()
    ball[..., 2] *= np.where(ball[..., 2] > 0, 1 + 0.2 * k, 1.0)
    return ball + START


#: What moves by itself in the room, from frame to frame, and whether it has two sides.
MOVERS = {
    "turns in place": (turned, False),
    "changes its shape": (swelling, False),
    "stands on the floor": (lambda k: shapes.finer(block([0.5, 0.6, 0.0], [0.7, 0.8, 0.3]), 2) + k * STEP, False),
    "parts the floor": (lambda k: shapes.finer(block([0.45, 0.2, 0.0], [0.47, 0.8, 0.4]), 2) + k * STEP / 8, False),
    "is a sheet": (lambda k: shapes.finer(shapes.quad(*SHEET), 3) + k * STEP, True),
}
SHEET = [0.4, 0.3, 0.6], [0.6, 0.3, 0.7], [0.6, 0.5, 0.7], [0.4, 0.5, 0.6]


@pytest.mark.parametrize("mover", MOVERS)
def test_all_that_moves_is_as_right_as_alone(mover):
    make, two_sided = MOVERS[mover]
    sides = np.arange(len(EMPTY) + len(make(0))) >= (len(EMPTY) if two_sided else np.inf)
    frames = [with_mesh(EMPTY, make(k), two_sided=sides) for k in range(3)]
    solution, found = followed(frames)[-1]
    assert isinstance(solution.space, MovedSpace)
    at = points(frames[-1])
    alone = fmm_core.solve(frames[-1], SETTINGS)
    exact, everywhere = alone.estimates(*at, 500, 50_000), slice(None)
    assert truly_off(found, exact, everywhere) < 1.3 * truly_off(alone.irradiance(*at), exact, everywhere)


def test_what_moves_all_over_an_empty_room_throws_its_shadow():
    frames = [with_mesh(EMPTY, BALL + at) for at in (0.0905, 0.2, 0.6)]
    solution, found = followed(frames)[-1]
    assert isinstance(solution.space, MovedSpace)
    assert (np.array(solution.space.still.boxes[0]) == [[0.0] * 3, [1.0] * 3]).all()
    at = points(frames[-1])
    alone, before = (fmm_core.solve(frame, SETTINGS).irradiance(*at) for frame in (frames[-1], frames[0]))
    assert off(found, alone) < 0.03
    assert off(found, alone) < 0.2 * off(before, alone)


def test_a_frame_in_which_nothing_moves_is_solved_like_any(ball):
    frames, found, alone = ball
    at = points(frames[3])
    assert not alone[0].precedes(frames[0])
    again = fmm_core.solve(frames[0], SETTINGS, before=alone[0])
    assert off(again.irradiance(*points(frames[0])), alone[0].irradiance(*points(frames[0]))) < 1e-9
    again = fmm_core.solve(frames[3], SETTINGS, before=found[3][0])
    assert off(again.irradiance(*at), found[3][1]) < 1e-9
    assert rays(again) < rays(alone[3])


def test_a_solution_can_be_asked_after_the_next_frame_was_made_from_it():
    frames = [flying(k) for k in range(4)]
    found = followed(frames)
    for seed, number in enumerate((1, 2, 1)):
        (solution, irradiance), at = found[number], points(frames[number])
        others = shapes.random_points(frames[2].triangles, 2, seed)
        assert off(solution.irradiance(*at), irradiance) < 1e-6
        relit = solution.relight(2 * frames[number].emission)
        assert off(relit.irradiance(*at), 2 * irradiance) < 1e-3
        assert np.isfinite(solution.irradiance(*others)).all()


def test_any_points_may_be_asked_for(ball):
    frames, found, alone = ball
    frame, followed_one, other = frames[2], found[2][0], alone[2]
    stay = points(scene([]))
    for at in (stay, shapes.random_points(frame.triangles, 2, seed=1), points(scene([START])), stay):
        found_there, right = followed_one.irradiance(*at), other.irradiance(*at)
        inside = np.linalg.norm(at[0] - START - 2 * STEP, axis=1) < 0.09
        assert off(found_there[~inside], right[~inside]) < 0.02
    with pytest.raises(fmm_core.Error, match="points: row 0"):
        followed_one.irradiance(np.full((1, 3), np.nan), [[0.0, 0.0, 1.0]])
    assert followed_one.irradiance(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0, 3)


def test_other_points_are_followed_from_the_next_frame_on():
    solution, traced = None, []
    for k in range(4):
        frame = scene([START + k * STEP])
        solution = fmm_core.solve(frame, SETTINGS, before=solution)
        before, at = rays(solution), shapes.random_points(frame.triangles, 1, seed=min(k, 1))
        found = solution.irradiance(*at)
        traced.append(rays(solution) - before)
    assert off(found, fmm_core.solve(frame, SETTINGS).irradiance(*at)) < 0.02
    assert 0 < traced[3] < 0.5 * traced[0] < traced[2]


def test_light_from_all_sides_and_gloss_are_found_after_a_move(ball):
    frames, found, alone = ball
    at = points(frames[2])
    one, other = (solution.harmonics(*at) for solution in (found[2][0], alone[2]))
    assert off(one, other) < 0.02
    gloss = fmm_core.Gloss(np.array([0.5, 0.5, 0.8]) - at[0], np.full((len(at[0]), 3), 0.2), facing=0.5, roughness=0.3)
    glossy = [scene([START + k * STEP], glossy=len(at[0])) for k in (1, 2)]
    solution = fmm_core.solve(glossy[1], SETTINGS, before=fmm_core.solve(glossy[0], SETTINGS))
    assert isinstance(solution.space, MovedSpace)
    shown, right = (
        one.radiance(*at, gloss, one.irradiance(*at)) for one in (solution, fmm_core.solve(glossy[1], SETTINGS))
    )
    assert off(shown, right) < 0.02


def test_the_error_is_measured_after_a_move(ball):
    frames, _, alone = ball
    at, settings = points(frames[2]), replace(SETTINGS, probes=1000)
    solution = fmm_core.solve(frames[2], settings, before=fmm_core.solve(frames[1], settings))
    assert isinstance(solution.space, MovedSpace)
    irradiance, exact = solution.irradiance(*at), alone[2].estimates(*at, 500, 50_000)
    error = solution.report["error"]
    assert error["low"] / 1.5 < truly_off(irradiance, exact, slice(None)) < 1.5 * error["high"]


def test_other_points_can_be_asked_apart(ball):
    frames, found, alone = ball
    others = shapes.random_points(frames[2].triangles, 1, seed=1)
    traced = rays(found[2][0])
    assert off(found[2][0].apart().irradiance(*others), alone[2].irradiance(*others)) < 0.02
    assert rays(found[2][0]) == traced


def test_lamps_and_sky_throw_the_shadows_of_a_new_solve():
    lights = [fmm_core.PointLight((0.2, 0.2, 0.9), 3.0, radius=0.05)]
    unlit = {"emission": 0.0, "albedo": 0.0, "lights": lights, "sky": fmm_core.Sky(1.0)}
    frames = [scene([START + k * STEP], **unlit) for k in range(3)]
    found = followed(frames)
    assert isinstance(found[-1][0].space, MovedSpace)
    at = points(frames[-1])
    right = fmm_core.solve(frames[-1], SETTINGS).irradiance(*at)
    # Single rays pass through edges.
    assert (np.abs(found[-1][1] - right) > 1e-6 * right.max()).any(axis=1).mean() < 0.01
    assert off(found[-1][1], right) < 1e-3
    assert off(found[-2][1][: len(ROOM)], right[: len(ROOM)]) > 0.01
    lit = [scene([START + k * STEP], **unlit | {"albedo": 0.5}) for k in range(3)]
    assert off(followed(lit)[-1][1], fmm_core.solve(lit[-1], SETTINGS).irradiance(*at)) < 0.02


def test_far_from_the_origin_frames_are_as_right():
    away = np.array([1000.0, -2000.0, 500.0])
    frames = [with_mesh(ROOM + away, BALL + START + k * STEP + away) for k in range(3)]
    at = points(frames[-1])
    assert off(followed(frames)[-1][1], fmm_core.solve(frames[-1], SETTINGS).irradiance(*at)) < 0.02


def scaled(k):
    """The same in which all that stays has moved a little, too."""
    return fmm_core.Scene(1.001 * flying(k).triangles, flying(k).albedo, flying(k).emission)


CHANGES = {
    "the settings": lambda: (flying(1), replace(SETTINGS, rays=100)),
    "an albedo": lambda: (flying(1, albedo=0.5), SETTINGS),
    "a mesh": lambda: (with_mesh(EMPTY, np.concatenate([BALL + START, BALL + START + 4 * STEP])), SETTINGS),
    "most of the scene": lambda: (scaled(1), SETTINGS),
    "what is outside": lambda: (with_mesh(EMPTY, BALL + [0.3, 0.4, 3.0]), SETTINGS),
    "transparency": lambda: (flying(1, opacity=0.5), SETTINGS),
    "a medium": lambda: (flying(1, medium=0.1), SETTINGS),
    "a target": lambda: (flying(1), replace(SETTINGS, target_error=0.05)),
}


@pytest.fixture(scope="module")
def first():
    return fmm_core.solve(flying(0), SETTINGS)


@pytest.mark.parametrize("change", CHANGES)
def test_other_changes_make_a_solve_of_its_own(first, change):
    frame, settings = CHANGES[change]()
    found = fmm_core.solve(frame, settings, before=first)
    assert not isinstance(found.space, MovedSpace)
    assert found.irradiance(*points(frame)) == pytest.approx(fmm_core.solve(frame, settings).irradiance(*points(frame)))


def test_what_touches_most_of_the_scene_makes_a_solve_of_its_own():
    flat = np.concatenate([shapes.room((1.0, 1.0, 0.2)), LAMP - [0.0, 0.0, 0.8]])
    box = block([0.2, 0.2, 0.0], [0.3, 0.3, 0.1])
    standing, hanging = (
        [
            fmm_core.Scene(np.concatenate([flat, box + at]), 0.6, np.arange(26) // 2 == 6)
            for at in ([0.0, 0.0, height], [0.05, 0.0, height])
        ]
        for height in (0.0, 0.05)
    )
    for frames, follows in ((standing, False), (hanging, True)):
        first = fmm_core.solve(frames[0], SETTINGS)
        assert first.precedes(frames[1])
        assert isinstance(fmm_core.solve(frames[1], SETTINGS, before=first).space, MovedSpace) == follows


def test_a_lamp_of_triangles_that_moves_makes_a_solve_of_its_own(first):
    triangles = first.scene.triangles.copy()
    triangles[first.scene.emission.any(axis=1)] -= [0.0, 0.0, 0.01]
    assert not first.precedes(fmm_core.Scene(triangles, first.scene.albedo, first.scene.emission))


def test_what_comes_before_is_checked():
    with pytest.raises(fmm_core.Error, match="before: expected Solution or None, got str"):
        fmm_core.solve(scene([START]), SETTINGS, before="yesterday")


places = st.tuples(*[st.floats(-2, 2)] * 3)


@example(start=(0.0, 0.0, 0.0), end=(0.0, 2.225073858507e-311, 0.0), low=(0.0, 0.0, 0.0), size=(0.0, 1.0, 0.0))
@given(start=places, end=places, low=places, size=st.tuples(*[st.floats(0, 1)] * 3))
def test_ways_pass_boxes_that_they_have_places_in(start, end, low, size):
    box = np.array([low, np.add(low, size)])
    way = np.linspace(start, end, 101)
    inside = ((way >= box[0]) & (way <= box[1])).all(axis=1).any()
    found = passing(np.array([start]), np.array([end]), [box])[0]
    assert found or not inside
    grown = box + np.array([[-0.05], [0.05]]) * np.linalg.norm(np.subtract(end, start))
    assert not found or ((way >= grown[0]) & (way <= grown[1])).all(axis=1).any()
