# SPDX-License-Identifier: GPL-3.0-or-later
"""What operators share that give the selected meshes more vertices."""

from __future__ import annotations

import bpy
import fmm_core
from bpy.app.translations import pgettext_iface as translated

from ..addon import subdivision
from ..addon.session import session

#: No more vertices are made at once.
MOST_VERTICES = 5_000_000


class OnMeshes:
    """Works on the selected meshes or on copies of them; shown: the options, by name."""

    shown: tuple[str, ...]

    copies: bpy.props.BoolProperty(
        name="On Copies",
        description="Leave the meshes as they are, hide them, and work on copies",
        default=False,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Object Mode, no bake under way, and a mesh is selected."""
        why = None
        if session.running is not None:
            why = "A bake is under way"
        elif context.mode != "OBJECT":
            why = "Switch to Object Mode first"
        elif not subdivision.receivers(context):
            why = "Select a mesh first, one that is not linked from a library"
        if why is not None:
            cls.poll_message_set(why)
        return why is None

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw the options."""
        self.layout.use_property_split = True
        for name in self.shown:
            self.layout.prop(self, name)

    def objects(self, context: bpy.types.Context) -> list[bpy.types.Object]:
        """The objects to work on."""
        return subdivision.copied(context) if self.copies else subdivision.receivers(context)


def check(expected: int) -> None:
    """Raise fmm_core.Error where so many vertices would be too many."""
    if expected > MOST_VERTICES:
        text = "This would come to {:,d} vertices, more than {:,d}: choose longer edges"
        raise fmm_core.Error(translated(text).format(expected, MOST_VERTICES))
