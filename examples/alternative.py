# SPDX-License-Identifier: GPL-3.0-or-later
"""A small gallery: two rows of round pillars, a globe on a pedestal, a warm and a cool panel in the ceiling."""

from __future__ import annotations

import scene
from geometry import Surface, add_globe, box, divisions, grid, perforated, rectangle, regular_polygon
from mathutils import Vector

WIDTH, DEPTH, HEIGHT, CELL = 6.0, 8.0, 4.0, 0.22
PILLARS = [regular_polygon(x, y, 0.3, 20) for x in (-1.9, 1.9) for y in (1.6, 3.8, 6.0)]
PEDESTAL = rectangle(0.0, 4.6, 1.0, 1.0)
PANELS = {"Warm panel": rectangle(0.0, 2.4, 1.6, 0.8), "Cool panel": rectangle(0.0, 6.2, 1.6, 0.8)}
RADIANCE = {"Warm panel": (26.0, 19.0, 12.0), "Cool panel": (15.0, 20.0, 27.0)}


def build() -> None:
    """Fill the open scene."""
    plaster, clay = scene.diffuse("Plaster", (0.74, 0.72, 0.68)), scene.diffuse("Clay", (0.55, 0.26, 0.16))
    teal, gold = scene.diffuse("Teal", (0.10, 0.38, 0.42)), scene.diffuse("Gold", (0.72, 0.50, 0.14))
    _hall().object("Hall", [plaster, clay, teal])
    for number, footprint in enumerate(PILLARS, 1):
        pillar = Surface()
        box(pillar, footprint, 0.0, HEIGHT, CELL, (0, None, None))
        pillar.object(f"Pillar {number}", [plaster], smooth=True)
    pedestal = Surface()
    box(pedestal, PEDESTAL, 0.0, 0.9, CELL, (0, 0, None))
    pedestal.object("Pedestal", [plaster])
    add_globe("Globe", gold, Vector((0.0, 4.6, 1.46)), 0.55)
    for name, footprint in PANELS.items():
        panel = Surface()
        # It fills its hole in the ceiling exactly: a side below would cast a shadow on the ceiling beside it.
        box(panel, footprint, HEIGHT, HEIGHT + 0.05, CELL, (0, 0, 1))
        panel.object(name, [plaster, scene.light(name, RADIANCE[name])])
    scene.camera((0.0, -4.6, 2.0), (0.0, 4.0, 1.8), 32.0, 32.0)


def _hall() -> Surface:
    """Floor, ceiling and three walls as one mesh, cut where pillars, pedestal and panels are."""
    hall = Surface()
    x = WIDTH / 2
    low, high = ([Vector((i, j, z)) for i, j in ((-x, 0), (x, 0), (x, DEPTH), (-x, DEPTH))] for z in (0.0, HEIGHT))
    nx, ny, nz = (divisions(length, CELL) for length in (WIDTH, DEPTH, HEIGHT))
    hall.add(*perforated(low, nx, ny, [*PILLARS, PEDESTAL], CELL), 1, Vector((0, 0, 1)))
    hall.add(*perforated(high, nx, ny, [*PILLARS, *PANELS.values()], CELL), 0, Vector((0, 0, -1)))
    hall.add(*grid([low[3], low[2], high[2], high[3]], nx, nz), 2, Vector((0, -1, 0)))
    hall.add(*grid([low[0], low[3], high[3], high[0]], ny, nz), 0, Vector((1, 0, 0)))
    hall.add(*grid([low[1], low[2], high[2], high[1]], ny, nz), 0, Vector((-1, 0, 0)))
    return hall
