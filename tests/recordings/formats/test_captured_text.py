"""Text that a program put something around: a clock, brackets, bars, lines below names, a common factor."""

from pathlib import Path

import numpy as np
import pytest

from servobench.core.errors import FormatError
from servobench.core.finding import Severity
from servobench.recordings.formats.framed_rows import without_frames
from tests.recordings.formats.tables import codes, columns, finding, loaded, units

NUMBERS = {"t": [0.0, 0.1, 0.2], "u": [1.0, 2.5, 2.5], "y": [0.0, 3.0, 7.0]}
ROWS = ["0.0, 1, 0", "0.1, 2.5, 3", "0.2, 2.5, 7"]


def captured(lines: list[str]) -> str:
    """Lines as the Arduino IDE shows them, 10 ms apart."""
    return "".join(f"12:34:59.{980 + 10 * k} -> {line}\n" for k, line in enumerate(lines[:2])) + "".join(
        f"12:35:00.0{10 * k:02} -> {line}\n" for k, line in enumerate(lines[2:])
    )


def test_the_clock_of_a_capture_is_a_column_of_its_own_behind_the_others(tmp_path: Path) -> None:
    recording = loaded(tmp_path, captured(["5,1,0", "6,2,0", "7,3,0"]), "log.txt")

    assert list(columns(recording)) == ["column_1", "column_2", "column_3", "capture_time"]
    assert columns(recording)["column_1"] == [5.0, 6.0, 7.0]
    assert recording["column_2"].t is not None
    assert np.allclose(recording["column_2"].t, [0.0, 0.01, 0.02])


def test_the_clock_in_front_of_names_is_no_part_of_the_first_name(tmp_path: Path) -> None:
    recording = loaded(tmp_path, captured(["pwm,counts", "6,2", "7,3"]), "log.txt")

    assert list(columns(recording)) == ["pwm", "counts", "capture_time"]


@pytest.mark.parametrize(("name", "times"), [("t_ms", [0.0, 0.02]), ("time", None)])
def test_the_boards_own_times_come_before_the_clock_where_their_unit_is_known(
    name: str, times: list[float] | None, tmp_path: Path
) -> None:
    recording = loaded(tmp_path, captured([f"{name},u", "0,2", "20,3"]), "log.txt")

    t = recording["u"].t
    assert (None if t is None else t.tolist()) == times
    assert ("time-ambiguous" in codes(recording.findings)) == (times is None)


def test_the_clock_goes_with_values_that_have_names(tmp_path: Path) -> None:
    recording = loaded(tmp_path, captured(["u: 1 y: 4", "u: 2 y: 5", "u: 3 y: 6"]), "log.txt")

    assert columns(recording)["y"] == [4.0, 5.0, 6.0]
    assert list(columns(recording)) == ["u", "y", "capture_time"]


FRAMED = {
    "tuples": "t,u,y\n" + "".join(f"({row})\n" for row in ROWS),
    "lists": "t,u,y\n" + "".join(f"[{row}],\n" for row in ROWS),
    "a list of lists": "t,u,y\n[[" + "],\n [".join(ROWS) + "]]\n",
    "Markdown": "| t | u | y |\n|---|:-:|--:|\n" + "".join(f"| {row.replace(',', ' |')} |\n" for row in ROWS),
    "MATLAB's table": "    t     u     y\n    __    __    _\n\n" + "\n".join(ROWS).replace(",", "  "),
    "ends of lines": "t,u,y\n" + "".join(f"{row};\n" for row in ROWS),
    "ends of a matrix's rows": "t u y\n" + "".join(f"{row.replace(',', ' ')};\n" for row in ROWS),
    "commas behind blanks": "t u y\n" + "".join(f"{row.replace(',', ' ')},\n" for row in ROWS),
    "a matrix with semicolons": "t u y\ndata = ["
    + ";\n".join(row.replace(",", " ") for row in ROWS)
    + "];\n",
    "a matrix of a script": "t u y\ndata = [" + ",\n".join(row.replace(",", " ") for row in ROWS) + "];\n",
    "a matrix below its name": "t u y\ndata = [\n"
    + ",\n".join(row.replace(",", " ") for row in ROWS)
    + "];\n",
    "underlined": "t;u;y\n-----\n" + "\n".join(ROWS).replace(",", ";"),
}


@pytest.mark.parametrize("frame", FRAMED)
def test_what_frames_rows_or_underlines_names_is_no_part_of_the_table(frame: str, tmp_path: Path) -> None:
    assert columns(loaded(tmp_path, FRAMED[frame].replace("__ ", "___ "), "log.txt")) == NUMBERS


WAYS = [("F", "N", "R"), ("fwd", "stop", "rev"), ("CW", "", "CCW")]


@pytest.mark.parametrize("words", WAYS, ids=["letters", "short", "clockwise"])
def test_words_for_a_direction_are_the_sign_of_a_duty(words: tuple[str, str, str], tmp_path: Path) -> None:
    ways = [0, 0, 2, 2, 1, 0]
    recording = loaded(
        tmp_path, "t,pwm,dir\n" + "".join(f"{n},{n},{words[way]}\n" for n, way in enumerate(ways)), "log.txt"
    )

    assert columns(recording)["dir"] == [1.0, 1.0, -1.0, -1.0, 0.0, 1.0]
    assert f"{words[2]!r} is read as −1" in finding(recording.findings, "direction-words").sentence


@pytest.mark.parametrize("words", [("F", "X"), ("N", "N"), ("F", "N")])
def test_words_for_no_way_or_for_something_else_are_no_signs(words: tuple[str, str], tmp_path: Path) -> None:
    recording = loaded(tmp_path, "t,dir\n" + "".join(f"{n},{words[n % 2]}\n" for n in range(6)), "log.txt")

    assert "column-skipped" in [each.code for each in recording.findings]


