# SPDX-License-Identifier: GPL-3.0-or-later
"""Which light meets an object: Blender's ray visibility and light linking."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import bpy


class Seen(NamedTuple):
    """Which rays meet an object; it is lit all the same.

    diffuse: those from surface to surface, for which it shines, reflects and blocks; shadow: those from lamps and sky
    """

    diffuse: bool
    shadow: bool


def of(instance: bpy.types.DepsgraphObjectInstance) -> Seen:
    """What meets an object, or a copy, which has what both it and its instancer have."""
    holders = [instance.object, instance.parent] if instance.is_instance else [instance.object]
    return Seen(*(all(getattr(obj, f"visible_{name}") for obj in holders) for name in Seen._fields))


def remarks(obj: bpy.types.Object, seen: Seen, view: bool) -> list[str]:
    """What is not simulated, in words; view: whether gloss is shown to a camera."""
    found = linking_remarks(obj) if seen.diffuse else []
    if seen.diffuse and not seen.shadow:
        found.append("is hidden from shadow rays alone: it lets light of lamps and the sky through, but blocks that of "
                     "surfaces that shine")  # fmt: skip
    if seen.shadow and not seen.diffuse:
        found.append("is hidden from diffuse rays alone: it blocks light of lamps and the sky, but not that of "
                     "surfaces that shine")  # fmt: skip
    if view and seen.diffuse and not obj.visible_glossy:
        found.append("is hidden from glossy rays, which is not simulated: gloss shows it")
    # Neither changes what others get, but Cycles bakes them black.
    for flag, kind in (("is_shadow_catcher", "shadow catcher"), ("is_holdout", "holdout")):
        if getattr(obj, flag):
            found.append(f"is a {kind}, which is not simulated: it gets colours as others do")
    return found


def linking_remarks(obj: bpy.types.Object) -> list[str]:
    """What light linking of a lamp or of an object that shines is not simulated, in words."""
    linking, found = obj.light_linking, []
    if linking.receiver_collection is not None:
        found.append(f"is linked to light collection '{linking.receiver_collection.name}', which is not simulated: it "
                     "lights everything")  # fmt: skip
    if linking.blocker_collection is not None:
        found.append(f"is linked to be shaded by collection '{linking.blocker_collection.name}', which is not "
                     "simulated: everything shades it")  # fmt: skip
    return found
