# SPDX-License-Identifier: GPL-3.0-or-later
"""Bad input is refused in one line that names the array, the row and the value."""

import fmm_core
import numpy as np
import pytest
import shapes

CUBE = shapes.room()


def broken(value):
    triangles = CUBE.copy()
    triangles[3, 1, 2] = value
    return triangles


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"triangles": broken(np.nan)}, "triangles: triangle 3 has the value nan"),
        ({"triangles": broken(np.inf)}, "triangles: triangle 3 has the value inf"),
        ({"triangles": np.zeros((0, 3, 3))}, "triangles: the scene is empty"),
        ({"triangles": np.zeros((4, 3))}, "triangles: expected shape (T, 3, 3), got (4, 3)"),
        ({"triangles": "cube"}, "triangles: expected numbers"),
        ({"triangles": np.zeros((2, 3, 3))}, "triangles: all 2 have no area"),
        ({"triangles": CUBE, "emission": 0.0}, "emission: the scene has no emitter"),
        ({"triangles": CUBE, "emission": -1.0}, "emission: triangle 0 has a negative value, -1"),
        ({"triangles": CUBE, "albedo": np.ones(5)}, "albedo: expected shape (12, 3), (12,) or a constant, got (5,)"),
        ({"triangles": CUBE, "albedo": np.nan}, "albedo: triangle 0 has the value nan"),
        ({"triangles": 1e100 * CUBE}, "triangles: triangle 0 has the value 1e+100"),
        ({"triangles": CUBE + 0j}, "triangles: expected numbers, got complex128"),
        ({"triangles": CUBE, "two_sided": "no"}, "two_sided: expected numbers"),
        ({"triangles": CUBE, "two_sided": np.nan}, "two_sided: expected True or False, got nan"),
        ({"triangles": CUBE, "two_sided": [True]}, "two_sided: expected shape (12,) or a constant, got (1,)"),
    ],
)
def test_wrong_scene_is_refused(arguments, message):
    with pytest.raises(fmm_core.Error) as error:
        fmm_core.Scene(**({"emission": 1.0} | arguments))
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("truncation", 21),
        ("truncation", -1),
        ("truncation", 2.5),
        ("truncation", True),
        ("grouping", 0),
        ("target_error", 0.0),
        ("target_error", float("nan")),
        ("method", "magic"),
        ("particles", 0),
        ("quadrature", 3),
        ("expansion", "taylor"),
        ("visibility", "maybe"),
        ("separation", 0),
        ("level", 9),
        ("probes", -1),
        ("tolerance", 0.0),
        ("max_iterations", 0),
    ],
)
def test_wrong_setting_is_refused_by_name_and_value(option, value):
    with pytest.raises(fmm_core.Error, match=f"^{option}: .*got {value!r}$"):
        fmm_core.Settings(**{option: value})


def test_compressed_expansion_is_refused_where_its_set_up_would_take_for_ever():
    with pytest.raises(fmm_core.Error, match="compressed expansion goes up to 8, got 9"):
        fmm_core.Settings(truncation=9, expansion="compressed")


def test_triangles_without_area_are_left_out_with_a_warning():
    line = [[[0, 0, 0], [1, 1, 1], [2, 2, 2]]]
    scene = fmm_core.Scene(np.concatenate([CUBE[:5], line, CUBE[5:]]), emission=1.0)
    assert scene.triangle_indices.tolist() == [0, 1, 2, 3, 4, *range(6, 13)]
    assert scene.warnings == ["1 of 13 triangles have no area and are left out"]


def test_triangles_that_are_there_twice_are_left_out_and_the_brightest_stays():
    turned, again, once_more = CUBE[[3]][:, [1, 2, 0]], CUBE[[5]], CUBE[[7]][:, [2, 1, 0]]
    triangles = np.concatenate([CUBE, turned, again, once_more])
    scene = fmm_core.Scene(triangles, emission=np.where(np.arange(15) == 13, 2.0, 1.0))
    assert scene.triangle_indices.tolist() == [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11, 13, 14]
    assert scene.warnings == ["2 of 15 triangles are there twice and are left out once"]


def test_a_face_with_two_sides_stands_for_one_at_its_back():
    triangles = np.concatenate([CUBE[:1], CUBE[:1, ::-1], CUBE[1:]])
    sides = np.arange(13) == 1
    assert fmm_core.Scene(triangles, emission=1.0, two_sided=sides).triangle_indices.tolist() == [*range(1, 13)]
    assert len(fmm_core.Scene(triangles, emission=1.0).triangle_indices) == 13


def test_albedo_of_one_is_clamped_with_a_warning_and_the_solve_ends():
    scene = fmm_core.Scene(CUBE[2:], albedo=1.0, emission=1.0)
    assert scene.albedo.max() == 0.999
    assert scene.warnings == ["albedo 1 is clamped to 0.999"]
    report = fmm_core.solve(scene, fmm_core.Settings(particles=200)).report
    assert report["warnings"] == ["albedo 1 is clamped to 0.999"]


def test_scene_does_not_follow_changes_of_the_callers_arrays():
    triangles = CUBE.copy()
    scene = fmm_core.Scene(triangles, emission=1.0)
    triangles[:] = 0
    assert scene.triangles.any()
    with pytest.raises(ValueError, match="read-only"):
        scene.triangles[0] = 0
