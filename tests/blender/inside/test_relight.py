# SPDX-License-Identifier: GPL-3.0-or-later
"""Relighting by the button, and by itself."""

import time

import bpy
import numpy as np
import pytest
from scenes import baked


@pytest.fixture(autouse=True)
def room(build):
    bpy.context.scene.fmm_radiosity.particles = 300
    build.room()
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}


@pytest.fixture
def live(fmm):
    """Switches Live on, and off in the end; `live()` does what Blender's timer would, until nothing is left to do."""
    manager = bpy.context.window_manager
    assert manager.fmm_radiosity_live is False
    manager.fmm_radiosity_live = True

    def follow():
        bpy.context.view_layer.update()
        wanted = fmm.live._follower.due is not None
        end = time.monotonic() + 30
        while fmm.live._turn() is not None and time.monotonic() < end:
            time.sleep(0.02)
        return wanted

    yield follow
    bpy.context.window_manager.fmm_radiosity_live = False


def glow(strength):
    bpy.data.materials["Glow"].node_tree.nodes["Emission"].inputs["Strength"].default_value = strength


def box():
    return baked(bpy.data.meshes["Box"])[:, :3]


def test_relight_needs_a_bake_of_the_same_meshes(fmm):
    before = box()
    glow(2.0)
    assert bpy.ops.fmm_radiosity.relight() == {"FINISHED"}
    assert np.allclose(box(), 2 * before, rtol=1e-4)
    assert fmm.session.session.report["counts"]["rays"] == 0
    bpy.data.objects["Box"].location.z += 0.2
    kept = box()
    with pytest.raises(RuntimeError, match="bake again"):
        bpy.ops.fmm_radiosity.relight()
    assert (box() == kept).all()
    # What the failed one left still serves.
    bpy.data.objects["Box"].location.z -= 0.2
    glow(1.0)
    assert bpy.ops.fmm_radiosity.relight() == {"FINISHED"}
    assert np.allclose(box(), before, rtol=1e-4)
    fmm.session.session.solution = None
    with pytest.raises(RuntimeError, match="Bake first"):
        bpy.ops.fmm_radiosity.relight()


def test_live_follows_lights_and_nothing_else(fmm, live):
    before = box()
    glow(3.0)
    assert live()
    assert np.allclose(box(), 3 * before, rtol=1e-4)
    assert fmm.session.session.report["counts"]["rays"] == 0
    # What it has written itself is no reason to begin again.
    assert not live()
    bpy.data.objects["Box"].location.z += 0.2
    assert not live()
    kept = box()
    glow(1.0)
    assert live()
    assert "bake again" in fmm.session.session.problem
    assert (box() == kept).all()
    bpy.data.objects["Box"].location.z -= 0.2
    glow(1.5)
    assert live()
    assert fmm.session.session.problem is None
    assert np.allclose(box(), 1.5 * before, rtol=1e-4)


def test_live_is_not_started_by_what_evaluates_noise(fmm, live):
    tree = bpy.data.materials["Red"].node_tree
    shader = next(node for node in tree.nodes if node.type == "BSDF_DIFFUSE")
    tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs["Color"], shader.inputs["Color"])
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    before = box()
    assert live()
    glow(2.0)
    assert live()
    assert np.allclose(box(), 2 * before, rtol=1e-4)
    assert not live()


def test_live_follows_the_frame_that_is_shown(fmm, live):
    strength = bpy.data.materials["Glow"].node_tree.nodes["Emission"].inputs["Strength"]
    for frame, value in ((1, 1.0), (11, 4.0)):
        strength.default_value = value
        strength.keyframe_insert("default_value", frame=frame)
    scene = bpy.context.scene
    scene.frame_set(1)
    live()
    before = box()
    scene.frame_set(11)
    assert live()
    assert np.allclose(box(), 4 * before, rtol=1e-4)
    # Bake Frames goes through frames of its own accord.
    fmm.session.session.running = fmm.session.Running()
    scene.frame_set(1)
    fmm.session.session.running = None
    assert not live()


def test_live_waits_until_the_artist_leaves_edit_mode(fmm, live):
    before = box()
    bpy.context.view_layer.objects.active = bpy.data.objects["Box"]
    bpy.ops.object.mode_set(mode="EDIT")
    glow(2.0)
    bpy.context.view_layer.update()
    end = time.monotonic() + 2
    while time.monotonic() < end:
        assert fmm.live._turn() is not None
    assert fmm.session.session.problem is None
    bpy.ops.object.mode_set(mode="OBJECT")
    assert live()
    assert np.allclose(box(), 2 * before, rtol=1e-4)


def test_live_begins_anew_after_a_mistake_of_the_program(fmm, live, monkeypatch):
    before = box()
    with monkeypatch.context() as patch:
        patch.setattr(fmm.export.Reading, "painting", lambda _: 1 / 0)
        glow(2.0)
        with pytest.raises(ZeroDivisionError):
            live()
    glow(3.0)
    assert live()
    assert np.allclose(box(), 3 * before, rtol=1e-4)


def test_live_waits_for_a_pause(fmm, live):
    glow(3.0)
    bpy.context.view_layer.update()
    assert fmm.live._turn() == fmm.live.LOOK
    assert fmm.live._follower.future is None


def test_live_is_off_in_every_new_file(fmm, live, tmp_path):
    handlers = bpy.app.handlers.depsgraph_update_post
    assert fmm.live.changed in handlers
    path = tmp_path / "live.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    assert not any(manager.fmm_radiosity_live for manager in bpy.data.window_managers)
    assert fmm.live.changed not in handlers
    assert not bpy.app.timers.is_registered(fmm.live._turn)


def test_relight_says_that_another_surface_glows():
    blue, kept = bpy.data.materials["Blue"].node_tree.nodes["Principled BSDF"].inputs, box()
    colour = "Emission Color" if "Emission Color" in blue else "Emission"
    blue[colour].default_value, blue["Emission Strength"].default_value = (1, 1, 1, 1), 2.0
    with pytest.raises(RuntimeError, match="surfaces began or ceased to glow"):
        bpy.ops.fmm_radiosity.relight()
    assert (box() == kept).all()
