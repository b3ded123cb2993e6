# SPDX-License-Identifier: GPL-3.0-or-later
"""What all operators share that solve in a thread of their own while the window stays alive."""

from __future__ import annotations

import math
from concurrent.futures import Future

import bpy
import fmm_core
from bpy.app.translations import pgettext_iface as translated

from ..addon import bake, estimate, properties
from ..addon.messages import told
from ..addon.panels import draw_status
from ..addon.report import summary
from ..addon.session import Running, session

#: Seconds between two looks at the thread, and of reading at a time; both are the same in single precision.
LOOK, MOMENT = 1 / 8, 1 / 32
#: The operator that waits for its thread, if there is one.
_under_way: list[Threaded] = []


def stop() -> None:
    """End what is under way: Blender does not tell an operator that its class is about to go."""
    for operator in tuple(_under_way):
        operator.cancel(bpy.context)


class ReadsScene:
    """What an operator needs that reads the scene as a bake does."""

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


class Threaded(ReadsScene):
    """Reads the scene step by step, solves in a thread, writes the colours. Escape cancels; in background straight
    through.
    """

    _timer: bpy.types.Timer | None = None
    _reading: bake.Reading | None = None
    _future: Future | None = None
    _running: Running | None = None
    _settings: fmm_core.Settings | None = None
    _expected: estimate.Cost | None = None

    def reading(self, context: bpy.types.Context) -> bake.Reading:
        """Read what is to be solved."""
        self._expected = estimate.of_scene(context.scene, context.view_layer)
        return bake.reading(context, context.scene.fmm_radiosity.keep_visibility)

    def solve(self, data: bake.Input, settings: fmm_core.Settings, progress: bake.Progress | None) -> bake.Result:
        """Solve; runs in the thread, away from Blender."""
        return bake.compute(data, settings, progress, session)

    def following(self, context: bpy.types.Context, result: bake.Result) -> bake.Reading | None:
        """Read what is to be solved after this, if anything."""
        return None

    def write(self, context: bpy.types.Context, result: bake.Result) -> dict:
        """Write the last result; returns the report."""
        report = bake.write(result)
        estimate.learn(report, self._expected)
        return report

    def end(self, context: bpy.types.Context) -> None:
        """Called once `invoke` or `execute` has begun, however it ends."""

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Straight through."""
        try:
            settings, steps = properties.settings_of(context.scene), self.reading(context)
            while steps is not None:
                result = self.solve(bake.read_on(steps, math.inf), settings, None)
                steps = self.following(context, result)
            return self.succeed(context, result)
        except bake.FAILURES as error:
            return self._fail(context, error)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """In a thread of its own, where there is a window."""
        if bpy.app.background or not self.options.is_invoke:
            return self.execute(context)
        self._running = Running()
        try:
            self._settings, self._reading = properties.settings_of(context.scene), self.reading(context)
            self._read_on(context)
        except bake.FAILURES as error:
            return self._fail(context, error)
        session.running = self._running
        _under_way.append(self)
        context.window_manager.modal_handler_add(self)
        _show(context)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Read on, or watch the thread."""
        try:
            if event.type == "ESC" and event.value == "PRESS":
                raise fmm_core.Cancelled
            result = self._look(context) if event.type == "TIMER" else None
            if result is None:
                return {"PASS_THROUGH"}
            self._stop(context)
            return self.succeed(context, result)
        except bake.FAILURES as error:
            self._stop(context)
            return self._fail(context, error)
        except BaseException:
            # Blender lets go of an operator with a mistake in it, and calls nothing of it any more.
            self.cancel(context)
            raise

    def _look(self, context: bpy.types.Context) -> object | None:
        """The last result, once it is there and can be written."""
        if self._reading is None:
            if not self._future.done() or context.mode != "OBJECT":
                if self._future.done():
                    self._running.progress(1.0, "Switch to Object Mode first")
                _show(context)
                return None
            result = self._future.result()
            self._reading = self.following(context, result)
            if self._reading is None:
                return result
        self._read_on(context)
        return None

    def _read_on(self, context: bpy.types.Context) -> None:
        """Read for a moment; once all is read let the thread solve it."""
        data = bake.read_on(self._reading, MOMENT)
        if data is not None:
            self._reading = None
            self._future = session.submit(self.solve, data, self._settings, self._running.progress)
        self._wake(context, MOMENT if data is None else LOOK)

    def _wake(self, context: bpy.types.Context, seconds: float | None) -> None:
        """Let `modal` be called every so many seconds, or no longer."""
        if self._timer is not None and (seconds is None or self._timer.time_step != seconds):
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        if self._timer is None and seconds is not None:
            self._timer = context.window_manager.event_timer_add(seconds, window=context.window)

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when it ends the operator, as when a file is opened or the program quits."""
        self._stop(context)
        self.end(context)

    def _stop(self, context: bpy.types.Context) -> None:
        """Let go of the thread: where it still runs, it ends by itself at the next step and its work is dropped."""
        self._running.cancelled = True
        session.running = None
        if self in _under_way:
            _under_way.remove(self)
        self._wake(context, None)
        context.workspace.status_text_set(None)
        _redraw(context)

    def succeed(self, context: bpy.types.Context, result: bake.Result) -> set[str]:
        """Write the colours, and tell of the bake."""
        report = self.write(context, result)
        session.finish(report)
        self.end(context)
        for warning in report["warnings"]:
            self.report({"WARNING"}, told(warning))
        self.report({"INFO"}, f"{translated('Radiosity baked')}: {summary(report, translated)}")
        return {"FINISHED"}

    def _fail(self, context: bpy.types.Context, error: Exception) -> set[str]:
        self.end(context)
        if isinstance(error, fmm_core.Cancelled):
            self.report({"INFO"}, translated("Bake cancelled, nothing was changed"))
        else:
            self.report({"ERROR"}, told(bake.reason(error)))
        return {"CANCELLED"}


def _show(context: bpy.types.Context) -> None:
    # Setting it again draws it again.
    context.workspace.status_text_set(draw_status)
    _redraw(context)


def _redraw(context: bpy.types.Context) -> None:
    """Draw the panels again; the picture of the scene, which takes longer, has not changed."""
    shown = {"VIEW_3D": "UI", "PROPERTIES": "WINDOW"}
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            for region in area.regions:
                if region.type == shown.get(area.type):
                    region.tag_redraw()


class Again(Threaded):
    """The same by the solution of the last bake."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """As a bake, and after one."""
        if session.running is None and session.solution is None:
            cls.poll_message_set("Bake first")
            return False
        return super().poll(context)
