# SPDX-License-Identifier: GPL-3.0-or-later
"""Rate of the direct sum: pair interactions a second without visibility, three colours counted once."""

import argparse
import json
import os
import platform
import time
from pathlib import Path

import numpy as np
from fmm_core import _binding


def rate(count: int, repeats: int) -> float:
    """Best of `repeats` runs of `count` sources on as many receivers, on the faces of a cube, pairs a second."""
    rng = np.random.default_rng(0)
    points = rng.random((count, 3))
    face = rng.integers(0, 6, count)
    points[np.arange(count), face % 3] = face // 3
    normals = np.eye(3)[face % 3] * (1 - 2 * (face // 3))[:, None]
    sources = _binding.Sources(points, normals, np.full(count, 1e-12), np.ones(count), 1)
    strengths = rng.random((count, 3))
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        sources.irradiance(points, normals, strengths)
        seconds.append(time.perf_counter() - start)
    return count**2 / min(seconds)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="write the table there")
    arguments = parser.parse_args()
    rows = [{"particles": n, "pairs_per_second": rate(n, repeats=5)} for n in (1_000, 5_000, 20_000, 40_000)]
    print(f"{os.cpu_count()} cores, {platform.machine()}")
    print(f"{'particles':>10} {'pairs/s':>12}")
    for row in rows:
        print(f"{row['particles']:>10,} {row['pairs_per_second']:>12.3g}")
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
