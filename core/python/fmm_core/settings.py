# SPDX-License-Identifier: GPL-3.0-or-later
"""What the user may choose about a solve."""

import math
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from numbers import Integral, Real

from .errors import Error

#: What a scene may call for, in the order in which it is shown; `effects.py` decides about them.
EFFECTS = ("occlusion", "interreflection", "colour", "lamps", "sky", "transparency", "two_sided", "glossy", "medium")
METHODS = ("direct", "fmm")
ITERATIONS = ("krylov", "shooting")
EXPANSIONS = ("whole", "paper", "compressed")
#: Setting up the compressed expansion takes p^9 steps.
MAX_COMPRESSED = 8
VISIBILITIES = ("rays", "cells")
#: Order of the expansions and rays of a receiver where the settings leave them open.
TRUNCATION, RAYS = 4, 200
#: Random points that tell the error, at most.
PROBES = 1000
#: The error of the default rays in rooms of all kinds, and the power of the rays by which errors fall.
USUAL_ERROR, POWER = 0.006, 2 / 3
#: Least and most rays that a target error asks for, and truncations for targets from so large on.
LEAST_RAYS, MOST_RAYS = 20, 20_000
TRUNCATIONS = ((0.03, 2), (0.015, 3), (0.0075, 4), (0.003, 5), (0.0, 6))


