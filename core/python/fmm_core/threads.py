# SPDX-License-Identifier: GPL-3.0-or-later
"""How many threads the work is shared among."""

import os
from numbers import Integral

from . import _binding
from .errors import Error

_limit = 0


def limit_threads(count: int) -> bool:
    """Uses at most `count` threads from now on in this process, 0 for as many as there are cores.

    Returns whether that holds for everything: the sums keep the number that they had at the first solve, rays do not.
    Raises `Error` on a number below 0.
    """
    global _limit
    if not isinstance(count, Integral) or count < 0:
        raise Error(f"limit_threads: expected a whole number, 0 or more, got {count!r}")
    if count == _limit:
        return True
    _limit = int(count)
    return _binding.limit_threads(_limit)


def threads() -> int:
    """How many threads rays are traced in."""
    return _limit or os.cpu_count() or 1
