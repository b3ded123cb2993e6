# SPDX-License-Identifier: GPL-3.0-or-later
"""Builds dist/fmm_radiosity-<version>.zip for this platform, with its wheels: uv run tools/build_extension.py

The core is one wheel for every Python from 3.11 on; embreex and Pillow have one for each. Blender's own
tool, which the bpy wheel brings along, validates and packs.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
WHEELS = ROOT / "wheels"
# `uv run` names itself; otherwise uv is the program of that name, or the module that pip installed.
UV = [name] if (name := os.environ.get("UV") or shutil.which("uv")) else [sys.executable, "-m", "uv"]
CONTENT = ("__init__.py", "addon", "operators", "LICENSE")
# Blender 4.2 to 5.0, 5.1 and 5.2 from blender.org, and builds of Linux distributions.
PYTHONS = ("3.11", "3.13", "3.14")
PLATFORMS = {
    ("Linux", "x86_64"): "linux-x64",
    ("Darwin", "arm64"): "macos-arm64",
    ("Darwin", "x86_64"): "macos-x64",
    ("Windows", "AMD64"): "windows-x64",
}


def main() -> int:
    """Build the zip; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=ROOT / "dist", help="folder for the zip (default: dist)")
    options = parser.parse_args()
    try:
        archive = build(options.output)
    except (RuntimeError, OSError, subprocess.CalledProcessError) as error:
        sys.stderr.write(f"build_extension: error: {error}\n")
        return 1
    print(archive)
    return 0


def build(output: Path) -> Path:
    """Gather the wheels, stage what belongs into the zip, validate, pack, and check the result."""
    wheels = [core_wheel(), *library_wheels(ROOT / "core", "embreex"), *library_wheels(ROOT, "pillow")]
    output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        staged = Path(folder) / "fmm_radiosity"
        stage(staged, wheels)
        blender_tool("validate", str(staged))
        blender_tool("build", "--source-dir", str(staged), "--output-dir", str(output.resolve()))
    archive = output / f"fmm_radiosity-{manifest()['version']}.zip"
    check(archive, wheels)
    return archive


def manifest() -> dict:
    """The manifest as it is in the repository."""
    return tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))


def core_wheel() -> Path:
    """Build the wheel of the core from its sources."""
    for old in WHEELS.glob("fmm_core-*.whl"):
        old.unlink()
    run(*UV, "build", "--wheel", "--quiet", "--out-dir", str(WHEELS), str(ROOT / "core"))
    return one_wheel("fmm_core-*-abi3-*.whl")


def library_wheels(project: Path, name: str) -> list[Path]:
    """Wheels of a library that a project depends on, for every Python, from the package index unless they are here."""
    text = (project / "pyproject.toml").read_text(encoding="utf-8")
    wanted = next(wanted for wanted in tomllib.loads(text)["project"]["dependencies"] if wanted.startswith(name))
    patterns = {version: f"{name}-*-cp{version.replace('.', '')}-cp*.whl" for version in PYTHONS}
    for version, pattern in patterns.items():
        if not list(WHEELS.glob(pattern)):
            run(*UV, "tool", "run", "--quiet", "pip", "--quiet", "download", "--no-deps", "--only-binary=:all:",
                "--python-version", version, "--dest", str(WHEELS), wanted)  # fmt: skip
    return [one_wheel(pattern) for pattern in patterns.values()]


def one_wheel(pattern: str) -> Path:
    """The one wheel with such a name; RuntimeError where there is none or more than one."""
    found = sorted(WHEELS.glob(pattern))
    if len(found) != 1:
        raise RuntimeError(f"expected one {pattern} in {WHEELS}, found {len(found)}")
    return found[0]


def stage(folder: Path, wheels: list[Path]) -> None:
    """Copy what belongs into the zip, with a manifest that lists the wheels and this platform."""
    (folder / "wheels").mkdir(parents=True)
    for name in CONTENT:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=shutil.ignore_patterns("__pycache__", "standalone.py"))
        else:
            shutil.copy2(source, folder / name)
    for wheel in wheels:
        shutil.copy2(wheel, folder / "wheels")
    listed = ", ".join(f'"./wheels/{wheel.name}"' for wheel in wheels)
    text = (ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    before, after = text.split("\n[permissions]", 1)
    added = f'wheels = [{listed}]\nplatforms = ["{this_platform()}"]\n'
    (folder / "blender_manifest.toml").write_text(f"{before}{added}\n[permissions]{after}", encoding="utf-8")


def this_platform() -> str:
    """Blender's name of this platform."""
    key = (platform.system(), platform.machine())
    if key not in PLATFORMS:
        raise RuntimeError(f"no embreex wheel for {' '.join(key)}")
    return PLATFORMS[key]


def blender_tool(*arguments: str) -> None:
    """Run Blender's extension tool, found in the bpy wheel without importing it."""
    spec = importlib.util.find_spec("bpy")
    if spec is None:
        raise RuntimeError("bpy is not installed in this environment")
    tools = sorted(Path(spec.origin).parent.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    run(sys.executable, str(tools[-1]), *arguments)


def run(*command: str) -> None:
    """Run a command; its output is shown only when it fails."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command[:3])} failed:\n{done.stdout}{done.stderr}")


def check(archive: Path, wheels: list[Path]) -> None:
    """RuntimeError where a wheel or the code is missing from the zip."""
    with zipfile.ZipFile(archive) as opened:
        names = set(opened.namelist())
    needed = {f"wheels/{wheel.name}" for wheel in wheels} | {"__init__.py", "blender_manifest.toml", "addon/bake.py"}
    if not needed <= names:
        raise RuntimeError(f"{archive} lacks {', '.join(sorted(needed - names))}")


if __name__ == "__main__":
    sys.exit(main())
