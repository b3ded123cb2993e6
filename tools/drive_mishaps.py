# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps of `drive_blender.py` in which something else happens while a bake is under way."""

from __future__ import annotations

import bpy
from bl_ui.space_statusbar import STATUSBAR_HT_header
from blender_window import (
    LOOK,
    MODULE,
    ROOT,
    Steps,
    all_colours,
    open_file,
    open_scene,
    operate,
    press,
    select,
    session,
    until_done,
    until_half_way,
    window,
)

CORNELL_BOX = ROOT / "examples" / "cornell_box.blend"


def _begin() -> Steps:
    yield from open_scene(CORNELL_BOX)
    assert operate("fmm_radiosity.bake") == {"RUNNING_MODAL"}
    yield from until_half_way(0.2)


def _written() -> list[bool]:
    return [values is not None for values in all_colours().values()]


def edit_mode() -> Steps:
    """Colours wait until Edit Mode is left."""
    yield from _begin()
    select("Room")
    press("TAB")
    yield 0.5
    assert bpy.context.mode == "EDIT_MESH"
    while session().running.text != "Switch to Object Mode first":
        yield LOOK
    yield 0.5
    assert session().running is not None
    assert not any(_written())
    press("TAB")
    yield from until_done()
    assert all(_written())


def another_scene() -> Steps:
    """The window shows another scene: the bake is written where it was begun."""
    yield from _begin()
    scene, other = window().scene, bpy.data.scenes.new("Other")
    window().scene = other
    yield from until_done()
    assert all(_written())
    window().scene = scene
    bpy.data.scenes.remove(other)


def another_file() -> Steps:
    """A file is opened: the bake ends, and nothing of it gets there."""
    yield from _begin()
    yield from open_file(CORNELL_BOX)
    assert session().running is None
    yield 3.0
    assert (session().report, session().solution) == (None, None)
    assert not any(_written())


def switched_off() -> Steps:
    """The extension is switched off: the bake ends and the status bar is Blender's own again; it comes back."""
    usual = STATUSBAR_HT_header.draw
    yield from _begin()
    assert STATUSBAR_HT_header.draw != usual
    with bpy.context.temp_override(window=window()):
        bpy.ops.preferences.addon_disable(module=MODULE)
    yield 0.5
    assert STATUSBAR_HT_header.draw == usual
    with bpy.context.temp_override(window=window()):
        bpy.ops.preferences.addon_enable(module=MODULE)
    yield from _begin()
    yield from until_done()
    assert all(_written())


def mishaps() -> Steps:
    """All of them."""
    for step in (edit_mode, another_scene, another_file, switched_off):
        yield from step()
