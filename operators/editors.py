# SPDX-License-Identifier: GPL-3.0-or-later
"""Where texts and pictures are shown."""

from __future__ import annotations

import bpy


def editor(context: bpy.types.Context, kind: str) -> bpy.types.Space:
    """An editor of a type of area, as "TEXT_EDITOR": one that is open, or else one in a new window."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == kind:
                return area.spaces.active
    bpy.ops.wm.window_new()
    area = context.window_manager.windows[-1].screen.areas[0]
    area.type = kind
    return area.spaces.active
