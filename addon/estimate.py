# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake will cost, from the number of vertices and the settings alone.

Rays and seconds are those that the core counted in rooms of 4,000 to 75,000 vertices with 100 to 4,000 rays per colour,
the seconds on cores of a common machine, until a bake of this session has shown what this one does.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

from . import export
from .session import session

if TYPE_CHECKING:
    import bpy
    import fmm_core

#: Colours of a vertex, which has more than one along creases.
_COLOURS = 1.5
#: Rays traced for each ray of the settings and colour, and for each particle whatever the settings: they find penumbrae
#: and small things.
_RAYS_PER_RAY, _RAYS_PER_PARTICLE = 1.5, 100
#: The particles that the core aims at where their number is left open, least and most, what comes of each of them, and
#: from when it is not direct.
_PARTICLES, _MADE, _FEW = (1200, 20_000), 2, 5000
#: A particle is given this part of the rays of a colour.
_PARTICLE_SHARE = 0.25
#: A fit looks from so many samples a vertex but not from more than these, with so many times the rays of the colours.
_SAMPLES, _MOST_SAMPLES, _FIT_RAYS = 6, 300_000, 1.5
#: Seconds of one core for each ray where there are so many triangles, what doubling these adds to it as a share, and
#: seconds for each particle and each sample.
_RAY, _TRIANGLES, _DOUBLED, _PARTICLE, _SAMPLE = 1.9e-7, 1e4, 0.15, 3.5e-5, 2.2e-5
#: What measuring the error takes, as a share of the rest, and seconds of one core at most.
_MEASURING, _MOST_MEASURING = 0.25, 2.0
#: Seconds and MiB that every bake takes; KiB a vertex, and for each particle that is asked for.
_LEAST_SECONDS, _LEAST_MIB, _KIB, _PARTICLE_KIB = 0.3, 150, 2.5, 4


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
    counts = export.count_vertices(layer, scene.fmm_radiosity.scope)
    return predict(*counts, properties.settings_of(scene), fitted, session.pace)


def predict(vertices: int, coloured: int, settings: fmm_core.Settings, fitted: bool, pace: float = 1.0) -> Cost:
    """The expected cost for so many vertices, of which so many get colours; fitted: whether these are; pace: how much
    longer bakes take here than this model has it.
    """
    triangles, cores = 2 * vertices, os.cpu_count() or 1
    particles = settings.particles or _MADE * min(max(_PARTICLES[0], triangles), _PARTICLES[1])
    samples = min(_SAMPLES * coloured, _MOST_SAMPLES) if fitted else _COLOURS * coloured
    if settings.method != "fmm" and max(particles, triangles) <= _FEW:
        # Half of all pairs face each other, and of two particles one asks for both.
        rays = particles * samples / 2 + particles**2 / 4
    else:
        asked = _COLOURS * coloured * (_FIT_RAYS if fitted else 1) + _PARTICLE_SHARE * particles
        rays = _RAYS_PER_PARTICLE * particles + _RAYS_PER_RAY * settings.begin().rays * asked
    ray = _RAY * (1 + _DOUBLED * max(0.0, math.log2(triangles / _TRIANGLES)) if triangles else 1)
    seconds = _LEAST_SECONDS + (ray * rays + _PARTICLE * particles + _SAMPLE * samples) / cores
    if settings.probes:
        seconds += min(_MEASURING * seconds, _MOST_MEASURING / cores)
    seconds *= pace
    memory = _LEAST_MIB + (_KIB * vertices + _PARTICLE_KIB * (settings.particles or 0)) / 1024
    return Cost(coloured, round(rays), seconds, round(memory))


def learn(report: dict, expected: Cost) -> None:
    """Let the time that a bake took, as its report has it, tell how fast this machine is."""
    if report["counts"]["rays"]:
        session.pace *= report["seconds"]["total"] / expected.seconds


def spoken(seconds: float) -> str:
    """Seconds as an artist reads them: "4 s", "3 min", "2.5 h"."""
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    return f"{round(seconds / 60)} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
