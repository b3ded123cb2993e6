# SPDX-License-Identifier: GPL-3.0-or-later
"""Measured reflection: files that materials name."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from fmm_core import Brdf, Error

if TYPE_CHECKING:
    import bpy

#: Files that are kept from bake to bake, some 50 MB each.
_KEPT = 4


class Tables:
    """The tables of the materials of one scene: found, each once, in the order of their numbers."""

    def __init__(self) -> None:
        self.found: list[Brdf] = []
        self._numbers: dict[Path, int] = {}

    def number(self, material: bpy.types.Material) -> int | None:
        """Of the file that a material names, or None. Raises fmm_core.Error naming both where it cannot be read."""
        import bpy

        given = material.fmm_radiosity.brdf
        if not given:
            return None
        path = Path(bpy.path.abspath(given, library=material.library))
        if path not in self._numbers:
            try:
                about = path.stat()
                self.found.append(_loaded(path, about.st_mtime_ns, about.st_size))
            except Error as error:
                raise Error(f"material '{material.name}': {error}") from None
            except OSError as error:
                why = error.strerror or error
                raise Error(f"material '{material.name}': '{path}' cannot be read: {why}") from None
            self._numbers[path] = len(self.found) - 1
        return self._numbers[path]


@lru_cache(_KEPT)
def _loaded(path: Path, _changed: int, _size: int) -> Brdf:
    return Brdf.load(path)
