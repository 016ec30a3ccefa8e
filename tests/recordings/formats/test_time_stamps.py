"""Time stamps and times of day in text tables."""

from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from servobench.recordings.formats.time_stamps import is_stamp, seconds_from_first
from tests.recordings.formats.tables import codes, columns, finding, loaded

STEP = timedelta(milliseconds=2)
BEGIN = datetime(2026, 11, 21, 23, 59, 59, 995_000)
TIMES = [0.002 * k for k in range(6)]  # s; midnight is between the third and the fifth
WAYS = {
    "ISO": lambda t: t.isoformat(timespec="milliseconds"),
    "a blank between": lambda t: t.isoformat(" ", "microseconds"),
    "universal time": lambda t: t.isoformat(timespec="milliseconds") + "Z",
    "a zone": lambda t: t.replace(tzinfo=timezone(timedelta(hours=5, minutes=30))).isoformat(),
    "slashes": lambda t: t.strftime("%Y/%m/%d %H:%M:%S.%f"),
    "clock": lambda t: t.strftime("%H:%M:%S.%f"),
    "comma": lambda t: t.strftime("%H:%M:%S,%f"),
}


@pytest.mark.parametrize("way", WAYS)
def test_time_stamps_are_seconds_from_the_first_and_the_time(way: str, tmp_path: Path) -> None:
    rows = [f"{WAYS[way](BEGIN + k * STEP)};1.5;{k}.5" for k in range(6)]
    recording = loaded(tmp_path, "when;u [V];y [rad]\n" + "\n".join(rows) + "\n")

    # Whole seconds are subtracted exactly; what is left is the rounding of one part of a second, 1e-16 s.
    assert columns(recording)["when"] == pytest.approx(TIMES, abs=1e-15)
    assert recording["y"].t is not None
    assert recording["y"].t == pytest.approx(TIMES, abs=1e-15)
    assert "2026" in finding(recording.findings, "time-stamps").sentence or way in {"clock", "comma"}
    assert not {"cell-not-a-number", "column-not-numbers"} & set(codes(recording.findings))


def test_zones_that_change_are_one_clock() -> None:
    """Noon in UTC is 13:00 at +01:00."""
    t = seconds_from_first(["2026-03-29T12:00:00Z", "2026-03-29T13:00:01+01:00", "2026-03-29T05:00:02-0700"])

    assert t.tolist() == [0.0, 1.0, 2.0]


def test_two_midnights_are_two_days() -> None:
    """Every six hours, from 18:00."""
    cells = ["18:00:00", "00:00:00", "06:00:00", "12:00:00", "18:00:00", "00:00:00"]

    assert seconds_from_first(cells).tolist() == [21_600.0 * k for k in range(6)]


def test_a_clock_that_is_set_back_a_little_is_on_the_same_day() -> None:
    assert seconds_from_first(["12:00:01", "12:00:00", "12:00:02"]).tolist() == [0.0, -1.0, 1.0]


@pytest.mark.parametrize(
    "cell", ["2026-02-30T10:00:00", "24:00:00", "10:61:00", "1.5", "", "2026-02-03", "a:b:c"]
)
def test_what_is_no_time_stamp_is_none(cell: str) -> None:
    assert not is_stamp(cell)
    assert np.isnan(seconds_from_first([cell])).all()


def test_a_cell_between_time_stamps_that_is_none_is_reported(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "t;u\n10:00:00;1\nlate;2\n10:00:02;3\n10:00:03;3\n10:00:04;3\n")

    found = finding(recording.findings, "cell-not-a-number")
    assert found.rows == (3, 3)
    assert "'late'" in found.sentence
    assert np.isnan(columns(recording)["t"][1])
