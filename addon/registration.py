# SPDX-License-Identifier: GPL-3.0-or-later
"""Registers everything with Blender in one place, and takes it away in reverse."""

from __future__ import annotations

import bpy

from ..operators.bake import FMM_RADIOSITY_OT_bake
from . import command_line, properties
from .panels import FMM_RADIOSITY_PT_bake
from .session import session

_CLASSES = (properties.FMM_RADIOSITY_settings, FMM_RADIOSITY_OT_bake, FMM_RADIOSITY_PT_bake)
_commands = []


@bpy.app.handlers.persistent
def _forget(*_: object) -> None:
    """Let go of the last solution: another file has other geometry, and it can be large."""
    session.solution = None


def register() -> None:
    """Register classes, scene settings and the command of `blender --command`."""
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    properties.register()
    bpy.app.handlers.load_pre.append(_forget)
    _commands.append(bpy.utils.register_cli_command("fmm_radiosity", command_line.main))


def unregister() -> None:
    """Undo `register`, the last step first."""
    while _commands:
        bpy.utils.unregister_cli_command(_commands.pop())
    bpy.app.handlers.load_pre.remove(_forget)
    _forget()
    properties.unregister()
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
