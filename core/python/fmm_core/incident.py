# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that arrives at points, by direction: found by rays, for what one number of irradiance does not tell."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from . import patterns
from .direct_light import lamp_pattern
from .emitters import Emitters
from .lights import Light
from .medium import left
from .progress import Tick, silent
from .scene import Scene
from .transport import Sums
from .visibility import Met

Points = NDArray[np.float64]

#: Rays that are handled together.
RAYS_PER_BLOCK = 1 << 16
#: Rays to emitters, to a lamp and to the bright parts of a sky, for each ray over the hemisphere.
AIMED, TO_LAMP, TO_BRIGHT = 0.5, 0.5, 0.5
#: Shift of the patterns of aimed rays against the others.
OTHER = 0.618


class Response(Protocol):
    """What receivers make of light, by its direction.

    outputs   J, how many numbers of each colour come out
    """

    outputs: int

    def directions(self, rows: slice, shifts: Points, count: int) -> Points:
        """(R, count, 3) unit directions from some of the receivers, more of them where the light counts for more."""

    def density(self, rows: slice, directions: Points, count: int) -> Points:
        """(R, K) per steradian, with which `directions` takes one of its directions, of so many."""

    def total(self, rows: slice, directions: Points, flux: Points) -> Points:
        """(R, J, 3) what comes out for light from directions (R, K, 3), of so many W/m^2 (R, K, 3) on a surface that
        faces each.
        """


