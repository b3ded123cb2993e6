# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a bake in words."""

from __future__ import annotations

from collections.abc import Callable

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


#: Puts a text into the language of the reader.
Translate = Callable[[str], str]


def typical(error: dict, translate: Translate = str) -> str:
    """The measured error, or what it is less than where it is too small to be told."""
    if error["low"]:
        return percent(error["measured_rms"])
    return translate("below {:s}").format(percent(max(error["high"], _LEAST)))


def measured(error: dict, translate: Translate = str) -> str:
    """The measured error with the range that it lies in, where that can be told."""
    shown = typical(error, translate)
    if error["low"]:
        return translate("{:s} ({:s} to {:s})").format(shown, percent(error["low"]), percent(error["high"]))
    return shown


def _round(tried: dict) -> str:
    """Settings that were tried to meet the target error, and what they came to."""
    grouping = "" if tried["grouping"] is None else f"s {tried['grouping']}, "
    chosen = f"p {tried['truncation']}, {grouping}{tried['particles']:,} particles, {tried['rays']:,} rays"
    return f"{tried['method']}, {chosen}: {measured(tried)} after {tried['seconds']:.2f} s"


def summary(report: dict, translate: Translate = str) -> str:
    """A report in one line."""
    counts, error = report["counts"], report.get("error") or {}
    numbers = counts["output_points"], counts["triangles"], report["seconds"]["total"]
    text = translate("{:,d} points from {:,d} triangles in {:.2f} s").format(*numbers)
    if "frames" in report:
        text = translate("{:d} frames, {:s}").format(len(report["frames"]), text)
    if error.get("measured_rms") is not None:
        text = translate("{:s}, measured error {:s}").format(text, measured(error, translate))
    if report["rounds"]:
        chosen = report["rounds"][-1]
        numbers = len(report["rounds"]), chosen["truncation"], chosen["particles"], chosen["rays"]
        text = translate("{:s} in round {:d}: p {:d}, {:,d} particles, {:d} rays").format(text, *numbers)
    if report["visibility_kept"] and not counts["rays"]:
        text = translate("{:s}, visibility kept").format(text)
    return text


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