@pytest.mark.parametrize(("word", "sign"), [("F", 1.0), ("CCW", -1.0)])
def test_words_for_one_way_are_the_sign_of_a_duty_in_a_file_of_one_direction(
    word: str, sign: float, tmp_path: Path
) -> None:
    recording = loaded(tmp_path, "t,dir\n" + "".join(f"{n},{word}\n" for n in range(6)), "log.txt")

    assert columns(recording)["dir"] == 6 * [sign]


def test_a_semicolon_behind_a_decimal_comma_is_a_separator(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "y\n" + "".join(f"{n},5;\n" for n in range(5)), "log.txt")

    assert columns(recording) == {"y": [0.5, 1.5, 2.5, 3.5, 4.5]}


def test_dashes_below_numbers_are_a_row_without_a_number_and_no_line(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "t u\n0 1\n1 2\n--- ---\n3 4\n", "log.txt")

    assert finding(recording.findings, "row-without-numbers").rows == (4, 4)


FACTOR = "x =\n\n   1.0e+03 *\n\n    0.0010    0.0500\n    0.0020    0.0600\n"


def test_the_common_factor_of_a_display_is_applied_and_named(tmp_path: Path) -> None:
    recording = loaded(tmp_path, FACTOR, "log.txt")

    assert np.allclose(recording["column_1"].values, [1.0, 2.0])
    assert np.allclose(recording["column_2"].values, [50.0, 60.0])
    assert "multiplied by 1000" in finding(recording.findings, "common-factor").sentence
    assert finding(recording.findings, "common-factor").rows == (3, 3)


def test_two_common_factors_are_an_error_that_names_their_rows(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="rows 3 and 9 both give a common factor"):
        loaded(tmp_path, FACTOR + FACTOR, "log.txt")


RUNS = "--- run 1 ---\nt_ms,u\n0,1\n10,2\n{between}t_ms,u\n0,3\n10,4\n"


@pytest.mark.parametrize("between", ["", "\n", "\n--- run 2 ---\n", "run 2,started\n"])
def test_repeated_names_between_runs_are_no_evidence_against_them(between: str, tmp_path: Path) -> None:
    from servobench.recordings.formats.base import load

    path = tmp_path / "log.txt"
    path.write_text(RUNS.format(between=between))
    first, second = load(path)

    assert columns(second) == {"t_ms": [0.0, 10.0], "u": [3.0, 4.0]}
    assert finding(first.findings, "header-repeated").severity is Severity.INFO
    assert all(each.severity is Severity.INFO for each in first.findings)


def test_a_row_of_words_among_the_numbers_is_a_lost_sample(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "t,u\n0,1\nfail,fail\n2,3\n", "log.csv")

    assert finding(recording.findings, "row-without-numbers").severity is Severity.WARNING


def test_columns_without_a_name_are_called_by_their_number_in_findings(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "t,u,\n0,1,\n0.1,,4\n0.2,2,\n", "log.csv")

    assert "in `u` and `column_3`" in finding(recording.findings, "cell-empty").sentence


def scope(header: str, rows: str = "0,1.5,0.25,,\n1,3.0,0.50,,\n2,-3.0,0.75,,\n") -> str:
    return f"{header},Start,Increment,\nSequence,Volt,Volt,-1.000000e+00,2.000000e-02\n{rows}"


def test_an_oscilloscopes_start_and_increment_are_its_times(tmp_path: Path) -> None:
    recording = loaded(tmp_path, scope("X,CH1,CH2"))

    assert columns(recording) == {
        "t": [-1.0, -0.98, -0.96],
        "CH1": [1.5, 3.0, -3.0],
        "CH2": [0.25, 0.5, 0.75],
    }
    assert units(recording) == {"t": "s", "CH1": "V", "CH2": "V"}
    assert recording["CH1"].t is not None
    assert recording["CH1"].t.tolist() == [-1.0, -0.98, -0.96]
    assert (
        "start of −1 s and an increment of 0.02 s"
        in finding(recording.findings, "start-and-increment").sentence
    )


def test_a_cell_that_an_oscilloscope_left_empty_is_told_by_its_row_in_the_file(tmp_path: Path) -> None:
    recording = loaded(tmp_path, scope("X,CH1,CH2", "0,1.5,0.25,,\n1,,0.50,,\n2,-3.0,0.75,,\n"))

    assert finding(recording.findings, "cell-empty").rows == (4, 4)


def test_an_oscilloscopes_start_and_increment_are_told_by_their_rows(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "# bench 3\n\n" + scope("X,CH1,CH2"))

    assert finding(recording.findings, "start-and-increment").rows == (3, 4)


@pytest.mark.parametrize(
    "text",
    [
        scope("X,CH1,CH2").replace("2.000000e-02", "0"),
        scope("X,CH1,CH2").replace("Increment", "Duration"),
        scope("CH2").replace("Volt,Volt", "Volt"),
    ],
    ids=["no increment", "another name", "no channel for a column"],
)
def test_other_lines_above_a_table_are_no_times(text: str, tmp_path: Path) -> None:
    assert "start-and-increment" not in codes(loaded(tmp_path, text).findings)


def test_frames_are_taken_off_where_more_than_half_of_the_rows_have_them() -> None:
    half = ["(0.0, 1)", "(0.1, 2)", "0.2, 3", "0.3, 4"]
    more = [*half, "(0.4, 5)"]

    assert without_frames(half, half) == half
    assert without_frames(more, more) == ["0.0, 1", "0.1, 2", "0.2, 3", "0.3, 4", "0.4, 5"]
