# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake did, what it cost and how exact it is."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any

from .effects import Effect
from .scene import Scene
from .settings import Settings

VERSION = 1
PHASES = ("export", "tree", "lists", "visibility", "transport", "evaluate", "accuracy", "write")
COUNTS = (
    "triangles",
    "particles",
    "channels",
    "output_points",
    "boxes",
    "leaves",
    "pairs_valid",
    "pairs_partial",
    "pairs_invalid",
    "rays",
    "directed_rays",
    "tables",
)

#: What `accuracy.measure` finds.
ERROR = ("measured_rms", "low", "high", "measured_max", "gathered", "probes", "rays", "bound")


def unmeasured() -> dict[str, Any]:
    """An error of which nothing is known."""
    return dict.fromkeys(ERROR) | {"probes": 0, "rays": 0}


class Report:
    """Collects counts, seconds, residuals and warnings while a scene is solved and baked."""

    def __init__(self, settings: Settings, scene: Scene, effects: dict[str, Effect]) -> None:
        self.settings, self.effects = settings, effects
        self.counts = dict.fromkeys(COUNTS, 0)
        self.seconds = dict.fromkeys(PHASES, 0.0)
        self.residuals: list[float] = []
        self.error = unmeasured()
        self.postponement: float | None = None
        #: Rays that other solutions of the same scene had traced before.
        self.traced = 0
        #: Whether anything that rays had found was kept from an earlier solve.
        self.kept = False
        #: What was tried to meet the target error, one after the other; see `Solution.irradiance`.
        self.rounds: list[dict[str, Any]] = []
        self.warnings = list(scene.warnings)

    @contextmanager
    def time(self, phase: str) -> Iterator[None]:
        """Adds the seconds spent inside to `phase`, one of `PHASES`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[phase] += time.perf_counter() - start

    def stopped_short(self, steps: int, remaining: float) -> None:
        """Warns of an iteration that ended before such a share of all light was found."""
        share = 100 * remaining
        self.warnings.append(f"iteration stopped after {steps} steps with {share:.2g} % of the light still to come")

    def follow(self, earlier: dict[str, Any]) -> None:
        """Adds the seconds, rays and rounds of an earlier report of the same bake."""
        for phase in PHASES:
            self.seconds[phase] += earlier["seconds"][phase]
        self.traced -= earlier["counts"]["rays"]
        self.rounds = [*earlier["rounds"], *self.rounds]

    def as_dict(self) -> dict[str, Any]:
        """Plain values, ready for json."""
        return {
            "version": VERSION,
            "settings": asdict(self.settings),
            "effects": {name: asdict(effect) for name, effect in self.effects.items()},
            "counts": dict(self.counts),
            "postponement": self.postponement,
            "visibility_kept": self.kept,
            "seconds": {**self.seconds, "total": sum(self.seconds.values())},
            "peak_memory_mib": peak_memory_mib(),
            "residuals": list(self.residuals),
            "error": dict(self.error),
            "rounds": [dict(round) for round in self.rounds],
            "warnings": list(self.warnings),
        }


def peak_memory_mib() -> float | None:
    """Largest resident size of this process so far, MiB; None on Windows, which has no such figure in Python."""
    try:
        import resource
    except ImportError:
        return None
    import sys

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1 << 20) if sys.platform == "darwin" else peak / (1 << 10)
