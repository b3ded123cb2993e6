# SPDX-License-Identifier: GPL-3.0-or-later
"""Show what accuracy costs in the scene."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import bpy

from ..addon import bake, chart, study
from .editors import editor
from .threaded import Threaded

if TYPE_CHECKING:
    import fmm_core
    from fmm_core.study import Study

NAME = "Radiosity Study"


class FMM_RADIOSITY_OT_study(Threaded, bpy.types.Operator):
    """Bake the scene some twenty times with other settings, and show error against time and what to choose"""

    bl_idname = "fmm_radiosity.study"
    bl_label = "Study"
    bl_options: ClassVar[set[str]] = {"REGISTER"}

    def reading(self, context: bpy.types.Context) -> bake.Reading:
        """Read what is to be baked; nothing is kept of so many bakes."""
        return bake.reading(context)

    def solve(self, data: bake.Input, settings: fmm_core.Settings, progress: bake.Progress | None) -> Study:
        """All bakes; in the thread, away from Blender."""
        return study.run(data, settings, progress)[0]

    def succeed(self, context: bpy.types.Context, result: Study) -> set[str]:
        """Show the picture in an Image Editor: one that is open, or else a new window; and the table as a text."""
        image = _image(chart.draw(result, study.title(context.blend_data.filepath)))
        text = bpy.data.texts.get(NAME) or bpy.data.texts.new(NAME)
        text.from_string(study.table(result) + "\n")
        if not bpy.app.background:
            editor(context, "IMAGE_EDITOR").image = image
        self.report({"INFO"}, result.why)
        return {"FINISHED"}


def _image(picture: chart.Image.Image) -> bpy.types.Image:
    """The picture as an image of the file, in place of that of an earlier study."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{NAME}.png"
        picture.save(path)
        image = bpy.data.images.load(str(path))
        image.pack()
    old = bpy.data.images.get(NAME)
    if old is not None:
        old.user_remap(image)
        bpy.data.images.remove(old)
    image.name, image.filepath_raw = NAME, f"//{NAME}.png"
    image.use_fake_user = True
    return image
