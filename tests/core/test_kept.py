# SPDX-License-Identifier: GPL-3.0-or-later
"""Kept visibility: no ray is traced twice, nothing changes by it, and a file that does not fit is never used."""

import functools
import os
import zipfile

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import accuracy, particles
from fmm_core import kept as module
from hypothesis import given, settings
from hypothesis import strategies as st
from test_visibility import ALBEDO, EMISSION, LAMP, TWO_BLOCKS, block

POINTS = shapes.random_points(TWO_BLOCKS, 5)
METHODS = [{"method": "fmm"}, {"method": "direct"}, {"method": "fmm", "visibility": "cells"}]


def solve(kept=None, emission=EMISSION, albedo=ALBEDO, triangles=TWO_BLOCKS, particles=1500, **options):
    options = fmm_core.Settings(particles=particles, **{"probes": 10, **options})
    return fmm_core.solve(fmm_core.Scene(triangles, albedo, emission), options, kept=kept)


def rays(solution):
    return solution.report["counts"]["rays"]


def saved(path, **options):
    """A file, and what was found when it was made."""
    kept = fmm_core.KeptVisibility()
    solution = solve(kept, **options)
    irradiance = solution.irradiance(*POINTS)
    kept.save(path)
    return solution, irradiance


@functools.cache
def small_file(folder):
    path = folder / "small.fmm-visibility"
    saved(path, particles=100, method="direct")
    return path.read_bytes()


@pytest.mark.parametrize("options", METHODS, ids=str)
def test_a_solve_from_the_file_traces_no_ray_and_changes_no_bit(tmp_path, monkeypatch, options):
    # By how many rays the error is measured depends on the seconds that there are for it.
    monkeypatch.setattr(accuracy, "SHARE", 0.0)
    first, irradiance = saved(tmp_path / "room", **options)
    assert (irradiance == solve(**options).irradiance(*POINTS)).all()
    assert rays(first) > 0
    assert not first.report["visibility_kept"]
    kept = fmm_core.KeptVisibility.load(tmp_path / "room")
    again = solve(kept, **options)
    assert (again.irradiance(*POINTS) == irradiance).all()
    assert (again.radiosity == first.radiosity).all()
    assert rays(again) == 0
    assert again.report["visibility_kept"]
    assert again.report["warnings"] == []
    assert again.report["error"] == first.report["error"]
    assert not kept.unsaved


@pytest.mark.parametrize("options", METHODS, ids=str)
def test_other_lights_from_the_file_equal_a_fresh_solve(tmp_path, options):
    saved(tmp_path / "room", **options)
    lights = {"emission": EMISSION[:, None] * [1.0, 3.0, 0.2], "albedo": 0.5}
    again = solve(fmm_core.KeptVisibility.load(tmp_path / "room"), **lights, **options)
    found, expected = again.irradiance(*POINTS), solve(**lights, **options).irradiance(*POINTS)
    assert rays(again) == 0
    assert np.linalg.norm(found - expected) < 1e-3 * np.linalg.norm(expected)


