# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's way in: nothing of Blender is imported before `register` is called."""


def register() -> None:
    """Switch the extension on."""
    from .addon import registration

    registration.register()


def unregister() -> None:
    """Switch the extension off."""
    from .addon import registration

    registration.unregister()
