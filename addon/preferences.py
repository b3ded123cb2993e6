# SPDX-License-Identifier: GPL-3.0-or-later
"""What belongs to this computer and not to a scene: processor cores, memory, and where files go."""

from __future__ import annotations

import hashlib
from pathlib import Path

import bpy
import fmm_core

from .session import session

#: The package of the extension, by whose name Blender keeps its preferences.
PACKAGE = __package__.rpartition(".")[0]


def _limit(preferences: FMM_RADIOSITY_preferences, _context: bpy.types.Context | None = None) -> None:
    session.threads_late = not fmm_core.limit_threads(preferences.threads)


class FMM_RADIOSITY_preferences(bpy.types.AddonPreferences):
    """Shown in Blender's preferences under the extension."""

    bl_idname = PACKAGE

    threads: bpy.props.IntProperty(
        name="Processor Cores",
        description="A bake uses at most so many processor cores, 0 uses all. Fewer leave room for other programs",
        default=0,
        min=0,
        soft_max=64,
        max=1024,
        update=_limit,
    )
    memory_limit: bpy.props.IntProperty(
        name="Memory Limit (MiB)",
        description="A bake is not begun where it is expected to need more memory than this, 0 for no limit. On Linux "
        "it also ends when it does need more",
        default=0,
        min=0,
        soft_max=262_144,
    )
    visibility_folder: bpy.props.StringProperty(
        name="Visibility Folder",
        description="Folder for the files of Keep Visibility. Where none is named they go beside the .blend",
        subtype="DIR_PATH",
        default="",
    )

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw the preferences."""
        self.layout.use_property_split = True
        for name in ("threads", "memory_limit", "visibility_folder"):
            self.layout.prop(self, name)
        if session.threads_late:
            self.layout.label(text="The number of cores counts in full from the next start of Blender", icon="INFO")


def own() -> FMM_RADIOSITY_preferences | None:
    """The preferences of the extension; None where it runs without being installed."""
    addon = bpy.context.preferences.addons.get(PACKAGE)
    return None if addon is None else addon.preferences


def apply() -> None:
    """Take up the preferences as they were saved."""
    if own() is not None:
        _limit(own())


def memory_limit() -> int:
    """MiB that a bake may take, 0 for no limit."""
    return 0 if own() is None else own().memory_limit


def kept_file(blend: Path, suffix: str) -> Path:
    """The file that keeps the visibility of a .blend."""
    folder = "" if own() is None else own().visibility_folder
    if not folder:
        return blend.with_suffix(suffix)
    # Two files of one name in different folders are different scenes.
    place = hashlib.blake2b(str(blend.absolute()).encode(), digest_size=4).hexdigest()
    return Path(bpy.path.abspath(folder)) / f"{blend.stem}-{place}{suffix}"
