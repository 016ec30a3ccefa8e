"""Rows that hold the counts since the row before."""

import numpy as np
import pytest

from servobench.core.errors import UsageError
from servobench.identification.identify import identify
from servobench.recordings.evidence import with_chain
from servobench.recordings.measurement.measure import measure
from servobench.recordings.recording import Recording
from tests.datasets import QUANTUM, dataset
from tests.recordings.measurement.test_measure import recording

DATA = dataset(seed=1, kind="prbs", samples=2000)
COUNTS = np.floor(DATA.y / QUANTUM)


def counted_in_each_row(rows: slice = slice(None), unit: str = "counts") -> Recording:
    counts = np.diff(COUNTS, prepend=COUNTS[0])
    return recording(counts[rows], unit, t=DATA.t_output[rows], u=DATA.u[rows], counts_per_rev=2048)


def test_the_sum_of_what_was_counted_in_each_row_is_the_position() -> None:
    data = measure(counted_in_each_row(), "accumulate", starts_at_rest=True)

    assert data.y - data.y[0] == pytest.approx(QUANTUM * (COUNTS - COUNTS[0]), abs=1e-9)
    assert (data.kind, data.output_unit, data.quantum) == ("position", "rad", QUANTUM)


def test_it_is_applied_now_to_rows_in_counts() -> None:
    evidence = with_chain(counted_in_each_row(), "accumulate")

    assert evidence.chain == "accumulate"
    assert identify(evidence.dataset())["gain"].value == pytest.approx(
        1 / (0.042 + 8.4 * 1e-6 / 0.042), rel=1e-3
    )


def test_counts_of_missing_rows_are_missed() -> None:
    whole = counted_in_each_row()
    there = np.delete(np.arange(2000), slice(700, 720))
    counts = whole["theta"].values[there]
    data = measure(recording(counts, "counts", t=DATA.t_output[there], u=DATA.u[there]), "accumulate")

    (lost,) = (each for each in data.findings if each.code == "counts-lost")
    assert lost.rows == (701, 701)
    assert "missing in 1 place, first before row 701" in lost.sentence


def test_without_it_counts_in_each_row_are_refused_and_it_is_named() -> None:
    result = identify(measure(counted_in_each_row()))

    (mistaken,) = (each for each in result.findings if each.code == "kind-mistaken")
    assert "`chain=accumulate`" in mistaken.sentence


def test_a_speed_is_not_added_up() -> None:
    with pytest.raises(UsageError, match="`accumulate` needs counts since the row before"):
        measure(counted_in_each_row(unit="rad/s"), "accumulate")
