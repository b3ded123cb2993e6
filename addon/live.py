# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours that follow the lights: after a change of lamps or materials the last bake is solved again by itself.

It waits until nothing has changed for a moment, reads the scene, solves in the thread of the bakes, and writes.
"""

from __future__ import annotations

import time
from concurrent.futures import Future
from contextlib import AbstractContextManager, nullcontext

import bpy
import fmm_core

from . import bake, properties
from .messages import told
from .node_fields import SCRATCH
from .session import session

#: Seconds without a change before anything is done, between two looks at the thread, and of reading at a time.
QUIET, LOOK, MOMENT = 0.2, 0.05, 0.04
#: Datablocks that light depends on beside the geometry.
_LIGHTS = ("MATERIAL", "LIGHT", "WORLD", "NODETREE")


class _Follower:
    """When to solve again, and the reading and the solve under way."""

    def __init__(self) -> None:
        self.due: float | None = None
        self.reading: bake.Reading | None = None
        self.settings: fmm_core.Settings | None = None
        self.future: Future | None = None

    def turn(self) -> float | None:
        """One look, from Blender's timer; returns the seconds until the next one, None for the last."""
        if self.future is None and self.reading is None and self.due is None:
            return None
        with _window():
            if bpy.context.mode == "EDIT_MESH":
                return QUIET
        if self.future is not None:
            return self._finish() if self.future.done() else LOOK
        if session.running is not None or (self.reading is None and time.monotonic() < self.due):
            return LOOK
        if session.solution is None:
            session.problem = self.reading = self.due = None
            return None
        try:
            return self._read_on()
        except bake.FAILURES as error:
            session.problem = told(bake.reason(error))
            return self._rest()

    def _read_on(self) -> float:
        """Begin to read or go on; once all is read let the thread solve it."""
        with _window():
            if self.reading is None:
                self.due, context = None, bpy.context
                self.settings = properties.settings_of(context.scene)
                self.reading = bake.reading(context, context.scene.fmm_radiosity.keep_visibility)
            # What fails is not gone on with.
            reading, self.reading = self.reading, None
            data = bake.read_on(reading, MOMENT)
        if data is None:
            self.reading = reading
            return 0.0
        self.future = session.submit(bake.compute, data, self.settings, None, session, False)
        return LOOK

    def _finish(self) -> float | None:
        future, self.future = self.future, None
        try:
            session.finish(bake.write(future.result()))
        except bake.FAILURES as error:
            session.problem = told(bake.reason(error))
        _redraw()
        return self._rest()

    def _rest(self) -> float | None:
        """Seconds until the next turn, if anything has changed meanwhile."""
        return None if self.due is None else LOOK


_follower = _Follower()


@bpy.app.handlers.persistent
def changed(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Note that light has changed; called by Blender after every update."""
    if scene.name.startswith(SCRATCH) or not any(_is_light(update.id) for update in depsgraph.updates):
        return
    _follower.due = time.monotonic() + QUIET
    if not bpy.app.timers.is_registered(_turn):
        bpy.app.timers.register(_turn, first_interval=QUIET)


@bpy.app.handlers.persistent
def moved(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Note that the light of another frame may be another; called by Blender after every change of the frame."""
    # Bake Frames changes it by itself.
    if session.running is None:
        changed(scene, depsgraph)


def _turn() -> float | None:
    return _follower.turn()


def _is_light(block: bpy.types.ID) -> bool:
    return block.id_type in _LIGHTS or (block.id_type == "OBJECT" and block.type == "LIGHT")


def _window() -> AbstractContextManager:
    """Timers have no window, and without one no scene."""
    windows = bpy.context.window_manager.windows
    return bpy.context.temp_override(window=windows[0]) if windows else nullcontext()


def _redraw() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


@bpy.app.handlers.persistent
def _off(*_: object) -> None:
    """Begin every file with the switch off, however it was saved."""
    for manager in bpy.data.window_managers:
        manager.fmm_radiosity_live = False


def _switch(manager: bpy.types.WindowManager, _context: bpy.types.Context) -> None:
    stop()
    if manager.fmm_radiosity_live:
        bpy.app.handlers.depsgraph_update_post.append(changed)
        bpy.app.handlers.frame_change_post.append(moved)


def stop() -> None:
    """Follow no longer."""
    session.problem = None
    _follower.__init__()
    for handlers, handler in (
        (bpy.app.handlers.depsgraph_update_post, changed),
        (bpy.app.handlers.frame_change_post, moved),
    ):
        if handler in handlers:
            handlers.remove(handler)
    if bpy.app.timers.is_registered(_turn):
        bpy.app.timers.unregister(_turn)


def register() -> None:
    """Add the switch, which is off and is not saved."""
    bpy.types.WindowManager.fmm_radiosity_live = bpy.props.BoolProperty(
        name="Live",
        description="Relight by itself whenever a lamp or a material changes, until Blender is closed",
        default=False,
        update=_switch,
    )
    bpy.app.handlers.load_post.append(_off)


def unregister() -> None:
    """Take everything away."""
    stop()
    bpy.app.handlers.load_post.remove(_off)
    del bpy.types.WindowManager.fmm_radiosity_live
