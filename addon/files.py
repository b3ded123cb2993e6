# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import secrets
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from fmm_core import Error

# Blender cuts a longer path off without a word; a temporary name has to fit, too.
MAX_PATH_BYTES = 990


def check_readable(path: Path) -> None:
    """Raise fmm_core.Error, naming the path, where there is no file to read."""
    try:
        path.stat()
    except OSError as error:
        why = "no such file" if isinstance(error, FileNotFoundError) else error.strerror
        raise Error(f"cannot read '{path}': {why}") from None
    if not path.is_file():
        raise Error(f"cannot read '{path}': it is {'a folder' if path.is_dir() else 'no plain file'}")


def check_writable(paths: Iterable[Path]) -> None:
    """Raise fmm_core.Error, naming the path, where a file could not be written; nothing is left behind.

    Parent folders may be missing: what counts is the nearest one that exists.
    """
    for path in paths:
        with writing(path):
            final = resolved(path)
            if final.is_dir():
                raise IsADirectoryError(errno.EISDIR, "it is a folder")
            if _exists(final):
                final.open("ab").close()
            folder = next(parent for parent in final.parents if _exists(parent))
            tempfile.TemporaryFile(dir=folder).close()


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn what the system refuses inside into a fmm_core.Error that names the path."""
    try:
        yield
    except OSError as error:
        raise Error(f"cannot write '{path}': {error.strerror}") from None


def resolved(path: Path) -> Path:
    """The absolute path of the file that is meant, links followed; OSError where Blender could not take it."""
    final = Path(os.path.realpath(path))
    if len(os.fsencode(final)) > MAX_PATH_BYTES:
        raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG))
    return final


def _exists(path: Path) -> bool:
    """Whether something is there; OSError where that cannot be known, as with a name that is too long."""
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True


class Staged:
    """Output files under temporary names beside their own; `commit` moves all of them into place.

    Links are followed: what they point to is replaced. Used as a context manager, which removes what was not committed.
    """

    def __init__(self) -> None:
        self._pending: dict[Path, Path] = {}

    def path(self, final: Path) -> Path:
        """The temporary path to write a file to; its folder is made."""
        with writing(final):
            final = resolved(final)
            final.parent.mkdir(parents=True, exist_ok=True)
        # In the same folder, so that paths relative to a .blend stay true; a file must not be there yet, as Blender
        # would keep a backup of it.
        self._pending[final] = final.with_name(f".{secrets.token_hex(8)}{final.suffix}")
        return self._pending[final]

    def commit(self) -> None:
        """Move every file to its own name."""
        for final, temporary in list(self._pending.items()):
            with writing(final):
                temporary.replace(final)
            del self._pending[final]

    def __enter__(self) -> Staged:
        """Begin with no files."""
        return self

    def __exit__(self, *_error: object) -> None:
        """Remove what was not committed."""
        for temporary in self._pending.values():
            temporary.unlink(missing_ok=True)
