# SPDX-License-Identifier: GPL-3.0-or-later
"""The command `fmm-radiosity` of the repository's environment: Blender as the Python module bpy."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from . import command_line


def main(argv: list[str] | None = None) -> int:
    """Check the arguments, then start Blender, switch the extension on and run the command."""
    argv = sys.argv[1:] if argv is None else argv
    try:
        options = command_line.parse(argv)
        if options.scene is None:
            raise command_line.UsageError("the following arguments are required: scene")
    except command_line.UsageError as error:
        return command_line.fail(error, 2)
    # Blender is slow to start: a wrong argument or --help never gets here.
    package = _load_extension()
    package.register()
    try:
        from fmm_radiosity.addon import command_line as inside

        return inside.main(argv)
    finally:
        package.unregister()
        _forget_drivers()


def _forget_drivers() -> None:
    """Drivers in Python crash the module bpy (4.2) when the interpreter ends, unless what they know is gone."""
    import bpy

    bpy.app.driver_namespace.clear()


def _load_extension() -> ModuleType:
    """The repository's root as the package `fmm_radiosity`, so that relative imports work as they do in Blender."""
    root = Path(__file__).resolve().parent.parent
    spec = importlib.util.spec_from_file_location(
        "fmm_radiosity", root / "__init__.py", submodule_search_locations=[str(root)]
    )
    package = importlib.util.module_from_spec(spec)
    sys.modules["fmm_radiosity"] = package
    spec.loader.exec_module(package)
    return package
