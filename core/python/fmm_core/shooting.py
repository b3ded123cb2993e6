# SPDX-License-Identifier: GPL-3.0-or-later
"""The iteration of the paper: shooting (section 4)."""

import numpy as np
from numpy.typing import NDArray

from .particles import Particles
from .progress import Tick
from .report import Report
from .settings import Settings
from .transport import Operator


def shoot(
    exchange: Operator,
    _particles: Particles,
    albedo: NDArray[np.float64],
    own: NDArray[np.float64],
    settings: Settings,
    report: Report,
    tick: Tick,
) -> NDArray[np.float64]:
    """Radiosity (N, C) of particles with an albedo and light of their own (N, C), by shooting: in each step all of them
    pass on what they received in the step before.

    Ends when no particle has more than the tolerance's share of its light still to come in any colour, judged from the
    last two steps, so that a dim corner or colour counts like a bright one; or at the cap, with a warning.
    """
    radiosity, unshot = own.copy(), own
    for step in range(1, settings.max_iterations + 1):
        unshot = albedo * np.maximum(exchange.apply(unshot), 0.0)
        radiosity += unshot
        lit = radiosity > 0
        report.residuals.append(float((unshot[lit] / radiosity[lit]).max(initial=0.0)))
        remaining = _remaining(report.residuals)
        if remaining <= settings.tolerance:
            return radiosity
        tick(min(0.99, step / (step + 10)))
    report.stopped_short(step, remaining)
    return radiosity


def _remaining(residuals: list[float]) -> float:
    """Share of the light that all further steps together would add, from the last two: a geometric series."""
    last = residuals[-1]
    if last == 0.0:
        return 0.0
    ratio = last / residuals[-2] if len(residuals) > 1 else 1.0
    return last * ratio / (1 - ratio) if ratio < 1 else float("inf")
