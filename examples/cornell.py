# SPDX-License-Identifier: GPL-3.0-or-later
"""The Cornell box from its published measurements.

Source: Cornell University Program of Computer Graphics, "Cornell Box Data", 1998,
https://www.graphics.cornell.edu/online/box/data.html (coordinates in mm, y up, spectra from 400 to 700 nm).
"""

from __future__ import annotations

from collections.abc import Sequence

import scene
from geometry import Surface, box, divisions, grid, perforated
from mathutils import Vector

# One unit is 10 cm of the model: the room is about 5.5 units wide.
SCALE = 0.01
CELL = 0.2

# Corners of the room as measured: it is not quite a box.
FLOOR = ((552.8, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 559.2), (549.6, 0.0, 559.2))
CEILING = ((556.0, 548.8, 0.0), (556.0, 548.8, 559.2), (0.0, 548.8, 559.2), (0.0, 548.8, 0.0))
BACK = ((549.6, 0.0, 559.2), (0.0, 0.0, 559.2), (0.0, 548.8, 559.2), (556.0, 548.8, 559.2))
RIGHT = ((0.0, 0.0, 559.2), (0.0, 0.0, 0.0), (0.0, 548.8, 0.0), (0.0, 548.8, 559.2))
LEFT = ((552.8, 0.0, 0.0), (549.6, 0.0, 559.2), (556.0, 548.8, 559.2), (556.0, 548.8, 0.0))
LIGHT = ((343.0, 548.8, 227.0), (343.0, 548.8, 332.0), (213.0, 548.8, 332.0), (213.0, 548.8, 227.0))
# Tops of the blocks; their sides go straight down to the floor.
SHORT_BLOCK = ((130.0, 165.0, 65.0), (82.0, 165.0, 225.0), (240.0, 165.0, 272.0), (290.0, 165.0, 114.0))
TALL_BLOCK = ((423.0, 330.0, 247.0), (265.0, 330.0, 296.0), (314.0, 330.0, 456.0), (472.0, 330.0, 406.0))
BLOCKS = {"Short block": SHORT_BLOCK, "Tall block": TALL_BLOCK}

CAMERA, FOCAL_LENGTH, SENSOR = (278.0, 273.0, -800.0), 35.0, 25.0

# Means of the measured spectra over 600 to 700, 500 to 600 and 400 to 500 nm, as red, green and blue.
WHITE = (0.734, 0.736, 0.706)
GREEN = (0.132, 0.348, 0.117)
RED = (0.581, 0.088, 0.057)
LIGHT_RADIANCE = (17.0, 11.8, 4.0)


def build(blocks: Sequence[str]) -> None:
    """Fill the open scene with the room, its light, its camera and the named blocks."""
    white, red, green = scene.diffuse("White", WHITE), scene.diffuse("Red", RED), scene.diffuse("Green", GREEN)
    _room([BLOCKS[name] for name in blocks]).object("Room", [white, red, green])
    _light().object("Light", [white, scene.light("Light", LIGHT_RADIANCE)])
    for name in blocks:
        top = [_place(corner) for corner in BLOCKS[name]]
        block = Surface()
        box(block, [corner.xy for corner in top], 0.0, top[0].z, CELL, (0, 0, None))
        block.object(name, [white])
    position = _place(CAMERA)
    scene.camera(position, position + Vector((0, 1, 0)), FOCAL_LENGTH, SENSOR)


def _room(blocks: Sequence[Sequence[Sequence[float]]]) -> Surface:
    """Five walls as one mesh, open in front, and cut where the blocks stand and the light is."""
    room = Surface()
    count = divisions(5.55, CELL)
    footprints = [[_place(corner).xy for corner in block] for block in blocks]
    opening = [[_place(corner).xy for corner in LIGHT]]
    for corners, slot, facing, holes in (
        (FLOOR, 0, (0, 0, 1), footprints),
        (CEILING, 0, (0, 0, -1), opening),
        (BACK, 0, (0, -1, 0), []),
        (RIGHT, 2, (-1, 0, 0), []),
        (LEFT, 1, (1, 0, 0), []),
    ):
        placed = [_place(corner) for corner in corners]
        patch = perforated(placed, count, count, holes, CELL) if holes else grid(placed, count, count)
        room.add(*patch, slot, Vector(facing))
    return room


def _light() -> Surface:
    """A flat closed box above the ceiling that shines from its lower side, which fills the opening exactly."""
    corners = [_place(corner) for corner in LIGHT]
    lamp = Surface()
    box(lamp, [corner.xy for corner in corners], corners[0].z, corners[0].z + 0.05, CELL, (0, 0, 1))
    return lamp


def _place(point: Sequence[float]) -> Vector:
    """From the published axes to Blender's: z up, looking along y, the middle of the room at x = 0."""
    x, y, z = point
    return Vector(((278.0 - x) * SCALE, z * SCALE, y * SCALE))
