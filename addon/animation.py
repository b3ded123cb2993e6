# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of an animation: each is baked by itself, and all are written together in the end, or none."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import fmm_core
import numpy as np
from fmm_core.progress import part

from . import attributes, bake
from .memory import Progress
from .scene_arrays import Dark
from .session import Session

if TYPE_CHECKING:
    import bpy


@dataclass(frozen=True)
class Frame:
    """What is left of a baked frame: its number, what is written, and the report; of a dark one it has the little that
    `Frames.report` takes.
    """

    number: int
    layers: attributes.Layers
    report: dict
    dark: bool = False


@dataclass(frozen=True)
class Night:
    """What a frame without light gives: the input, the error it would be alone, and the seconds it took."""

    data: bake.Input
    error: Dark
    seconds: float


class Frames:
    """Bakes frame after frame of a scene, by its name: `reading` and `take` in the main thread, `compute` in any.

    Where only lights and colours change from a frame to the next, its visibility is used again, and where few things
    move, that of all others. Frames without light are black, unless all are.
    """

    def __init__(self, numbers: Sequence[int], scene: str) -> None:
        self._numbers, self._scene = numbers, scene
        self._done: list[Frame] = []
        self._dark: Dark | None = None
        self._session = Session(moving=True)

    def unfinished(self) -> bool:
        """Whether there is a frame left to read; raises fmm_core.Error where it turns out that none has light."""
        if len(self._done) < len(self._numbers):
            return True
        if all(frame.dark for frame in self._done):
            raise fmm_core.Error(f"frame {self._numbers[0]}: {self._dark}")
        return False

    def reading(self, context: bpy.types.Context, **output: object) -> bake.Reading:
        """Go to the next frame and read it in steps, output as in `bake.reading`."""
        number = self._numbers[len(self._done)]
        with self._named():
            if context.scene.name != self._scene:
                raise fmm_core.Error(f"the window no longer shows scene '{self._scene}'")
            context.scene.frame_set(number)
            name = f"{context.scene.fmm_radiosity.attribute_name} {number:04d}"
            return (yield from bake.reading(context, name=name, **output))

    def compute(self, data: bake.Input, settings: fmm_core.Settings, progress: Progress | None) -> bake.Result | Night:
        """Solve the frame that was read."""
        began, start, count = time.perf_counter(), len(self._done), len(self._numbers)
        share = part(progress, start / count, (start + 1) / count)
        with self._named():
            try:
                return bake.compute(data, settings, share, self._session)
            except Dark as error:
                return Night(data, error, data.seconds + time.perf_counter() - began)

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Let errors name the frame that is not done yet."""
        try:
            yield
        except fmm_core.Cancelled:
            raise
        except fmm_core.Error as error:
            raise fmm_core.Error(f"frame {self._numbers[len(self._done)]}: {error}") from None

    def take(self, result: bake.Result | Night) -> None:
        """Keep what is to be written of the frame that was solved."""
        number = self._numbers[len(self._done)]
        if isinstance(result, Night):
            self._done.append(_black(number, result))
            self._dark = self._dark or result.error
            return
        colours = {name: values.astype(np.float32) for name, values in result.layers.items()}
        layers = attributes.Layers(result.arrays.receivers, colours, result.output)
        self._done.append(Frame(number, layers, bake.report_of(result)))

    def write(self) -> dict:
        """Write one attribute a frame to the meshes, all of them or none; returns the report."""
        start = time.perf_counter()
        attributes.write([frame.layers for frame in self._done])
        return self.report(time.perf_counter() - start)

    def save(self, path: Path) -> None:
        """Write one file in numpy's .npz format in place of the attributes.

        Its arrays "<object>/<attribute>", as "Cube/Radiosity 0012", hold what the attribute would: the linear colour
        (C,3) float32 of every face corner.
        """
        arrays = {
            f"{receiver.object}/{name}": colours[receiver.rows]
            for frame in self._done
            for receiver in frame.layers.receivers
            for name, colours in frame.layers.colours.items()
        }
        np.savez_compressed(path, **arrays)

    def report(self, seconds_write: float = 0.0) -> dict:
        """That of the last lit frame, with seconds, rays and warnings of all, and in "frames" a line for each."""
        reports = [frame.report for frame in self._done]
        last = next(frame.report for frame in reversed(self._done) if not frame.dark)
        seconds = {phase: sum(report["seconds"].get(phase, 0.0) for report in reports) for phase in last["seconds"]}
        seconds["write"] += seconds_write
        seconds["total"] += seconds_write
        lines = [
            {
                "frame": frame.number,
                "rays": frame.report["counts"]["rays"],
                "seconds": frame.report["seconds"]["total"],
                "measured_rms": frame.report["error"]["measured_rms"],
            }
            for frame in self._done
        ]
        return last | {
            "frames": lines,
            "seconds": seconds,
            "counts": last["counts"] | {"rays": sum(line["rays"] for line in lines)},
            "warnings": self._warnings(),
        }

    def _warnings(self) -> list[str]:
        """Those of all frames, each once; what is not true of all of them names the first that it is of."""
        numbers: dict[str, list[int]] = {}
        for frame in self._done:
            for text in dict.fromkeys(frame.report["warnings"]):
                numbers.setdefault(text, []).append(frame.number)
        return [text if len(of) == len(self._done) else f"frame {of[0]}: {text}" for text, of in numbers.items()]


def _black(number: int, night: Night) -> Frame:
    """A frame that no light reaches."""
    reading, output = night.data.scene, night.data.output
    colours = dict.fromkeys(output.names, np.zeros((reading.corner_count, 3), np.float32))
    warning = "nothing gives off light, its colours are black"
    report = {
        "seconds": {"export": night.seconds, "total": night.seconds},
        "counts": {"rays": 0},
        "error": {"measured_rms": None},
        "warnings": [*night.error.warnings, warning],
    }
    return Frame(number, attributes.Layers(reading.receivers, colours, output), report, dark=True)


def solve(
    context: bpy.types.Context,
    numbers: Sequence[int],
    settings: fmm_core.Settings,
    progress: Progress | None = None,
    **output: object,
) -> Frames:
    """Solve frames of the scene of a context; the frame that is shown now is shown again in the end.

    output as in `bake.read`. Raises as `bake.bake`.
    """
    scene, frames = context.scene, Frames(numbers, context.scene.name)
    frame, subframe = scene.frame_current, scene.frame_subframe
    try:
        while frames.unfinished():
            data = bake.read_on(frames.reading(context, **output), math.inf)
            frames.take(frames.compute(data, settings, progress))
    finally:
        scene.frame_set(frame, subframe=subframe)
    return frames
