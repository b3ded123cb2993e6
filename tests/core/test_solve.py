# SPDX-License-Identifier: GPL-3.0-or-later
"""The solve as a whole: linearity, symmetry, progress, cancelling, reports."""

import json

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core.particles import make_particles
from fmm_core.solver import FEW_PARTICLES
from fmm_core.transport import Operator
from hypothesis import example, given, settings
from hypothesis import strategies as st

CUBE = shapes.room()
SMALL = fmm_core.Settings(particles=300)


def test_light_is_linear_in_emission_and_colours_do_not_mix():
    emission = np.linspace([0.0, 1.0, 2.0], [1.0, 0.0, 3.0], 12)
    points = shapes.random_points(CUBE, 3)
    tight = fmm_core.Settings(particles=300, tolerance=1e-9)
    together = fmm_core.solve(fmm_core.Scene(CUBE, 0.6, emission), tight).irradiance(*points)
    for colour in range(3):
        alone = fmm_core.solve(fmm_core.Scene(CUBE, 0.6, 7 * emission[:, colour]), tight).irradiance(*points)
        assert alone == pytest.approx(7 * together[:, [colour] * 3], rel=1e-6)


@settings(max_examples=25, deadline=None)
@given(
    axis=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda a: np.linalg.norm(a) > 0.1),
    angle=st.floats(0, 6.3),
    shift=st.tuples(*[st.floats(-10, 10)] * 3),
    scale=st.floats(1e-2, 1e2),
)
@example(axis=(0.0, 0.0, 1.0), angle=5e-324, shift=(0.0, 0.0, 0.0), scale=1.0)
@example(axis=(1.0, 0.0, 0.0), angle=3.5, shift=(0.0, 0.0, 0.0), scale=1.0)
def test_result_is_the_same_after_moving_turning_and_scaling_the_scene(axis, angle, shift, scale):
    block = shapes.room((0.4, 0.3, 0.2))[:, ::-1] + [0.35, 0.35, 0.2]
    triangles = np.concatenate([CUBE, block])
    emission = np.where(np.arange(24) == 0, 1.0, 0.0)
    a = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.cross(np.eye(3), a)
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    points, normals = shapes.random_points(CUBE, 4)

    def move(x):
        return scale * (x @ turn) + shift

    before = fmm_core.solve(fmm_core.Scene(triangles, 0.5, emission), SMALL).irradiance(points, normals)
    moved = fmm_core.solve(fmm_core.Scene(move(triangles), 0.5, emission), SMALL)
    after = moved.irradiance(move(points), normals @ turn)
    # Rays that graze an edge of the block, as many do at once when turned about x, may fall on the other side of it.
    different = np.abs(after - before)[:, 0] > 1e-2 * before[:, 0]
    assert different.mean() < 0.1
    assert np.linalg.norm(after - before) < 5e-3 * np.linalg.norm(before)


@pytest.mark.parametrize("per_side", [7, 10])
def test_nothing_comes_of_rounding(per_side):
    block = shapes.room((0.4, 0.3, 0.2))[:, ::-1] + [0.35, 0.35, 0.0]
    triangles = np.concatenate([shapes.subdivided_room(per_side), block])
    emission = (np.arange(len(triangles)) < 9).astype(float)
    _, vertices = np.unique(triangles.reshape(-1, 3).round(9), axis=0, return_inverse=True)
    rng = np.random.default_rng(0)

    def bake(rounding):
        moved = triangles * (1 + rounding * rng.uniform(-1, 1, triangles.shape))
        centres = np.repeat(moved.mean(axis=1), 3, axis=0)
        normals = np.repeat(shapes.normals(moved), 3, axis=0)
        out = fmm_core.output_points(moved.reshape(-1, 3), normals, vertices.ravel(), centres)
        solution = fmm_core.solve(fmm_core.Scene(moved, 0.7, emission))
        return solution.radiosity, solution.irradiance(out.points, out.normals)

    for exact, rounded in zip(bake(0.0), bake(1e-15), strict=True):
        assert exact.max() > 0.1
        assert rounded == pytest.approx(exact, abs=1e-6, rel=0)


def test_two_sided_triangle_lights_both_sides():
    plate = shapes.quad([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0])
    above = fmm_core.solve(fmm_core.Scene(plate, 0.0, 1.0, two_sided=True), SMALL)
    below = fmm_core.solve(fmm_core.Scene(plate, 0.0, 1.0), SMALL)
    points, normals = np.array([[0.5, 0.5, 1.0], [0.5, 0.5, -1.0]]), np.array([[0, 0, -1.0], [0, 0, 1.0]])
    assert above.irradiance(points, normals)[:, 0] == pytest.approx([0.2394, 0.2394], rel=1e-2)
    assert below.irradiance(points, normals)[:, 0] == pytest.approx([0.2394, 0.0], rel=1e-2)


