# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension as a user has it: built, installed and switched on, in Blender processes of their own.

FMM_RADIOSITY_PYTHON names the interpreter whose bpy is driven (default: this one), FMM_RADIOSITY_ZIP a zip that is
already built.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# The tests in there need an installed extension: test_extension.py runs them.
collect_ignore = ["inside"]

INSTALL = """
import bpy
bpy.ops.extensions.package_install_files(filepath={archive!r}, repo="user_default", enable_on_install=True)
bpy.ops.wm.save_userpref()
"""

START = "import sys; from addon.standalone import main; status = main(); {after}; sys.exit(status)"

COLOURS = """
import bpy, json, numpy as np, sys
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
found = {}
for mesh in bpy.data.meshes:
    data = mesh.color_attributes["Radiosity"].data
    values = np.empty(4 * len(data), np.float32)
    data.foreach_get("color", values)
    found[mesh.name] = values.reshape(-1, 4)[:, :3].ravel().tolist()
print("\\n" + json.dumps(found))
"""


class Blender:
    """Runs Python in fresh Blender processes that share one folder of user files."""

    def __init__(self, user: Path) -> None:
        self.python = os.environ.get("FMM_RADIOSITY_PYTHON", sys.executable)
        self.environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
        self.environment["BLENDER_USER_RESOURCES"] = str(user)
        self.folder = user.parent

    def run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run the interpreter away from the repository, so that only the installed extension can be imported."""
        command = [self.python, *arguments]
        return subprocess.run(
            command, cwd=self.folder, env=self.environment, capture_output=True, text=True, timeout=600
        )

    def code(self, text: str) -> str:
        """Run a piece of Python; returns what it printed."""
        done = self.run("-c", text)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout


@pytest.fixture(scope="session")
def root():
    """Folder of the repository."""
    return ROOT


@pytest.fixture(scope="session")
def archive(tmp_path_factory):
    """The zip of the extension."""
    given = os.environ.get("FMM_RADIOSITY_ZIP")
    if given:
        return Path(given)
    output = tmp_path_factory.mktemp("dist")
    command = [sys.executable, str(ROOT / "tools" / "build_extension.py"), "--output", str(output)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return next(output.glob("*.zip"))


@pytest.fixture(scope="session")
def blender(archive, tmp_path_factory):
    """Blender with the extension installed."""
    blender = Blender(tmp_path_factory.mktemp("blender") / "user")
    blender.code(INSTALL.format(archive=str(archive)))
    return blender


@pytest.fixture(scope="session")
def colours():
    """Reads red, green and blue of every mesh of a baked file, all in one list for each."""

    def colours(path, python=sys.executable):
        done = subprocess.run([python, "-c", COLOURS, str(path)], check=True, capture_output=True, text=True)
        return json.loads(done.stdout.splitlines()[-1])

    return colours


@pytest.fixture(scope="session")
def run(root):
    """Runs `fmm-radiosity` in the repository's own environment; `after` is Python to run in the end."""

    def run(*arguments, after="pass"):
        command = [sys.executable, "-c", START.format(after=after), *map(str, arguments)]
        return subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=600)

    return run
