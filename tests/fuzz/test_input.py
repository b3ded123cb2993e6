# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever is given to the core makes a valid object, or an `fmm_core.Error` of one line; never anything else."""

import io
import zipfile

import fmm_core
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

TRIANGLE = np.array([[[0, 0, 0], [1, 0, 0], [0, 1.0, 0]], [[0, 0, 1], [0, 1, 1], [1, 0, 1.0]]])
SMALL = fmm_core.Settings(particles=20, probes=0)
LOOSE = settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))

ODD = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.complex_numbers(),
    st.text(max_size=5),
    st.binary(max_size=5),
    st.lists(st.floats(), max_size=4),
    st.lists(st.lists(st.floats(), max_size=3), max_size=3),
    st.dictionaries(st.text(max_size=2), st.integers(), max_size=2),
    st.sampled_from([object(), object, np.array(object()), np.datetime64("2020-01-01"), np.ma.masked, {1}, range(3)]),
)
SHAPES = st.sampled_from([(), (0,), (1,), (2,), (3,), (2, 3), (3, 2), (2, 3, 3), (1, 3, 3), (0, 3, 3), (2, 3, 3, 1)])
DTYPES = st.sampled_from(["f8", "f4", "f2", "i8", "u1", "?", "c16", "U3", "S2", "O", "M8[s]", "f8,i4"])
NUMBERS = st.sampled_from([0.0, -0.0, 1.0, -1.0, 0.5, 1e-300, 5e-324, 1e-60, 1e30, 1e60, 1e61, 1e300, np.inf, np.nan])


@st.composite
def arrays(draw):
    """Arrays of any kind; most are of numbers, with a few odd ones among them."""
    shape, dtype = draw(SHAPES), draw(DTYPES)
    if dtype not in ("f8", "f4", "f2"):
        return np.zeros(shape, dtype)
    values = np.random.default_rng(draw(st.integers(0, 99))).random(shape)
    for place in draw(st.lists(st.integers(0, max(0, values.size - 1)), max_size=3)):
        if values.size:
            values.flat[place] = draw(NUMBERS)
    with np.errstate(over="ignore"):
        values = (values * draw(st.sampled_from([1.0, 1.0, 1e-200, 1e-50, 1e40, 1e200]))).astype(dtype)
    return np.asfortranarray(values) if draw(st.booleans()) else values


ANYTHING = st.one_of(arrays(), arrays(), ODD)


def made(make):
    """What `make` returns, or None after an error of one line."""
    try:
        return make()
    except fmm_core.Error as error:
        message = str(error)
    assert message
    assert "\n" not in message
    return None


@LOOSE
@given(triangles=st.one_of(st.just(TRIANGLE), ANYTHING), albedo=ANYTHING, emission=ANYTHING, two_sided=ANYTHING)
def test_scene(triangles, albedo, emission, two_sided):
    scene = made(lambda: fmm_core.Scene(triangles, albedo, emission, two_sided))
    if scene is None:
        return
    for values in (scene.triangles, scene.albedo, scene.emission):
        assert np.isfinite(values).all()
    solution = made(lambda: fmm_core.solve(scene, SMALL))
    if solution is not None:
        assert np.isfinite(solution.radiosity).all()
        assert solution.radiosity.min() >= 0


@LOOSE
@given(scale=st.floats(-320, 320), lamp=st.floats(-320, 320))
@example(scale=-100.0, lamp=0.0)
@example(scale=59.0, lamp=59.0)
def test_sizes_and_powers_of_any_magnitude(scale, lamp):
    with np.errstate(all="ignore"):
        size, power = np.float64(10.0) ** scale, np.float64(10.0) ** lamp
        triangles = TRIANGLE * size
    scene = made(lambda: fmm_core.Scene(triangles, 0.5, power))
    solution = scene and made(lambda: fmm_core.solve(scene, SMALL))
    if solution:
        ratio = solution.radiosity.max() / power
        assert 1.05 < ratio < 1.2


@LOOSE
@given(options=st.dictionaries(st.sampled_from(list(fmm_core.Settings.__dataclass_fields__)), ANYTHING, max_size=3))
def test_settings(options):
    made(lambda: fmm_core.Settings(**options))


@pytest.fixture(scope="module")
def solution():
    return fmm_core.solve(fmm_core.Scene(TRIANGLE, 0.5, 1.0), SMALL)


@LOOSE
@given(points=ANYTHING, normals=ANYTHING)
def test_output_points(solution, points, normals):
    found = made(lambda: solution.irradiance(points, normals))
    if found is not None:
        assert np.isfinite(found).all()
        assert found.min(initial=0.0) >= 0


@LOOSE
@given(emission=ANYTHING, albedo=ANYTHING)
def test_relight(solution, emission, albedo):
    other = made(lambda: solution.relight(emission, albedo))
    if other is not None:
        assert np.isfinite(other.radiosity).all()


@pytest.fixture(scope="module")
def kept_file(tmp_path_factory):
    """A good file of kept visibility, its bytes."""
    kept, path = fmm_core.KeptVisibility(), tmp_path_factory.mktemp("kept") / "scene"
    fmm_core.solve(fmm_core.Scene(TRIANGLE, 0.5, 1.0), SMALL, kept=kept)
    kept.save(path)
    return path.read_bytes()


def loaded_and_used(content, path):
    path.write_bytes(content)
    kept = made(lambda: fmm_core.KeptVisibility.load(path))
    if kept is not None:
        again = fmm_core.solve(fmm_core.Scene(TRIANGLE, 0.5, 1.0), SMALL, kept=kept)
        assert np.isfinite(again.radiosity).all()


@LOOSE
@given(data=st.data())
def test_kept_file_with_changed_bytes(data, kept_file, tmp_path):
    content = bytearray(kept_file)
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    loaded_and_used(bytes(content[: data.draw(st.integers(0, len(content)))]), tmp_path / "changed")


@LOOSE
@given(content=st.binary(max_size=200))
def test_kept_file_of_any_bytes(content, tmp_path):
    loaded_and_used(content, tmp_path / "any")


@LOOSE
@given(
    about=st.one_of(st.binary(max_size=30), st.sampled_from([b'{"geometry": "", "triangles": -1}', b"[]", b"1"])),
    lights=st.binary(max_size=100),
    rows=st.binary(max_size=60),
    answers=st.binary(max_size=30),
)
def test_kept_file_that_is_a_zip_of_anything(about, lights, rows, answers, tmp_path):
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name, part in (("version", b"1"), ("about", about), ("lights", lights), ("rows", rows)):
            archive.writestr(name, part)
        archive.writestr("answers", answers)
    loaded_and_used(content.getvalue(), tmp_path / "zip")
