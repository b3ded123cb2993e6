# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: one parser and one `main` for Blender's `--command fmm_radiosity` and for `fmm-radiosity`.

Exit status: 0 done, 1 the bake failed, 2 bad arguments. An error is one line on stderr.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

import fmm_core

from .bake import summary

PROGRAM = "fmm-radiosity"


class UsageError(Exception):
    """Wrong arguments; the text is one line."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(message)


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Check the arguments without any Blender; raises UsageError, or SystemExit(0) after --help."""
    options = _parser().parse_args(argv)
    try:
        fmm_core.Settings(**_chosen(options))
    except fmm_core.Error as error:
        raise UsageError(str(error)) from None
    outputs = {"-o": options.output, "--report": options.report, "--preview": options.preview}
    named = {name: path.absolute() for name, path in outputs.items() if path is not None}
    if len(set(named.values())) < len(named):
        raise UsageError(f"{' and '.join(named)} must name different files")
    if options.output.suffix != ".blend":
        raise UsageError(f"-o: '{options.output}' must end in .blend")
    return options


def main(argv: Sequence[str]) -> int:
    """Run one command in a Blender that has the extension; returns the exit status."""
    try:
        options = parse(argv)
        with _quiet():
            report = _bake(options)
    except SystemExit:
        return 0
    except UsageError as error:
        return fail(error, 2)
    except (fmm_core.Error, OSError) as error:
        return fail(error, 1)
    except KeyboardInterrupt:
        return fail("interrupted", 1)
    for warning in report["warnings"]:
        _say(f"{PROGRAM}: warning: {warning}")
    sys.stdout.write(f"{options.output}: {summary(report)}\n")
    return 0


def fail(error: Exception | str, status: int) -> int:
    """Print an error in one line and return the status."""
    _say(f"{PROGRAM}: error: {' '.join(str(error).split())}")
    return status


def _parser() -> _Parser:
    parser = _Parser(prog=PROGRAM, description="Radiosity baked into vertex colours.")
    commands = parser.add_subparsers(title="commands", required=True, metavar="command")
    command = commands.add_parser("bake", help="bake a scene", description="Bake the radiosity of a scene.")
    add = command.add_argument
    add("scene", nargs="?", type=Path, help="the .blend file to read (inside Blender: the open file)")
    add("-o", "--output", required=True, type=Path, help="the .blend file to write")
    add("-p", "--truncation", type=int, help="order p of the expansions, 0 to 20 (default: as saved in the scene)")
    add("-s", "--grouping", type=int, help="particles s in a leaf of the octree (default: as saved in the scene)")
    add("--method", help="direct: every particle with every other one")
    add("--target-error", type=float, help="relative error that is good enough, as 0.01")
    add("--particles", type=int, help="about how many points gather the light (default: chosen from the scene)")
    add("--report", type=Path, help="also write numbers and warnings to this .json file")
    add("--preview", type=Path, help=f"also render a picture of {512} x {512} to this .png file")
    return parser


def _chosen(options: argparse.Namespace) -> dict[str, object]:
    """The settings that were given; the others come from the scene."""
    names = ("truncation", "grouping", "method", "target_error", "particles")
    return {name: getattr(options, name) for name in names if getattr(options, name) is not None}


def _bake(options: argparse.Namespace) -> dict:
    import bpy

    from . import bake, files, preview, properties

    wanted = [path for path in (options.output, options.report, options.preview) if path is not None]
    files.check_writable(wanted)
    _open(options.scene)
    context = bpy.context
    settings = properties.settings_of(context.scene, **_chosen(options))
    data = bake.read(context)
    report = bake.write(bake.compute(data, settings, _progress()))
    with files.Staged() as staged:
        _save(staged.path(options.output))
        if options.preview is not None:
            corners = data.arrays.corner_position
            preview.render(context.scene, context.view_layer, corners, staged.path(options.preview))
        if options.report is not None:
            staged.path(options.report).write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
        staged.commit()
    return report


def _open(scene: Path | None) -> None:
    import bpy

    if scene is None:
        if not bpy.data.filepath:
            raise fmm_core.Error("no scene: name a .blend file to read")
        return
    if not scene.is_file():
        raise fmm_core.Error(f"cannot read '{scene}': {'it is a folder' if scene.is_dir() else 'no such file'}")
    try:
        bpy.ops.wm.open_mainfile(filepath=str(scene.absolute()), load_ui=False, use_scripts=False)
    except RuntimeError as error:
        raise fmm_core.Error(f"cannot read '{scene}': {str(error).removeprefix('Error: ')}") from None


def _save(path: Path) -> None:
    import bpy

    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(path.absolute()), copy=True, compress=True)
    except RuntimeError as error:
        raise fmm_core.Error(f"cannot write: {str(error).removeprefix('Error: ')}") from None


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Blender's own talk of every step off stdout."""
    sys.stdout.flush()
    kept = os.dup(1)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 1)
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)


def _progress() -> Callable[[float, str], bool] | None:
    """A line of progress that overwrites itself on a terminal; nothing where stderr is a file or a pipe."""
    if not sys.stderr.isatty():
        return None

    def show(fraction: float, text: str) -> bool:
        sys.stderr.write(f"\r\x1b[K{100 * fraction:3.0f} % {text}" if fraction < 1 else "\r\x1b[K")
        sys.stderr.flush()
        return True

    return show


def _say(line: str) -> None:
    sys.stderr.write(line + "\n")