def test_progress_rises_and_cancels():
    calls = []

    def progress(fraction, text):
        calls.append((fraction, text))

    fmm_core.solve(fmm_core.Scene(CUBE, 0.5, 1.0), SMALL, progress)
    fractions = [fraction for fraction, _ in calls]
    assert fractions == sorted(fractions)
    assert 0 < fractions[0] <= fractions[-1] <= 1


@pytest.mark.parametrize("answer", [False, 0, np.False_])
def test_a_false_answer_cancels_solve_and_gather_before_their_end(answer):
    scene = fmm_core.Scene(CUBE, 0.5, 1.0)
    with pytest.raises(fmm_core.Cancelled):
        fmm_core.solve(scene, SMALL, lambda fraction, text: answer)
    solution = fmm_core.solve(scene, fmm_core.Settings(particles=3000))
    seen = []

    def progress(fraction, text):
        seen.append(fraction)
        return answer

    with pytest.raises(fmm_core.Cancelled):
        solution.irradiance(*shapes.random_points(CUBE, 2000), progress=progress)
    assert len(seen) == 1
    assert seen[0] < 0.5


def test_residuals_fall_and_the_cap_is_reported():
    report = fmm_core.solve(fmm_core.Scene(CUBE, 0.5, 1.0), SMALL).report
    assert report["residuals"] == sorted(report["residuals"], reverse=True)
    assert report["residuals"][-1] < 1e-4
    assert report["warnings"] == []
    capped = fmm_core.solve(fmm_core.Scene(CUBE, 0.5, 1.0), fmm_core.Settings(particles=300, max_iterations=2))
    assert len(capped.report["residuals"]) == 2
    assert "iteration stopped after 2 steps" in capped.report["warnings"][0]


def test_report_is_json_with_the_fixed_keys():
    solution = fmm_core.solve(fmm_core.Scene(CUBE, 0.5, 1.0), SMALL)
    solution.irradiance(*shapes.random_points(CUBE, 1))
    report = json.loads(json.dumps(solution.report))
    assert report["version"] == 1
    assert report["counts"]["triangles"] == 12
    assert report["counts"]["output_points"] == 12
    assert report["effects"]["interreflection"]["used"]
    assert report["seconds"]["total"] == pytest.approx(sum(v for k, v in report["seconds"].items() if k != "total"))
    assert set(report) == {
        "version", "settings", "effects", "counts", "postponement", "seconds", "peak_memory_mib", "residuals", "error",
        "warnings", "visibility_kept", "rounds",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("points", "normals", "message"),
    [
        ("abc", [[0, 0, 1]], "points: expected numbers"),
        ([[0, 0, 0], [0]], [[0, 0, 1]], "points: expected numbers"),
        ([[0, 0]], [[0, 0, 1]], r"points: expected shape \(N, 3\)"),
        ([[0, 0, np.nan]], [[0, 0, 1]], "points: row 0 is"),
        ([[0, 0, 0]], [[0, 0, 0]], "normals: row 0 has no direction"),
        ([[0, 0, 0]], [[0, 0, 1], [0, 0, 1]], "normals: expected 1 rows"),
    ],
)
def test_wrong_output_points_are_refused(points, normals, message):
    solution = fmm_core.solve(fmm_core.Scene(CUBE, 0.5, 1.0), SMALL)
    with pytest.raises(fmm_core.Error, match=message):
        solution.irradiance(points, normals)


def test_corners_with_one_vertex_and_one_normal_are_one_output_point():
    grid = np.array([[x, y, 0.0] for y in range(3) for x in range(3)])
    faces = np.array([[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]])
    corners = faces.ravel()
    centres = np.repeat(grid[faces].mean(axis=1), 4, axis=0)
    up = np.tile([0.0, 0.0, 1.0], (16, 1))
    points = fmm_core.output_points(grid[corners], up, corners, centres)
    assert len(points.points) == 9
    assert points.points[points.inverse] == pytest.approx(grid[corners], abs=1e-3)
    assert points.points[points.inverse[0]] == pytest.approx([0.0005, 0.0005, 0])


