# SPDX-License-Identifier: GPL-3.0-or-later
"""The default iteration: GMRES, started by a few steps of shooting."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .arrays import weighed
from .particles import Particles
from .progress import Tick
from .report import Report
from .settings import Settings
from .transport import Operator

Colours = NDArray[np.float64]

#: Steps of shooting that tell how bright each particle is.
STEPS = 3
#: Vectors that are kept before the residual is taken anew.
LARGEST_BASIS = 30
#: A basis that leaves more than this share of the residual has come to a stand.
STALLED = 0.5
#: Particles darker than this share of the mean count as this bright.
DARK = 1e-3


def gmres(
    exchange: Operator,
    particles: Particles,
    albedo: Colours,
    own: Colours,
    settings: Settings,
    report: Report,
    tick: Tick,
) -> Colours:
    """Radiosity (N, C) of particles with an albedo and light of their own (N, C), by GMRES (Saad and Schultz, SIAM J.
    Sci. Stat. Comput. 7, 1986), the colours side by side.

    Residuals are relative to each particle's own radiosity, so that a dim corner or colour counts like a bright one,
    down to a thousandth of the mean.
    Ends when no particle has more than the tolerance's share of its light still to come; or at the cap of applications,
    with a warning.
    """
    # Nobody receives more than a hemisphere full of the brightest, so that no bounce is larger than this share.
    most, count = float(albedo.max(initial=0.0)), 0

    def reflect(radiosity: Colours) -> Colours:
        nonlocal count
        count += 1
        tick(min(0.99, count / (count + 10)))
        return albedo * exchange.apply(radiosity)

    radiosity, unshot, ratio = own.copy(), own, 1.0
    for _ in range(min(STEPS, settings.max_iterations)):
        before, unshot = weighed(particles.weights, unshot), reflect(unshot)
        ratio = min(most, float((weighed(particles.weights, unshot) / np.where(before > 0, before, 1.0)).max()))
        report.residuals.append(_largest(unshot, radiosity + unshot))
        if _remaining(report.residuals[-1], ratio) <= settings.tolerance:
            return np.maximum(radiosity + unshot, 0.0)
        radiosity, residual = radiosity + unshot, unshot
    residual = reflect(unshot) if count < settings.max_iterations else unshot
    stalled = False
    while (remaining := _remaining(_largest(residual, radiosity), ratio)) > settings.tolerance:
        if count + 2 > settings.max_iterations:
            report.stopped_short(count, remaining)
            break
        scale, before = _brightness(radiosity), _largest(residual, radiosity)
        if stalled:
            # By area the exchange is symmetric, and each step gets closer (reciprocity); by brightness it may not.
            scale = scale.mean() * np.sqrt(particles.weights.mean() / particles.weights)[:, None] * np.ones_like(scale)
        columns = min(LARGEST_BASIS, settings.max_iterations - count - 1)
        wanted = 0.2 * settings.tolerance * (1 - min(ratio, 0.9999))
        step = _solved(lambda y, scale=scale: y - reflect(scale * y) / scale, residual / scale, wanted, columns, report)
        radiosity = radiosity + scale * step
        residual = own + reflect(radiosity) - radiosity
        stalled = not stalled and _largest(residual, radiosity) > STALLED * before
    return np.maximum(radiosity, 0.0)


def _solved(
    apply: Callable[[Colours], Colours], right: Colours, wanted: float, columns: int, report: Report
) -> Colours:
    """About the solution y (N, C) of apply(y) = right for each colour, from a basis of at most so many vectors."""
    count, channels = right.shape
    # A colour after the other, so that products with all vectors so far are products of matrices.
    basis = np.zeros((channels, columns + 1, count))
    hessenberg, goal = np.zeros((channels, columns + 1, columns)), np.zeros((channels, columns + 1))
    goal[:, 0] = np.linalg.norm(right, axis=0)
    basis[:, 0] = _unit(right.T, goal[:, 0])
    fits: list[Colours] = []
    for k in range(columns):
        vector = np.ascontiguousarray(apply(np.ascontiguousarray(basis[:, k].T)).T)
        for colour in range(channels):
            known = basis[colour, : k + 1]
            hessenberg[colour, : k + 1, k] = weighed(vector[colour], known.T)
            vector[colour] -= weighed(hessenberg[colour, : k + 1, k], known)
        hessenberg[:, k + 1, k] = np.linalg.norm(vector, axis=1)
        basis[:, k + 1] = _unit(vector, hessenberg[:, k + 1, k])
        systems = [(h[: k + 2, : k + 1], g[: k + 2]) for h, g in zip(hessenberg, goal, strict=True)]
        fits = [np.linalg.lstsq(h, g, rcond=None)[0] for h, g in systems]
        left = [g - h @ fit for (h, g), fit in zip(systems, fits, strict=True)]
        report.residuals.append(float(np.linalg.norm(left, axis=1).max() / np.sqrt(count)))
        if report.residuals[-1] <= wanted:
            break
    return np.stack([weighed(fit, known[: len(fit)]) for fit, known in zip(fits, basis, strict=True)], axis=1)


def _unit(rows: Colours, lengths: Colours) -> Colours:
    return rows / np.where(lengths > 0, lengths, 1.0)[:, None]


def _largest(residual: Colours, radiosity: Colours) -> float:
    """Largest share of its radiosity that a particle lacks, in any colour."""
    return float((np.abs(residual) / _brightness(radiosity)).max(initial=0.0))


def _brightness(radiosity: Colours) -> Colours:
    return np.maximum(radiosity, DARK * radiosity.mean(axis=0) + np.finfo(float).tiny)


def _remaining(share: float, ratio: float) -> float:
    """What all further bounces add where the next one adds so much, each one `ratio` of the one before."""
    return share / (1 - ratio) if ratio < 1 else (0.0 if share == 0 else float("inf"))
