# SPDX-License-Identifier: GPL-3.0-or-later
"""What a running Blender remembers between redraws and never saves: the bake under way, and the last one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import fmm_core


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
    """What is remembered.

    running: the bake under way or None; report: that of the last finished bake or None; solution: what it solved, which
    serves the next bake where only lights and colours have changed, or None.
    """

    running: Running | None = None
    report: dict | None = None
    solution: fmm_core.Solution | None = None


session = Session()
