# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds against the number of particles, fast multipole method and brute force (figure 10 of the paper).

The scene is the unoccluded Cornell room (common.cornell_room), its particles are sources and receivers. "Whole" is from
points to values: octree, lists, translations and one application; later applications cost the "application" alone. Each
row is a process of its own and the best of several runs; "first" is its first run from points to values, in which the
expansion's own tables are made as well. Errors are against the direct sum at 500 random receivers. The grouping factor
s is the cost model's choice; it takes some tenths of a second, which are not counted, and its calibration is once a
process. Brute force is the direct sum with SIMD on all cores; beyond 1e5 particles it is measured at 2,000 random
receivers beside the other runs of that size, and scaled to all of them.
"""

import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np
from common import (
    Array,
    Cloud,
    Row,
    best,
    brute_force,
    cornell_room,
    direct,
    errors,
    in_child,
    multipole,
    parser,
    print_machine,
    print_table,
    receivers,
    write_json,
)
from fmm_core import Settings, cost

mpl.use("Agg")
import matplotlib.pyplot as plt

SIZES = (1_000, 2_000, 5_000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
LARGE = (3_000_000, 10_000_000)
SMALL = (1_000, 2_000)
TRUNCATIONS = (2, 3, 4, 6)
SMALL_TRUNCATIONS = (2,)
#: Brute force is measured up to this many particles; beyond, on this many receivers and all sources.
BRUTE_LIMIT, BRUTE_RECEIVERS = 110_000, 2_000
COLUMNS = {
    "particles": ("particles", ",d"),
    "truncation": ("p", "d"),
    "grouping": ("s", "d"),
    "whole": ("whole s", ".3g"),
    "first": ("first s", ".3g"),
    "setup": ("setup s", ".3g"),
    "application": ("application s", ".3g"),
    "predicted": ("predicted appl. s", ".3g"),
    "relative_l2": ("L2 error", ".2%"),
    "mean_relative": ("mean error", ".2%"),
    "bytes": ("bytes/particle", ",.0f"),
    "brute": ("brute s", ".3g"),
    "ratio": ("brute/whole", ".3g"),
}


def measured(path: Path, truncation: int, expansion: str, grouping: int) -> Row:
    """Seconds, peak memory above that at the start and irradiance at the receivers; to run in a fresh process."""
    start = peak_bytes()
    with np.load(path) as arrays:
        cloud = Cloud(**arrays)
    first = multipole(cloud, truncation, expansion, grouping).whole
    run = best(lambda: multipole(cloud, truncation, expansion, grouping))
    return {
        "first": first,
        "whole": run.whole,
        "setup": run.setup,
        "application": run.application,
        "passes": run.passes,
        "counts": run.counts,
        "bytes": (peak_bytes() - start) / len(cloud) if start else None,
        "irradiance": run.irradiance[receivers(cloud)],
    }


def peak_bytes() -> int:
    """The most memory that this process ever had, bytes; 0 where the system does not say."""
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM:")), 0)


def grow(sizes: tuple[int, ...], truncations: tuple[int, ...]) -> list[Row]:
    """A row for each size and truncation."""
    rows: list[Row] = []
    for size in sizes:
        cloud = cornell_room(size)
        whole = len(cloud) <= BRUTE_LIMIT
        seconds = brute_seconds(cloud, len(cloud) if whole else BRUTE_RECEIVERS)
        exact = direct(cloud, receivers(cloud))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "cloud.npz"
            np.savez(path, **vars(cloud))
            for truncation in truncations:
                row = one_row(cloud, path, truncation, exact)
                rows.append(row | {"brute": seconds, "brute_whole": whole, "ratio": seconds / row["whole"]})
    return rows


def brute_seconds(cloud: Cloud, count: int) -> float:
    """Seconds of the direct sum at all particles, from the best of several at the first `count` of a random order."""
    rows = np.random.default_rng(2).permutation(len(cloud))[:count]
    return best(lambda: brute_force(cloud, rows)).whole * len(cloud) / count


def one_row(cloud: Cloud, path: Path, truncation: int, exact: Array) -> Row:
    """Measures one run and predicts it."""
    settings = Settings(truncation=truncation)
    expansion = settings.expansion_in_use
    grouping = cost.choose_grouping(cloud.positions, cloud.normals, settings)
    chosen = truncation, expansion, settings.separation
    counts = cost.predicted_counts(cloud.positions, cloud.normals, grouping, *chosen)
    row = in_child(measured, path, truncation, expansion, grouping)
    return {
        "particles": len(cloud),
        "truncation": truncation,
        "expansion": expansion,
        "grouping": grouping,
        "predicted": cost.seconds(counts, truncation, expansion, settings.separation),
        **errors(row.pop("irradiance"), exact),
        **row,
    }


def summarise(rows: list[Row]) -> dict[str, float | int | None]:
    """The figures that the rows come down to; None where the sizes do not reach that far."""
    exponents = [
        slope([row for row in rows if row["truncation"] == p and 9_000 < row["particles"] < 1.1e6])
        for p in sorted({row["truncation"] for row in rows})
    ]
    million = [row for row in rows if 0.9e6 < row["particles"] < 1.1e6]
    precise = [row["ratio"] for row in million if row["relative_l2"] <= 0.005]
    return {
        "growth_exponent": max((e for e in exponents if e is not None), default=None),
        "beats_brute_force_from": always_ahead_from(rows),
        "ratio_at_a_million": max(precise, default=None),
        "bytes_per_particle": max((row["bytes"] for row in million if row["bytes"]), default=None),
    }


def always_ahead_from(rows: list[Row]) -> int | None:
    """The least N from which on, at every size, some run of at most 1 % error is faster than brute force."""
    ahead = None
    for size in sorted({row["particles"] for row in rows}, reverse=True):
        if not any(row["particles"] == size and row["relative_l2"] <= 0.01 and row["ratio"] > 1 for row in rows):
            break
        ahead = size
    return ahead


def slope(rows: list[Row]) -> float | None:
    """Exponent of N in the seconds from points to values, by least squares over logarithms."""
    if len(rows) < 2:
        return None
    return float(np.polyfit(*(np.log([row[key] for row in rows]) for key in ("particles", "whole")), 1)[0])


def print_summary(summary: dict[str, float | int | None]) -> None:
    """The figures beside their bars."""
    for key, text in (
        ("growth_exponent", "largest growth exponent from 1e4 to 1e6: {:.2f} (at most 1.1)"),
        ("beats_brute_force_from", "at <= 1 % error faster than brute force from N = {:,} (at the latest 10,000)"),
        ("ratio_at_a_million", "at N = 1e6 and <= 0.5 % error {:.0f} times faster than brute force (at least 300)"),
        ("bytes_per_particle", "peak memory at N = 1e6: {:,.0f} bytes a particle (at most 1,500)"),
    ):
        if summary[key] is not None:
            print(text.format(summary[key]))


def draw(path: Path, rows: list[Row]) -> None:
    """Both axes logarithmic; brute force dashed where it is extrapolated."""
    figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
    for p in sorted({row["truncation"] for row in rows}):
        own = [row for row in rows if row["truncation"] == p]
        sizes = [row["particles"] for row in own]
        label = f"FMM, p = {p} (error {own[-1]['relative_l2']:.2g} at the right end)"
        axes.plot(sizes, [row["whole"] for row in own], "o-", markersize=4, label=label)
    brute = sorted({(row["particles"], row["brute"], row["brute_whole"]) for row in rows})
    last = max(i for i, (_, _, whole) in enumerate(brute) if whole)
    axes.plot(*zip(*[(n, t) for n, t, _ in brute[: last + 1]], strict=True), "ks-", markersize=4, label="brute force")
    if brute[last:-1]:
        rest = [(n, t) for n, t, _ in brute[last:]]
        axes.plot(*zip(*rest, strict=True), "k--", label="brute force, from its rate")
    axes.set(xscale="log", yscale="log", xlabel="particles N", ylabel="seconds from points to values")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=150)


def main() -> None:
    options = parser(__doc__, "growth.png")
    options.add_argument("--large", action="store_true", help="up to 1e7 particles")
    arguments = options.parse_args()
    print_machine()
    if arguments.small:
        rows = grow(SMALL, SMALL_TRUNCATIONS)
    else:
        rows = grow(SIZES + LARGE * arguments.large, TRUNCATIONS)
    print_table(rows, COLUMNS)
    print(f"brute force is measured at all receivers up to N = {BRUTE_LIMIT:,}, at {BRUTE_RECEIVERS:,} of them beyond")
    summary = summarise(rows)
    print_summary(summary)
    draw(arguments.picture, rows)
    write_json(arguments.json, {"rows": rows, "summary": summary})


if __name__ == "__main__":
    main()
