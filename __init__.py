# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's way in: nothing of Blender is imported before `register` is called."""


def register() -> None:
    """Switch the extension on, or say why it cannot run."""
    from .addon import missing

    if missing.reason() is None:
        from .addon import registration

        registration.register()
    else:
        missing.register()


def unregister() -> None:
    """Switch the extension off."""
    from .addon import missing

    if missing.is_registered():
        missing.unregister()
    else:
        from .addon import registration

        registration.unregister()
