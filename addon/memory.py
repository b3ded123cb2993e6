# SPDX-License-Identifier: GPL-3.0-or-later
"""The limit on the memory of a bake: checked against the estimate before, and on Linux against the truth during it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import fmm_core

#: Called with a fraction from 0 to 1 and a text; returning False cancels.
Progress = Callable[[float, str], bool | None]
_STATUS = Path("/proc/self/statm")


def check(expected_mib: int, limit_mib: int) -> None:
    """Raise fmm_core.Error where a bake is expected to need more than the limit, 0 for none."""
    if limit_mib and expected_mib > limit_mib:
        raise fmm_core.Error(f"the bake would need about {expected_mib:,} MiB of memory, more than the limit in the "
                             f"preferences, {limit_mib:,} MiB")  # fmt: skip


def limited(progress: Progress | None, limit_mib: int) -> Progress | None:
    """Progress that raises fmm_core.Error once this process takes so much more than it did, 0 for no limit."""
    before = resident_mib()
    if not limit_mib or before is None:
        return progress

    def check_and_tell(fraction: float, text: str) -> bool | None:
        if resident_mib() - before > limit_mib:
            raise fmm_core.Error(f"the bake needs more memory than the limit in the preferences, {limit_mib:,} MiB")
        return None if progress is None else progress(fraction, text)

    return check_and_tell


def resident_mib() -> float | None:
    """Memory of this process, MiB; None where the system does not tell it in a file."""
    try:
        pages = int(_STATUS.read_text(encoding="ascii").split()[1])
    except OSError:
        return None
    return pages * os.sysconf("SC_PAGE_SIZE") / (1 << 20)
