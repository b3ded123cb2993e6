# SPDX-License-Identifier: GPL-3.0-or-later
"""Diffuse global illumination (radiosity) by a fast multipole method, without any Blender in it."""

from .brdf import Brdf
from .closed import inward, signed_volume
from .effects import plan
from .errors import Cancelled, Error
from .evaluation import OutputPoints, output_points
from .fit import Sight, VertexFit
from .gloss import Gloss
from .harmonics import irradiance_of, matched
from .kept import KeptVisibility
from .lights import AreaLight, Light, PointLight, SpotLight, SunLight
from .medium import Volume
from .opacity import Opacity
from .scene import MAX_ALBEDO, Scene
from .settings import EFFECTS, Settings
from .sky import Sky
from .solution import Solution
from .solver import solve
from .target import solve_at
from .threads import limit_threads

__all__ = [
    "EFFECTS",
    "MAX_ALBEDO",
    "AreaLight",
    "Brdf",
    "Cancelled",
    "Error",
    "Gloss",
    "KeptVisibility",
    "Light",
    "Opacity",
    "OutputPoints",
    "PointLight",
    "Scene",
    "Settings",
    "Sight",
    "Sky",
    "Solution",
    "SpotLight",
    "SunLight",
    "VertexFit",
    "Volume",
    "inward",
    "irradiance_of",
    "limit_threads",
    "matched",
    "output_points",
    "plan",
    "signed_volume",
    "solve",
    "solve_at",
]
