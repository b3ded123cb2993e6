# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs the tests of the installed extension on every Blender: uv run tools/run_blender_tests.py [version]

Each gets an environment of its own under .venvs, about 1 GB, which is kept. All of them install the same zip.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import build_extension

ROOT = build_extension.ROOT
TESTS = [str(ROOT / "tests" / "blender" / name) for name in ("test_extension.py", "test_round_trip.py")]
# bpy: Python it is built for, and the numpy of that Blender.
VERSIONS = {
    "4.2.23": ("3.11", "numpy==1.26.4"),
    "4.5.15": ("3.11", "numpy>=1.26,<2"),
    "5.0.1": ("3.11", "numpy>=1.26,<2"),
    "5.2.3": ("3.13", "numpy>=2.2,<3"),
}


def main() -> int:
    """Test the named versions, or all; returns the exit status."""
    wanted = sys.argv[1:] or list(VERSIONS)
    unknown = set(wanted) - set(VERSIONS)
    if unknown:
        sys.stderr.write(f"run_blender_tests: error: expected {', '.join(VERSIONS)}, got {', '.join(unknown)}\n")
        return 2
    archive = build_extension.build(ROOT / "dist")
    failed = [version for version in wanted if not passes(version, archive)]
    print("failed: " + ", ".join(failed) if failed else f"passed on bpy {', '.join(wanted)}")
    return 1 if failed else 0


def passes(version: str, archive: Path) -> bool:
    """Run the tests on one version."""
    print(f"bpy {version}", flush=True)
    environment = os.environ | {"FMM_RADIOSITY_ZIP": str(archive), "FMM_RADIOSITY_PYTHON": str(python(version))}
    return subprocess.run([sys.executable, "-m", "pytest", "-q", *TESTS], cwd=ROOT, env=environment).returncode == 0


def python(version: str) -> Path:
    """The interpreter of an environment with this bpy, made on first use."""
    folder = ROOT / ".venvs" / f"bpy-{version}"
    interpreter = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if not (folder / "ready").exists():
        needs, numpy = VERSIONS[version]
        uv = build_extension.UV
        subprocess.run([*uv, "venv", "--quiet", "--clear", "-p", needs, str(folder)], check=True)
        command = [*uv, "pip", "install", "--quiet", "-p", str(interpreter), f"bpy=={version}", numpy, "pytest>=8"]
        subprocess.run(command, check=True)
        (folder / "ready").touch()
    return interpreter


if __name__ == "__main__":
    sys.exit(main())
