# SPDX-License-Identifier: GPL-3.0-or-later
"""What a running Blender remembers between redraws and never saves: the bake under way, and the last one."""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    import fmm_core

    from .solving import Places

#: Before so much is done nobody can tell when the rest will be.
_FIRST_FRACTION = 0.03


@dataclass
class Running:
    """A bake under way, shared between its thread and the window: the thread writes, the window asks to cancel."""

    fraction: float = 0.0
    text: str = "Reading the scene"
    cancelled: bool = False
    began: float = field(default_factory=time.monotonic)

    def progress(self, fraction: float, text: str) -> bool:
        """Progress callback of the solve; False once the user has cancelled."""
        self.fraction, self.text = fraction, text
        return not self.cancelled

    def seconds_left(self) -> float | None:
        """Seconds that the rest takes if it goes on as it did so far, None where that cannot be told."""
        if not _FIRST_FRACTION <= self.fraction < 1:
            return None
        return (time.monotonic() - self.began) * (1 - self.fraction) / self.fraction


@dataclass
class Session:
    """What is remembered.

    running: the bake under way or None; report: that of the last finished bake or None; effects: which ones the scene
    called for when it was last looked at, as in a report, or None; solution: what it solved, which serves the next bake
    where only lights and colours have changed, or None; places: where its light was found; map_top: the error that the
    brightest colour of the error map stands for, or None; pace: how much longer bakes take on this machine than
    `estimate` has it; views: how 3D views were shaded before they showed the result; problem: why the colours do not
    follow the lights at the moment, or None; moving: whether a bake that follows the last one keeps what it can of its
    rays where things have moved; threads_late: whether the wanted number of threads came too late for this
    process
    """

    running: Running | None = None
    report: dict | None = None
    effects: dict[str, dict] | None = None
    solution: fmm_core.Solution | None = None
    places: Places | None = None
    map_top: float | None = None
    pace: float = 1.0
    views: dict[int, dict[str, object]] = field(default_factory=dict)
    problem: str | None = None
    moving: bool = False
    threads_late: bool = False
    _pool: ThreadPoolExecutor | None = None

    def finish(self, report: dict) -> None:
        """Remember what a bake came to."""
        self.report, self.effects, self.problem = report, report["effects"], None

    def forget(self) -> None:
        """Let go of the last bake: another file has other geometry, and its solution can be large."""
        self.solution = self.places = self.map_top = self.report = self.effects = self.problem = None
        self.views.clear()

    def submit(self, work: Callable, *arguments: object) -> Future:
        """Start work in the thread that all bakes share: one that was cancelled ends before the next one begins."""
        if self._pool is None:
            self._pool = ThreadPoolExecutor(max_workers=1)
        return self._pool.submit(work, *arguments)

    def close(self) -> None:
        """Cancel what is under way, wait for its end and forget everything."""
        if self.running is not None:
            self.running.cancelled = True
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
        self.__init__()


session = Session()
