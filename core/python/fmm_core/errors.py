# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors raised on bad input; each is one line that names the thing and the value."""

from collections.abc import Iterator
from contextlib import contextmanager


class Error(Exception):
    """Base class of every error that fmm_core raises on bad input."""


class Cancelled(Error):
    """The progress callback returned False."""

    def __init__(self) -> None:
        super().__init__("cancelled")


@contextmanager
def memory_errors() -> Iterator[None]:
    """Turns Python's MemoryError into an `Error`."""
    try:
        yield
    except MemoryError:
        raise Error("out of memory: use fewer particles, or a machine with more of it") from None
