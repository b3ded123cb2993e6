# SPDX-License-Identifier: GPL-3.0-or-later
"""The measured error of a solve: a few random probes, each found once more by rays, and a range that it lies in."""

import itertools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .arrays import weighed
from .direct_light import Receivers
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
#: What measuring aims to take elsewhere, as a share of the other seconds of a bake, and what of that finds what the
#: radiosity lacks.
SHARE, FOR_RADIOSITY = 0.235, 0.33
#: Least rays of each kind from all particles together and from all probes, and most of either, in one estimate.
LEAST_SAMPLES, LEAST_RAYS, MOST_RAYS = 24_000, 40_000, 320_000
#: Rays that one of each kind are in the end from a particle, and from a probe, from where some go on.
FOLLOWED, FOLLOWED_ON = 1.5, 2.9
#: Rays of the second estimate for each of the first, at most.
UNLIKE = 2.0
#: Rays of a probe in the second estimate, as shares of the mean, at least and at most.
FEWEST_SHARED, MOST_SHARED = 0.4, 4.0
#: Samples that tell what the radiosity lacks at a place: where patches have fewer, neighbours are taken together.
TOGETHER = 32
#: Rays of a probe that tell enough: where there are more, probes are more, and elsewhere fewer, down to so many.
ENOUGH, FEWEST = 220, 300
#: Standard deviation of the product of both estimates' noise over all probes, as a share of their squared difference.
COMMON = 0.15
#: Samples of the probes that tell how far chance goes, and the share of them that the range holds.
RESAMPLES, CONFIDENCE = 1000, 0.95


@dataclass(frozen=True)
class Solved:
    """What is measured: a scene, the operators and the radiosity (N, 3) that solve it.

    exchange None where nothing is reflected
    lit      the particles, as lamps and sky shine on them
    direct   (N, 3) irradiance of the particles from there; what is wrong with that from the sky is not measured, nor of
             lamps where nothing was found that divides a patch
    lamps    the same at any points with normals (M, 3), exact
    """

    scene: Scene
    space: Space
    exchange: Operator | None
    radiosity: Points
    lit: Receivers
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
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, Any]:
    """Relative error of the irradiance (M, 3) found at points with normals (M, 3), judged at random ones of them.

    seconds: those of the bake so far, and those of one application of the exchange; clock: tells them. Returns

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
    judge, most = Judge(solved, clock), min(settings.probes, len(found))
    if settings.target_error is None:
        most, rays, missing, ends = _by_time(judge, most, *seconds, clock, tick)
    else:
        rays, missing, ends = *_by_target(judge, settings.target_error, tick), None
    chosen = spread(points, normals, most, rng)
    gathered, further = judge.light(points[chosen], normals[chosen], missing, rays, tick, ends)
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
        "rays": judge.rays,
        "bound": nearest_bound(settings.truncation, settings.separation) if multipole else None,
    }


def _by_time(
    judge: "Judge", most: int, baked: float, application: float, clock: Callable[[], float], tick: Tick
) -> tuple[int, int, Points, float]:
    """How many probes, at most so many, rays of each kind for each, what the radiosity lacks, and when to end: what a
    share of the seconds of a bake pays for.
    """
    ends = clock() + SHARE * baked
    judge.find_missing(LEAST_SAMPLES, tick)
    kept = (1 - FOR_RADIOSITY) * SHARE * baked + 2 * application
    more = _rays(ends - kept - clock(), FOLLOWED * judge.ray_seconds)
    if more > LEAST_SAMPLES // 2:
        judge.find_missing(more, tick)
    missing = judge.missing()
    rays = max(LEAST_RAYS, _rays(ends - clock(), FOLLOWED_ON * judge.ray_seconds))
    probes = min(most, max(FEWEST, round(rays / ENOUGH)))
    return probes, min(PROBE_RAYS, round(rays / probes)), missing, ends


def _by_target(judge: "Judge", target: float, tick: Tick) -> tuple[int, Points]:
    """Rays of each kind for each probe, and what the radiosity lacks: as well as a target error wants it."""
    effort = float(np.clip((USUAL_TARGET / target) ** 0.5, LEAST_EFFORT, MOST_EFFORT))
    judge.find_missing(round(effort * PARTICLE_RAYS), tick)
    return round(effort * PROBE_RAYS), judge.missing()


class Judge:
    """Two independent estimates of the light from what was solved, and of what that lacks.

    ray_seconds   how long a ray took that found what is missing, with all that is done for it
    """

    def __init__(self, solved: Solved, clock: Callable[[], float] = time.perf_counter) -> None:
        self._solved, self._clock, self._spent, self._seeds = solved, clock, 0.0, itertools.count()
        self._reference = Reference(solved.scene, solved.space.sums, solved.lit, solved.direct)
        self._samples, self._residuals = 0, np.zeros((2, *solved.radiosity.shape))

    @property
    def rays(self) -> int:
        """Rays traced so far."""
        return self._reference.rays

    @property
    def ray_seconds(self) -> float:
        return self._spent / max(1, self.rays)

    def find_missing(self, samples: int, tick: Tick = silent) -> None:
        """Finds what the radiosity lacks by so many more rays of each kind from all surfaces, in each estimate."""
        solved, began = self._solved, self._clock()
        each = max(1, round(samples / len(solved.space.sums.particles.areas)))
        found = [self._reference.residual(solved.radiosity, each, next(self._seeds)) for _ in range(2)]
        self._samples += each
        self._residuals += (np.array(found) - self._residuals) * (each / self._samples)
        self._spent += self._clock() - began
        tick(0.3)

    def missing(self) -> Points:
        """(2, N, 3) what the radiosity lacks."""
        solved, albedo = self._solved, self._solved.space.sums.particles.of_triangles(self._solved.scene.albedo)
        count = math.ceil(TOGETHER / self._samples)
        residuals = [self._reference.evened(found + albedo * solved.direct, count) for found in self._residuals]
        if solved.exchange is None:
            return np.array(residuals)
        again = reflected_again(solved, albedo)
        return np.array([propagated(solved.exchange, albedo, residual, again) for residual in residuals])

    def light(
        self,
        points: Points,
        normals: Points,
        missing: Points,
        rays: int,
        tick: Tick = silent,
        ends: float | None = None,
    ) -> tuple[Points, Points]:
        """Irradiance (2, M, 3) at points with normals (M, 3), and what it lacks where the radiosity lacks so much
        (2, N, 3), by so many rays of each kind each. Where it is to end at some time the second estimate has as many
        as the first one left seconds for, most of them where single rays of that differ most.
        """
        solved, lamps = self._solved, self._solved.lamps(points, normals)
        found, began, counts = [], self._clock(), np.full(len(points), rays)
        for half in (0, 1):
            tick(0.5 + 0.25 * half)
            given = points, normals, solved.radiosity, missing[half], solved.direct
            light, unlike = self._reference.irradiance(*given, counts, next(self._seeds))
            found.append(light)
            if half == 0 and ends is not None:
                now = self._clock()
                afforded = rays * (ends - now) / max(now - began, 1e-9)
                counts = shared(unlike, np.clip(afforded, LEAST_RAYS / len(points), UNLIKE * rays))
        tick(1.0)
        gathered, further = np.swapaxes(found, 0, 1)
        return gathered + lamps, further


def shared(unlike: Points, rays: float) -> NDArray[np.int64]:
    """(M,) rays of each point, so many on average, where single rays of another estimate have such variances (M,)."""
    wanted = np.sqrt(unlike)
    wanted = np.clip(wanted / max(wanted.mean(), np.finfo(float).tiny), FEWEST_SHARED, MOST_SHARED)
    return np.maximum(1, np.round(rays * wanted / wanted.mean())).astype(np.int64)


def spread(points: Points, normals: Points, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Rows (K,) of so many of the points with normals (M, 3), each as likely as any other: one of each K-th of them,
    where neighbours follow each other, since their errors are alike.
    """
    order = _binding.tree_order(np.ascontiguousarray(points), np.ascontiguousarray(normals)).astype(np.int64)
    at = (np.arange(count) + rng.random(count)) * (len(points) / count)
    return np.sort(order[np.minimum(at.astype(np.int64), len(points) - 1)])


