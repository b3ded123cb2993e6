# SPDX-License-Identifier: GPL-3.0-or-later
"""One bake: read the scene, solve, write the colours. Panel and command line both come here.

`read` and `write` touch Blender and belong to the main thread; `compute` does not and may run in any. `reading` is
`read` in steps, between which Blender may do what it likes: `read_on` takes them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING

import fmm_core

from . import attributes, estimate, export, memory
from .memory import Progress
from .solving import Input, Result, compute

if TYPE_CHECKING:
    import bpy

    from .session import Session

#: What ends a bake with one line for the user; anything else is a mistake of the program.
FAILURES = (fmm_core.Error, MemoryError)
#: Of the file beside the .blend that keeps what rays found.
KEPT_SUFFIX = ".fmm-visibility"


def bake(
    context: bpy.types.Context,
    settings: fmm_core.Settings,
    progress: Progress | None = None,
    keep: bool = False,
    session: Session | None = None,
) -> dict:
    """Bake the scene of a context; returns the report. keep as in `read`, session as in `compute`.

    Raises fmm_core.Error, in one line, on anything that cannot be baked, and fmm_core.Cancelled; the scene is then as
    it was.
    """
    return write(compute(read(context, keep), settings, progress, session))


#: Reads a scene in steps; its value is the input of a solve.
Reading = Generator[None, None, Input]


def read(context: bpy.types.Context, keep: bool = False, **output: object) -> Input:
    """Read the scene of a context as its settings say, and check already here that its meshes can be written.

    keep: what rays find is kept in a file beside the .blend, and taken from there if it is of the same geometry.
    output: fields of `Output` in place of what the scene says.
    """
    return read_on(reading(context, keep, **output), math.inf)


def read_on(steps: Reading, seconds: float) -> Input | None:
    """Go on reading for so many seconds, or somewhat more; the input once all is read."""
    until = time.perf_counter() + seconds
    try:
        while time.perf_counter() < until:
            next(steps)
    except StopIteration as end:
        return end.value
    return None


def reading(context: bpy.types.Context, keep: bool = False, **output: object) -> Reading:
    """`read` in steps; after the first one the context is not asked for anything."""
    from . import preferences, properties

    start, output = time.perf_counter(), properties.output_of(context.scene, **output)
    scene = export.read(context, context.scene.fmm_radiosity.scope, output.view)
    attributes.check(scene.receivers, output)
    blend, kept, warnings = context.blend_data.filepath, None, ()
    if keep and blend:
        kept = preferences.kept_file(Path(blend), KEPT_SUFFIX)
    elif keep:
        warnings = ("visibility is not kept: save the .blend first, the file goes beside it",)
    count, limit, settings = scene.vertex_count, preferences.memory_limit(), properties.settings_of(context.scene)
    memory.check(estimate.predict(count, count, settings, output.colours == "FIT").memory_mib, limit)
    seconds, painting, going = time.perf_counter() - start, scene.painting(), True
    while going:
        yield
        start = time.perf_counter()
        going = next(painting, "done") is None
        seconds += time.perf_counter() - start
    return Input(scene, seconds, output, limit, kept, warnings)


def write(result: Result) -> dict:
    """Write the colours of a solve to the meshes; returns the report."""
    start = time.perf_counter()
    attributes.write([attributes.Layers(result.arrays.receivers, result.layers, result.output)])
    return report_of(result, time.perf_counter() - start)


def report_of(result: Result, seconds_write: float = 0.0) -> dict:
    """The report of a bake: that of its solve, and what was done around it."""
    report = dict(result.solution.report)
    seconds = dict(report["seconds"], export=result.seconds_export, write=seconds_write)
    seconds["total"] = result.seconds_export + result.seconds_solve + seconds_write
    # Between the phases, light becomes colours.
    seconds["evaluate"] += seconds["total"] - sum(value for phase, value in seconds.items() if phase != "total")
    report["seconds"] = seconds
    report["warnings"] = [*result.arrays.warnings, *report["warnings"], *result.warnings]
    return report


def reason(error: Exception) -> str:
    """Why a bake failed, for the user, in one line."""
    if isinstance(error, MemoryError):
        return " ".join(f"not enough memory: {error}".removesuffix(": ").split())
    return " ".join(str(error).split())
