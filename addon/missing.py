# SPDX-License-Identifier: GPL-3.0-or-later
"""What is shown in place of the extension where its native part is missing: one that was packed for another system."""

from __future__ import annotations

import platform
import sys

import bpy

from . import wrapped


def reason() -> str | None:
    """Why the extension cannot run, in one line; None where it can."""
    try:
        import fmm_core  # noqa: F401
        import PIL.Image  # noqa: F401
    except ImportError as error:
        return " ".join(str(error).split())
    return None


def lines() -> tuple[str, ...]:
    """What the user is told."""
    return (
        "FMM Radiosity cannot run here: its native part is missing.",
        f"This is {platform.system()} {platform.machine()}, Python {sys.version_info.major}.{sys.version_info.minor}.",
        f"Install the zip that was made for this system ({reason()}).",
    )


class FMM_RADIOSITY_PT_missing(bpy.types.Panel):
    """Says what is missing."""

    bl_label = "FMM Radiosity"
    bl_category = "Radiosity"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the reason."""
        for text, icon in zip(lines(), ("ERROR", "BLANK1", "BLANK1"), strict=True):
            wrapped.draw(self.layout, context, text, icon)


def is_registered() -> bool:
    """Whether the panel is shown."""
    return FMM_RADIOSITY_PT_missing.is_registered


def register() -> None:
    """Show the panel, and say the same where Blender was started from a terminal."""
    bpy.utils.register_class(FMM_RADIOSITY_PT_missing)
    sys.stderr.write(f"{' '.join(lines())}\n")


def unregister() -> None:
    """Take the panel away."""
    bpy.utils.unregister_class(FMM_RADIOSITY_PT_missing)