def test_output_points_are_told_apart_by_vertex_and_normal_and_come_in_the_order_of_corners():
    rng = np.random.default_rng(1)
    vertices = rng.integers(-(1 << 40), 1 << 40, 50)[rng.integers(50, size=5000)]
    normals = np.concatenate([np.eye(3), -np.eye(3)])[rng.integers(6, size=5000)]
    out = fmm_core.output_points(rng.random((5000, 3)), normals, vertices, rng.random((5000, 3)))
    rows = [(vertex, *normal) for vertex, normal in zip(vertices, normals, strict=True)]
    number = {row: place for place, row in enumerate(dict.fromkeys(rows))}
    assert out.inverse.tolist() == [number[row] for row in rows]


def test_output_point_of_a_reentrant_fan_stays_on_its_own_faces():
    # Three quarters of a floor around a block's corner at the origin; the mean of the faces would lie in the block.
    centres = np.array([[-0.5, 0.5, 0], [-0.5, -0.5, 0], [0.5, -0.5, 0]])
    up = np.tile([0.0, 0.0, 1.0], (3, 1))
    (point,) = fmm_core.output_points(np.zeros((3, 3)), up, [7, 7, 7], centres).points
    assert point[0] < 0 or point[1] < 0


def test_bent_quad_is_lit_at_all_its_corners():
    # Flat shading of a quad folded along its diagonal: two triangles, one normal.
    corners = np.array([[0, 0, 0], [1, 0, -0.4], [1, 1, 0], [0, 1, -0.4]])
    quad = corners[[[0, 1, 2], [0, 2, 3]]]
    lamp = shapes.quad([-2, -2, 3], [-2, 3, 3], [3, 3, 3], [3, -2, 3])
    triangles = np.concatenate([quad, lamp])
    scene = fmm_core.Scene(triangles, 0.0, np.array([0, 0, 1.0, 1.0]))
    normal = np.tile([0.0, 0.0, 1.0], (4, 1))
    centres = quad.mean(axis=1)[[0, 0, 1, 1]]
    out = fmm_core.output_points(corners, normal, np.arange(4), centres)
    irradiance = fmm_core.solve(scene, SMALL).irradiance(out.points, out.normals)[:, 0]
    assert irradiance.min() > 0.8 * irradiance.max() > 0.2


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        (([[0, 0, 0]], [[0, 0, 0]], [0], [[1, 0, 0]]), "normals: row 0 has no direction"),
        (([[0, 0, 0]], [[0, 0, 1]], [0, 1], [[1, 0, 0]]), "differ in length"),
        (([[0, 0, np.inf]], [[0, 0, 1]], [0], [[1, 0, 0]]), "positions: row 0 is"),
    ],
)
def test_wrong_corners_are_refused(arrays, message):
    with pytest.raises(fmm_core.Error, match=message):
        fmm_core.output_points(*arrays)


def test_no_corners_give_no_output_points():
    assert len(fmm_core.output_points([], [], [], []).points) == 0


def test_dim_colours_and_dim_rooms_converge_like_bright_ones():
    colours = fmm_core.Scene(CUBE, albedo=np.tile([0, 0, 0.9], (12, 1)), emission=np.tile([1e4, 0, 1.0], (12, 1)))
    points = shapes.random_points(CUBE, 2)
    blue = 1 + 0.9 * fmm_core.solve(colours, SMALL).irradiance(*points)[:, 2]
    assert blue == pytest.approx(10.0, rel=2e-3)

    bright = np.arange(24) < 12
    rooms = np.concatenate([CUBE + np.array([5.0, 0, 0]), CUBE])
    scene = fmm_core.Scene(rooms, np.where(bright, 0.0, 0.9), np.where(bright, 1e4, 1.0))
    dim = 1 + 0.9 * fmm_core.solve(scene, fmm_core.Settings(particles=800)).irradiance(*points)
    assert dim == pytest.approx(10.0, rel=5e-3)


@pytest.mark.parametrize("method", ["direct", "fmm"])
@pytest.mark.parametrize("albedo", [0.5, 0.99])
def test_bright_rooms_converge_within_thirty_applications(method, albedo, monkeypatch):
    block = shapes.room((0.4, 0.3, 0.2))[:, ::-1] + [0.35, 0.35, 0.2]
    triangles = np.concatenate([CUBE, block])
    scene = fmm_core.Scene(triangles, albedo, np.where(np.arange(24) < 2, 1.0, 0.0))
    applied, apply = [], Operator.apply
    monkeypatch.setattr(Operator, "apply", lambda self, radiosity: (applied.append(1), apply(self, radiosity))[1])
    solution = fmm_core.solve(scene, fmm_core.Settings(method=method, particles=600, probes=0))
    assert solution.report["warnings"] == []
    assert 3 < len(applied) <= 30


