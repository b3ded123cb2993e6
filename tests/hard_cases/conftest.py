# SPDX-License-Identifier: GPL-3.0-or-later
"""A table of what was measured against its bound, at the end of a run."""

import sys
from pathlib import Path

import pytest

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent.parent / "core")]

#: Name of the properties of a test that are rows of the table: case, what was measured, value, bound.
ROW = "measured"


@pytest.fixture
def at_most(request):
    """`at_most(bound, **values)` asserts each value, and puts it into the table beside its bound."""

    def check(bound, **values):
        case = request.node.name.removeprefix("test_")
        rows = [(ROW, (case, what, float(value), bound)) for what, value in values.items()]
        request.node.user_properties.extend(rows)
        for what, value in values.items():
            assert value <= bound, f"{what}: {value:.3g} is above {bound:g}"

    return check


def pytest_terminal_summary(terminalreporter):
    reports = [report for some in terminalreporter.stats.values() for report in some]
    ended = [report for report in reports if getattr(report, "when", None) == "call"]
    rows = [row for report in ended for name, row in report.user_properties if name == ROW]
    if not rows:
        return
    width = max(len(case) for case, *_ in rows)
    terminalreporter.section("hard cases: measured against bound")
    for case, what, value, bound in rows:
        mark = "" if value <= bound else "  ABOVE"
        terminalreporter.write_line(f"{case:{width}}  {what:10}  {value:10.2e}  {bound:8.1e}{mark}")