def propagated(exchange: Operator, albedo: Points, residual: Points, again: Points) -> Points:
    """About the e (N, 3) of e = residual + albedo * exchange(e): what the radiosity lacks where each particle lacks so
    much of what the others send it. After the first reflection a share of `again` (3,) is left by each further one.
    """
    return residual + albedo * exchange.apply(residual) / (1 - again)


def reflected_again(solved: Solved, albedo: Points) -> Points:
    """(3,) the share of all light in a scene that surfaces (N, 3) reflect onto others."""
    particles = solved.space.sums.particles
    reflected = solved.radiosity - particles.of_triangles(solved.scene.emission) - albedo * solved.direct
    sent, all_light = (weighed(particles.weights, light) for light in (reflected, solved.radiosity))
    return np.clip(sent / np.where(all_light > 0, all_light, 1.0), 0.0, albedo.max(axis=0))


def _rays(seconds: float, each: float) -> int:
    """How many rays of each kind so many seconds pay for in each of two estimates, of so many seconds each."""
    return round(min(seconds / (2 * each), MOST_RAYS))


def _root(squared: float) -> float:
    return float(np.sqrt(max(0.0, squared)))


def nearest_bound(truncation: int, separation: int) -> float:
    """The bound of section 2.2 for boxes `separation` + 1 sides apart, relative to strength / (pi r_x^2)."""
    # In half sides: sources reach the corners of their box, receivers start at the near face of theirs.
    source_radius, receiver_distance = np.sqrt(3.0), 2.0 * separation + 1.0
    bound = _binding.error_bound(truncation, 1.0, source_radius, receiver_distance)
    return float(bound * np.pi * receiver_distance**2)
