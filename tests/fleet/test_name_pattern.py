"""Columns from the names of files."""

import pytest

from servobench.core.errors import UsageError
from servobench.fleet.name_pattern import NamePattern


@pytest.mark.parametrize(
    ("pattern", "path", "columns"),
    [
        ("{line}/{serial}_{date}.csv", "A/17_2026-11-23.csv", {"line": "A", "serial": "17", "date": "2026-11-23"}),
        ("{serial}_{date}.csv", "a_b_c.csv", {"serial": "a", "date": "b_c"}),
        ("**/{serial}.csv", "x/y/7.csv", {"serial": "7"}),
        ("**/{serial}.csv", "7.csv", {"serial": "7"}),
        ("*/{serial}.csv", "x/7.csv", {"serial": "7"}),
        ("{serial}(1).csv", "7(1).csv", {"serial": "7"}),
        ("{serial}.csv", "x/7.csv", None),
        ("{serial}.csv", "7.tdms", None),
        ("{serial}.csv", ".csv", None),
    ],
)  # fmt: skip
def test_a_name_gives_its_columns(pattern: str, path: str, columns: dict[str, str] | None) -> None:
    assert NamePattern(pattern).columns(path) == columns


@pytest.mark.parametrize(
    ("pattern", "because"),
    [
        ("motor.csv", "has no field"),
        ("{serial", "a brace isn't closed"),
        ("{Serial No}.csv", "can't be a column"),
        ("{n}_{n}.csv", "occurs in it twice"),
        ("{file}.csv", "has a column file already"),
        ("{gain_low}.csv", "has a column gain_low already"),
    ],
)
def test_what_is_no_pattern_is_reported(pattern: str, because: str) -> None:
    with pytest.raises(UsageError, match=because):
        NamePattern(pattern)
