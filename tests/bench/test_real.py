"""The judge of intervals by replicates is right on made-up recordings, and its list names files that exist."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from real_parts.judge import judged, scatter_of_families
from real_parts.recordings import FOLDER, usable
from real_parts.runs import Outcome, Stated


def said(gain: float, half_width: float, motor: str = "one") -> Outcome:
    stated = Stated(value=gain, half_width=half_width, low=gain - half_width, high=gain + half_width)
    return Outcome(motor=motor, name=f"{gain}", verdict="doubtful", stated={"gain": stated})


def test_each_recording_is_held_against_the_median_of_the_others() -> None:
    (row,) = judged([said(9.0, 0.5), said(10.0, 0.5), said(11.0, 0.5), said(10.2, 0.5)])

    # The others' medians are 10.2, 10.2, 10.0 and 10.0: the first and the third miss them.
    assert (row.held, row.stated) == (2, 4)
    assert row.consensus == pytest.approx(10.1)
    # Deviations from it are 1.1, 0.1, 0.9, 0.1: their median is 0.5.
    assert row.scatter == pytest.approx(1.4826 * 0.5 / 10.1)
    assert row.width == pytest.approx(0.5 / (1.4826 * 0.5))


def test_a_motor_with_two_recordings_is_not_judged() -> None:
    assert judged([said(9.0, 1.0), said(10.0, 1.0)]) == ()


def test_what_a_recording_does_not_state_does_not_count() -> None:
    silent = Outcome(motor="one", name="silent", verdict="refused", stated={})

    (row,) = judged([said(9.0, 9.0), said(10.0, 9.0), said(11.0, 9.0), silent])

    assert (row.held, row.stated) == (3, 3)


def test_motors_are_judged_apart() -> None:
    one = [said(gain, 1.0) for gain in (9.0, 10.0, 11.0)]
    other = [said(gain, 1.0, "other") for gain in (90.0, 100.0, 110.0)]

    assert [row.motor for row in judged([*one, *other])] == ["one", "other"]


def test_the_scatter_of_a_family_is_that_within_its_motors_beside_that_of_the_others() -> None:
    """Two recordings 10 % apart have a standard deviation of 7.1 %; another motor of the same make may be quite different."""
    recordings = [
        replace(said(gain, 1.0, motor), name=f"{family}/{gain}")
        for family, motor, gain in (
            *(("a", "a1", 9.5), ("a", "a1", 10.5), ("a", "a2", 95.0), ("a", "a2", 105.0)),
            *(("b", "b1", 9.0), ("b", "b1", 11.0)),
            ("c", "c1", 10.0),
        )
    ]

    found = {each.family: each for each in scatter_of_families(recordings, "gain")}

    assert set(found) == {"a", "b"}
    assert found["a"].own == pytest.approx(0.1 / 2**0.5)
    assert found["a"].others == found["b"].own == pytest.approx(0.2 / 2**0.5)


def test_every_recording_of_the_list_is_there(real_data: Callable[[str], Path]) -> None:
    real_data("emps/DATA_EMPS.mat")  # skips where there are none
    missing = [each.file for each in usable() if not (FOLDER / each.file).is_file()]

    assert missing == []
