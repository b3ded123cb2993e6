# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: one parser and one `main` for Blender's `--command fmm_radiosity` and for `fmm-radiosity`.

Exit status: 0 done, 1 the bake failed, 2 bad arguments. An error is one line on stderr.
"""

from __future__ import annotations

import argparse
import errno
import json
import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import fmm_core
import numpy as np

from . import animation, bake, files, preview, report

if TYPE_CHECKING:
    import bpy

PROGRAM = "fmm-radiosity"
#: Characters of the bar of progress.
_BAR = 20
#: Samples of Cycles in a study, and the most.
_SAMPLES, _MOST_SAMPLES = (4, 16, 64), 1 << 20
_SUFFIXES = {"-o": ".blend", "--report": ".json", "--preview": ".png"}

#: What -o may end in besides for frames.
_FRAMES_SUFFIX = ".npz"
#: Of Blender.
_LAST_FRAME = 1048574


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
    if options.command == "study":
        wrong = [count for count in options.cycles or () if not 1 <= count <= _MOST_SAMPLES]
        if wrong:
            raise UsageError(f"--cycles: expected numbers of samples from 1 to {_MOST_SAMPLES}, got {wrong[0]}")
        return options
    for name in set(options.forced) & set(options.without):
        raise UsageError(f"--with and --without: '{name}' is in both")
    if options.frames is not None and (options.preview is not None or options.keep_visibility):
        raise UsageError("--frames: --preview and --keep-visibility are of one frame")
    suffixes = dict(_SUFFIXES)
    if options.frames is not None and options.output.suffix == _FRAMES_SUFFIX:
        suffixes["-o"] = _FRAMES_SUFFIX
    for name, path in _outputs(options).items():
        if path.suffix != suffixes[name]:
            raise UsageError(f"{name}: '{path}' must end in {suffixes[name]}")
    _check_distinct(options, options.scene)
    return options


def main(argv: Sequence[str]) -> int:
    """Run one command in a Blender that has the extension; returns the exit status."""
    try:
        options = parse(argv)
        with _quiet():
            warnings, told = (_bake if options.command == "bake" else _study)(options)
    except SystemExit:
        return 0
    except UsageError as error:
        return fail(error, 2)
    except (*bake.FAILURES, OSError) as error:
        return fail(bake.reason(error), 1)
    except KeyboardInterrupt:
        return fail("interrupted", 1)
    for warning in warnings:
        _say(f"{PROGRAM}: warning: {warning}")
    sys.stdout.write(f"{told}\n")
    return 0


def fail(error: Exception | str, status: int) -> int:
    """Print an error in one line and return the status."""
    _say(f"{PROGRAM}: error: {' '.join(str(error).split())}")
    return status


def _outputs(options: argparse.Namespace) -> dict[str, Path]:
    """The files to write, by the option that names them."""
    given = {"-o": options.output, "--report": options.report, "--preview": options.preview}
    return {name: path for name, path in given.items() if path is not None}


def _check_distinct(options: argparse.Namespace, scene: Path | str | None) -> None:
    """Raise UsageError where two outputs are one file, links followed, or one other than -o is the scene itself."""
    known = {os.path.realpath(scene): "the scene"} if scene else {}
    for name, path in _outputs(options).items():
        other = known.setdefault(os.path.realpath(path), name)
        if other != name and (name, other) != ("-o", "the scene"):
            raise UsageError(f"{name}: '{path}' is the same file as {other}")


def _parser() -> _Parser:
    parser = _Parser(prog=PROGRAM, description="Radiosity baked into vertex colours.")
    commands = parser.add_subparsers(title="commands", required=True, dest="command", metavar="command")
    _add_study(commands)
    command = commands.add_parser("bake", help="bake a scene", description="Bake the radiosity of a scene.")
    add = command.add_argument
    add("scene", nargs="?", type=_file, help="the .blend file to read (inside Blender: the open file)")
    add("-o", "--output", required=True, type=_file, help="the .blend file to write")
    add("--frames", type=_frames, metavar="FIRST-LAST", help="bake these frames, as 1-24, each into an attribute of "
        f"its own; where -o ends in {_FRAMES_SUFFIX} all into that file")  # fmt: skip
    add("-p", "--truncation", type=int, help="order p of the expansions, 0 to 20 (default: as saved in the scene)")
    add("-s", "--grouping", type=int, help="particles s in a leaf of the octree (default: as saved in the scene)")
    add("--method", help="direct: every particle with every other one")
    add("--target-error", type=float, help="relative error that is good enough, as 0.01")
    add("--particles", type=int, help="about how many points gather the light (default: chosen from the scene)")
    add("--rays", type=int, help="about how many shadow rays a colour, less grain for more (default: as in the scene)")
    add(
        "--probes",
        type=int,
        help="random points to measure the error at, 0 for none (default: 300 to 1,000, or as in the scene); a target "
        "error measures in any case",
    )
    effects = ", ".join(fmm_core.EFFECTS)
    add("--without", action="append", default=[], metavar="EFFECT", help=f"leave an effect out: {effects}")
    add("--with", action="append", default=[], dest="forced", metavar="EFFECT",
        help="simulate an effect that the scene does not call for")  # fmt: skip
    add("--keep-visibility", action="store_true", help=f"save what sees what in a {bake.KEPT_SUFFIX} beside the scene: "
        "faster bakes with other lights and colours")  # fmt: skip
    add("--colours", choices=("fit", "points"), help="fit: colours that match the light on the faces best; points: the "
        "light at the vertices themselves (default: as in the scene)")  # fmt: skip
    add("--directional", action="store_true", help="also write where the light comes from: four spherical harmonics")
    add("--view", action="store_true", help="also write what the active camera sees, with gloss and metal")
    add("--report", type=_file, help="also write numbers and warnings to this .json file")
    add("--preview", type=_file, help=f"also render a picture of {preview.SIZE} x {preview.SIZE} to this .png file")
    return parser


def _add_study(commands: argparse._SubParsersAction) -> None:
    text = "Bake a scene again and again, and show what accuracy costs: a table, a CSV file and a picture."
    add = commands.add_parser("study", help="show what accuracy costs", description=text).add_argument
    add("scene", nargs="?", type=_file, help="the .blend file to read (inside Blender: the open file)")
    add("--out", required=True, type=_file, help="folder for study.csv and study.png")
    add("--target-error", type=float, help="relative error that is good enough (default: as in the scene, or 0.01)")
    add("--particles", type=int, help="about how many points gather the light (default: chosen from the scene)")
    add("--cycles", nargs="*", type=int, metavar="SAMPLES", help="also bake with Cycles, with so many samples "
        f"({', '.join(map(str, _SAMPLES))})")  # fmt: skip


def _file(name: str) -> Path:
    if not name:
        raise argparse.ArgumentTypeError("expected the name of a file, got an empty one")
    return Path(name)


def _frames(text: str) -> range:
    found = re.fullmatch(r"(\d{1,7})(?:-(\d{1,7}))?", text)
    if found is None:
        raise argparse.ArgumentTypeError(f"expected frames as 1-24, got '{text}'")
    first, last = int(found[1]), int(found[2] or found[1])
    if not first <= last <= _LAST_FRAME:
        raise argparse.ArgumentTypeError(f"expected frames from 0 to {_LAST_FRAME}, the first one first, got '{text}'")
    return range(first, last + 1)


def _chosen(options: argparse.Namespace) -> dict[str, object]:
    """The settings that were given; the others come from the scene."""
    names = ("truncation", "grouping", "method", "target_error", "particles", "rays", "probes")
    chosen = {name: getattr(options, name, None) for name in names}
    chosen = {name: value for name, value in chosen.items() if value is not None}
    if options.command == "bake" and (options.forced or options.without):
        chosen["effects"] = dict.fromkeys(options.forced, True) | dict.fromkeys(options.without, False)
    return chosen


def _output(options: argparse.Namespace) -> dict[str, object]:
    """What is written, as far as it was given; the rest comes from the scene."""
    chosen: dict[str, object] = {name: True for name in ("directional", "view") if getattr(options, name)}
    return chosen | ({"colours": options.colours.upper()} if options.colours else {})


def _bake(options: argparse.Namespace) -> tuple[list[str], str]:
    """Bake; returns the warnings and what to tell of it."""
    import bpy

    from . import properties

    _check_distinct(options, options.scene or bpy.data.filepath)
    files.check_writable(_outputs(options).values())
    _open(options.scene)
    _leave_edit_mode()
    context = bpy.context
    settings = properties.settings_of(context.scene, **_chosen(options))
    if options.frames is not None:
        done = _bake_frames(options, context, settings)
    else:
        keep = options.keep_visibility or context.scene.fmm_radiosity.keep_visibility
        data = bake.read(context, keep, **_output(options))
        done = bake.write(bake.compute(data, settings, _progress()))
        _write_files(options, done, _save, data.arrays.corner_position)
    return done["warnings"], f"{options.output}: {report.summary(done)}"


def _study(options: argparse.Namespace) -> tuple[list[str], str]:
    """The same for a study."""
    import bpy

    from . import chart, cycles, properties, study

    table, picture = options.out / "study.csv", options.out / "study.png"
    files.check_writable((table, picture))
    _open(options.scene)
    _leave_edit_mode()
    context = bpy.context
    data, settings = bake.read(context), properties.settings_of(context.scene, **_chosen(options))
    progress = _progress()
    done, judge, points = study.run(data, settings, progress, compared=options.cycles is not None)
    if options.cycles is not None:
        done = study.add(done, cycles.study(context, data.arrays, judge, points, options.cycles or _SAMPLES))
    with files.Staged() as staged:
        with files.writing(table):
            staged.path(table).write_text(study.as_csv(done), encoding="utf-8")
        with files.writing(picture):
            chart.draw(done, study.title(bpy.data.filepath)).save(staged.path(picture))
        staged.commit()
    return [*data.arrays.warnings, *data.warnings], f"{study.table(done)}\n{picture}: the picture of it"


def _bake_frames(options: argparse.Namespace, context: bpy.types.Context, settings: fmm_core.Settings) -> dict:
    frames = animation.solve(context, options.frames, settings, _progress(), **_output(options))
    if options.output.suffix == _FRAMES_SUFFIX:
        done, save = frames.report(), frames.save
    else:
        done, save = frames.write(), _save
    _write_files(options, done, save)
    return done


def _write_files(
    options: argparse.Namespace, done: dict, save: Callable[[Path], None], corners: np.ndarray | None = None
) -> None:
    """Write all of the wanted files or none; corners (C,3) in m are what a preview has to show."""
    import bpy

    with files.Staged() as staged:
        with files.writing(options.output):
            save(staged.path(options.output))
        if options.preview is not None:
            with files.writing(options.preview):
                name = bpy.context.scene.fmm_radiosity.attribute_name
                preview.render(bpy.context.scene, bpy.context.view_layer, corners, name, staged.path(options.preview))
        if options.report is not None:
            with files.writing(options.report):
                staged.path(options.report).write_text(json.dumps(done, indent=2) + "\n", encoding="utf-8")
        staged.commit()


def _open(scene: Path | None) -> None:
    import bpy

    if scene is None:
        if not bpy.data.filepath:
            raise fmm_core.Error("no scene: name a .blend file to read")
        return
    files.check_readable(scene)
    try:
        bpy.ops.wm.open_mainfile(filepath=str(scene.absolute()), load_ui=False, use_scripts=False)
    except RuntimeError as error:
        raise fmm_core.Error(f"cannot read '{scene}': {_told(error)}") from None


def _leave_edit_mode() -> None:
    """Leave Edit Mode, where a mesh is evaluated without its faces."""
    import bpy

    objects = bpy.context.view_layer.objects
    active = objects.active
    for obj in objects:
        if obj.mode == "EDIT":
            objects.active = obj
            bpy.ops.object.mode_set(mode="OBJECT")
    objects.active = active


def _save(path: Path) -> None:
    import bpy

    try:
        # Blender does not notice a full disk when it compresses.
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, compress=False)
    except RuntimeError as error:
        raise OSError(errno.EIO, f"Blender could not save it, is the disk full? ({_told(error)})") from None


def _told(error: RuntimeError) -> str:
    """What Blender reported, without its prefix."""
    return " ".join(str(error).split()).removeprefix("Error: ")


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
        bar = "#" * round(_BAR * fraction)
        sys.stderr.write(f"\r\x1b[K[{bar:<{_BAR}}] {100 * fraction:3.0f} % {text}" if fraction < 1 else "\r\x1b[K")
        sys.stderr.flush()
        return True

    return show


def _say(line: str) -> None:
    sys.stderr.write(line + "\n")
