# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a bake in words."""

from __future__ import annotations

#: Phases of a bake, as an artist may call them.
PHASES = {
    "export": "Reading",
    "tree": "Sorting",
    "lists": "Pairing",
    "visibility": "Shadows",
    "transport": "Bounces",
    "evaluate": "Colouring",
    "accuracy": "Measuring",
    "write": "Writing",
    "total": "All Together",
}

#: Errors below this one are of no interest.
_LEAST = 1e-4


def percent(share: float) -> str:
    """A share as percent with two digits, or all that there are before the point."""
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:,.0f} %"


def typical(error: dict, below: str = "below {:s}") -> str:
    """The measured error, or, in the words of `below`, what it is less than where it is too small to be told."""
    return percent(error["measured_rms"]) if error["low"] else below.format(percent(max(error["high"], _LEAST)))


def measured(error: dict) -> str:
    """The measured error with the range that it lies in, where that can be told."""
    between = f" ({percent(error['low'])} to {percent(error['high'])})" if error["low"] else ""
    return f"{typical(error)}{between}"


def _round(tried: dict) -> str:
    """Settings that were tried to meet the target error, and what they came to."""
    grouping = "" if tried["grouping"] is None else f"s {tried['grouping']}, "
    chosen = f"p {tried['truncation']}, {grouping}{tried['particles']:,} particles, {tried['rays']:,} rays"
    return f"{tried['method']}, {chosen}: {measured(tried)} after {tried['seconds']:.2f} s"


def summary(report: dict) -> str:
    """A report in one line."""
    counts, error = report["counts"], report.get("error") or {}
    seconds = report["seconds"]["total"]
    text = f"{counts['output_points']:,} points from {counts['triangles']:,} triangles in {seconds:.2f} s"
    if "frames" in report:
        text = f"{len(report['frames'])} frames, {text}"
    if error.get("measured_rms") is not None:
        text = f"{text}, measured error {measured(error)}"
    if report["rounds"]:
        chosen = report["rounds"][-1]
        text = f"{text} in round {len(report['rounds'])}: p {chosen['truncation']}, {chosen['particles']:,} particles"
        text = f"{text}, {chosen['rays']} rays"
    return f"{text}, visibility kept" if report["visibility_kept"] and not counts["rays"] else text


def text(report: dict) -> str:
    """A report as a page to read."""
    error, lines = report["error"], [f"Radiosity: {summary(report)}", ""]
    if error["measured_rms"] is not None:
        lines += [
            f"Measured error: {measured(error)} of the light on average, at most "
            f"{percent(error['measured_max'])}, at {error['probes']} random points",
            "",
        ]
    if report["rounds"]:
        lines += ["Rounds", *(f"  {_round(tried)}" for tried in report["rounds"]), ""]
    lines += ["Seconds", *(f"  {name:<14}{report['seconds'][phase]:9.2f}" for phase, name in PHASES.items()), ""]
    lines += ["Counts", *(f"  {name.replace('_', ' '):<14}{count:>14,}" for name, count in report["counts"].items())]
    if report["peak_memory_mib"] is not None:
        lines += ["", f"Largest memory of Blender so far: {report['peak_memory_mib']:,.0f} MiB"]
    effects = [
        f"  {name:<16}{'yes' if part['used'] else 'no':<5}{part['why']}" for name, part in report["effects"].items()
    ]
    lines += ["", "Effects", *effects]
    chosen = {name: value for name, value in report["settings"].items() if value is not None and name != "effects"}
    lines += ["", "Settings", *(f"  {name.replace('_', ' '):<14}{value:>14}" for name, value in chosen.items())]
    if report["warnings"]:
        lines += ["", "Warnings", *(f"  {warning}" for warning in report["warnings"])]
    return "\n".join(lines) + "\n"
