# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors raised on bad input; each is one line that names the thing and the value."""


class Error(Exception):
    """Base class of every error that fmm_core raises on bad input."""


class Cancelled(Error):
    """The progress callback returned False."""

    def __init__(self) -> None:
        super().__init__("cancelled")
