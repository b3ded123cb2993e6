# SPDX-License-Identifier: GPL-3.0-or-later
"""From a scene to its solution: particles, visibility, iteration."""

from dataclasses import replace
from functools import reduce

from .balance import is_watertight
from .cutting import bisected
from .direct import DirectSpace
from .effects import plan, planned
from .errors import Error, memory_errors
from .exchange import Exchange
from .kept import KeptVisibility
from .moving import next_frame
from .multipole import MultipoleSpace
from .particles import Particles, make_particles, serve
from .progress import Progress
from .report import Report
from .scene import Scene
from .settings import Settings
from .solution import Solution
from .spots import cut_by_spots
from .transport import Sums
from .visibility import Occlusion

#: Quadrature points that a scene of few triangles is cut into when the user leaves the number open.
AUTOMATIC_PARTICLES = 1200
#: And one of many.
MOST_AUTOMATIC = 20_000
#: Particles up to which the direct method is chosen where the user leaves it open.
FEW_PARTICLES = 5000


def solve(
    scene: Scene,
    settings: Settings | None = None,
    progress: Progress | None = None,
    kept: KeptVisibility | None = None,
    before: Solution | None = None,
) -> Solution:
    """Solves the radiosity equation B = E + albedo * (direct + irradiance(B)) (eq 1) for a scene.

    direct is what lamps and sky send.

    progress(fraction, text) is called now and then; a false answer other than None cancels, which raises `Cancelled`.
    kept: what rays found in earlier solves of these triangles, which is not traced again; what is traced is added.
    Where it is of no use, a warning of the report says why.
    before: the solution of an earlier frame, solved with the same settings. Where only a few things have moved since,
    and lamps, the rays of all others are kept, see `moving.py`; it takes rays to ask that solution again afterwards.
    Raises `Error` on bad input or when memory does not suffice.
    """
    settings = Settings() if settings is None else settings
    if not isinstance(scene, Scene) or not isinstance(settings, Settings):
        raise Error(f"solve: expected a Scene and Settings, got {type(scene).__name__} and {type(settings).__name__}")
    if not isinstance(kept, KeptVisibility | None):
        raise Error(f"kept: expected KeptVisibility or None, got {type(kept).__name__}")
    if not isinstance(before, Solution | None):
        raise Error(f"before: expected Solution or None, got {type(before).__name__}")
    if before is not None and kept is None and before.settings == settings and before.precedes(scene):
        with memory_errors():
            moved = _moved(before, scene.near_origin(), progress)
        if moved is not None:
            return moved
    return solve_with(scene, settings, settings.begin(), progress, kept)


def solve_with(
    scene: Scene, asked: Settings, used: Settings, progress: Progress | None, kept: KeptVisibility | None
) -> Solution:
    """The same with settings that leave nothing open, in place of those that were asked for."""
    with memory_errors():
        return _solve(scene.near_origin(), asked, used, progress, kept)


def _solve(
    whole: Scene, asked: Settings, settings: Settings, progress: Progress | None, kept: KeptVisibility | None
) -> Solution:
    effects = plan(whole, settings)
    scene = planned(whole, effects)
    report = Report(settings, scene, effects)
    if scene.absorbs and settings.visibility == "cells":
        raise Error("visibility: 'cells' cannot be used where something absorbs light on its way")
    if kept is not None:
        report.warnings += kept.take(scene)
    triangles = len(scene.triangles)
    with report.time("visibility"):
        # Through what absorbs light is found by rays, which know how far it comes.
        occlusion = Occlusion(scene, kept) if effects["occlusion"].used or scene.absorbs else None
    with report.time("tree"):
        count = settings.particles or min(max(AUTOMATIC_PARTICLES, triangles), MOST_AUTOMATIC)
        degree = settings.quadrature or (2 if triangles < count else 1)
        first = scene if kept is None else kept.first(scene)
        multipole = settings.method != "direct" and not _few(first, settings, count, degree)
        buried = occlusion.buried if occlusion and multipole and settings.visibility == "rays" else None
        particles = make_particles(first, count, degree, buried)
        if kept is not None and not serve(particles, first, scene):
            first, particles = scene, make_particles(scene, count, degree, buried)
            report.warnings += kept.remake(scene)
        if occlusion is not None:
            particles = _cut_by_spots(scene, particles, occlusion, settings.rays, kept)
    report.counts.update(triangles=triangles, particles=len(particles))
    single = 6.0 if multipole and occlusion else 12.0
    room = None
    if occlusion is None and settings.effects.get("occlusion") is not False:
        room = scene.opacity is None and is_watertight(scene.triangles)
    near_reach = settings.near_reach or (single if degree == 1 else 4.0)
    sums = Sums(particles, occlusion, near_reach, room, scene.what_absorbs())
    exchange = Exchange(MultipoleSpace(sums, settings) if multipole else DirectSpace(sums), settings)
    radiosity = exchange.radiosity(scene, report, progress)
    report.counts["rays"], report.kept = sums.rays, sums.replayed > 0
    used = replace(settings, particles=count)
    return Solution(whole, scene, asked, used, exchange, radiosity, report, kept, first)


def _cut_by_spots(
    scene: Scene, particles: Particles, occlusion: Occlusion, rays: float, kept: KeptVisibility | None
) -> Particles:
    """The particles with patches cut by bright spots, as they were where that is kept."""
    if kept is not None and kept.cuts is not None:
        return reduce(bisected, kept.cuts, particles)
    particles, cuts = cut_by_spots(scene, particles, occlusion, rays)
    if kept is not None:
        kept.cuts = cuts
    return particles


def _moved(before: Solution, scene: Scene, progress: Progress | None) -> Solution | None:
    """The next frame after a solution that precedes the scene, None where that is no use."""
    settings, effects = before.used, plan(scene, before.used)
    report = Report(settings, scene, effects)
    with report.time("tree"):
        found = next_frame(before, scene)
        if found is None:
            return None
        whole, space = found
    left = planned(whole, effects)
    report.counts.update(triangles=len(scene.triangles), particles=len(space.sums.particles))
    exchange = Exchange(space, settings)
    radiosity = exchange.radiosity(left, report, progress)
    report.counts["rays"], report.kept = space.sums.rays, True
    return Solution(whole, left, before.settings, settings, exchange, radiosity, report, None, left)


def _few(scene: Scene, settings: Settings, count: int, degree: int) -> bool:
    """Whether the direct method is chosen where the settings leave the method open."""
    # It goes through the meshes that absorb for each pair, again and again.
    if settings.method is not None or settings.visibility == "cells" or scene.volumes:
        return False
    least = max(count, len(scene.triangles))
    # Strong emitters and contacts are cut finer than was asked for.
    return least <= FEW_PARTICLES and len(make_particles(scene, count, degree)) <= FEW_PARTICLES
