# SPDX-License-Identifier: GPL-3.0-or-later
"""Run by pytest in a process with bpy and the installed extension, whose modules are fixtures."""

import importlib
import sys
from types import SimpleNamespace

import bpy
import pytest
from scenes import Build

MODULE = "bl_ext.user_default.fmm_radiosity"


@pytest.fixture(scope="session", autouse=True)
def fmm():
    """Modules of the installed extension, by name."""
    import addon_utils

    assert addon_utils.enable(MODULE, default_set=True) is not None
    names = ("export", "bake", "attributes", "materials", "properties", "command_line", "session", "report",
             "error_map", "estimate", "live", "meshes", "subdivision", "memory", "animation")  # fmt: skip
    return SimpleNamespace(**{name: importlib.import_module(f"{MODULE}.addon.{name}") for name in names})


@pytest.fixture(autouse=True)
def empty(fmm):
    """An empty scene before each test."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)


@pytest.fixture
def read(fmm):
    """Reads the open scene into arrays."""
    return lambda: fmm.export.read_scene(bpy.context.evaluated_depsgraph_get()).arrays()


@pytest.fixture
def command(fmm, capfd):
    """Runs the command line: `command(*arguments)` returns its exit status and the lines on stderr."""

    def run(*arguments):
        capfd.readouterr()
        status = fmm.command_line.main([str(argument) for argument in arguments])
        sys.stderr.flush()
        return status, capfd.readouterr().err.splitlines()

    return run


@pytest.fixture
def build():
    """Makes objects and materials."""
    return Build()
