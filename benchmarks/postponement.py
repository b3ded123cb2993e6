# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds against the number of particles, for scenes of different postponement factor (figure 12 of the paper).

The octree is of level 3, its leaves are the cells. "cells" is the paper's own visibility algorithm, "rays" the default
one. Seconds are from triangles to the particles' radiosity, with all iterations; visibility is the part of them that
finds which pairs see each other. Alpha (eq 13) is the share of the pairs of boxes that is postponed to the children;
that of "rays" counts pairs which no shaft proves clear, and does not compare. Each row is a process of its own.
"""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
from common import Array, Row, in_child, parser, print_machine, print_table, write_json
from fmm_core import Scene, Settings, solve
from scenes import cornell

from examples import example

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

SIZES = (2_000, 5_000, 10_000, 20_000, 30_000, 50_000)
SMALL = (600,)
ALGORITHMS = ("cells", "rays")
STYLES = {"cells": "o-", "rays": "s--"}
COLUMNS = {
    "scene": ("      scene", "s"),
    "visibility": ("algorithm", "s"),
    "particles": ("particles", ",d"),
    "alpha": ("alpha", ".4f"),
    "seconds": ("seconds", ".3g"),
    "visibility_seconds": ("visibility s", ".3g"),
    "share": ("share", ".0%"),
    "rays": ("rays", ",d"),
    "iterations": ("iterations", "d"),
}

Triangles = tuple[Array, Array, Array]


def room(blocks: int) -> Triangles:
    """The Cornell room with so many of its blocks, the tall one first; without any its ceiling is the lamp."""
    walls, lamp, each = 10, 2, 10
    count = walls + lamp + blocks * each if blocks else walls
    triangles, albedo, emission = (values[:count] for values in cornell())
    if not blocks:
        ceiling = (triangles[:, :, 2] == 1).all(axis=1)
        emission, albedo = np.where(ceiling, 1.0, emission), np.where(ceiling[:, None], 0.0, albedo)
    return triangles, albedo, emission


def alternative() -> Triangles:
    """The gallery of the examples, as the extension reads it."""
    scene, _ = example("alternative")
    return scene.triangles, scene.albedo, scene.emission


def load(scene: str) -> Triangles:
    """A scene by its name."""
    makers: dict[str, Callable[[], Triangles]] = {
        "empty": lambda: room(0),
        "one block": lambda: room(1),
        "two blocks": lambda: room(2),
        "alternative": alternative,
    }
    return makers[scene]()


def measured(path: Path, size: int, visibility: str) -> Row:
    """One solve; to run in a fresh process."""
    with np.load(path) as arrays:
        scene = Scene(arrays["triangles"], arrays["albedo"], arrays["emission"])
    settings = Settings(method="fmm", level=3, particles=size, quadrature=1, visibility=visibility, probes=0)
    start = time.perf_counter()
    report = solve(scene, settings).report
    seconds = time.perf_counter() - start
    return {
        "visibility": visibility,
        "particles": report["counts"]["particles"],
        "alpha": report["postponement"],
        "seconds": seconds,
        "visibility_seconds": report["seconds"]["visibility"],
        "share": report["seconds"]["visibility"] / seconds,
        "rays": report["counts"]["rays"],
        "cells": report["counts"]["leaves"],
        "pairs": {state: report["counts"][f"pairs_{state}"] for state in ("valid", "partial", "invalid")},
        "iterations": len(report["residuals"]),
    }


def run(scenes: list[str], sizes: tuple[int, ...]) -> list[Row]:
    """A row for each scene, size and algorithm; sizes below a scene's number of triangles are left out."""
    rows: list[Row] = []
    for scene in scenes:
        triangles, albedo, emission = load(scene)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "scene.npz"
            np.savez(path, triangles=triangles, albedo=albedo, emission=emission)
            for size in (size for size in sizes if size >= len(triangles)):
                rows += [{"scene": scene} | in_child(measured, path, size, name) for name in ALGORITHMS]
    return rows


def draw(path: Path, rows: list[Row]) -> None:
    """Both axes logarithmic; a colour for each scene, a line for each algorithm."""
    figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
    for number, scene in enumerate(dict.fromkeys(row["scene"] for row in rows)):
        for visibility in ALGORITHMS:
            own = [row for row in rows if (row["scene"], row["visibility"]) == (scene, visibility)]
            label = f"{scene}, α = {own[-1]['alpha']:.3f}" if visibility == "cells" else None
            values = [row["particles"] for row in own], [row["seconds"] for row in own]
            axes.plot(*values, STYLES[visibility], color=f"C{number}", markersize=4, label=label)
    for visibility, text in (("cells", "cells, the paper's algorithm"), ("rays", "rays, the default")):
        axes.plot([], [], STYLES[visibility], color="0.4", markersize=4, label=text)
    axes.set(xscale="log", yscale="log", xlabel="particles N", ylabel="seconds from triangles to radiosity")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda n, _: f"{n:,.0f}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=150)


def main() -> None:
    arguments = parser(__doc__, "postponement.png").parse_args()
    print_machine()
    scenes = ["empty", "two blocks"] if arguments.small else ["empty", "one block", "two blocks", "alternative"]
    rows = run(scenes, SMALL if arguments.small else SIZES)
    print_table(rows, COLUMNS)
    draw(arguments.picture, rows)
    write_json(arguments.json, {"rows": rows})


if __name__ == "__main__":
    main()
