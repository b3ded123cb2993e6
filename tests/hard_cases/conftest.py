# SPDX-License-Identifier: GPL-3.0-or-later
"""A table of what was measured against its bound, at the end of a run."""

import sys
from pathlib import Path

import pytest

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent.parent / "core")]

#: Rows of the table: case, what was measured, value, bound.
ROWS: list[tuple[str, str, float, float]] = []


@pytest.fixture
def at_most(request):
    """`at_most(bound, **values)` asserts each value, and puts it into the table beside its bound."""

    def check(bound, **values):
        case = request.node.name.removeprefix("test_")
        ROWS.extend((case, what, float(value), bound) for what, value in values.items())
        for what, value in values.items():
            assert value <= bound, f"{what}: {value:.3g} is above {bound:g}"

    return check


def pytest_terminal_summary(terminalreporter):
    if not ROWS:
        return
    width = max(len(case) for case, *_ in ROWS)
    terminalreporter.section("hard cases: measured against bound")
    for case, what, value, bound in ROWS:
        mark = "" if value <= bound else "  ABOVE"
        terminalreporter.write_line(f"{case:{width}}  {what:10}  {value:10.2e}  {bound:8.1e}{mark}")
