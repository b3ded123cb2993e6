# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of an animation: each is baked by itself, and all are written together in the end, or none."""

from __future__ import annotations

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
from .session import Session

if TYPE_CHECKING:
    import bpy


@dataclass(frozen=True)
class Frame:
    """What is left of a baked frame: its number, what is written, and the report."""

    number: int
    layers: attributes.Layers
    report: dict


class Frames:
    """Bakes frame after frame of a scene: `read` and `take` in the main thread, `compute` in any.

    Where only lights and colours change from a frame to the next, its visibility is used again.
    """

    def __init__(self, numbers: Sequence[int]) -> None:
        self._numbers = numbers
        self._done: list[Frame] = []
        self._session = Session()

    def read(self, context: bpy.types.Context, **output: object) -> bake.Input | None:
        """Go to the next frame and read it, output as in `bake.read`; None once all are done."""
        if len(self._done) == len(self._numbers):
            return None
        number = self._numbers[len(self._done)]
        context.scene.frame_set(number)
        name = f"{context.scene.fmm_radiosity.attribute_name} {number:04d}"
        with self._named():
            return bake.read(context, name=name, **output)

    def compute(self, data: bake.Input, settings: fmm_core.Settings, progress: Progress | None) -> bake.Result:
        """Solve the frame that was read."""
        start, count = len(self._done), len(self._numbers)
        with self._named():
            return bake.compute(data, settings, part(progress, start / count, (start + 1) / count), self._session)

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Let errors name the frame that is not done yet."""
        try:
            yield
        except fmm_core.Cancelled:
            raise
        except fmm_core.Error as error:
            raise fmm_core.Error(f"frame {self._numbers[len(self._done)]}: {error}") from None

    def take(self, result: bake.Result) -> None:
        """Keep what is to be written of the frame that was solved."""
        colours = {name: values.astype(np.float32) for name, values in result.layers.items()}
        layers = attributes.Layers(result.arrays.receivers, colours, result.output)
        self._done.append(Frame(self._numbers[len(self._done)], layers, bake.report_of(result)))

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
        """That of the last frame, with seconds, rays and warnings of all, and in "frames" a line for each."""
        reports = [frame.report for frame in self._done]
        seconds = {phase: sum(report["seconds"][phase] for report in reports) for phase in reports[0]["seconds"]}
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
        return reports[-1] | {
            "frames": lines,
            "seconds": seconds,
            "counts": reports[-1]["counts"] | {"rays": sum(line["rays"] for line in lines)},
            "warnings": self._warnings(),
        }

    def _warnings(self) -> list[str]:
        """Those of all frames, each once; what is not true of all of them names the first that it is of."""
        numbers: dict[str, list[int]] = {}
        for frame in self._done:
            for text in dict.fromkeys(frame.report["warnings"]):
                numbers.setdefault(text, []).append(frame.number)
        return [text if len(of) == len(self._done) else f"frame {of[0]}: {text}" for text, of in numbers.items()]


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
    scene, frames = context.scene, Frames(numbers)
    frame, subframe = scene.frame_current, scene.frame_subframe
    try:
        while (data := frames.read(context, **output)) is not None:
            frames.take(frames.compute(data, settings, progress))
    finally:
        scene.frame_set(frame, subframe=subframe)
    return frames
