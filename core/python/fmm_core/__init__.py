# SPDX-License-Identifier: GPL-3.0-or-later
"""Diffuse global illumination (radiosity) by a fast multipole method, without any Blender in it."""

from .errors import Cancelled, Error
from .evaluation import OutputPoints, output_points
from .fit import Sight, VertexFit
from .kept import KeptVisibility
from .opacity import Opacity
from .scene import MAX_ALBEDO, Scene
from .settings import Settings
from .solution import Solution
from .solver import solve

__all__ = [
    "MAX_ALBEDO",
    "Cancelled",
    "Error",
    "KeptVisibility",
    "Opacity",
    "OutputPoints",
    "Scene",
    "Settings",
    "Sight",
    "Solution",
    "VertexFit",
    "output_points",
    "solve",
]
