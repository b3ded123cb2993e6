# SPDX-License-Identifier: GPL-3.0-or-later
"""What a view layer shows, in the viewport and in renders."""

from __future__ import annotations

from collections.abc import Iterator, Set
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import bpy


@contextmanager
def unhidden(layer: bpy.types.ViewLayer) -> Iterator[None]:
    """Show in the viewport everything of a view layer, and hide it again."""
    hidden = [obj for obj in layer.objects if obj.hide_get()]
    switches = [obj for obj in layer.objects if obj.hide_viewport]
    collections = list(_collections(layer.layer_collection))
    switches += [item for item in collections if item.hide_viewport]
    switches += {item.collection for item in collections if item.collection.hide_viewport}
    try:
        for item in switches:
            item.hide_viewport = False
        for obj in hidden:
            obj.hide_set(False, view_layer=layer)
        layer.update()
        yield
    finally:
        for obj in hidden:
            obj.hide_set(True, view_layer=layer)
        for item in switches:
            item.hide_viewport = True
        layer.update()


def _collections(layer: bpy.types.LayerCollection) -> Iterator[bpy.types.LayerCollection]:
    yield from (item for child in layer.children for item in (child, *_collections(child)))


def renderable(layer: bpy.types.LayerCollection) -> Iterator[str]:
    """Names of the objects in collections that are neither excluded nor switched off for renders."""
    if layer.exclude or layer.collection.hide_render:
        return
    yield from (obj.name for obj in layer.collection.objects)
    for child in layer.children:
        yield from renderable(child)


def hidden(layer: bpy.types.ViewLayer, shown: Set[str]) -> Iterator[bpy.types.Object]:
    """The meshes and lamps that renders have, which show objects of these names, and the viewport hides."""
    for obj in layer.objects:
        if obj.type in ("MESH", "LIGHT") and obj.name in shown and not obj.hide_render and not obj.visible_get():
            yield obj
