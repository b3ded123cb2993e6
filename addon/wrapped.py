# SPDX-License-Identifier: GPL-3.0-or-later
"""Long texts in narrow panels."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import bpy

#: Width of a letter, and of what a panel has beside a text, in pixels of a screen of usual density.
_LETTER, _BESIDE_TEXT = 6.2, 80


def draw(layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str) -> None:
    """Draw a text over as many lines as the width of the panel calls for."""
    width = context.region.width / context.preferences.system.ui_scale - _BESIDE_TEXT
    column = layout.column(align=True)
    for line in textwrap.wrap(text, max(20, int(width / _LETTER))):
        column.label(text=line, icon=icon, translate=False)
        icon = "BLANK1"
