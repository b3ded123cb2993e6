# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake will cost, from the number of vertices and the settings alone.

Rays per colour and memory per vertex are those that the core counted in rooms of 5,000 to 160,000 vertices; rays per
second is that of one core of a common machine, until a bake of this session has shown what this one does.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

from . import export
from .session import session

if TYPE_CHECKING:
    import bpy
    import fmm_core

#: Rays traced for each ray of the settings: the second half finds penumbrae and small things.
_RAYS_PER_RAY = 2.0
#: What measuring the error takes, as a share of the rest.
_MEASURING = 0.25
#: The number of particles that the core chooses where it is left open, least and most, and from when it is not direct.
_PARTICLES, _FEW = (1200, 20_000), 5000
#: A particle is given this part of the rays of a colour.
_PARTICLE_SHARE = 0.25
#: A fit looks from so many samples a vertex, with so many times the rays of the vertex together.
_SAMPLES, _FIT_RAYS = 6, 1.5
#: Rays a second and core; seconds and MiB that every bake takes; KiB a vertex.
_RATE, _LEAST_SECONDS, _LEAST_MIB, _KIB = 2.5e6, 0.3, 150, 2.5


@dataclass(frozen=True)
class Cost:
    """Of a bake: colours, rays, seconds, and MiB of memory beside what Blender has."""

    colours: int
    rays: int
    seconds: float
    memory_mib: int


def of_scene(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> Cost:
    """The expected cost of a bake of a scene."""
    from . import properties

    fitted = properties.output_of(scene).colours == "FIT"
    return predict(export.count_vertices(layer), properties.settings_of(scene), fitted, session.pace)


def predict(vertices: int, settings: fmm_core.Settings, fitted: bool, pace: float = 1.0) -> Cost:
    """The expected cost for so many vertices; fitted: whether colours are; pace: how much longer bakes take here than
    this model has it.
    """
    triangles = 2 * vertices
    particles = settings.particles or min(max(_PARTICLES[0], triangles), _PARTICLES[1])
    if settings.method != "fmm" and max(particles, triangles) <= _FEW:
        # Half of all pairs face each other, and of two particles one asks for both.
        rays = particles * (_SAMPLES * vertices if fitted else vertices) / 2 + particles**2 / 4
    else:
        each = _RAYS_PER_RAY * settings.begin().rays
        rays = each * (vertices * (_FIT_RAYS if fitted else 1) + _PARTICLE_SHARE * particles)
    pace *= 1 + _MEASURING if settings.probes else 1
    seconds = pace * (_LEAST_SECONDS + rays / (_RATE * (os.cpu_count() or 1)))
    return Cost(vertices, round(rays), seconds, round(_LEAST_MIB + _KIB * vertices / 1024))


def learn(report: dict, scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> None:
    """Let the time that a bake took, as its report has it, tell how fast this machine is."""
    if report["counts"]["rays"]:
        session.pace *= report["seconds"]["total"] / of_scene(scene, layer).seconds


def spoken(seconds: float) -> str:
    """Seconds as an artist reads them: "4 s", "3 min", "2.5 h"."""
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    return f"{round(seconds / 60)} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
