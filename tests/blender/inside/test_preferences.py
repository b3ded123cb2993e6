# SPDX-License-Identifier: GPL-3.0-or-later
"""What the preferences of the extension do."""

import threading

import bpy
import fmm_core
import pytest
from conftest import MODULE


@pytest.fixture
def preferences(empty):
    own = bpy.context.preferences.addons[MODULE].preferences
    bpy.context.scene.fmm_radiosity.particles = 300
    yield own
    for name in ("threads", "memory_limit", "visibility_folder"):
        own.property_unset(name)


def test_bake_is_not_begun_where_memory_will_not_do(build, preferences):
    build.room()
    preferences.memory_limit = 100
    with pytest.raises(RuntimeError, match=r"about 151 MiB of memory, more than the limit in the preferences, 100 MiB"):
        bpy.ops.fmm_radiosity.bake()
    assert all("Radiosity" not in mesh.attributes for mesh in bpy.data.meshes)
    preferences.memory_limit = 1000
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}


def test_memory_of_many_light_points_is_foretold(build, preferences):
    build.room()
    bpy.context.scene.fmm_radiosity.particles = 400_000
    # It took 1,675 MiB.
    preferences.memory_limit = 1300
    with pytest.raises(RuntimeError, match="more than the limit in the preferences, 1,300 MiB"):
        bpy.ops.fmm_radiosity.check()
    preferences.memory_limit = 2100
    assert bpy.ops.fmm_radiosity.check() == {"FINISHED"}


def test_bake_ends_where_it_takes_more_memory(build, fmm, preferences, monkeypatch):
    build.room()
    preferences.memory_limit = 1000
    taken = iter([500.0, 600.0, 1400.0, *[1501.0] * 99])
    monkeypatch.setattr(fmm.memory, "resident_mib", lambda: next(taken))
    with pytest.raises(RuntimeError, match="needs more memory than the limit in the preferences, 1,000 MiB"):
        bpy.ops.fmm_radiosity.bake()
    assert all("Radiosity" not in mesh.attributes for mesh in bpy.data.meshes)


def test_memory_in_use_is_that_of_the_process(fmm):
    before = fmm.memory.resident_mib()
    if before is None:
        pytest.skip("this system does not tell it")
    block = bytearray(b"x" * (300 << 20))
    assert 250 < fmm.memory.resident_mib() - before < 350
    del block


def test_visibility_goes_to_the_folder_that_was_chosen(build, preferences, tmp_path):
    build.room()
    (tmp_path / "kept").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"))
    preferences.visibility_folder = str(tmp_path / "kept")
    bpy.context.scene.fmm_radiosity.keep_visibility = True
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    assert [path.name.split("-")[0] for path in (tmp_path / "kept").iterdir()] == ["room"]
    assert not list(tmp_path.glob("*.fmm-visibility"))


def test_rays_are_traced_in_as_many_threads_as_were_asked_for(build, fmm, preferences, monkeypatch):
    build.room()
    started = []
    start = threading.Thread.start
    monkeypatch.setattr(threading.Thread, "start", lambda thread: (started.append(thread), start(thread)))
    preferences.threads = 1
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    alone = len(started)
    preferences.threads = 3
    fmm.session.session.solution = None
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    # Each pool of threads grows up to its limit.
    assert 0 < alone < len(started) - alone
    with pytest.raises(fmm_core.Error, match="limit_threads"):
        fmm_core.limit_threads(-1)
