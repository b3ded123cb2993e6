# SPDX-License-Identifier: GPL-3.0-or-later
"""Error against truncation p for the three expansions, and error against time (figure 11 of the paper).

The scene is the unoccluded Cornell room (common.cornell_room) with about 20,000 particles, which are sources and
receivers; the errors are against the direct sum at all of them. All expansions work on the same octree and lists, so
that only they differ. Seconds are those of one application, the best of several; the setup beside it is the first, in
which the expansion's own tables are made.
"""

from pathlib import Path

import matplotlib as mpl
from common import (
    Array,
    Cloud,
    Row,
    best,
    brute_force,
    cornell_room,
    errors,
    multipole,
    parser,
    print_machine,
    print_table,
    write_json,
)

mpl.use("Agg")
import matplotlib.pyplot as plt

#: Greatest p of each expansion: beyond, a row takes longer than it is worth.
TRUNCATIONS = {"paper": 8, "whole": 10, "compressed": 8}
SMALL_TRUNCATION = 2
PARTICLES, SMALL_PARTICLES = 20_000, 1_000
#: Particles in a leaf, the same for all.
GROUPING = 64
#: Seconds that differ by less than this factor are level: the clock tells no more.
LEVEL_WITHIN = 1.1
LEVELS = (0.05, 0.01, 0.001, 0.0001)
COLUMNS = {
    "expansion": ("expansion", "s"),
    "truncation": ("p", "d"),
    "coefficients": ("coefficients", "d"),
    "mean_relative": ("mean error", ".2e"),
    "relative_l2": ("L2 error", ".2e"),
    "setup": ("setup s", ".3g"),
    "application": ("application s", ".3g"),
    "far": ("of it far field", ".3g"),
}


def measured(cloud: Cloud, exact: Array, expansion: str, truncation: int) -> Row:
    """One expansion at one p."""
    setup = multipole(cloud, truncation, expansion, GROUPING).setup
    run = best(lambda: multipole(cloud, truncation, expansion, GROUPING))
    return {
        "expansion": expansion,
        "truncation": truncation,
        "coefficients": run.counts["coefficients"],
        **errors(run.irradiance, exact),
        "setup": setup,
        "application": run.application,
        "far": run.application - run.passes["p2p"],
        "passes": run.passes,
    }


def winners(rows: list[Row]) -> list[Row]:
    """For each level of the mean error the quickest way of each expansion to stay below it."""
    result = []
    for level in LEVELS:
        enough = sorted((row for row in rows if row["mean_relative"] <= level), key=lambda row: row["application"])
        quickest = {row["expansion"]: row for row in reversed(enough)}
        result.append({"level": level, "ranking": sorted(quickest.values(), key=lambda row: row["application"])})
    return result


def print_winners(levels: list[Row]) -> None:
    """One sentence a level."""
    for level in levels:
        if not level["ranking"]:
            print(f"{level['level']:.2%}: no expansion at the measured p")
            continue
        first, *others = level["ranking"]
        text = f"{first['expansion']} wins with p = {first['truncation']} in {first['application']:.3g} s"
        for other in others:
            factor = other["application"] / first["application"]
            relation = "level with" if factor < LEVEL_WITHIN else f"{factor:.1f} times as fast as"
            text += f", {relation} {other['expansion']} with p = {other['truncation']}"
        missing = TRUNCATIONS.keys() - {row["expansion"] for row in level["ranking"]}
        if missing:
            text += f"; {' and '.join(sorted(missing))} did not get there at the measured p"
        print(f"{level['level']:.2%}: {text}")


def draw(path: Path, rows: list[Row], brute_seconds: float) -> None:
    """Left: mean relative error against p. Right: the same against seconds of one application."""
    figure, (by_p, by_time) = plt.subplots(1, 2, figsize=(9, 4), sharey=True, layout="constrained")
    for expansion in TRUNCATIONS:
        own = [row for row in rows if row["expansion"] == expansion]
        error = [row["mean_relative"] for row in own]
        by_p.plot([row["truncation"] for row in own], error, "o-", markersize=4, label=expansion)
        by_time.plot([row["application"] for row in own], error, "o-", markersize=4)
    by_time.axvline(brute_seconds, color="k", linestyle="--", linewidth=1)
    by_time.text(brute_seconds, 1.0, " brute force", transform=by_time.get_xaxis_transform(), va="bottom", ha="center")
    by_p.set(yscale="log", xlabel="truncation p", ylabel="mean relative error of the irradiance")
    by_time.set(xscale="log", xlabel="seconds of one application")
    for axes in (by_p, by_time):
        axes.grid(alpha=0.3)
    by_p.legend(frameon=False, title="expansion")
    figure.savefig(path, dpi=150)


def main() -> None:
    arguments = parser(__doc__, "accuracy.png").parse_args()
    print_machine()
    cloud = cornell_room(SMALL_PARTICLES if arguments.small else PARTICLES)
    brute = best(lambda: brute_force(cloud))
    rows = [
        measured(cloud, brute.irradiance, expansion, truncation)
        for expansion, greatest in TRUNCATIONS.items()
        for truncation in range((SMALL_TRUNCATION if arguments.small else greatest) + 1)
    ]
    print(f"{len(cloud):,} particles, s = {GROUPING}; the direct sum takes {brute.whole:.3g} s")
    print_table(rows, COLUMNS)
    levels = winners(rows)
    print_winners(levels)
    draw(arguments.picture, rows, brute.whole)
    write_json(arguments.json, {"particles": len(cloud), "brute": brute.whole, "rows": rows, "winners": levels})


if __name__ == "__main__":
    main()
