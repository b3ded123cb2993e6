# SPDX-License-Identifier: GPL-3.0-or-later
"""The solved scene: irradiance anywhere, and the report."""

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .accuracy import PROBE_RAYS, Judge, Solved, measure
from .arrays import finite_rows, unit_rows
from .direct_light import LIGHTING, Receivers
from .effects import plan, planned
from .errors import Error, memory_errors
from .exchange import Exchange
from .fit import Sight, VertexFit
from .gloss import Gloss, Shine
from .harmonics import Tilted
from .incident import Incident
from .kept import KeptVisibility
from .lights import Light
from .moving import precedes
from .multipole import MultipoleSpace
from .particles import Particles, serve
from .progress import Progress, Tick, silent, ticker
from .report import Report, unmeasured
from .scene import Scene
from .settings import Settings
from .sky import Sky
from .transport import Space

Points = NDArray[np.float64]

#: What is going on, for whoever waits.
DIRECTING, SHINING = "Finding where light comes from", "Finding gloss"


class Solution:
    """Solved radiosity of a scene.

    scene, settings   what was asked for and how
    used              the settings with nothing left open
    radiosity         (N, 3) at the particles, W/m^2
    kept              the kept visibility that `solve` was given, or None
    """

    def __init__(
        self,
        scene: Scene,
        planned: Scene,
        settings: Settings,
        used: Settings,
        exchange: Exchange,
        radiosity: NDArray[np.float64],
        report: Report,
        kept: KeptVisibility | None,
        first: Scene,
    ) -> None:
        """planned: what is left of the scene by the plan; first: the scene whose lights the particles were made for."""
        self.scene, self.settings, self.used = scene, settings, used
        # (N, C), as it was solved.
        self._radiosity = radiosity
        self.radiosity = radiosity if radiosity.shape[1] == 3 else np.repeat(radiosity, 3, axis=1)
        self.kept = kept
        self._planned, self._first = planned, first
        self._exchange, self._space, self._report, self._relit = exchange, exchange.space, report, False
        # The points that were asked for last, under lamps and sky.
        self._lit_points: Receivers | None = None

    def irradiance(
        self, points: ArrayLike, normals: ArrayLike, progress: Progress | None = None, effort: float = 1.0
    ) -> NDArray[np.float64]:
        """Irradiance (M, 3) in W/m^2 at points (M, 3) with normals (M, 3), which are made unit length.

        effort: the share of the rays that the settings give each point, where several points are averaged afterwards.

        A point on an edge lies on several surfaces and may be blocked by any of them: step it inside first. Where the
        plan leaves occlusion out, as nothing stands between the surfaces, nothing blocks points off them either.
        progress(fraction, text) as in `solve`. Raises `Error` naming the row on a shape or value that is wrong.
        """
        points, normals = self._receivers(points, normals)
        with memory_errors(), self._report.time("evaluate"):
            irradiance = np.zeros_like(points)
            if self.radiosity.any():
                tick = ticker(progress, 0.0, 0.7, "Gathering light")
                irradiance = irradiance + self._space.gather(points, normals, self._radiosity, tick, effort)
            irradiance += self._direct(points, normals, effort, ticker(progress, 0.7, 0.8, LIGHTING))
        self._report.counts["output_points"] = len(points)
        # Once a solve, and not where it shall trace no ray.
        if self.used.probes > 0 and len(points) > 0 and not self._relit and not self._report.error["probes"]:
            tick = ticker(progress, 0.8, 1.0, "Measuring the error")
            with memory_errors(), self._report.time("accuracy"):
                self._report.error = self._measured(irradiance, points, normals, tick)
            if self.used.target_error is not None:
                self._report.rounds.append(self._round())
        # Expansions and corrections may leave a little less than nothing in the dark.
        irradiance = np.maximum(irradiance, 0.0)
        self._report.counts["rays"] = self._space.sums.rays - self._report.traced
        self._report.kept |= self._space.sums.replayed > 0
        return irradiance

    @property
    def space(self) -> Space:
        """What makes its sums."""
        return self._space

    @property
    def received(self) -> NDArray[np.float64]:
        """Irradiance (N, 3) of the particles as the iteration has it, W/m^2.

        Times their weights it keeps the energy; `irradiance` at their points does as far as points stand for areas.
        """
        with memory_errors():
            return self._exchange.received(self._planned, self._radiosity, self._report)

    def sight(self, fit: VertexFit) -> Sight:
        """What other objects do to the samples of a fit; asked once for the same samples, also after `relight`."""
        with memory_errors(), self._report.time("evaluate"):
            origin = self.scene.origin
            found = self._space.sums.sight(fit.points - origin, fit.normals, fit.corners - origin)
        self._report.counts["rays"] = self._space.sums.rays - self._report.traced
        return found

    def harmonics(self, points: ArrayLike, normals: ArrayLike, progress: Progress | None = None) -> Points:
        """Four spherical harmonics (M, 4, 3) of the light at points (M, 3) with normals (M, 3), see `harmonics.py`.

        They are found by rays, also where nothing is in the way and after `relight`; `matched` gives them the
        irradiance that was found otherwise. progress as in `solve`. Raises `Error` as `irradiance`.
        """
        points, normals = self._receivers(points, normals)
        with memory_errors(), self._report.time("evaluate"):
            incident = Incident(self._planned, self._space.sums, self.radiosity)
            tick = ticker(progress, 0.0, 1.0, DIRECTING)
            found = incident.gather(points, normals, Tilted(normals), self.used.rays, tick)
        self._report.counts["directed_rays"] += incident.rays
        return found

    def radiance(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        gloss: Gloss,
        irradiance: Points,
        progress: Progress | None = None,
    ) -> Points:
        """Radiance (M, 3) in W/(m^2 sr) that points (M, 3) with normals (M, 3) send towards an eye, reflected only.

        gloss: how they reflect; irradiance (M, 3) is what was found there, for their diffuse part. What is glossy is
        found by rays. Where the plan leaves gloss out, all of it is diffuse. Surfaces that the eye sees in others are
        diffuse. progress as in `solve`. Raises `Error` as `irradiance`.
        """
        points, normals = self._receivers(points, normals)
        if not len(points) == len(gloss.towards) == len(irradiance):
            raise Error(f"gloss: expected {len(points)} rows like points, got {len(gloss.towards)}")
        found = gloss.colour * irradiance / math.pi
        if not self._planned.glossy:
            return found
        tick = ticker(progress, 0.0, 1.0, SHINING)
        with memory_errors(), self._report.time("evaluate"):
            incident = Incident(self._planned, self._space.sums, self.radiosity)
            shines = np.flatnonzero(gloss.shines(normals))
            done, shining = 0, gloss.of(shines)
            for rows, table in shining.by_table():
                at, seen = shines[rows], shining.of(rows)
                share = len(rows) / len(shines)
                lobes = incident.gather(
                    points[at], normals[at], Shine(table, seen.towards, normals[at]), self.used.rays,
                    lambda part, done=done, share=share: tick(done + share * part),
                )  # fmt: skip
                done += share
                found[at] = seen.radiance(table, normals[at], irradiance[at], lobes)
                self._report.counts["tables"] += 1
        self._report.counts["directed_rays"] += incident.rays
        return found

    def apart(self) -> "Solution":
        """The same, to be asked at other points: keeps no rays, and leaves what `relight` finds again alone."""
        other, space = copy(self), copy(self._space)
        space.sums = copy(space.sums)
        if space.sums.occlusion is not None:
            space.sums.occlusion = space.sums.occlusion.apart()
        other._space, other._lit_points, other._relit = space, None, True
        other._report = Report(self.used, self._planned, self._report.effects)
        return other

    def _receivers(self, points: ArrayLike, normals: ArrayLike) -> tuple[Points, Points]:
        """Points and normals (M, 3), checked, where the scene was solved."""
        points, normals = finite_rows("points", points), unit_rows("normals", normals)
        if len(points) != len(normals):
            raise Error(f"normals: expected {len(points)} rows like points, got {len(normals)}")
        return points - self.scene.origin, normals

    def _direct(
        self, points: NDArray[np.float64], normals: NDArray[np.float64], effort: float, tick: Tick
    ) -> NDArray[np.float64]:
        """Irradiance (M, 3) from lamps and sky."""
        asked = Receivers(points, normals, self._space.sums.occlusion, effort * self.used.rays)
        if self._lit_points is None or not self._lit_points.same(asked):
            self._lit_points = asked
        return self._lit_points.irradiance(self._planned, tick)

    def estimates(
        self, points: ArrayLike, normals: ArrayLike, rays: int, samples: int, tick: Tick = silent
    ) -> NDArray[np.float64]:
        """Two independent estimates (2, M, 3) of the irradiance at points with normals (M, 3), W/m^2: noisy, but
        right on average whatever this solution lacks, by so many rays for each point, and from all surfaces together.
        """
        points, normals = self._receivers(points, normals)
        with memory_errors():
            judge = Judge(self._solved(rays))
            judge.find_missing(samples, tick)
            gathered, further = judge.light(points, normals, judge.missing(), rays, tick)
        return gathered + further

    def _measured(self, irradiance: NDArray[np.float64], points: Points, normals: Points, tick: Tick) -> dict[str, Any]:
        seconds = self._report.seconds
        application = seconds["transport"] / max(1, len(self._report.residuals))
        spent = sum(seconds.values()), application
        return measure(irradiance, points, normals, self._solved(PROBE_RAYS), self.used, spent, tick)

    def _solved(self, rays: int) -> Solved:
        """What is measured; rays: to lamps and sky from each point."""

        def lamps(points: Points, normals: Points) -> Points:
            return Receivers(points, normals, self._space.sums.occlusion, rays).irradiance(self._planned)

        direct = self._exchange.direct(self._planned)
        parts = self._exchange.operator, self.radiosity, self._exchange.lit, direct, lamps
        return Solved(self._planned, self._space, *parts)

    def _round(self) -> dict[str, Any]:
        return {
            "method": "direct" if self.grouping is None else "fmm",
            "truncation": self.used.truncation,
            "grouping": self.grouping,
            "particles": self._report.counts["particles"],
            "rays": self.used.rays,
            "seconds": sum(self._report.seconds.values()),
            **{name: self._report.error[name] for name in ("measured_rms", "low", "high", "gathered")},
        }

    def use(self, used: Settings) -> None:
        """Gathers with other settings from now on, and measures the error again."""
        self.used = self._report.settings = used
        self._exchange.use(used)
        self._report.error = unmeasured()

    def follow(self, report: dict[str, Any]) -> None:
        """Takes over what an earlier solve of the same bake cost and tried, as its report has it."""
        self._report.follow(report)

    def warn(self, text: str) -> None:
        """Adds a warning to the report."""
        self._report.warnings.append(text)

    def serves(self, scene: Scene) -> bool:
        """Whether `relight` with the lights and albedo of a scene does what a new solve of it would do.

        It does not where the triangles are others, where others of them emit or stand out as lamps, or where triangles
        that share a particle no longer have one albedo.
        """
        scene = scene.near_origin()
        if self.space.order is not None and len(scene.triangles) == len(self.space.order):
            scene = scene.only(self.space.order)
        return self.scene.same_geometry(scene) and serve(self.particles, self._first, scene)

    def precedes(self, scene: Scene) -> bool:
        """Whether `solve` makes use of this solution where it comes before the scene, as that of the frame before."""
        return precedes(self, scene.near_origin())

    def relight(
        self,
        emission: ArrayLike | None = None,
        albedo: ArrayLike | None = None,
        lights: Sequence[Light] | None = None,
        sky: Sky | None = None,
        progress: Progress | None = None,
        glossy: int | None = None,
    ) -> "Solution":
        """The same triangles solved with other light or albedo, without a new ray; also at the points asked last.

        emission, albedo, lights, sky, glossy   as `Scene` takes them, for the same triangles; None keeps what there is.
        A surface that did not emit at first is given as many rays as others that do not, of which a warning tells: see
        `serves`. Lamps in new places, a first sky, and one with bright parts elsewhere take rays of their own.
        progress as in `solve`. Raises `Error` naming the array, the row and the value.
        """
        scene = self.scene.relit(emission, albedo, lights, sky, glossy)
        effects = plan(scene, self.settings)
        left = planned(scene, effects)
        report = Report(self.used, left, effects)
        if not serve(self.particles, self._first, left):
            report.warnings.append(
                "relight: other triangles emit, or some that share a particle differ now; a new solve is more exact"
            )
        report.counts.update(self._report.counts, rays=0, output_points=0, directed_rays=0, tables=0)
        report.kept = True
        report.postponement, report.traced = self._report.postponement, self._space.sums.rays
        with memory_errors():
            blocked = effects["occlusion"].used and self._exchange.block(left, self.kept)
            radiosity = self._exchange.radiosity(left, report, progress)
        report.counts["rays"] = self._space.sums.rays - report.traced
        parts = self._exchange, radiosity, report
        solution = Solution(scene, left, self.settings, self.used, *parts, self.kept, self._first)
        solution._lit_points, solution._relit = None if blocked else self._lit_points, True
        return solution

    @property
    def grouping(self) -> int | None:
        """The particles s in a leaf of the octree, as it was chosen; None in the direct method."""
        return self._space.grouping if isinstance(self._space, MultipoleSpace) else None

    @property
    def particles(self) -> Particles:
        """The quadrature points that carry the radiosity."""
        particles, origin = self._space.sums.particles, self.scene.origin
        if not origin.any():
            return particles
        return replace(particles, positions=particles.positions + origin, patches=particles.patches + origin)

    @property
    def report(self) -> dict[str, Any]:
        """The report of this solve, version 1, as plain values that json can write."""
        return self._report.as_dict()