class Incident:
    """Light from the particles' radiosity, from lamps and a sky.

    Rays go where the response is, and count with the radiosity of what they meet. Others are aimed at the strong
    emitters; both find the light of these, weighed by the balance heuristic (Veach and Guibas, SIGGRAPH 1995). Lamps
    and bright parts of the sky get rays of their own. Each receiver has its own directions, the same in each call.

    rays   traced so far
    """

    def __init__(self, scene: Scene, sums: Sums, radiosity: Points) -> None:
        """radiosity: (N, 3) of the particles, W/m^2."""
        self._scene, self._particles, self._radiosity = scene, sums.particles, radiosity
        self._occlusion, self._surface = sums.apart(scene)
        self._emitters, self._medium = Emitters(scene, sums.particles), sums.medium

    @property
    def rays(self) -> int:
        return self._occlusion.rays

    def gather(self, points: Points, normals: Points, response: Response, rays: int, tick: Tick = silent) -> Points:
        """(M, J, 3) what a response makes of the light at points with unit normals (M, 3), by so many rays each."""
        found = np.zeros((len(points), response.outputs, 3))
        lights = [light for light in self._scene.lights if light.colour.any()]

        def block(rows: slice) -> int:
            at = _Block(rows, points[rows], normals[rows], response, patterns.shifts(np.arange(rows.start, rows.stop)))
            count = self._by_rays(at, rays, found)
            if len(self._emitters):
                count += self._aimed(at, rays, found)
            for light in lights:
                count += self._from_lamp(at, light, max(1, round(TO_LAMP * rays)), found)
            if self._scene.sky is not None and self._scene.sky.bright is not None:
                count += self._from_bright(at, max(1, round(TO_BRIGHT * rays)), found)
            return count

        self._occlusion.run_blocks(block, len(points), max(1, RAYS_PER_BLOCK // rays), tick)
        return found

    def _by_rays(self, at: "_Block", rays: int, found: Points) -> int:
        directions = at.response.directions(at.rows, at.shifts, rays)
        row, k = np.nonzero(at.above(directions))
        chosen = directions[row, k]
        met = self._occlusion.met(at.points[row], at.normals[row], chosen, self._surface)
        density = rays * at.response.density(at.rows, directions, rays)
        own = density[row, k]
        hit, radiance = met.particles >= 0, np.zeros((len(row), 3))
        passed = left(self._medium, at.points[row], chosen, np.linalg.norm(met.positions - at.points[row], axis=1))
        radiance[hit] = passed[hit] * self._radiosity[met.particles[hit]] / np.pi / own[hit, None]
        lit = np.flatnonzero(self._emitters.density[met.particles] > 0)
        if len(lit):
            other = self._aim_density(at.points[row[lit]], chosen[lit], _of(met, lit), rays)
            emission = self._scene.emission[self._particles.triangle[met.particles[lit]]] / np.pi
            radiance[lit] -= passed[lit] * emission * (other / (own[lit] * (own[lit] + other)))[:, None]
        if self._scene.sky is not None:
            through = (met.triangles < 0).astype(float)
            if self._scene.shade is not None:
                ends = at.points[row], at.normals[row], chosen
                through = self._occlusion.transmitted(*ends, np.full(len(row), np.inf))
            free = through > 0
            passed = left(self._medium, at.points[row[free]], chosen[free], np.inf)
            radiance[free] += (through[free] / own[free])[:, None] * passed * self._scene.sky.smooth(chosen[free])
        flux = np.zeros(directions.shape)
        flux[row, k] = radiance
        at.add(directions, flux, found)
        return len(row)

    def _aimed(self, at: "_Block", rays: int, found: Points) -> int:
        """Adds the light of emitters by rays that are aimed at them."""
        particles, count = self._particles, _aims(rays)
        pattern = patterns.square(count, (at.shifts + OTHER) % 1.0)
        cumulative = self._emitters.cumulative
        number = np.minimum(np.searchsorted(cumulative, pattern[..., 0], side="right"), len(self._emitters) - 1)
        low = np.where(number > 0, cumulative[number - 1], 0.0)
        into = np.clip((pattern[..., 0] - low) / np.maximum(cumulative[number] - low, 1e-30), 0, 1)
        patch = self._emitters.patches[number]
        chosen = patch * particles.per_patch
        root = np.sqrt(into)[..., None]
        a, b, c = np.moveaxis(particles.patches[patch], 2, 0)
        ends = (1 - root) * a + root * ((1 - pattern[..., 1:]) * b + pattern[..., 1:] * c)
        between = ends - at.points[:, None]
        distances = np.maximum(np.linalg.norm(between, axis=2), 1e-30)
        directions = between / distances[..., None]
        leaving = -(directions * particles.normals[chosen]).sum(axis=2)
        row, k = np.nonzero(at.above(directions) & (leaving > 0))
        there = ends[row, k], particles.normals[chosen[row, k]]
        seen = self._occlusion.sees(at.points[row], at.normals[row], *there).astype(float)
        triangles = particles.triangle[chosen[row, k]]
        if self._scene.opacity is not None:
            seen = seen * self._scene.opacity.mean[triangles]
        aim = count * self._emitters.density[chosen[row, k]] * distances[row, k] ** 2 / leaving[row, k]
        total = aim + rays * at.response.density(at.rows, directions, rays)[row, k]
        flux = np.zeros(directions.shape)
        passed = left(self._medium, at.points[row], directions[row, k], distances[row, k])
        flux[row, k] = (seen / total)[:, None] * passed * self._scene.emission[triangles] / np.pi
        at.add(directions, flux, found)
        return len(row)

    def _aim_density(self, points: Points, directions: Points, met: Met, rays: int) -> Points:
        """(K,) per steradian, of all rays that are aimed at emitters, at places met along directions (K, 3)."""
        squared = ((met.positions - points) ** 2).sum(axis=1)
        leaving = np.maximum(-(directions * met.normals).sum(axis=1), 1e-30)
        return _aims(rays) * self._emitters.density[met.particles] * squared / leaving

    def _from_lamp(self, at: "_Block", light: Light, count: int, found: Points) -> int:
        pattern = at.shifts[:, None] if light.is_small else lamp_pattern(light, at.shifts, count)
        irradiance = light.unshadowed(at.points, at.normals)
        samples = light.samples(at.points, at.normals, pattern)
        cosines = np.einsum("mkx,mx->mk", samples.directions, at.normals)
        wanted = (samples.weights * samples.cones > 0) & (irradiance[:, None] > 0) & (cosines > 0)
        row, k = np.nonzero(wanted)
        through = np.ones(len(row))
        if light.shadows:
            ends = at.points[row], at.normals[row], samples.directions[row, k], samples.distances[row, k]
            through = self._occlusion.transmitted(*ends)
        total = samples.weights.sum(axis=1)
        share = irradiance / np.where(total > 0, total, 1.0)
        flux = np.zeros(samples.directions.shape)
        arriving = through * (samples.weights * samples.cones)[row, k] / cosines[row, k] * share[row]
        passed = left(self._medium, at.points[row], samples.directions[row, k], samples.distances[row, k])
        flux[row, k] = arriving[:, None] * passed * light.colour
        at.add(samples.directions, flux, found)
        return len(row) if light.shadows else 0

    def _from_bright(self, at: "_Block", count: int, found: Points) -> int:
        bright = self._scene.sky.bright
        directions, pixels = bright.directions(patterns.square(count, at.shifts))
        row, k = np.nonzero(at.above(directions))
        far = np.full(len(row), np.inf)
        seen = np.zeros(pixels.shape)
        seen[row, k] = self._occlusion.transmitted(at.points[row], at.normals[row], directions[row, k], far)
        passed = left(self._medium, at.points[:, None], directions, np.inf)
        at.add(directions, seen[..., None] * passed * bright.weights(pixels, bright), found)
        return len(row)


class _Block:
    """Some of the receivers."""

    def __init__(self, rows: slice, points: Points, normals: Points, response: Response, shifts: Points) -> None:
        self.rows, self.points, self.normals, self.response, self.shifts = rows, points, normals, response, shifts

    def above(self, directions: Points) -> NDArray[np.bool_]:
        """(R, K) whether directions (R, K, 3) are above the horizon."""
        return np.einsum("mkx,mx->mk", directions, self.normals) > 0

    def add(self, directions: Points, flux: Points, found: Points) -> None:
        """Adds what the response makes of light that brings so many W/m^2 (R, K, 3) from each direction."""
        found[self.rows] += self.response.total(self.rows, directions, flux)


def _aims(rays: int) -> int:
    return max(1, round(AIMED * rays))


def _of(met: Met, rows: NDArray[np.int64]) -> Met:
    return Met(*(part[rows] for part in met))
