# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake says of a scene, in the language of Blender's interface; the command line says it in English."""

from __future__ import annotations

import re

from bpy.app.translations import pgettext_iface as translated

from .messages_german import GERMAN


def _pattern(template: str) -> re.Pattern[str]:
    return re.compile("(.*?)".join(map(re.escape, template.split("{}"))))


# What begins with words of its own, and of these the longest, is what a text is.
_ORDER = sorted(GERMAN, key=lambda template: (template.startswith("{}"), -len(template)))
_PATTERNS = [(_pattern(template), template) for template in _ORDER]


def told(text: str) -> str:
    """A text of a bake in the language of the interface, with what it quotes of other such texts."""
    for pattern, template in _PATTERNS:
        found = pattern.fullmatch(text)
        if found is not None:
            return translated(template).format(*map(told, found.groups()))
    if text.startswith(" (") and text.endswith(")"):
        return f" ({'; '.join(map(told, text[2:-1].split('; ')))})"
    return text
