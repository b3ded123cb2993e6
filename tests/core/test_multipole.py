# SPDX-License-Identifier: GPL-3.0-or-later
"""The fast multipole method against the direct sum, through the public API."""

import subprocess
import sys

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import _binding, cost
from hypothesis import given, settings
from hypothesis import strategies as st

#: The unoccluded Cornell room: open in front, with its lamp in the ceiling.
WALLS = shapes.room()[2:]
LAMP = shapes.quad([0.35, 0.35, 0.99], [0.35, 0.65, 0.99], [0.65, 0.65, 0.99], [0.65, 0.35, 0.99])
ROOM = np.concatenate([WALLS, LAMP])
EMISSION = np.where(np.arange(len(ROOM)) < len(WALLS), 0.0, 10 * np.pi)
SCENE = fmm_core.Scene(ROOM, np.array([[0.73, 0.5, 0.2]] * len(ROOM)), EMISSION)
POINTS = shapes.random_points(ROOM, 100)


def solved(**options):
    options = {"particles": 9000, "effects": {"occlusion": False}, "tolerance": 1e-6} | options
    return fmm_core.solve(SCENE, fmm_core.Settings(**options))


@pytest.fixture(scope="module")
def exact():
    return solved(method="direct").irradiance(*POINTS)


def error(solution, exact):
    return np.linalg.norm(solution.irradiance(*POINTS) - exact) / np.linalg.norm(exact)


@pytest.mark.parametrize("expansion", ["whole", "compressed"])
def test_error_against_the_direct_sum_falls_with_p(exact, expansion):
    errors = [error(solved(method="fmm", truncation=p, expansion=expansion), exact) for p in (2, 4, 8)]
    assert errors[0] < 0.02
    assert errors[1] < 0.005
    assert errors[2] < 0.0002
    assert errors == sorted(errors, reverse=True)


def test_papers_expansion_falls_with_p_too(exact):
    errors = [error(solved(method="fmm", truncation=p, expansion="paper"), exact) for p in (2, 4, 6)]
    assert errors[2] < 0.005
    assert errors == sorted(errors, reverse=True)


@pytest.mark.parametrize(
    "options", [{"grouping": 4}, {"grouping": 1000}, {"level": 3}, {"separation": 2}, {"grouping": None}]
)
def test_any_tree_and_any_separation_give_the_same_light(exact, options):
    assert error(solved(method="fmm", truncation=5, **options), exact) < 0.002


@pytest.mark.parametrize(("truncation", "bound"), [(2, 0.1), (4, 0.02)])
def test_near_patches_at_the_horizon_are_not_corrected_where_the_sum_left_them_out(truncation, bound):
    room = shapes.room()
    scene = fmm_core.Scene(room, 0.5, np.where(np.arange(12) == 2, 1.0, 0.0))
    points = [np.concatenate(p) for p in zip(shapes.corner_points(room), shapes.random_points(room, 100), strict=True)]
    exact = fmm_core.solve(scene, fmm_core.Settings(method="direct", particles=4000)).irradiance(*points)
    settings = fmm_core.Settings(method="fmm", particles=4000, level=4, truncation=truncation)
    found = fmm_core.solve(scene, settings).irradiance(*points)
    assert np.abs(found - exact).max() < bound * np.sqrt((exact**2).mean())


def test_report_counts_boxes_and_pairs():
    counts = solved(method="fmm").report["counts"]
    assert counts["rays"] == 0
    assert counts["boxes"] > counts["leaves"] > 0
    assert counts["pairs_valid"] > 0


def against_direct(triangles, emission, points, **options):
    """Relative L2 error of the irradiance at points, against the direct sum over the same particles."""
    scene = fmm_core.Scene(triangles, 0.5, emission)
    chosen = {"particles": 2000, "effects": {"occlusion": False}} | options
    exact = fmm_core.solve(scene, fmm_core.Settings(**chosen | {"method": "direct"})).irradiance(*points)
    found = fmm_core.solve(scene, fmm_core.Settings(**chosen | {"method": "fmm"})).irradiance(*points)
    return np.linalg.norm(found - exact) / np.linalg.norm(exact)


@pytest.mark.parametrize(
    ("size", "gap", "shift"), [(20.0, 1e-5, 0.0), (1.0, 1e-6, 0.0), (1.0, 1e-2, 1e5), (1.0, 0.1, 1e6)]
)
def test_close_plates_and_plates_far_from_the_origin_keep_their_light(size, gap, shift):
    low = size * shapes.quad([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]) + shift
    high = low[:, ::-1] + np.array([0, 0, gap])
    points = shapes.random_points(high, 20)
    assert against_direct(np.concatenate([low, high]), [1.0, 1.0, 0.0, 0.0], points) < 0.005


def test_one_far_output_point_does_not_disturb_the_others():
    points, normals = shapes.random_points(ROOM, 10)
    far = np.concatenate([points, [[1e7, 0, 0]]]), np.concatenate([normals, [[-1.0, 0, 0]]])
    solution = solved(method="fmm")
    alone, together = solution.irradiance(points, normals), solution.irradiance(*far)[:-1]
    assert np.linalg.norm(together - alone) < 0.01 * np.linalg.norm(alone)


def test_balls_in_a_room_fall_with_p():
    ball = shapes.sphere(0.2, 2)
    triangles = np.concatenate([shapes.room(), ball + np.array([0.3, 0.4, 0.5]), ball + np.array([0.7, 0.6, 0.5])])
    emission = np.where(np.arange(len(triangles)) < 2, 1.0, 0.0)
    points = shapes.random_points(triangles, 1)
    errors = [against_direct(triangles, emission, points, truncation=p, grouping=16) for p in (2, 4, 6)]
    assert errors[0] < 0.05
    assert errors[1] < 0.01
    assert errors[2] < 0.002


