"""Signals merged into one table, each with rows of its own."""

from collections.abc import Callable
from pathlib import Path

import pytest

from servobench.core.finding import Severity
from servobench.recordings.formats.mapping import assign
from tests.recordings.formats.tables import codes, finding, loaded


def merged(cells: Callable[[int], tuple[object, object]]) -> str:
    rows = [f"{0.005 * k:.3f},{u},{y}\n" for k in range(200) for u, y in [cells(k)]]
    return "t,u,y [rad]\n" + "".join(rows)


def test_rows_that_hold_input_or_output_in_turn_are_no_evidence_against_the_data(tmp_path: Path) -> None:
    assigned = assign(loaded(tmp_path, merged(lambda k: ("", k) if k % 2 else (k % 3, ""))))

    assert finding(assigned.findings, "rows-merged").severity is Severity.INFO
    assert "`u` has a value in 100 of 200 rows" in finding(assigned.findings, "rows-merged").sentence
    assert len(assigned["u"].values) == 100


@pytest.mark.parametrize(
    "cells",
    [
        lambda k: ("" if k % 4 == 1 else k % 3, k),  # lost values of the input beside whole rows
        lambda k: ("", k) if k % 2 or 60 < k < 100 else (k % 3, ""),  # and a pause in it
    ],
)
def test_lost_values_of_the_input_stay_a_warning(
    cells: Callable[[int], tuple[object, object]], tmp_path: Path
) -> None:
    assigned = assign(loaded(tmp_path, merged(cells)))

    warnings = [each for each in assigned.findings if each.severity is Severity.WARNING]
    assert codes(warnings) == ["rows-left-out"]
