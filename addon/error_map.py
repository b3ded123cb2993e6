# SPDX-License-Identifier: GPL-3.0-or-later
"""Where baked colours are off, as a colour attribute of its own: dark where they are right, bright where they are not.

Each face is looked at once more in random places with four times the rays, and what a renderer makes of the colours
there is compared with what is found.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import fmm_core
import numpy as np
from fmm_core.progress import part

from . import attributes, memory, solving
from .textures import linear

if TYPE_CHECKING:
    import bpy

    from .memory import Progress
    from .session import Session

#: Rays of a sample against those of the bake: a quarter of the grain.
EFFORT = 4.0
#: Of all colours, this share is below the brightest colour of the map.
_SHOWN = 0.99
#: sRGB colours from no error to the largest that is shown (the colour map viridis of Smith and van der Walt).
_RAMP = np.array([[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]]) / 255


@dataclass(frozen=True)
class ErrorMap:
    """What is written: colours of every corner; and the error that the brightest of them stands for, as a share of the
    usual light.
    """

    layers: attributes.Layers
    top: float


def name_of(scene: bpy.types.Scene) -> str:
    """The attribute of the map, beside that of the bake."""
    return _beside(scene.fmm_radiosity.attribute_name)


def _beside(name: str) -> str:
    return f"{name} Error"


def shown(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> bool:
    """Whether the map is what 3D views show of any mesh."""
    name = name_of(scene)
    return any(obj.type == "MESH" and obj.data.attributes.active_color_name == name for obj in layer.objects)


def check(data: solving.Input) -> None:
    """Raise fmm_core.Error where there are no colours to map, or the map could not be written; before a solve."""
    import bpy

    meshes = [bpy.data.meshes[receiver.mesh, None] for receiver in data.scene.receivers]
    if not any(data.output.name in mesh.color_attributes for mesh in meshes):
        raise fmm_core.Error(f"no mesh has colours '{data.output.name}': bake first")
    attributes.check(data.scene.receivers, _output(data))


def compute(data: solving.Input, settings: fmm_core.Settings, progress: Progress | None, session: Session) -> ErrorMap:
    """The map of the colours of the last bake, as it was lit; away from Blender, in any thread.

    Raises fmm_core.Error where that one does not serve, and fmm_core.Cancelled.
    """
    arrays, progress = data.arrays, memory.limited(progress, data.memory_limit)
    places = solving.places_of(arrays, data.output.colours == "FIT", session)
    solution = solving.last_solution(data, settings, session)
    gathered = solution.irradiance(*places.asked, part(progress, 0.0, 0.2), places.effort)
    values = places.values(gathered, solution)
    again = solving.fit_of(arrays, places.points, seed=1)
    apart = solution.apart()
    found = apart.irradiance(again.points, again.normals, part(progress, 0.2, 1.0), EFFORT * again.effort)
    errors = again.errors(values, found, apart.sight(again))
    usual = np.sqrt((found**2).sum(axis=1).mean())
    shares = errors / usual if usual > 0 else errors
    top = _rounded(np.quantile(shares, _SHOWN))
    colours = coloured(shares / top)[places.points.inverse]
    output = _output(data)
    return ErrorMap(attributes.Layers(arrays.receivers, {output.name: colours}, output, rendered=False), top)


def _output(data: solving.Input) -> attributes.Output:
    return attributes.Output(_beside(data.output.name), domain=data.output.domain)


def _rounded(share: float) -> float:
    """The next of 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(max(share, 1e-6)))
    return float(power * next(step for step in (1, 2, 5, 10) if share <= step * power * (1 + 1e-9)))


def coloured(shares: np.ndarray) -> np.ndarray:
    """Linear colours (N,3) for shares (N,) from 0 to 1; what is more counts as 1."""
    steps = np.linspace(0.0, 1.0, len(_RAMP))
    encoded = np.stack([np.interp(shares, steps, channel) for channel in _RAMP.T], axis=1)
    return linear(encoded)
