# SPDX-License-Identifier: GPL-3.0-or-later
"""Registers everything with Blender in one place, and takes it away in reverse."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..operators.add_nodes import FMM_RADIOSITY_OT_add_nodes
from ..operators.bake import FMM_RADIOSITY_OT_bake
from ..operators.bake_frames import FMM_RADIOSITY_OT_bake_frames
from ..operators.check import FMM_RADIOSITY_OT_check
from ..operators.error_map import FMM_RADIOSITY_OT_error_map
from ..operators.presets import FMM_RADIOSITY_OT_preset_add
from ..operators.refine import FMM_RADIOSITY_OT_refine
from ..operators.relight import FMM_RADIOSITY_OT_relight
from ..operators.show import FMM_RADIOSITY_OT_show
from ..operators.show_report import FMM_RADIOSITY_OT_show_report
from ..operators.study import FMM_RADIOSITY_OT_study
from ..operators.subdivide import FMM_RADIOSITY_OT_subdivide
from ..operators.threaded import stop
from . import command_line, live, panels, preferences, properties, translations
from .session import session

_CLASSES = (
    properties.FMM_RADIOSITY_settings,
    properties.FMM_RADIOSITY_material,
    preferences.FMM_RADIOSITY_preferences,
    FMM_RADIOSITY_OT_bake,
    FMM_RADIOSITY_OT_check,
    FMM_RADIOSITY_OT_bake_frames,
    FMM_RADIOSITY_OT_relight,
    FMM_RADIOSITY_OT_show,
    FMM_RADIOSITY_OT_subdivide,
    FMM_RADIOSITY_OT_refine,
    FMM_RADIOSITY_OT_add_nodes,
    FMM_RADIOSITY_OT_preset_add,
    FMM_RADIOSITY_OT_show_report,
    FMM_RADIOSITY_OT_study,
    FMM_RADIOSITY_OT_error_map,
    *panels.CLASSES,
)
#: Holds a folder "presets".
_FOLDER = str(Path(__file__).parent)
_commands = []


@bpy.app.handlers.persistent
def _forget(*_: object) -> None:
    session.forget()


def register() -> None:
    """Register classes, scene settings, presets and the command of `blender --command`."""
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    properties.register()
    preferences.apply()
    bpy.app.translations.register(preferences.PACKAGE, translations.DICTIONARY)
    live.register()
    bpy.utils.register_preset_path(_FOLDER)
    bpy.app.handlers.load_pre.append(_forget)
    _commands.append(bpy.utils.register_cli_command("fmm_radiosity", command_line.main))


def unregister() -> None:
    """Undo `register`, the last step first."""
    stop()
    while _commands:
        bpy.utils.unregister_cli_command(_commands.pop())
    bpy.app.handlers.load_pre.remove(_forget)
    bpy.utils.unregister_preset_path(_FOLDER)
    live.unregister()
    session.close()
    bpy.app.translations.unregister(preferences.PACKAGE)
    properties.unregister()
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
