"""Separators between thousands, which spreadsheets write into exported numbers."""

from pathlib import Path

import numpy as np
import pytest

from servobench.core.finding import Severity
from servobench.recordings.formats.text_table import Layout
from tests.recordings.formats.tables import codes, columns, finding, loaded

SPACES = {"no-break": "\u00a0", "thin": "\u2009", "narrow no-break": "\u202f"}


@pytest.mark.parametrize("mark", ["'", "’", *SPACES.values()])
@pytest.mark.parametrize("separator", [";", ",", "\t"])
def test_an_apostrophe_or_space_between_groups_of_three_digits_is_no_part_of_the_number(
    mark: str, separator: str, tmp_path: Path
) -> None:
    rows = [
        ("t_ms", "y"),
        ("999", "-5"),
        (f"1{mark}000", f"-1{mark}234{mark}567"),
        ("1001", f"+2{mark}000.25"),
    ]

    recording = loaded(tmp_path, "\n".join(map(separator.join, rows)) + "\n")

    assert columns(recording) == {"t_ms": [999.0, 1000.0, 1001.0], "y": [-5.0, -1234567.0, 2000.25]}
    about = finding(recording.findings, "thousands-separated")
    assert about.severity is Severity.INFO
    what = "apostrophes" if mark in "'’" else "spaces"
    assert about.sentence.startswith(f"The {what} inside numbers separate thousands: 1")
    assert about.sentence.endswith("000 is read as 1000.")


def test_grouped_numbers_may_have_a_decimal_comma(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "u;y\n1,5;1'000,5\n1,5;2'000,25\n")

    assert columns(recording) == {"u": [1.5, 1.5], "y": [1000.5, 2000.25]}
    assert codes(recording.findings)[:2] == ["thousands-separated", "decimal-comma"]


def test_an_apostrophe_of_windows_is_read_where_the_file_is_no_utf_8(tmp_path: Path) -> None:
    """Byte 0x92 is the typographic apostrophe of Windows-1252."""
    recording = loaded(tmp_path, b"u;y\n1;4\x92400\n1;4\x92500\n")

    assert columns(recording)["y"] == [4400.0, 4500.0]
    assert "4'400 is read as 4400" in finding(recording.findings, "thousands-separated").sentence


@pytest.mark.parametrize(
    "cell", ["0'400", "4'40", "4'4000", "1234'567", "1'234’567", "1'234e5", "'400", "400'", "4 400"]
)
def test_what_is_not_grouped_by_three_is_no_number(cell: str) -> None:
    assert not Layout(separator=";", decimal=".").is_number(cell)


def test_a_no_break_space_between_columns_joins_no_numbers(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "a b\n5\u00a0100\n6\u00a0200\n")

    assert columns(recording) == {"a": [5.0, 6.0], "b": [100.0, 200.0]}


def test_apostrophes_in_words_and_numbers_without_any_are_told_nothing_about(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "t,y,note\n" + "".join(f"{k},{k + 1000},don't\n" for k in range(20)))

    assert "thousands-separated" not in codes(recording.findings)
    assert np.isfinite(recording["y"].values).all()
