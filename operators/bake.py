# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake the radiosity of the scene into a colour attribute of its meshes."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from typing import ClassVar

import bpy
from fmm_core import Cancelled

from ..addon import bake, properties
from ..addon.session import Running, session


class FMM_RADIOSITY_OT_bake(bpy.types.Operator):
    """Solve the light of the scene and write it to the colour attribute "Radiosity" of every mesh"""

    bl_idname = "fmm_radiosity.bake"
    bl_label = "Bake Radiosity"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    _timer: bpy.types.Timer | None = None
    _pool: ThreadPoolExecutor | None = None
    _future: Future | None = None

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Object Mode, and no other bake under way."""
        if session.running is not None:
            cls.poll_message_set("A bake is under way")
            return False
        if context.mode != "OBJECT":
            cls.poll_message_set("Switch to Object Mode first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Bake straight through."""
        try:
            keep = context.scene.fmm_radiosity.keep_visibility
            report = bake.bake(context, properties.settings_of(context.scene), keep=keep, session=session)
        except bake.FAILURES as error:
            return self._fail(error)
        return self._succeed(report)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Bake in a thread of its own while the window stays alive; Escape cancels."""
        if bpy.app.background or not self.options.is_invoke:
            return self.execute(context)
        try:
            settings = properties.settings_of(context.scene)
            data = bake.read(context, context.scene.fmm_radiosity.keep_visibility)
        except bake.FAILURES as error:
            return self._fail(error)
        session.running = Running()
        self._pool = ThreadPoolExecutor(max_workers=1)
        self._future = self._pool.submit(bake.compute, data, settings, session.running.progress, session)
        self._timer = context.window_manager.event_timer_add(0.1, window=context.window)
        context.workspace.status_text_set("Baking radiosity: Esc cancels")
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Watch the thread."""
        if event.type == "ESC" and event.value == "PRESS":
            session.running.cancelled = True
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        _redraw(context)
        if not self._future.done():
            return {"PASS_THROUGH"}
        future = self._future
        self._stop(context)
        try:
            return self._succeed(bake.write(future.result()))
        except bake.FAILURES as error:
            return self._fail(error)

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when it ends the operator, as when a file is opened or the program quits."""
        session.running.cancelled = True
        self._stop(context)

    def _stop(self, context: bpy.types.Context) -> None:
        self._pool.shutdown(wait=True)
        session.running = None
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)
        _redraw(context)

    def _succeed(self, report: dict) -> set[str]:
        session.report = report
        for warning in report["warnings"]:
            self.report({"WARNING"}, warning)
        self.report({"INFO"}, f"Radiosity baked: {bake.summary(report)}")
        return {"FINISHED"}

    def _fail(self, error: Exception) -> set[str]:
        if isinstance(error, Cancelled):
            self.report({"INFO"}, f"Bake {error}")
        else:
            self.report({"ERROR"}, bake.reason(error))
        return {"CANCELLED"}


def _redraw(context: bpy.types.Context) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