def test_light_that_spreads_over_more_and_more_particles_converges():
    """A plate close above a floor: what its few particles send lights ever more of those of the floor."""

    def square(low, high, height, cells, up):
        steps = np.linspace(low, high, cells + 1)
        x, y = (grid.ravel() for grid in np.meshgrid(steps[:-1], steps[:-1], indexing="ij"))
        width = (high - low) / cells
        corners = [np.stack([x + i * width, y + j * width, np.full_like(x, height)], axis=1) for i, j in
                   ((0, 0), (1, 0), (1, 1), (0, 1))]  # fmt: skip
        triangles = np.stack([np.stack([corners[k] for k in ks], axis=1) for ks in ((0, 1, 2), (0, 2, 3))], axis=1)
        return triangles.reshape(-1, 3, 3)[:, :: 1 if up else -1]

    parts = square(-2, 2, 0.0, 16, True), square(0, 0.2, 2.0, 1, False), square(0, 1, 0.1, 1, False)
    which = np.repeat(np.arange(3), [len(part) for part in parts])
    scene = fmm_core.Scene(
        np.concatenate(parts),
        np.array([0.8, 0.0, 0.8])[which],
        np.array([0.0, 125.7, 0.0])[which],
        np.full(len(which), True),
    )
    report = fmm_core.solve(scene, fmm_core.Settings(particles=300)).report
    assert report["warnings"] == []
    assert len(report["residuals"]) <= 20


def test_more_particles_than_memory_can_pair_are_refused_in_one_line():
    # Something in the way, so that there is a bit to keep for each pair.
    room = fmm_core.Scene([*CUBE, *(0.5 * CUBE[:, ::-1] + 0.2)], 0.5, 1.0)
    with pytest.raises(fmm_core.Error, match=r"particles: the direct method with \d+ of them takes \d+ GiB"):
        fmm_core.solve(room, fmm_core.Settings(method="direct", particles=2_000_000))


@pytest.mark.parametrize("posts", [0, 5])
def test_many_particles_are_not_solved_directly_where_few_triangles_are_cut_into_them(posts):
    # Feet of posts cut a floor up.
    post = shapes.room((0.02, 0.02, 0.8))[:, ::-1]
    places = [(x, y, 0.0) for x in np.linspace(0.1, 0.9, 5) for y in np.linspace(0.1, 0.9, posts)]
    triangles = np.concatenate([shapes.subdivided_room(16), *(post + place for place in places)])
    scene = fmm_core.Scene(triangles, 0.5, np.where(np.arange(len(triangles)) == 0, 1.0, 0.0))
    assert len(triangles) < FEW_PARTICLES
    solution = fmm_core.solve(scene, fmm_core.Settings(rays=20, probes=0))
    assert (solution.grouping is None) == (posts == 0)
    assert (len(make_particles(scene, len(triangles), 1)) <= FEW_PARTICLES) == (posts == 0)


@pytest.mark.parametrize("arguments", [(None,), (CUBE,), ("scene", {})])
def test_solve_wants_a_scene_and_settings(arguments):
    with pytest.raises(fmm_core.Error, match="expected a Scene and Settings"):
        fmm_core.solve(*arguments)


def test_smooth_convex_mesh_is_lit_at_every_vertex_and_a_smooth_hollow_one_keeps_the_furnace():
    ball = shapes.sphere(0.3, 2) + [0.5, 0.5, 0.5]
    triangles = np.concatenate([CUBE, ball])
    emission = np.where(np.arange(len(triangles)) < 12, 1.0, 0.0)
    outside = fmm_core.solve(fmm_core.Scene(triangles, 0.0, emission), SMALL)
    corners = ball.reshape(-1, 3)
    _, vertices = np.unique(corners.round(9), axis=0, return_inverse=True)
    smooth = (corners - 0.5) / 0.3
    out = fmm_core.output_points(corners, smooth, vertices.ravel(), np.repeat(ball.mean(axis=1), 3, axis=0))
    assert len(out.points) == 66
    # What the ball hides of itself below the horizon of a smooth normal on flat faces stays small.
    assert outside.irradiance(out.points, out.normals).min() > 0.9

    inward = ball[:, ::-1]
    hollow = fmm_core.solve(fmm_core.Scene(inward, 0.5, 1.0), SMALL)
    centres = np.repeat(inward.mean(axis=1), 3, axis=0)
    corners = inward.reshape(-1, 3)
    _, vertices = np.unique(corners.round(9), axis=0, return_inverse=True)
    out = fmm_core.output_points(corners, (0.5 - corners) / 0.3, vertices.ravel(), centres)
    assert hollow.irradiance(out.points, out.normals) == pytest.approx(2.0, rel=2e-3)
