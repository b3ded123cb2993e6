# SPDX-License-Identifier: GPL-3.0-or-later
"""What a running Blender remembers between redraws and never saves: the bake under way and the last report."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Running:
    """A bake under way, shared between its thread and the window: the thread writes, the window asks to cancel."""

    fraction: float = 0.0
    text: str = "Reading the scene"
    cancelled: bool = False

    def progress(self, fraction: float, text: str) -> bool:
        """Progress callback of the solve; False once the user has cancelled."""
        self.fraction, self.text = fraction, text
        return not self.cancelled


@dataclass
class Session:
    """running: the bake under way or None; report: that of the last finished bake or None."""

    running: Running | None = None
    report: dict | None = None


session = Session()
