# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes the example scenes beside this script; run it with bpy 4.2, so that every later Blender opens them."""

from __future__ import annotations

from pathlib import Path

import alternative
import cornell
import scene

SCENES = {
    "cornell_box": lambda: cornell.build(("Short block", "Tall block")),
    "cornell_one_block": lambda: cornell.build(("Tall block",)),
    "cornell_empty": lambda: cornell.build(()),
    "alternative": alternative.build,
}


def main() -> None:
    """Build and save every scene."""
    for name, build in SCENES.items():
        scene.start()
        build()
        path = Path(__file__).parent / f"{name}.blend"
        vertices = scene.save(path)
        print(f"{path.name}: {vertices:,} vertices, {path.stat().st_size / 1024:.0f} KiB")


if __name__ == "__main__":
    main()
