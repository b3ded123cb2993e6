# SPDX-License-Identifier: GPL-3.0-or-later
"""How long the extension holds Blender up: by its own code in the main thread, and by its thread, which may keep the
interpreter to itself.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import bpy

#: Seconds that nothing of the extension may hold up the program.
LONGEST = 0.1
#: Seconds between two beats of the thread that listens.
BEAT = 0.005


class Stalls:
    """Seconds since `forget` that the longest call of the extension by Blender took, by its name; that the interpreter
    was kept from a thread that does nothing; and that passed between two turns of the main loop, drawing included.

    The first two are the extension's doing, less the time that other programs had the processor, where the system
    tells. How long the window takes to be drawn depends on the graphics card.
    """

    def __init__(self) -> None:
        self.forget()
        threading.Thread(target=self._listen, daemon=True).start()
        bpy.app.timers.register(self._turn, persistent=True)

    def forget(self) -> None:
        """Begin anew."""
        self.calls: dict[str, float] = {}
        self.kept = self.turn = 0.0
        self._last = time.perf_counter()

    def watch(self, module: str) -> None:
        """Time whatever Blender calls in the extension of this name: operators, panels, timers."""
        panels, live, threaded = (
            sys.modules[f"{module}.{name}"] for name in ("addon.panels", "addon.live", "operators.threaded")
        )
        for kind in panels.CLASSES:
            kind.draw = self._timed(f"{kind.__name__}.draw", kind.draw)
        for name in ("invoke", "modal"):
            setattr(threaded.Threaded, name, self._timed(name, getattr(threaded.Threaded, name)))
        threaded.draw_status = self._timed("draw_status", threaded.draw_status)
        live._Follower.turn = self._timed("live", live._Follower.turn)

    def check(self, when: str) -> None:
        """Say what was longest, assert that the extension's part is short, and begin anew."""
        name = max(self.calls, key=self.calls.get, default="none")
        called = self.calls.get(name, 0.0)
        print(f"drive: stalls {when}: {name} {1000 * called:.0f} ms, interpreter kept {1000 * self.kept:.0f} ms, "
              f"turn {1000 * self.turn:.0f} ms", flush=True)  # fmt: skip
        assert called < LONGEST, self.calls
        assert self.kept < LONGEST
        self.forget()

    def _timed(self, name: str, function: Callable) -> Callable:
        def timed(*arguments: object) -> object:
            start, waited = time.perf_counter(), _waited()
            try:
                return function(*arguments)
            finally:
                took = time.perf_counter() - start - (_waited() - waited)
                self.calls[name] = max(self.calls.get(name, 0.0), took)

        # Blender gives a function as many arguments as its code names.
        counted = {1: lambda a: timed(a), 2: lambda a, b: timed(a, b), 3: lambda a, b, c: timed(a, b, c)}
        return counted[function.__code__.co_argcount]

    def _turn(self) -> float:
        now = time.perf_counter()
        self.turn, self._last = max(self.turn, now - self._last), now
        return BEAT

    def _listen(self) -> None:
        while True:
            start, waited = time.perf_counter(), _waited()
            time.sleep(BEAT)
            self.kept = max(self.kept, time.perf_counter() - start - BEAT - (_waited() - waited))


def _waited() -> float:
    """Seconds that this thread has waited for a processor so far, which other programs may have had; 0 if unknown."""
    path = Path("/proc/thread-self/schedstat")
    return int(path.read_text().split()[1]) / 1e9 if path.exists() else 0.0
