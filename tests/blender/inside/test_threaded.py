# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes beside which Blender goes on, with what may happen meanwhile; what Blender's window does is played."""

import importlib
import time
from types import SimpleNamespace

import bpy
import pytest
from conftest import MODULE
from scenes import baked


class Window:
    """A context with a window: counts timers, and keeps what the status bar shows."""

    def __init__(self):
        self.timers, self.status = [], None
        self.window_manager = SimpleNamespace(
            event_timer_add=self._add, event_timer_remove=self.timers.remove, modal_handler_add=id, windows=()
        )
        self.workspace = SimpleNamespace(status_text_set=lambda text: setattr(self, "status", text))

    def __getattr__(self, name):
        return getattr(bpy.context, name)

    def _add(self, seconds, window):
        self.timers.append(SimpleNamespace(time_step=seconds))
        return self.timers[-1]


class Bake:
    """An operator whose window is played."""

    def __init__(self, kind, window):
        self.window, self.reports = window, []
        made = type("Played", (kind,), {"__init__": lambda self: None})
        self.operator = made()
        self.operator.options = SimpleNamespace(is_invoke=True)
        self.operator.report = lambda kinds, text: self.reports.append((*kinds, text))

    def begin(self):
        assert self.operator.invoke(self.window, None) == {"RUNNING_MODAL"}

    def event(self, kind="TIMER", value="NOTHING"):
        return self.operator.modal(self.window, SimpleNamespace(type=kind, value=value))

    def go_on(self, seconds=30):
        """Until it ends, or at most for so many seconds; returns how it ended."""
        end = time.monotonic() + seconds
        while (done := self.event()) == {"PASS_THROUGH"} and time.monotonic() < end:
            time.sleep(0.01)
        return done


@pytest.fixture
def threaded(fmm, monkeypatch):
    """The module, as with a window."""
    module = importlib.import_module(f"{MODULE}.operators.threaded")
    monkeypatch.setattr(module, "bpy", SimpleNamespace(app=SimpleNamespace(background=False), types=bpy.types))
    yield module
    fmm.session.session.running = None


@pytest.fixture
def begun(build, threaded):
    """Begins a bake of a room, or another operator: `begun(kind)`."""
    build.room()
    bpy.context.scene.fmm_radiosity.particles = 300
    bpy.context.view_layer.update()

    def begin(kind=threaded.Threaded):
        bake = Bake(kind, Window())
        threaded.bpy.context = bake.window
        bake.begin()
        return bake

    return begin


def is_over(fmm, bake):
    return (fmm.session.session.running, bake.window.timers, bake.window.status) == (None, [], None)


def test_it_ends_as_it_began(fmm, begun):
    bake = begun()
    assert not is_over(fmm, bake)
    assert bake.go_on() == {"FINISHED"}
    assert is_over(fmm, bake)
    assert "Radiosity" in bpy.data.meshes["Box"].color_attributes


def test_escape_leaves_everything_as_it_was(fmm, begun):
    bake = begun()
    assert bake.event("ESC", "PRESS") == {"CANCELLED"}
    assert is_over(fmm, bake)
    assert "Radiosity" not in bpy.data.meshes["Box"].color_attributes
    assert bake.reports == [("INFO", "Bake cancelled, nothing was changed")]


def test_a_mistake_of_the_program_does_not_lock_the_panel(fmm, begun, threaded):
    def wrong(*_):
        raise ValueError("a mistake")

    bake = begun(type("Wrong", (threaded.Threaded,), {"solve": wrong}))
    with pytest.raises(ValueError, match="a mistake"):
        bake.go_on()
    assert is_over(fmm, bake)


def test_switching_the_extension_off_ends_a_bake(fmm, begun, threaded):
    bake = begun()
    threaded.stop()
    assert is_over(fmm, bake)
    threaded.stop()


def test_colours_wait_until_the_artist_leaves_edit_mode(fmm, begun):
    bake = begun()
    bpy.context.view_layer.objects.active = bpy.data.objects["Box"]
    bpy.ops.object.mode_set(mode="EDIT")
    assert bake.go_on(3) == {"PASS_THROUGH"}
    running = fmm.session.session.running
    assert (running.text, running.seconds_left()) == ("Switch to Object Mode first", None)
    bpy.ops.object.mode_set(mode="OBJECT")
    assert bake.go_on(3) == {"FINISHED"}
    assert baked(bpy.data.meshes["Box"]).any()


def test_another_scene_in_the_window_changes_no_expected_time(fmm, begun):
    bake = begun()
    scene, layer = bpy.context.scene, bpy.context.view_layer
    bpy.context.window.scene = bpy.data.scenes.new("Other")
    assert bake.go_on() == {"FINISHED"}
    bpy.context.window.scene = scene
    total = fmm.session.session.report["seconds"]["total"]
    assert fmm.estimate.of_scene(scene, layer).seconds == pytest.approx(total)


@pytest.mark.parametrize("gone", [False, True])
def test_frames_of_another_scene_are_not_touched(fmm, begun, threaded, gone):
    frames = importlib.import_module(f"{MODULE}.operators.bake_frames").FMM_RADIOSITY_OT_bake_frames
    kind = type("Frames", (threaded.Threaded,), {
        name: value for name, value in vars(frames).items() if not name.startswith("__") and name[:3] != "bl_"
    })  # fmt: skip
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end, other = 1, 3, bpy.data.scenes.new("Other")
    scene.frame_set(2)
    other.frame_set(5)
    bake = begun(kind)
    bpy.context.window.scene = other
    if gone:
        bpy.data.scenes.remove(scene)
    assert bake.go_on() == {"CANCELLED"}
    assert is_over(fmm, bake)
    assert other.frame_current == 5
    assert gone or scene.frame_current == 2
    assert bake.reports == [("ERROR", "frame 2: the window no longer shows scene 'Scene'")]