def test_coefficients_that_do_not_fit_are_refused_in_one_line():
    # Run apart: the limit holds for a whole process.
    script = (
        "import resource; resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))\n"
        "import numpy as np\n"
        "from fmm_core import _binding, cost\n"
        "room, soft = cost._room(20_000), np.full(20_000, 1e-12)\n"
        "fmm = _binding.Fmm(room, soft, None, 12, 64, 7, 1, 'paper')\n"
        "fmm.apply(np.ones((20_000, 3)))\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stderr
    assert "no memory for" in done.stderr


@settings(max_examples=40, deadline=None)
@given(
    count=st.integers(1, 400),
    clusters=st.integers(1, 4),
    spread=st.sampled_from([0.0, 1e-6, 1e-2, 1.0]),
    grouping=st.integers(1, 400),
    truncation=st.integers(0, 6),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_cloud_of_particles_gives_finite_light_close_to_the_direct_sum(
    count, clusters, spread, grouping, truncation, seed
):
    rng = np.random.default_rng(seed)
    points = rng.random((clusters, 3))[rng.integers(0, clusters, count)] + spread * rng.random((count, 3))
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # Expansions know no softening: it has to be below the distances that they serve.
    softening = np.full(count, 1e-20)
    strengths = rng.random((count, 3))
    fmm = _binding.Fmm((points, normals), softening, None, truncation, grouping, None, 1, "whole")
    found, _ = fmm.apply(strengths)
    assert np.isfinite(found).all()
    exact = _binding.Sources(points, normals, softening, np.ones(count), np.ones(1)).irradiance(
        points, normals, strengths
    )
    if count > 100 and spread == 1.0 and truncation >= 4:
        assert np.linalg.norm(found - exact) < 0.05 * np.linalg.norm(exact)


def test_unit_costs_are_not_negative_and_seconds_add_them_up():
    unit = cost.unit_costs(3, "whole", 1)
    assert {work: len(costs) for work, costs in unit.items()} == {work: len(names) for work, names in cost.WORK.items()}
    assert min(min(costs) for costs in unit.values()) >= 0
    assert min(sum(unit[work]) for work in ("p2m", "m2l", "l2p", "p2p")) > 0
    nothing = {name: 0 for names in cost.WORK.values() for name in names}
    one = cost.seconds(nothing | {"interactions": 1000, "batches": 10}, 3, "whole", 1)
    assert one == pytest.approx(10 * unit["m2l"][0] + 1000 * unit["m2l"][1])


def test_fitted_costs_are_those_that_made_the_seconds():
    runs = [({"pairs": pairs, "points": points}, 2e-6 * pairs + 3e-8 * points) for pairs, points in ((1, 90), (8, 20))]
    assert cost._fitted(("pairs", "points"), runs) == pytest.approx((2e-6, 3e-8))
    shrinking = [({"pairs": 1, "points": 10}, 1.0), ({"pairs": 2, "points": 10}, 0.5)]
    assert cost._fitted(("pairs", "points"), shrinking)[0] == 0
    assert cost._fitted(("pairs",), [({"pairs": 0}, 1.0)]) == (0.0,)


def test_dear_near_pairs_make_small_leaves_and_dear_translations_large_ones(monkeypatch):
    points, normals = cost._room(20_000)
    chosen = []
    for dear in ("p2p", "m2l"):
        unit = {work: tuple(1e-4 if work == dear else 1e-9 for _ in names) for work, names in cost.WORK.items()}
        monkeypatch.setattr(cost, "unit_costs", lambda *_, unit=unit: unit)
        chosen.append(cost.choose_grouping(points, normals, fmm_core.Settings(truncation=4)))
    assert chosen[0] < chosen[1]
    assert set(chosen) <= set(cost.GROUPINGS)


def test_sixteen_times_the_points_on_surfaces_are_sixteen_times_the_work():
    points, normals = cost._room(40_000)
    few = cost.predicted_counts(points[:2500], normals[:2500], 64, 4, "whole", 1)
    many = cost.predicted_counts(points, normals, 64, 4, "whole", 1)
    for what in ("boxes", "points"):
        assert 8 < many[what] / few[what] < 32


@pytest.mark.parametrize("grid", [True, False])
@pytest.mark.parametrize("grouping", [64, 128, 256])
def test_sampled_counts_predict_those_of_the_whole_tree(grid, grouping):
    points, normals = _room_on_a_grid(180) if grid else cost._room(200_000)
    assert len(points) >= 2 * cost.SAMPLE * 0.9
    fmm = _binding.Fmm((points, normals), np.full(len(points), 1e-12), None, 4, grouping, None, 1, "compressed")
    counts, predicted = fmm.counts(), cost.predicted_counts(points, normals, grouping, 4, "compressed", 1)
    for what in ("boxes", "interactions", "point_pairs"):
        assert predicted[what] == pytest.approx(counts[what], rel=0.3), what
    for what in ("p2l_points", "m2p_points"):
        assert predicted[what] == pytest.approx(counts[what], rel=1.0, abs=0.2 * counts["interactions"]), what


def _room_on_a_grid(cells):
    """Middles of the cells of a grid on each side of the unit cube, with inward normals."""
    u, v = (np.indices((cells, cells)).reshape(2, -1) + 0.5) / cells
    points = [np.roll(np.stack([np.full_like(u, side), u, v], 1), axis, 1) for axis in range(3) for side in (0.0, 1.0)]
    normals = [np.eye(3)[axis] * (1 - 2 * side) for axis in range(3) for side in (0, 1)]
    return np.concatenate(points), np.repeat(normals, cells * cells, axis=0)
