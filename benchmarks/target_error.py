# SPDX-License-Identifier: GPL-3.0-or-later
"""Does a bake meet its target error? In rooms, clutter, among balls and in the examples, at vertices or random points.

uv run python benchmarks/target_error.py [--json FILE] [--only NAME ...] [--targets E ...]

All settings but the target are left open. The true error is found as in measured_error.py; `over` is true over target,
of which 1.2 is the bar.
"""

import time
from collections.abc import Sequence
from typing import Any

from common import Array, Row, parser, print_table, write_json
from fmm_core import Scene, Settings, solve_at
from measured_error import CASES, FEW, true_error, truth

TARGETS = (0.05, 0.02, 0.01, 0.005)
#: The bar for the true error over the target.
BAR = 1.2
#: The scenes of `measured_error.py`, without the settings that some have there.
SCENES = {case.name.split(", ")[0]: case.make for case in CASES}
COLUMNS = {
    "name": ("scene", "s"),
    "target": ("target", ".3f"),
    "true": ("true", ".4f"),
    "over": ("over", ".2f"),
    "measured_rms": ("measured", ".4f"),
    "high": ("high", ".4f"),
    "seconds": ("seconds", ".2f"),
    "truncation": ("p", "d"),
    "rays": ("rays", "d"),
    "particles": ("particles", "d"),
    "rounds": ("rounds", "d"),
    "warnings": ("warnings", "s"),
}


def run(name: str, targets: Sequence[float], effort: float) -> list[Row]:
    """A bake to each target, judged by a share of all rays."""
    scene, points = SCENES[name]()
    exact = truth(scene, points, effort)
    return [bake(name, target, scene, points, exact) for target in targets]


def bake(name: str, target: float, scene: Scene, points: tuple[Array, Array], exact: Any) -> Row:
    start = time.perf_counter()
    solution, found = solve_at(scene, Settings(target_error=target), *points)
    seconds = time.perf_counter() - start
    report = solution.report
    true = true_error(found, exact)
    chosen = {name: report["settings"][name] for name in ("truncation", "rays")}
    error = {name: report["error"][name] for name in ("measured_rms", "low", "high", "gathered")}
    return {
        "name": name,
        "target": target,
        "true": true,
        "over": true / target,
        **error,
        "seconds": seconds,
        **chosen,
        "particles": report["counts"]["particles"],
        "rounds": len(report["rounds"]),
        "warnings": "; ".join(report["warnings"]),
    }


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--only", nargs="+", choices=SCENES, help="some of the scenes")
    options.add_argument("--targets", nargs="+", type=float, default=TARGETS)
    arguments = options.parse_args()
    effort = FEW if arguments.small else 1.0
    names = ["room"] if arguments.small else arguments.only or SCENES
    rows = [row for name in names for row in run(name, arguments.targets, effort)]
    print_table(rows, COLUMNS)
    print(f"{sum(row['over'] <= BAR for row in rows)} of {len(rows)} within {BAR} times the target")
    write_json(arguments.json, rows)


if __name__ == "__main__":
    main()
