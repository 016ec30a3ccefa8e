"""Text tables with comments in odd places, and with blocks of rows between blank lines."""

from pathlib import Path

import pytest

from servobench.recordings.formats.base import load
from servobench.recordings.recording import Recording
from tests.recordings.formats.tables import codes, columns, finding, loaded, units

ROWS = "0.0 1 5\n0.1 2 6\n0.2 3 7\n"
TIMES = [0.0, 0.1, 0.2]
U, Y = [1.0, 2.0, 3.0], [5.0, 6.0, 7.0]


def several(folder: Path, text: str) -> tuple[Recording, ...]:
    """Load the recordings in a text."""
    path = folder / "log.dat"
    path.write_text(text)
    return load(path)


@pytest.mark.parametrize("between", ["\n\n", "\n", "\n\n# t u y\n", "\n% second run\n"])
def test_where_the_time_begins_again_after_a_blank_line_a_recording_begins(
    between: str, tmp_path: Path
) -> None:
    found = several(tmp_path, "# t u y\n" + ROWS + between + ROWS.replace(" 5", " 55"))

    assert [each.name for each in found] == ["log 1", "log 2"]
    assert columns(found[0]) == {"t": TIMES, "u": U, "y": Y}
    assert columns(found[1]) == {"t": TIMES, "u": U, "y": [55.0, *Y[1:]]}
    assert found[1]["y"].t is not None
    assert "time-not-increasing" not in codes(found[1].findings)
    assert "Blank lines separate 2 blocks" in finding(found[0].findings, "blocks-apart").sentence


def test_two_blank_lines_separate_data_sets_without_times_too(tmp_path: Path) -> None:
    found = several(tmp_path, ROWS + "\n\n" + ROWS + "\n\n" + ROWS)

    assert [columns(each)["column_2"] for each in found] == [U, U, U]


def test_one_blank_line_in_a_run_that_goes_on_is_only_reported(tmp_path: Path) -> None:
    (recording,) = several(tmp_path, "t u y\n" + ROWS + "\n0.3 4 8\n")

    assert columns(recording)["t"] == [*TIMES, 0.3]
    assert "rows-blank" in codes(recording.findings)


def test_lines_that_are_spaced_by_blank_ones_are_one_table(tmp_path: Path) -> None:
    """Such a text was written with the wrong line endings twice: every row stands alone."""
    (recording,) = several(tmp_path, ROWS.replace("\n", "\n\n\n"))

    assert columns(recording)["column_3"] == Y


@pytest.mark.parametrize("mark", ["%", "#"])
@pytest.mark.parametrize("separator", [" ", "\t", ";", ",", "   "])
def test_a_comment_behind_the_numbers_costs_nothing_but_itself(
    mark: str, separator: str, tmp_path: Path
) -> None:
    text = ("t u y\n" + ROWS).replace(" ", separator).replace(f"2{separator}6", f"2{separator}6 {mark} bump")

    recording = loaded(tmp_path, text)

    assert columns(recording) == {"t": TIMES, "u": U, "y": Y}
    assert finding(recording.findings, "rows-remark").rows == (3, 3)


@pytest.mark.parametrize(
    "header",
    ["% t [s], u [V], y [rad]", "# t [s]\tu [V]\ty [rad]", "%t[s] u[V] y[rad]", "# t; u; y\n# s; V; rad"],
)
def test_a_commented_header_may_separate_names_as_it_likes(header: str, tmp_path: Path) -> None:
    recording = loaded(tmp_path, f"% made by hand\n{header}\n{ROWS}% the end\n")

    assert columns(recording) == {"t": TIMES, "u": U, "y": Y}
    assert units(recording) == {"t": "s", "u": "V", "y": "rad"}


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
def test_comments_units_and_decimal_commas_in_every_encoding_with_a_mark(
    encoding: str, tmp_path: Path
) -> None:
    text = "% motor 3\n% t;u;y;\n% s;V;°;\n0,0;1;5;\n0,1;2;6;\n% pause\n0,2;3;7;\n"
    mark = "\ufeff" if encoding.endswith("e") else ""

    recording = loaded(tmp_path, (mark + text).encode(encoding), "log.dat")

    assert columns(recording) == {"t": TIMES, "u": U, "y": Y}
    assert units(recording) == {"t": "s", "u": "V", "y": "°"}


def test_a_header_that_stands_again_in_the_middle_is_no_row(tmp_path: Path) -> None:
    for header in ("% t u y\n", "t u y\n"):
        recording = loaded(tmp_path, header + ROWS + header + "0.3 4 8\n")

        assert columns(recording)["u"] == [*U, 4.0]
