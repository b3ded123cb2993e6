# SPDX-License-Identifier: GPL-3.0-or-later
"""A 3D view that shows the baked colours and nothing else, and the way back."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .session import session

if TYPE_CHECKING:
    import bpy

#: Shading of a view that shows colours as they are, in an order in which Blender takes them.
_COLOURS = {"type": "SOLID", "light": "FLAT", "color_type": "VERTEX"}
#: That of a view nobody has changed.
_USUAL = {"type": "SOLID", "light": "STUDIO", "color_type": "MATERIAL"}


def views(context: bpy.types.Context) -> list[bpy.types.SpaceView3D]:
    """The view whose panel is used, or else every 3D view of the screen."""
    if context.space_data is not None and context.space_data.type == "VIEW_3D":
        return [context.space_data]
    areas = context.screen.areas if context.screen is not None else ()
    return [area.spaces.active for area in areas if area.type == "VIEW_3D"]


def shows(view: bpy.types.SpaceView3D) -> bool:
    """Whether a view shows the colours now."""
    return all(getattr(view.shading, name) == value for name, value in _COLOURS.items())


def show(view: bpy.types.SpaceView3D) -> None:
    """Show the colours, and remember how the view was shaded; nothing where it shows them already."""
    if shows(view):
        return
    kind = view.shading.type
    # Light and colour of solid shading are kept apart from those of wireframes.
    view.shading.type = "SOLID"
    before = {name: getattr(view.shading, name) for name in _COLOURS}
    session.views[view.as_pointer()] = before | {"type": kind}
    _set(view, _COLOURS)


def back(view: bpy.types.SpaceView3D) -> None:
    """Shade a view as it was before `show`."""
    before = session.views.pop(view.as_pointer(), _USUAL)
    _set(view, before | {"type": "SOLID"})
    view.shading.type = before["type"]


def _set(view: bpy.types.SpaceView3D, values: dict[str, object]) -> None:
    for name, value in values.items():
        setattr(view.shading, name, value)