def test_grouped_triangles_are_kept_too(tmp_path):
    ball = 0.2 * shapes.sphere(1.0, 4) + [0.5, 0.5, 0.4]
    triangles = np.concatenate([shapes.room(), LAMP, ball])
    emission = np.where(np.arange(len(triangles)) // 2 == 6, 5.0, 0.0)
    room = {"triangles": triangles, "emission": emission, "albedo": 0.5, "method": "fmm", "particles": 600}
    first, irradiance = saved(tmp_path / "ball", **room)
    assert len(first.particles) < len(triangles)
    again = solve(fmm_core.KeptVisibility.load(tmp_path / "ball"), **room)
    assert (rays(again), rays(first) > 0) == (0, True)
    assert (again.irradiance(*POINTS) == irradiance).all()
    # Half of the triangles in another colour: a particle for some of both would mix them.
    room["albedo"] = np.where(np.random.default_rng(0).random(len(triangles)) < 0.5, 0.2, 0.5)
    assert not first.serves(fmm_core.Scene(triangles, room["albedo"], emission))
    other = solve(fmm_core.KeptVisibility.load(tmp_path / "ball"), **room)
    assert "other emitters or albedos" in other.report["warnings"][0]
    assert (other.irradiance(*POINTS) == solve(**room).irradiance(*POINTS)).all()


def test_only_new_output_points_and_settings_are_traced():
    kept = fmm_core.KeptVisibility()
    everything = rays(solve(kept, method="direct"))
    solution = solve(kept, method="direct")
    assert rays(solution) == 0
    solution.irradiance(*POINTS)
    gathered = rays(solution)
    assert 0 < gathered < everything
    assert rays(solve(kept, method="direct", tolerance=1e-3)) == 0
    assert rays(solve(kept, method="direct", particles=2000)) > 0


def test_what_two_solves_do_not_ask_for_is_dropped(tmp_path):
    kept, sizes = fmm_core.KeptVisibility(), []
    for count in (4000, 300, 300, 300):
        solve(kept, particles=count, method="direct")
        kept.save(tmp_path / "room")
        sizes.append((tmp_path / "room").stat().st_size)
    assert sizes[1] == sizes[2] == sizes[3] < sizes[0] / 4


@pytest.mark.parametrize(
    ("triangles", "why"),
    [(TWO_BLOCKS + np.where(np.arange(len(TWO_BLOCKS)) < 14, 0.0, 0.01)[:, None, None], "geometry"), (None, "emitter")],
)
def test_what_does_not_fit_is_computed_anew_with_a_warning(tmp_path, triangles, why):
    saved(tmp_path / "room")
    room = {"triangles": TWO_BLOCKS if triangles is None else triangles}
    room["emission"] = np.roll(EMISSION, 2) if triangles is None else EMISSION
    kept = fmm_core.KeptVisibility.load(tmp_path / "room")
    again, fresh = solve(kept, **room), solve(**room)
    assert [why in text for text in again.report["warnings"]] == [True]
    assert rays(again) > 0
    assert (again.irradiance(*POINTS) == fresh.irradiance(*POINTS)).all()
    kept.save(tmp_path / "room")
    assert rays(solve(fmm_core.KeptVisibility.load(tmp_path / "room"), **room)) == 0


def test_an_earlier_solution_stays_right_when_the_same_object_is_given_another_scene():
    kept = fmm_core.KeptVisibility()
    first = solve(kept, method="direct")
    solve(kept, method="direct", triangles=TWO_BLOCKS[:14], emission=EMISSION[:14], albedo=0.5).irradiance(*POINTS)
    assert (first.irradiance(*POINTS) == solve(method="direct").irradiance(*POINTS)).all()


def test_a_convex_room_is_kept_without_rays(tmp_path):
    kept = fmm_core.KeptVisibility()
    room = {"triangles": shapes.room(), "emission": 1.0, "albedo": 0.5, "method": "fmm", "probes": 0}
    first = solve(kept, **room)
    kept.save(tmp_path / "room")
    again = solve(fmm_core.KeptVisibility.load(tmp_path / "room"), **room)
    assert (rays(first), rays(again), again.report["warnings"]) == (0, 0, [])
    assert (again.radiosity == first.radiosity).all()


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_a_damaged_file_is_refused_or_whole(tmp_path_factory, data):
    folder = tmp_path_factory.getbasetemp()
    whole = small_file(folder)
    at = data.draw(st.integers(0, len(whole) - 1))
    cut = data.draw(st.booleans())
    bad = whole[:at] if cut else whole[:at] + bytes([whole[at] ^ (1 << data.draw(st.integers(0, 7)))]) + whole[at + 1 :]
    path = folder / "damaged.fmm-visibility"
    path.write_bytes(bad)
    kept, refused = None, ""
    try:
        kept = fmm_core.KeptVisibility.load(path)
    except fmm_core.Error as error:
        refused = str(error)
    if kept is None:
        assert str(path) in refused
        assert "\n" not in refused
        return
    # Not every byte of a zip says something: what is not refused is what was saved.
    assert not cut
    solution = solve(kept, particles=100, method="direct")
    solution.irradiance(*POINTS)
    assert (rays(solution), solution.report["warnings"]) == (0, [])


@pytest.mark.parametrize("text", [b"", b"BLENDER", b"PK\3\4", os.urandom(1000)], ids=["empty", "blend", "zip", "noise"])
def test_what_is_no_such_file_is_refused(tmp_path, text):
    (tmp_path / "no").write_bytes(text)
    with pytest.raises(fmm_core.Error, match=r"^kept visibility '.*no' is damaged: [^\n]+$"):
        fmm_core.KeptVisibility.load(tmp_path / "no")


def test_another_version_and_a_missing_file_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "VERSION", 6)
    saved(tmp_path / "new", particles=100, method="direct")
    monkeypatch.undo()
    with pytest.raises(fmm_core.Error, match=r"^kept visibility '.*new' has version '6', expected 5$"):
        fmm_core.KeptVisibility.load(tmp_path / "new")
    with pytest.raises(fmm_core.Error, match=r"^cannot read '.*none': No such file"):
        fmm_core.KeptVisibility.load(tmp_path / "none")
    with pytest.raises(fmm_core.Error, match=r"^cannot read '.*': Is a directory"):
        fmm_core.KeptVisibility.load(tmp_path)


def test_parts_that_do_not_belong_together_are_refused(tmp_path):
    saved(tmp_path / "room", particles=100, method="direct")
    with zipfile.ZipFile(tmp_path / "room") as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    for name in ("lights", "rows", "answers"):
        with zipfile.ZipFile(tmp_path / "bad", "w") as archive:
            for other, content in parts.items():
                archive.writestr(other, content[:-1] if other == name else content)
        with pytest.raises(fmm_core.Error, match="is damaged"):
            fmm_core.KeptVisibility.load(tmp_path / "bad")


