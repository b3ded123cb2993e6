# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress of long work, and how it is cancelled."""

from collections.abc import Callable

from .errors import Cancelled

#: Called with a fraction from 0 to 1 and a text; anything false but None cancels.
Progress = Callable[[float, str], bool | None]
#: Called with the fraction done of one phase; raises `Cancelled`.
Tick = Callable[[float], None]


def ticker(progress: Progress | None, start: float, end: float, text: str) -> Tick:
    """Progress of one phase, which is the part from `start` to `end` of the whole."""

    def tick(fraction: float) -> None:
        if progress is None:
            return
        answer = progress(start + (end - start) * min(1.0, fraction), text)
        if answer is not None and not answer:
            raise Cancelled

    return tick


def part(progress: Progress | None, start: float, end: float) -> Progress | None:
    """Progress of one step of several phases, which is the part from `start` to `end` of the whole."""
    if progress is None:
        return None
    return lambda fraction, text: progress(start + (end - start) * fraction, text)


def silent(fraction: float) -> None:
    """A tick that tells nobody."""