@dataclass(frozen=True)
class Settings:
    """Settings of a solve; a wrong value raises `Error` naming the option and the value.

    truncation      order p at which expansions are cut, 0 to 20 (section 2.2 of the paper); None: 4, or what the target
                    error asks for
    grouping        at most s particles in a leaf of the octree, 1 or more (section 4, step 1), or None to choose s
                    by the number of particles, and where there are no shadows by the cost model
    target_error    wanted relative error of the irradiance at the points asked for first, between 0 and 1, or None. It
                    chooses truncation, rays and particles as far as they are None, and raises them until the measured
                    error meets it
    method          "fmm": the fast multipole method; "direct": every particle with every other one, the reference;
                    None: direct where there are few particles, which takes no longer there
    visibility      "rays": shadows; "cells": the paper's own algorithm, of the fast multipole method only, with shadows
                    as coarse as the leaves of the octree
    rays            about how many rays the fast multipole method traces from each receiver; the error falls with their
                    number. The direct method traces one for each pair. None: 200, or what the target error asks for
    expansion       "whole": the kernel as one tensor; "compressed": the same in fewer numbers, which take longer to set
                    up at high p; "paper": eq 4 to 11; None: compressed up to p = 6, whole above
    separation      boxes up to k boxes apart count as near (section 7 of the paper)
    level           depth of a non-adaptive octree, or None for the adaptive one, which follows the grouping
    particles       about how many quadrature points the scene is cut into, or None to choose from the scene;
                    never fewer than one a triangle in the direct method; elsewhere one may stand for
                    neighbours, over at most a tenth of their mesh
    quadrature      degree of the Gaussian rule on each patch: 1, 2, 4 or 5 (1, 3, 6 or 7 points), or None to choose
                    2 where there are fewer triangles than particles asked for and 1 elsewhere
    near_reach      patches closer than so many of their radii, at least 2, count with their exact form factor; None:
                    4, or 12 where they carry a single point, for errors of less than 0.1 %, but 6 with shadows in the
                    fast multipole method, which has larger errors and pays for reach in rays
    iteration       "krylov": GMRES; "shooting": that of the paper (section 4), slower where surfaces are bright
    tolerance       iteration ends when the unshot part of the light is below this share
    max_iterations  and at the latest after this many applications of the operator
    effects         which of `EFFECTS` to simulate whatever the scene says, True, or to leave out, False, by name;
                    without occlusion all that is in front of the horizon is seen, as it is in a convex room
    probes          random points whose irradiance is also found by rays, to measure the error: so many where the bake
                    takes long enough, and no fewer than 300 of them elsewhere; 0 for none. A target error takes 1,000
                    or more in any case, and as many rays as it wants
    """

    truncation: int | None = None
    grouping: int | None = None
    target_error: float | None = None
    method: str | None = None
    visibility: str = "rays"
    rays: int | None = None
    expansion: str | None = None
    separation: int = 1
    level: int | None = None
    particles: int | None = None
    quadrature: int | None = None
    near_reach: float | None = None
    iteration: str = "krylov"
    tolerance: float = 1e-4
    max_iterations: int = 1000
    probes: int = PROBES
    effects: Mapping[str, bool] = field(default_factory=dict)

    @property
    def expansion_in_use(self) -> str:
        """The expansion, chosen by p where it was left open."""
        return self.expansion or ("compressed" if (self.truncation or 0) <= 6 else "whole")

    def begin(self) -> "Settings":
        """The same with what is left open filled in, by the target error if there is one; see `target.solve_at`."""
        truncation, rays, probes = TRUNCATION, RAYS, self.probes
        if self.target_error is not None:
            truncation = next(p for least, p in TRUNCATIONS if self.target_error >= least)
            rays = round(RAYS * (USUAL_ERROR / self.target_error) ** (1 / POWER))
            rays, probes = min(MOST_RAYS, max(LEAST_RAYS, rays)), max(probes, PROBES)
        return replace(
            self,
            truncation=truncation if self.truncation is None else self.truncation,
            rays=rays if self.rays is None else self.rays,
            probes=probes,
        )

    def __post_init__(self) -> None:
        self._check_integer("separation", 1, 8)
        self._check_integer("probes", 0, 1 << 20)
        self._check_integer("max_iterations", 1, 1 << 20)
        self._check_real("tolerance", 1e-12, 0.5)
        self._check_choice("method", (None, *METHODS))
        self._check_choice("visibility", VISIBILITIES)
        self._check_choice("iteration", ITERATIONS)
        if self.visibility == "cells" and self.method == "direct":
            raise Error("visibility: 'cells' is for the method 'fmm', got 'direct'")
        self._check_effects()
        self._check_choice("expansion", (None, *EXPANSIONS))
        if self.near_reach is not None:
            self._check_real("near_reach", 2.0, 1e3)
        if self.target_error is not None:
            self._check_real("target_error", 1e-6, 1.0)
        optional = {
            "truncation": (0, 20),
            "grouping": (1, 1 << 20),
            "rays": (10, 100_000),
            "level": (0, 8),
            "particles": (1, 1 << 31),
        }
        for name, (low, high) in optional.items():
            if getattr(self, name) is not None:
                self._check_integer(name, low, high)
        if not isinstance(self.quadrature, Integral | None) or self.quadrature not in (None, 1, 2, 4, 5):
            raise Error(f"quadrature: expected 1, 2, 4 or 5, got {_shown(self.quadrature)}")
        if self.expansion == "compressed" and (self.truncation or 0) > MAX_COMPRESSED:
            raise Error(f"truncation: the compressed expansion goes up to {MAX_COMPRESSED}, got {self.truncation}")

    def _check_effects(self) -> None:
        if not isinstance(self.effects, Mapping):
            raise Error(f"effects: expected names with True or False, got {_shown(self.effects)}")
        for name, wanted in self.effects.items():
            if name not in EFFECTS:
                raise Error(f"effects: expected one of {', '.join(EFFECTS)}, got {_shown(name)}")
            if not isinstance(wanted, bool):
                raise Error(f"effects: expected True or False for {name}, got {_shown(wanted)}")

    def _check_integer(self, name: str, low: int, high: int) -> None:
        value = getattr(self, name)
        if not isinstance(value, Integral) or isinstance(value, bool) or not low <= value <= high:
            raise Error(f"{name}: expected a whole number from {low} to {high}, got {_shown(value)}")

    def _check_choice(self, name: str, choices: tuple[str | None, ...]) -> None:
        value = getattr(self, name)
        if not isinstance(value, str | None) or value not in choices:
            raise Error(f"{name}: expected one of {', '.join(map(str, choices))}, got {_shown(value)}")

    def _check_real(self, name: str, low: float, high: float) -> None:
        value = getattr(self, name)
        if not isinstance(value, Real) or not math.isfinite(value) or not low <= value <= high:
            raise Error(f"{name}: expected a number from {low:g} to {high:g}, got {_shown(value)}")


def _shown(value: object) -> str:
    """A value in one line that is not too long."""
    return textwrap.shorten(repr(value), 80)
