# SPDX-License-Identifier: GPL-3.0-or-later
"""The measured error of a solve: a few random probes, each found once more by rays, and a range that it lies in."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .multipole import MultipoleSpace
from .progress import Tick, silent
from .reference import Reference
from .scene import Scene
from .settings import Settings
from .transport import Operator, Space

Points = NDArray[np.float64]

#: Rays of each kind from a probe, and from all particles together, in each of two independent estimates, where an
#: error decides over the settings: all that there are for `USUAL_TARGET`, and for others a share of them from the least
#: to the most effort.
PROBE_RAYS, PARTICLE_RAYS = 1024, 320_000
USUAL_TARGET, LEAST_EFFORT, MOST_EFFORT = 0.005, 0.22, 1.5
#: What measuring aims to take elsewhere, as a share of the other seconds of a bake, so that it takes no more than a
#: quarter where rays are slow; least and most rays of each kind that one estimate has, and their share from the probes.
SHARE, LEAST_RAYS, MOST_RAYS, FROM_PROBES = 0.18, 80_000, 640_000, 2 / 3
#: Seconds of a ray, with all that is done for it, which threads hardly share, and rays that one of each kind are in the
#: end, as some go on: neither need be exact.
RAY_SECONDS, FOLLOWED = 0.45e-6, 2.5
#: Rays of a probe that tell enough: where there are more, probes are more, and elsewhere fewer, down to so many.
ENOUGH, FEWEST = 256, 300
#: Applications of the exchange after which an error of the radiosity goes on as a geometric series.
STEPS = 2
#: Standard deviation of the product of both estimates' noise over all probes, as a share of their squared difference.
COMMON = 0.15
#: Samples of the probes that tell how far chance goes, and the share of them that the range holds.
RESAMPLES, CONFIDENCE = 1000, 0.95


@dataclass(frozen=True)
class Solved:
    """What is measured: a scene, the operators and the radiosity (N, 3) that solve it.

    exchange None where nothing is reflected
    direct   (N, 3) irradiance of the particles from lamps and sky; what is wrong with it is not measured
    lamps    the same at any points with normals (M, 3), exact
    """

    scene: Scene
    space: Space
    exchange: Operator | None
    radiosity: Points
    direct: Points
    lamps: Callable[[Points, Points], Points]


def measure(
    found: Points,
    points: Points,
    normals: Points,
    solved: Solved,
    settings: Settings,
    seconds: tuple[float, float],
    tick: Tick = silent,
) -> dict[str, Any]:
    """Relative error of the irradiance (M, 3) found at points with normals (M, 3), judged at random ones of them.

    seconds: those of the bake so far, and those of one application of the exchange. Returns

    measured_rms   relative L2 error over the probes, with the noise of what they are judged by taken out
    low, high      where it lies in 95 of 100 cases, fewer where few points have most of it; low is 0 where it is too
                   small to be told from noise
    measured_max   largest error of a probe, relative to their RMS irradiance, noise included
    gathered       the part of the error that the last gather has; the rest comes with the radiosity
    probes, rays   how many there were, and what measuring took
    bound          of the multipole method: the paper's (section 2.2) for the two nearest boxes that exchange light by
                   expansions, relative to the largest irradiance that the source box can send there
    """
    rng = np.random.default_rng(0)
    probes, rays, samples = _plan(min(settings.probes, len(found)), settings.target_error, *seconds)
    chosen = np.sort(rng.choice(len(found), size=probes, replace=False))
    gathered, further, traced = estimates(points[chosen], normals[chosen], solved, rays, samples, tick)
    whole = gathered + further
    errors = found[chosen] - whole
    scale = (whole[0] * whole[1]).sum(axis=1).mean()
    scale = scale if scale > 0 else 1.0
    of_gather = np.prod(found[chosen] - gathered, axis=0).sum(axis=1).mean() / scale
    squared = np.prod(errors, axis=0).sum(axis=1) / scale
    # What the estimate of the radiosity's error is off by is much the same at all probes.
    noise = COMMON * ((further[0] - further[1]) ** 2).sum(axis=1).mean() / scale
    picked = rng.integers(0, len(chosen), (RESAMPLES, len(chosen)))
    resampled = squared[picked].mean(axis=1) + rng.normal(0.0, noise, RESAMPLES)
    low, high = np.quantile(resampled, (0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2))
    measured = _root(squared.mean())
    multipole = isinstance(solved.space, MultipoleSpace)
    return {
        "measured_rms": measured,
        "low": min(_root(low), measured),
        "high": max(_root(high), measured),
        "measured_max": float(np.linalg.norm(errors.mean(axis=0), axis=1).max() / np.sqrt(scale)),
        "gathered": _root(of_gather),
        "probes": len(chosen),
        "rays": traced,
        "bound": nearest_bound(settings.truncation, settings.separation) if multipole else None,
    }


def estimates(
    points: Points, normals: Points, solved: Solved, rays: int, samples: int, tick: Tick = silent
) -> tuple[Points, Points, int]:
    """Two independent estimates of the irradiance (2, M, 3) from what was solved, and of what that lacks, and how many
    rays it took: so many of each kind for each point, and so many from all surfaces together.
    """
    particles = solved.space.sums.particles
    reference, albedo = Reference(solved.scene, solved.space.sums), particles.of_triangles(solved.scene.albedo)
    lamps, each = solved.lamps(points, normals), max(1, round(samples / len(particles.areas)))
    gathered, further = [], []
    for half in (0, 1):
        residual = reference.residual(solved.radiosity, each, half) + albedo * solved.direct
        tick(0.5 * half + 0.2)
        missing = residual if solved.exchange is None else propagated(solved.exchange, albedo, residual)
        tick(0.5 * half + 0.3)
        found = reference.irradiance(points, normals, solved.radiosity, missing, solved.direct, rays, 2 + half)
        gathered.append(found[0] + lamps)
        further.append(found[1])
        tick(0.5 * half + 0.5)
    return np.array(gathered), np.array(further), reference.rays


def propagated(exchange: Operator, albedo: Points, residual: Points) -> Points:
    """About the e (N, 3) of e = residual + albedo * exchange(e): what the radiosity lacks where each particle lacks so
    much of what the others send it.
    """
    total, term, ratio = residual, residual, 0.0
    for _ in range(STEPS):
        following = albedo * exchange.apply(term)
        before = (term * term).sum()
        ratio = (following * term).sum() / before if before > 0 else 0.0
        total, term = total + following, following
    ratio = min(max(ratio, 0.0), float(albedo.max()))
    return total + term * ratio / (1 - ratio)


def _plan(most: int, target: float | None, baked: float, application: float) -> tuple[int, int, int]:
    """How many probes, at most so many, rays of each kind for each, and rays from all particles."""
    if target is not None:
        effort = float(np.clip((USUAL_TARGET / target) ** 0.5, LEAST_EFFORT, MOST_EFFORT))
        return most, round(effort * PROBE_RAYS), round(effort * PARTICLE_RAYS)
    left = SHARE * baked - 2 * STEPS * application
    rays = float(np.clip(left / (2 * FOLLOWED * RAY_SECONDS), LEAST_RAYS, MOST_RAYS))
    asked = FROM_PROBES * rays
    probes = min(most, max(FEWEST, round(asked / ENOUGH)))
    return probes, min(PROBE_RAYS, round(asked / probes)), round(rays - asked)


def _root(squared: float) -> float:
    return float(np.sqrt(max(0.0, squared)))


def nearest_bound(truncation: int, separation: int) -> float:
    """The bound of section 2.2 for boxes `separation` + 1 sides apart, relative to strength / (pi r_x^2)."""
    # In half sides: sources reach the corners of their box, receivers start at the near face of theirs.
    source_radius, receiver_distance = np.sqrt(3.0), 2.0 * separation + 1.0
    bound = _binding.error_bound(truncation, 1.0, source_radius, receiver_distance)
    return float(bound * np.pi * receiver_distance**2)
