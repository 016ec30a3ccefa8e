"""Counts whose thousands were separated by a point, which was read as a decimal point."""

import numpy as np
import pytest

from servobench.recordings.measurement.measure import measure
from servobench.recordings.measurement.point_of_thousands import are_thousands
from tests.recordings.measurement.test_measure import recording

COUNTS = np.floor(7.3 * np.arange(400))  # 0 to 2912; some of them are whole thousands


def as_exported(counts: np.ndarray) -> np.ndarray:
    """Counts as they are read from a file in which 1013 is written 1.013."""
    return np.where(np.abs(counts) >= 1000, counts / 1000, counts)


@pytest.mark.parametrize("counts", [COUNTS, -COUNTS, COUNTS[::-1], np.arange(990.0, 3010.0), COUNTS[:139]])
def test_whole_numbers_below_a_thousand_and_three_digits_behind_a_point_above_are_thousands(
    counts: np.ndarray,
) -> None:
    assert are_thousands(as_exported(counts))


@pytest.mark.parametrize(
    "x",
    [
        COUNTS,
        COUNTS / 3,  # averaged: as many digits as a float has
        np.round(COUNTS / 3, 3),  # and with three of them
        np.round(10 * np.sin(0.1 * np.arange(400)), 3),
        np.round(1 + 0.0123 * np.arange(400), 3),
        as_exported(np.arange(1001.0, 1400.0)),  # nothing below a thousand shows that these are more
        as_exported(COUNTS) + 0.0005,
        np.array([np.nan, np.nan]),
    ],
)
def test_numbers_that_may_well_be_decimal_are_none(x: np.ndarray) -> None:
    assert not are_thousands(x)


def doubt(counts: np.ndarray) -> str:
    """What is said of counts that aren't whole."""
    data = measure(recording(counts, "counts", t=0.002 * np.arange(len(counts))))
    (sentence,) = [each.sentence for each in data.findings if each.code == "counts-not-whole"]
    return sentence


def test_counts_with_a_point_between_thousands_are_to_be_exported_without_it() -> None:
    assert "such as 1.007, where the others suggest 1007. If the point separates thousands, export" in doubt(
        as_exported(COUNTS)
    )


def test_counts_that_were_averaged_are_asked_for_their_unit_only() -> None:
    assert "thousands" not in doubt(COUNTS / 3)
