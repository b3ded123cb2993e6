# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that appear whole or not at all."""

from __future__ import annotations

import secrets
import tempfile
from collections.abc import Iterable
from pathlib import Path

from fmm_core import Error


def check_writable(paths: Iterable[Path]) -> None:
    """Raise fmm_core.Error, naming the path, where a file could not be written; nothing is left behind.

    Parent folders may be missing: what counts is the nearest one that exists.
    """
    for path in paths:
        if path.is_dir():
            raise Error(f"cannot write '{path}': it is a folder")
        folder = next(parent for parent in path.absolute().parents if parent.exists())
        try:
            if path.exists():
                path.open("ab").close()
            tempfile.TemporaryFile(dir=folder).close()
        except OSError as error:
            raise Error(f"cannot write '{path}': {error.strerror}") from None


class Staged:
    """Output files under temporary names beside their own; `commit` moves all of them into place.

    Used as a context manager, which removes what was not committed.
    """

    def __init__(self) -> None:
        self._pending: dict[Path, Path] = {}

    def path(self, final: Path) -> Path:
        """The temporary path to write a file to; its folder is made."""
        try:
            final.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise Error(f"cannot write '{final}': {error.strerror}") from None
        # In the same folder, so that paths relative to a .blend stay true; a file must not be there yet, as Blender
        # would keep a backup of it.
        self._pending[final] = final.with_name(f".{final.stem}-{secrets.token_hex(4)}{final.suffix}")
        return self._pending[final]

    def commit(self) -> None:
        """Move every file to its own name."""
        for final, temporary in list(self._pending.items()):
            temporary.replace(final)
            del self._pending[final]

    def __enter__(self) -> Staged:
        """Begin with no files."""
        return self

    def __exit__(self, *_error: object) -> None:
        """Remove what was not committed."""
        for temporary in self._pending.values():
            temporary.unlink(missing_ok=True)