def test_answers_of_the_wrong_length_are_traced_anew(tmp_path):
    first, irradiance = saved(tmp_path / "room", particles=100, method="direct")
    kept = fmm_core.KeptVisibility.load(tmp_path / "room")
    kept._loaded = dict.fromkeys(kept._loaded, module.zlib.compress(b"x"))
    again = solve(kept, particles=100, method="direct")
    assert (again.irradiance(*POINTS) == irradiance).all()
    assert rays(again) == rays(first)


def test_a_file_that_cannot_be_written_is_an_error_and_loses_nothing(tmp_path, monkeypatch):
    saved(tmp_path / "room", particles=100, method="direct")
    before, kept = (tmp_path / "room").read_bytes(), fmm_core.KeptVisibility()
    solve(kept, particles=200, method="direct")

    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    with pytest.raises(fmm_core.Error, match=r"^cannot write '.*none.room': [^\n]+$"):
        kept.save(tmp_path / "none" / "room")
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", refuse)
        with pytest.raises(fmm_core.Error, match=r"^cannot write '.*room': Permission denied$"):
            kept.save(tmp_path / "room")
    assert [path.name for path in tmp_path.iterdir()] == ["room"]
    assert (tmp_path / "room").read_bytes() == before
    assert kept.unsaved
    kept.save(tmp_path / "room")
    assert rays(solve(fmm_core.KeptVisibility.load(tmp_path / "room"), particles=200, method="direct")) == 0


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="nothing is read-only for root")
def test_a_read_only_folder_is_an_error(tmp_path):
    kept = fmm_core.KeptVisibility()
    solve(kept, particles=100, method="direct")
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(fmm_core.Error, match=r"^cannot write '.*room': Permission denied$"):
            kept.save(tmp_path / "room")
    finally:
        tmp_path.chmod(0o700)


def test_a_solution_says_whom_it_serves():
    solution = solve(method="direct", particles=100)
    scene = functools.partial(fmm_core.Scene, TWO_BLOCKS)
    assert solution.serves(scene(0.3, 7.0 * EMISSION))
    assert not solution.serves(scene(0.3, np.roll(EMISSION, 2)))
    assert not solution.serves(scene(0.3, np.maximum(EMISSION, 1e-3)))
    assert not solution.serves(scene(0.3, EMISSION, two_sided=True))
    moved = np.concatenate([TWO_BLOCKS[:-12], block([0.55, 0.2, 1e-3], [0.8, 0.45, 0.4])])
    assert not solution.serves(fmm_core.Scene(moved, ALBEDO, EMISSION))
    assert not solution.serves(fmm_core.Scene(TWO_BLOCKS[:-1], ALBEDO[:-1], EMISSION[:-1]))


def test_an_emitter_that_comes_to_stand_out_gets_particles_of_its_own():
    dim = EMISSION + np.where(np.arange(len(EMISSION)) < 2, 1e-3, 0.0)
    bright = EMISSION + np.where(np.arange(len(EMISSION)) < 2, 10.0, 0.0)
    first = fmm_core.Scene(TWO_BLOCKS, 0.5, dim)
    made = particles.make_particles(first, 200, 1)
    assert particles.serve(made, first, fmm_core.Scene(TWO_BLOCKS, 0.5, 3 * dim))
    assert not particles.serve(made, first, fmm_core.Scene(TWO_BLOCKS, 0.5, bright))


def test_the_same_rays_in_other_geometry_are_other_rays():
    kept, up = fmm_core.KeptVisibility(), np.ones((9, 3), np.float32)

    class Tracer:
        def __init__(self, answer):
            self.answer = answer

        def run(self, origins, *_, **__):
            return np.full(len(origins), self.answer, np.int32)

    tracers = []
    for triangles, answer in ((TWO_BLOCKS, 0), (2 * TWO_BLOCKS, -1)):
        kept.take(fmm_core.Scene(triangles, ALBEDO, EMISSION))
        tracers.append(kept.around(Tracer(answer)))
    for _ in range(2):
        assert [tracer.run(up, up, query="OCCLUDED").tolist() for tracer in tracers] == [[0] * 9, [-1] * 9]
    assert [tracer.replayed for tracer in tracers] == [9, 9]


def test_what_was_never_used_can_be_saved_and_loaded(tmp_path):
    fmm_core.KeptVisibility().save(tmp_path / "unused")
    kept = fmm_core.KeptVisibility.load(tmp_path / "unused")
    with pytest.raises(fmm_core.Error, match="kept: expected KeptVisibility or None, got str"):
        fmm_core.solve(fmm_core.Scene(shapes.room(), 0.5, 1.0), kept=str(kept))
