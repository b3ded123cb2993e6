# SPDX-License-Identifier: GPL-3.0-or-later
"""What lamps and the sky send to receivers straight away: closed forms, times what shadow rays say."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from . import _binding, patterns
from .convexity import Planes
from .lamp import Samples
from .lights import Light, SunLight
from .medium import left
from .particles import Particles
from .patch_lamps import PatchLamps, run_rows, sent
from .progress import Tick, silent
from .scene import Scene
from .sky import Bright, Sky
from .visibility import Occlusion

Points = NDArray[np.float64]

#: Rays to the rim of a lamp and to its inside that tell whether a receiver lies in a penumbra.
RIM, INSIDE = 24, 8
#: A lamp within so many radii of a patch makes spots that are smaller than it: the mean over the patch counts.
NEAR = 4.0
#: A patch is cut in four so many times for that.
CUTS = 4
#: Rays over the hemisphere of a receiver for each ray of the settings.
SKY_SHARE = 2
#: Rays to the bright parts of a sky.
BRIGHT_RAYS = 64
#: Ways from a lamp that tell how much of its light a medium leaves.
WAYS = 16
#: Steps in which the share of a sky ray that arrives is kept.
STEPS = 255
#: What is going on, for whoever waits.
LIGHTING = "Lighting by lamps and sky"


class Receivers:
    """Points that lamps and a sky shine on. What rays find is kept: other power and colours need no ray.

    points, normals (M, 3), unit
    """

    def __init__(
        self,
        points: Points,
        normals: Points,
        occlusion: Occlusion | None,
        rays: float,
        particles: Particles | None = None,
    ) -> None:
        """rays: about how many one gets to a lamp in whose penumbra it lies; occlusion: None for no shadows; particles:
        what the points are, where each stands for all of its patch.
        """
        self.points, self.normals, self._particles = points, normals, particles
        self._occlusion, self._rays = occlusion, max(1, round(rays))
        self._patches = None if particles is None else PatchLamps(particles, occlusion, rays)
        self._lamps: dict[object, NDArray[np.float32]] = {}
        self._partly: dict[object, NDArray[np.bool_]] = {}
        self._sky: NDArray[np.uint8] | None = None
        self._bright: tuple[Bright, NDArray[np.uint8]] | None = None

    def same(self, other: "Receivers") -> bool:
        """Whether others are at the same points, and ask as much."""
        points, normals = (np.array_equal(getattr(self, name), getattr(other, name)) for name in ("points", "normals"))
        return points and normals and self._rays == other._rays

    def irradiance(self, scene: Scene, tick: Tick = silent) -> Points:
        """(M, 3) W/m^2 from the lamps and the sky of a scene, through its medium."""
        lights, sky, medium = scene.lights, scene.sky, scene.what_absorbs()
        found, parts = np.zeros_like(self.points), len(lights) + 1

        def part(number: int) -> Tick:
            return lambda done: tick((number + done) / parts)

        for number, light in enumerate(lights):
            if light.colour.any():
                found += self._from_lamp(light, part(number))[:, None] * self._left(light, medium) * light.colour
        if sky is not None:
            found += self._from_sky(sky, medium, part(len(lights)))
        wanted = {light.geometry for light in lights}
        self._lamps = {geometry: lamp for geometry, lamp in self._lamps.items() if geometry in wanted}
        self._partly = {geometry: partly for geometry, partly in self._partly.items() if geometry in wanted}
        return found

    def unlike(
        self, scene: Scene, of: NDArray[np.int64], places: Points, normals: Points, rng: np.random.Generator,
        occlusion: Occlusion,
    ) -> tuple[Points, int]:  # fmt: skip
        """How much more (K, 3) lamps send to places (K, 3) with normals (K, 3) than to the particles (K,) there, noisy
        but right on average; and the rays that were traced, to be called by what `run_blocks` runs.
        """
        found, asked = np.zeros_like(places), 0
        for light in scene.lights if scene.what_absorbs().is_clear else ():
            if light.geometry not in self._partly:
                continue
            at = np.flatnonzero(self._partly[light.geometry][of])
            x, n = places[at], normals[at]
            _, passed, rays = sent(light, x, n, rng, occlusion if light.shadows else None)
            there = light.without_cone.unshadowed(x, n) * passed
            found[at] += (there - self._lamps[light.geometry][of[at]])[:, None] * light.colour
            asked += rays
        return found, asked

    def _from_lamp(self, light: Light, tick: Tick) -> NDArray[np.float32]:
        """(M,) irradiance for a power of 1."""
        if light.geometry not in self._lamps:
            if self._patches is None:
                unshadowed = light.unshadowed(self.points, self.normals)
                rows = np.flatnonzero(unshadowed > 0)
                unshadowed[rows] *= self._seen(light, rows, tick)
            else:
                unshadowed = self._unshadowed(light.without_cone)
                shares, partly = self._patches.shares(light, self._shadowed(light, self.points), tick)
                unshadowed *= self._particles.of_points(shares)
                self._partly[light.geometry] = self._particles.of_points(partly)
            self._lamps[light.geometry] = unshadowed.astype(np.float32)
        return self._lamps[light.geometry]

    def _left(self, light: Light, medium: _binding.Medium) -> Points | float:
        """(M, 3) shares that a medium leaves of a lamp's light."""
        if medium.is_clear:
            return 1.0
        found = np.ones_like(self.points)

        def block(rows: slice) -> int:
            shifts = patterns.shifts(np.arange(rows.start, rows.stop))
            pattern = shifts[:, None] if light.is_small else lamp_pattern(light, shifts, WAYS)
            samples = light.samples(self.points[rows], self.normals[rows], pattern)
            weights = samples.weights * samples.cones
            total = weights.sum(axis=1, keepdims=True)
            passed = left(medium, self.points[rows, None], samples.directions, samples.distances)
            mean = np.einsum("mk,mkc->mc", weights, passed)
            found[rows] = np.where(total > 0, mean / np.where(total > 0, total, 1.0), 1.0)
            return 0

        self._run(block, len(self.points), WAYS, silent)
        return found

    def _unshadowed(self, light: Light) -> Points:
        """(M,) irradiance of particles for a power of 1 with nothing in the way, over the patch of each."""
        found, particles = light.unshadowed(self.points, self.normals), self._particles
        if isinstance(light, SunLight):
            return found
        middles = particles.patches.mean(axis=1)
        distances = np.linalg.norm(middles - light.position, axis=1)
        near = np.flatnonzero((distances < NEAR * particles.radii) & particles.whole)
        if len(near):
            pieces = patterns.triangles(particles.patches[near], CUTS)
            rows = near[:, None] * particles.per_patch + np.arange(particles.per_patch)
            normals = np.repeat(self.normals[rows[:, 0]], pieces.shape[1], axis=0)
            over_patches = light.unshadowed(pieces.reshape(-1, 3), normals).reshape(len(near), -1)
            found[rows] = over_patches.mean(axis=1)[:, None]
        return found

    def _seen(self, light: Light, rows: NDArray[np.int64], tick: Tick) -> Points:
        """(R,) the share of a lamp's light that gets to some of the receivers."""
        seen, through = np.ones(len(rows)), np.ones(len(rows))
        shadows = self._shadowed(light, self.points[rows])
        partly, again = np.zeros((2, len(rows)), bool)

        def first(block: slice) -> int:
            samples = self._samples(light, rows[block], _first_pattern)
            lit = samples.weights * samples.cones > 0
            shares, asked = self._traced(rows[block], samples, lit & (shadows and not light.has_narrow_cone))
            most, least = np.where(lit, shares, 0.0).max(axis=1), np.where(lit, shares, 1.0).min(axis=1)
            partly[block] = least < most
            again[block] = partly[block] | light.has_narrow_cone | (np.ptp(samples.cones, axis=1) > 0)
            through[block], seen[block] = most, most * _mean(samples.cones, samples.weights)
            return asked

        def second(block: slice) -> int:
            chosen = np.flatnonzero(again)[block]
            samples = self._samples(light, rows[chosen], lamp_pattern)
            lit = samples.weights * samples.cones > 0
            # A cone that fades over the lamp wants many samples of it, but no more rays.
            traced = (partly[chosen] | light.has_narrow_cone) & shadows
            shares, asked = self._traced(rows[chosen], samples, lit & traced[:, None])
            seen[chosen] = np.where(traced, 1.0, through[chosen]) * _mean(shares * samples.cones, samples.weights)
            return asked

        self._run(first, len(rows), 1 if light.is_small else RIM + INSIDE, tick)
        self._run(second, np.count_nonzero(again), self._rays_to(light), tick)
        return seen

    def _shadowed(self, light: Light, points: Points) -> bool:
        """Whether anything can be between a lamp and points."""
        if not light.shadows or self._occlusion is None or len(points) == 0:
            return False
        planes = Planes(self._occlusion.shading.triangles, self._occlusion.size, points)
        return not planes.nothing_between(*light.extent)

    def _rays_to(self, light: Light) -> int:
        """How many go to a lamp from a penumbra: a narrow cone holds many of them back."""
        return (2 if light.has_narrow_cone else 1) * self._rays

    def _samples(self, light: Light, rows: NDArray[np.int64], pattern: Callable[..., Points]) -> Samples:
        made = pattern(light, patterns.shifts(rows), self._rays_to(light))
        return light.samples(self.points[rows], self.normals[rows], made)

    def _traced(self, rows: NDArray[np.int64], samples: Samples, wanted: NDArray[np.bool_]) -> tuple[Points, int]:
        """(R, K) the share of light that gets through along the wanted directions, and how many rays that took."""
        shares = np.ones(wanted.shape)
        if not wanted.any():
            return shares, 0
        row, k = np.nonzero(wanted)
        at = rows[row]
        shares[row, k] = self._occlusion.transmitted(
            self.points[at], self.normals[at], samples.directions[row, k], samples.distances[row, k]
        )
        return shares, len(row)

    def _from_sky(self, sky: Sky, medium: _binding.Medium, tick: Tick) -> Points:
        found = np.zeros_like(self.points)
        if self._sky is None:
            self._sky = self._open(self._hemisphere, SKY_SHARE * self._rays, tick)

        def smooth(block: slice) -> int:
            seen = self._sky[block] / STEPS
            if sky.is_even and medium.is_clear:
                found[block] += np.pi * seen.mean(axis=1)[:, None] * sky.smooth(np.zeros(3))
            else:
                directions = self._hemisphere(block)
                radiance = sky.smooth(directions) * left(medium, self.points[block, None], directions, np.inf)
                found[block] += np.pi * np.einsum("mk,mkc->mc", seen, radiance) / seen.shape[1]
            return 0

        self._run(smooth, len(self.points), self._sky.shape[1], silent)
        if sky.bright is not None:
            self._add_bright(sky.bright, medium, found, tick)
        return found

    def _add_bright(self, bright: Bright, medium: _binding.Medium, found: Points, tick: Tick) -> None:
        """Adds what the bright parts of a sky bring."""
        if self._bright is None or not self._bright[0].serves(bright):
            seen = self._open(lambda block: self._towards(bright, block)[0], BRIGHT_RAYS, tick)
            self._bright = bright, seen
        aimed, seen = self._bright

        def add(block: slice) -> int:
            directions, pixels = self._towards(aimed, block)
            cosines = np.maximum(np.einsum("mkx,mx->mk", directions, self.normals[block]), 0.0)
            weights = aimed.weights(pixels, bright) * left(medium, self.points[block, None], directions, np.inf)
            found[block] += np.einsum("mk,mkc->mc", cosines * seen[block] / STEPS, weights)
            return 0

        self._run(add, len(self.points), BRIGHT_RAYS, silent)

    def _open(self, directions: Callable[[slice], Points], count: int, tick: Tick) -> NDArray[np.uint8]:
        """(M, count) the share of light that comes along each direction from outside, in `STEPS`."""
        seen = np.full((len(self.points), count), STEPS, np.uint8)
        if self._occlusion is None:
            return seen

        def block(rows: slice) -> int:
            made = directions(rows)
            row, k = np.nonzero(np.einsum("mkx,mx->mk", made, self.normals[rows]) > 0)
            ends = self.points[rows][row], self.normals[rows][row], made[row, k]
            seen[rows][row, k] = np.rint(STEPS * self._occlusion.transmitted(*ends, np.full(len(row), np.inf)))
            return len(row)

        self._run(block, len(self.points), count, tick)
        return seen

    def _hemisphere(self, rows: slice) -> Points:
        """(R, K, 3) directions about the normals of some of the receivers, even by cosine."""
        made = patterns.disc(SKY_SHARE * self._rays, patterns.shifts(np.arange(rows.start, rows.stop)))
        return patterns.around(self.normals[rows], np.sqrt(1 - made[..., 0]), made[..., 1])

    def _towards(self, bright: Bright, rows: slice) -> tuple[Points, NDArray[np.int64]]:
        return bright.directions(patterns.square(BRIGHT_RAYS, patterns.shifts(np.arange(rows.start, rows.stop))))

    def _run(self, work: Callable[[slice], int], count: int, each: int, tick: Tick) -> None:
        """Runs `work` on all rows, where each takes so many rays."""
        run_rows(self._occlusion, work, count, each, tick)


def _first_pattern(light: Light, shifts: Points, _rays: int) -> Points:
    if light.is_small:
        return shifts[:, None]
    if light.is_round:
        return np.concatenate([patterns.disc_rim(RIM, shifts), patterns.disc(INSIDE, shifts)], axis=1)
    return np.concatenate([patterns.square_rim(RIM, shifts), patterns.square(INSIDE, shifts)], axis=1)


def lamp_pattern(light: Light, shifts: Points, rays: int) -> Points:
    """(M, rays, 2) as `samples` of a lamp take it."""
    return (patterns.disc if light.is_round else patterns.square)(rays, shifts)


def _mean(values: Points, weights: Points) -> Points:
    """(R,) weighted means over the columns, 0 where all weights are."""
    sums = weights.sum(axis=1)
    return (values * weights).sum(axis=1) / np.where(sums > 0, sums, 1.0)
