# SPDX-License-Identifier: GPL-3.0-or-later
"""Which light meets an object: Blender's ray visibility and light linking."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import bpy


@dataclass(frozen=True)
class Seen:
    """reflects: it gives off and reflects light; blocks: it stops light. What does neither is lit all the same."""

    reflects: bool
    blocks: bool


def of(instance: bpy.types.DepsgraphObjectInstance) -> Seen:
    """What light meets of an object, or of a copy, which has what both it and its instancer have."""
    holders = [instance.object, instance.parent] if instance.is_instance else [instance.object]
    diffuse, shadow = (all(getattr(obj, name) for obj in holders) for name in ("visible_diffuse", "visible_shadow"))
    # Hidden from shadow rays alone it would let through light of lamps, and stop that of surfaces.
    return Seen(reflects=diffuse, blocks=diffuse or shadow)


def remarks(obj: bpy.types.Object, seen: Seen, view: bool) -> list[str]:
    """What is not simulated, in words; view: whether gloss is shown to a camera."""
    found = linking_remarks(obj) if seen.reflects else []
    if seen.reflects and not obj.visible_shadow:
        found.append("is hidden from shadow rays alone, which is not simulated: it blocks light")
    if seen.blocks and not seen.reflects:
        found.append("is hidden from diffuse rays alone: it neither shines nor reflects, but blocks light of lamps "
                     "and surfaces alike")  # fmt: skip
    if view and seen.reflects and not obj.visible_glossy:
        found.append("is hidden from glossy rays, which is not simulated: gloss shows it")
    if obj.is_shadow_catcher:
        found.append("is a shadow catcher, which is not simulated: it reflects and gets light as others do")
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
