# SPDX-License-Identifier: GPL-3.0-or-later
"""The default iteration: GMRES, started by a few steps of shooting."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .particles import Particles
from .progress import Tick
from .report import Report
from .scene import Scene
from .settings import Settings
from .transport import Operator

Colours = NDArray[np.float64]

#: Steps of shooting that tell how bright each particle is.
STEPS = 3
#: Vectors that are kept before the residual is taken anew.
LARGEST_BASIS = 30
#: Particles darker than this share of the mean count as this bright.
DARK = 1e-9


def gmres(
    exchange: Operator, scene: Scene, particles: Particles, settings: Settings, report: Report, tick: Tick
) -> Colours:
    """Radiosity (N, 3) by GMRES (Saad and Schultz, SIAM J. Sci. Stat. Comput. 7, 1986), the colours side by side.

    Residuals are relative to each particle's own radiosity, so that a dim corner or colour counts like a bright one.
    Ends when no particle has more than the tolerance's share of its light still to come; or at the cap of applications,
    with a warning.
    """
    albedo, emission = scene.albedo[particles.triangle], scene.emission[particles.triangle]
    count = 0

    def reflect(radiosity: Colours) -> Colours:
        nonlocal count
        count += 1
        tick(min(0.99, count / (count + 10)))
        return albedo * exchange.apply(radiosity)

    radiosity, unshot, ratio = emission.copy(), emission, 1.0
    for _ in range(min(STEPS, settings.max_iterations)):
        before, unshot = unshot.sum(axis=0), reflect(unshot)
        ratio = float((unshot.sum(axis=0) / np.where(before > 0, before, 1.0)).max())
        report.residuals.append(_largest(unshot, radiosity + unshot))
        if _remaining(report.residuals[-1], ratio) <= settings.tolerance:
            return np.maximum(radiosity + unshot, 0.0)
        radiosity, residual = radiosity + unshot, unshot
    residual = reflect(unshot) if count < settings.max_iterations else unshot
    while (remaining := _remaining(_largest(residual, radiosity), ratio)) > settings.tolerance:
        if count + 2 > settings.max_iterations:
            report.warnings.append(
                f"iteration stopped after {count} steps with {remaining:.2g} of the light still to come"
            )
            break
        scale = np.maximum(radiosity, DARK * radiosity.mean(axis=0) + np.finfo(float).tiny)
        columns = min(LARGEST_BASIS, settings.max_iterations - count - 1)
        wanted = 0.2 * settings.tolerance * (1 - min(ratio, 0.99))
        step = _solved(lambda y, scale=scale: y - reflect(scale * y) / scale, residual / scale, wanted, columns, report)
        radiosity = np.maximum(radiosity + scale * step, 0.0)
        residual = emission + reflect(radiosity) - radiosity
    return radiosity


def _solved(
    apply: Callable[[Colours], Colours], right: Colours, wanted: float, columns: int, report: Report
) -> Colours:
    """About the solution y (N, 3) of apply(y) = right for each colour, from a basis of at most so many vectors."""
    norms = np.linalg.norm(right, axis=0)
    basis = [right / np.where(norms > 0, norms, 1.0)]
    hessenberg = np.zeros((3, columns + 1, columns))
    goal = np.zeros((3, columns + 1))
    goal[:, 0] = norms
    for k in range(columns):
        vector = apply(basis[k])
        for i, other in enumerate(basis):
            hessenberg[:, i, k] = (other * vector).sum(axis=0)
            vector = vector - hessenberg[:, i, k] * other
        norm = np.linalg.norm(vector, axis=0)
        hessenberg[:, k + 1, k] = norm
        basis.append(vector / np.where(norm > 0, norm, 1.0))
        fits = [
            np.linalg.lstsq(h[: k + 2, : k + 1], g[: k + 2], rcond=None)[0]
            for h, g in zip(hessenberg, goal, strict=True)
        ]
        left = [g[: k + 2] - h[: k + 2, : k + 1] @ y for h, g, y in zip(hessenberg, goal, fits, strict=True)]
        report.residuals.append(float(np.linalg.norm(left, axis=1).max() / np.sqrt(len(right))))
        if report.residuals[-1] <= wanted:
            break
    return sum(vector * weights for vector, weights in zip(basis, np.transpose(fits), strict=False))


def _largest(residual: Colours, radiosity: Colours) -> float:
    """Largest share of its radiosity that a particle lacks, in any colour."""
    lit = radiosity > 0
    return float((np.abs(residual[lit]) / radiosity[lit]).max(initial=0.0))


def _remaining(share: float, ratio: float) -> float:
    """What all further bounces add where the next one adds so much, each one `ratio` of the one before."""
    return share / (1 - ratio) if ratio < 1 else (0.0 if share == 0 else float("inf"))
