# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake every frame that the timeline plays."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import bpy

from ..addon import animation, bake, properties
from .threaded import Threaded

if TYPE_CHECKING:
    import fmm_core


class FMM_RADIOSITY_OT_bake_frames(Threaded, bpy.types.Operator):
    """Bake all frames of the scene's range, or of its preview range if that is on, each into an attribute of its own"""

    bl_idname = "fmm_radiosity.bake_frames"
    bl_label = "Bake Frames"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    _frames: animation.Frames | None = None
    _shown: tuple[str, int, float] | None = None

    def reading(self, context: bpy.types.Context) -> bake.Reading:
        """Read the first frame."""
        scene = context.scene
        self._shown = scene.name, scene.frame_current, scene.frame_subframe
        self._frames = animation.Frames(properties.frames_of(scene), scene.name)
        return self._frames.reading(context)

    def solve(
        self, data: bake.Input, settings: fmm_core.Settings, progress: bake.Progress | None
    ) -> bake.Result | animation.Night:
        """Solve a frame."""
        return self._frames.compute(data, settings, progress)

    def following(self, context: bpy.types.Context, result: bake.Result | animation.Night) -> bake.Reading | None:
        """The next frame."""
        self._frames.take(result)
        return self._frames.reading(context) if self._frames.unfinished() else None

    def write(self, context: bpy.types.Context, result: bake.Result) -> dict:
        """Write all frames."""
        return self._frames.write()

    def end(self, context: bpy.types.Context) -> None:
        """Go back to the frame that was shown, and let go of what was solved."""
        if self._shown is not None:
            name, frame, subframe = self._shown
            scene = context.blend_data.scenes.get((name, None))
            if scene is not None:
                scene.frame_set(frame, subframe=subframe)
        self._shown = self._frames = None
