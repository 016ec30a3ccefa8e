"""Text tables as people and programs write them."""

import csv
import io
import re
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servobench.core.channels import Channel
from servobench.core.errors import FormatError, UnknownName, UsageError
from servobench.core.finding import Severity, info
from servobench.recordings.formats import text_table
from servobench.recordings.formats.base import load, save
from servobench.recordings.formats.csv import Csv
from servobench.recordings.formats.mapping import assign
from servobench.recordings.recording import Recording, Series, Source
from tests.recordings.formats.tables import codes, columns, finding, loaded, units
from tests.recordings.native.samples import small

NUMBERS = {"t": [0.0, 0.02, 0.04], "u": [1.5, 1.5, -2.0], "y": [0.25, 1e3, -7.0]}

LAYOUTS = {
    "comma": "t,u,y\n0,1.5,.25\n0.02,1.5,1e3\n0.04,-2.,-7\n",
    "comma and blank": "t, u, y\n0, 1.5, 0.25\n0.02, 1.5, 1E+3\n0.04, -2, -7\n",
    "semicolon": "t;u;y\n0;1.5;0.25\n0.02;1.5;1000\n0.04;-2;-7\n",
    "tab": "t\tu\ty\n0\t1.5\t0.25\n0.02\t1.5\t1000\n0.04\t-2\t-7\n",
    "bar": "t|u|y\n0|1.5|0.25\n0.02|1.5|1000\n0.04|-2|-7\n",
    "blanks": "   t     u      y\n   0   1.5   0.25\n0.02   1.5   1000\n0.04    -2     -7\n",
    "blanks and tabs": "t u\ty\n0 1.5\t0.25\n0.02 1.5\t1000\n0.04 -2\t-7\n",
    "decimal comma and semicolon": "t;u;y\n0,00;1,5;0,25\n0,02;1,5;1000\n0,04;-2,0;-7\n",
    "decimal comma and tab": "t\tu\ty\n0,00\t1,5\t0,25\n0,02\t1,5\t1e3\n0,04\t-2,0\t-7\n",
    "decimal comma and blank": "t u y\n0,00 1,5 0,25\n0,02 1,5 1000\n0,04 -2,0 -7\n",
    "decimal comma in quotes": '"t","u","y"\n"0,00","1,5","0,25"\n"0,02","1,5","1000"\n"0,04","-2","-7"\n',
    "quotes": '"t","u","y"\n"0","1.5","0.25"\n"0.02","1.5","1000"\n"0.04","-2","-7"\n',
    "Windows": "t,u,y\r\n0,1.5,0.25\r\n0.02,1.5,1000\r\n0.04,-2,-7\r\n",
    "old Macintosh": "t,u,y\r0,1.5,0.25\r0.02,1.5,1000\r0.04,-2,-7\r",
    "no newline at the end": "t,u,y\n0,1.5,0.25\n0.02,1.5,1000\n0.04,-2,-7",
    "separator at the end of the rows": "t,u,y\n0,1.5,0.25,\n0.02,1.5,1000,\n0.04,-2,-7,\n",
    "separators at the end of all": "t,u,y,,\n0,1.5,0.25,,\n0.02,1.5,1000,,\n0.04,-2,-7,,\n",
    "Excel's first row": "sep=;\nt;u;y\n0;1.5;0.25\n0.02;1.5;1000\n0.04;-2;-7\n",
    "header in a comment": "# t,u,y\n0,1.5,0.25\n0.02,1.5,1000\n0.04,-2,-7\n",
    "header of numpy.savetxt": "# t u y\n0 1.5 0.25\n0.02 1.5 1000\n0.04 -2 -7\n",
    "header of MATLAB": "% made by hand\n% t u y\n0\t1.5\t0.25\n0.02\t1.5\t1000\n0.04\t-2\t-7\n",
    "comments": "// made by\n; a rig\nt,u,y\n0,1.5,0.25\n# tick\n0.02,1.5,1000\n%\n0.04,-2,-7\n",
    "lines above the header": "My logger, version 2\nRate,500\n\nt,u,y\n0,1.5,0.25\n0.02,1.5,1000\n0.04,-2,-7\n",
    "byte order mark": "\ufefft,u,y\n0,1.5,0.25\n0.02,1.5,1000\n0.04,-2,-7\n",
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_table_is_read_however_it_is_laid_out(layout: str, tmp_path: Path) -> None:
    assert columns(loaded(tmp_path, LAYOUTS[layout])) == NUMBERS


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"])
def test_a_table_is_read_however_its_letters_are_encoded(encoding: str, tmp_path: Path) -> None:
    mark = {"utf-16-le": b"\xff\xfe", "utf-16-be": b"\xfe\xff"}.get(encoding, b"")

    recording = loaded(tmp_path, mark + "t,µ [°/s]\n0,1\n1,2\n".encode(encoding))

    assert units(recording) == {"t": None, "µ": "°/s"}
    assert ("encoding-latin-1" in codes(recording.findings)) == (encoding == "latin-1")


@pytest.mark.parametrize("unit_row", ["s,V,rad/s", "[s],[V],[rad/s]", "(s), (V), (rad/s)", "s,V,rad/s,"])
def test_a_row_of_units_below_the_header_is_no_row_of_numbers(unit_row: str, tmp_path: Path) -> None:
    recording = loaded(tmp_path, f"time,u,omega\n{unit_row}\n0,1,2\n0.1,3,4\n")

    assert units(recording) == {"time": "s", "u": "V", "omega": "rad/s"}
    assert columns(recording)["u"] == [1.0, 3.0]


def test_units_stand_in_the_header_in_many_ways(tmp_path: Path) -> None:
    header = 'Time (ms),"speed, filtered [rad/s]",u / V,y in deg,x_mm,theta_deg,i [foo],gain [-],control_pct'
    recording = loaded(tmp_path, f"{header}\n0,1,2,3,4,5,6,7,8\n1,1,2,3,4,5,6,7,8\n")

    assert units(recording) == {
        "Time": "ms",
        "speed, filtered": "rad/s",
        "u": "V",
        "y": "deg",
        "x_mm": None,
        "theta_deg": "deg",
        "i [foo]": None,
        "gain": "1",
        "control_pct": "%",
    }
    assert recording["u"].t is not None
    assert recording["u"].t.tolist() == [0.0, 0.001]


@pytest.mark.parametrize("entry", ["% 1 \t{}", "# column 1: {}", "% 0) {}"])
def test_comments_that_number_the_columns_name_them(entry: str, tmp_path: Path) -> None:
    """Four words of a comment had become the names of four columns, and the speed was the `voltage`."""
    names = [
        "Time (sec)",
        "Reference for left motor (m/s)",
        "Measured velocity (m/s)",
        "Motor voltage output (V)",
    ]
    first = int(re.search(r"\d", entry)[0])  # type: ignore[index]
    lines = [entry.replace(str(first), str(first + k)).format(name) for k, name in enumerate(names)]
    text = "\n".join(
        [
            "% Log of motor 1",
            *lines,
            "% PID parameters",
            "%  Kp = 7",
            *(f"{t} 0 0.1 -1.5" for t in (0.0, 0.1)),
        ]
    )

    recording = loaded(tmp_path, f"{text}\n")

    assert units(recording) == {
        "Time": "sec", "Reference for left motor": "m/s", "Measured velocity": "m/s", "Motor voltage output": "V"
    }  # fmt: skip
    assert columns(recording)["Motor voltage output"] == [-1.5, -1.5]
    assert "header-in-comment" in codes(recording.findings)


def test_a_numbered_comment_among_too_few_names_no_column(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "% 4 Motor voltage output (V)\n0.0 0 0.1 -1.5\n0.1 0 0.1 -1.5\n")

    assert list(columns(recording)) == ["column_1", "column_2", "column_3", "column_4"]


def test_without_a_header_columns_are_numbered_and_a_finding_says_so(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "0.0,1,2\n0.1,3,4\n")

    assert columns(recording) == {"column_1": [0.0, 0.1], "column_2": [1.0, 3.0], "column_3": [2.0, 4.0]}
    assert codes(recording.findings) == ["header-missing"]
    assert recording["column_1"].t is None


def test_names_that_stand_twice_or_not_at_all_are_told_apart(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "y,y,,y_2\n1,2,3,4\n5,6,7,8\n")

    assert list(columns(recording)) == ["y", "y_2_", "column_3", "y_2"]
    assert {"name-duplicate", "name-missing"} <= set(codes(recording.findings))


def test_a_header_that_does_not_fit_is_not_used_and_a_warning_says_so(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "t u y\n1 0.0 1 2\n2 0.1 1 3\n")

    assert list(columns(recording)) == ["column_1", "column_2", "column_3", "column_4"]
    assert finding(recording.findings, "header-mismatch").severity is Severity.WARNING
    assert finding(recording.findings, "header-mismatch").rows == (1, 1)


def test_whoever_asks_for_a_name_of_such_a_header_hears_why_there_is_none(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "t u y\n1 0.0 1 2\n2 0.1 1 3\n")

    with pytest.raises(UnknownName, match=r"column_4\. Row 1 .* has 3 cells and the rows of numbers 4"):
        assign(recording, input="u:V", output="y:rad/s")


def test_columns_that_are_said_by_number_need_no_names(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "Time,data\n0.0,1,2,3\n0.1,1,3,4\n0.2,1,4,5\n")

    assigned = assign(recording, time="1:s", input="2:V", output="3:rad")

    assert finding(assigned.findings, "header-mismatch").severity is Severity.INFO


def test_names_above_what_a_program_said_before_the_numbers_are_found(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "t,u,y\nlogging began, 20 ms a row\n0,1,2\n0.02,1,3\n")

    assert list(columns(recording)) == ["t", "u", "y"]
    assert finding(recording.findings, "preamble-skipped").rows == (2, 2)


DAMAGED = """\
t,u,y

0.0,1,2
0.1,1
0.2,1,3,4
0.3,,5
0.4,off,6

0.5,NaN,7
t,u,y
0.6,1,8
"""


def test_each_thing_that_is_wrong_is_reported_with_the_rows_of_the_file(tmp_path: Path) -> None:
    recording = loaded(tmp_path, DAMAGED)

    assert columns(recording)["t"] == [0.0, 0.3, 0.4, 0.5, 0.6]
    assert recording["y"].values.tolist() == [2.0, 5.0, 6.0, 7.0, 8.0]
    assert np.isnan(recording["u"].values[1:4]).all()
    rows = {each.code: each.rows for each in recording.findings if each.rows is not None}
    assert rows == {
        "rows-blank": (8, 8),
        "row-short": (4, 4),
        "row-long": (5, 5),
        "cell-empty": (6, 6),
        "cell-not-a-number": (7, 7),
        "header-repeated": (10, 10),
        "time-gap": (6, 6),
        "cell-nan": (9, 9),
    }
    assert "'off'" in finding(recording.findings, "cell-not-a-number").sentence
    assert finding(recording.findings, "row-short").severity is Severity.WARNING
    assert "in `u`" in finding(recording.findings, "cell-nan").sentence


def test_a_column_of_words_is_no_column_of_wrong_cells(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "t,y,direction\n" + "".join(f"{k / 100},{k},up\n" for k in range(50)))

    (sentence,) = [each.sentence for each in recording.findings if each.code != "time-recognised"]
    assert sentence == "`direction` holds text, such as 'up', and no number."
    assert np.isfinite(recording["y"].values).all()


def test_many_wrong_rows_make_one_finding(tmp_path: Path) -> None:
    rows = "".join(f"{k / 100},{k if k % 5 == 0 else ''},{k % 3}\n" for k in range(20000))

    recording = loaded(tmp_path, "t,y,u\n" + rows)

    assert codes(recording.findings) == ["cell-empty", "time-recognised"]
    assert finding(recording.findings, "cell-empty").rows == (3, 20001)
    assert "16000 rows" in finding(recording.findings, "cell-empty").sentence
    assert np.isfinite(recording["y"].values).sum() == 4000


def test_times_that_do_not_increase_are_reported_with_the_rows_of_the_file(tmp_path: Path) -> None:
    t = [0.0, 0.1, 0.1, 0.3, 0.2, 0.4, 0.5, 0.6, 0.7, 5.0]
    recording = loaded(tmp_path, "t,u\n" + "".join(f"{each},1\n" for each in t))

    assert finding(recording.findings, "time-duplicate").rows == (4, 4)
    assert finding(recording.findings, "time-not-increasing").rows == (6, 6)
    assert finding(recording.findings, "time-gap").rows == (11, 11)
    assert recording["u"].t is not None
    assert recording["u"].t.tolist() == t


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("1,2\n3,4\n5,6\n", "two whole numbers or one with a decimal comma"),
        ("1,2\n3,x\n5,6\n", "two whole numbers or one with a decimal comma"),
        ("1,5E+02\n1,6E+02\n", "two whole numbers or one with a decimal comma"),
        ("1,234;5,678\n2,345;6,789\n", "may be a decimal mark, or group thousands"),
        ("t,u\n0,02,0,43\n0,04,0,44\n", "both separator and decimal mark"),
        ("t,u,y\n", "no rows of numbers, only text such as 't,u,y'"),
        ("\n  \n\n", "no rows"),
        ("# only\n# comments\n", "no rows"),
        ("hello world\nthis is a letter\n", "no rows of numbers"),
        (bytes(range(256)) * 8, "isn't a text file"),
        (b"\xff\xfe\x00", "isn't a text file"),
        (",".join("0" * 1001) + "\n", "1001 columns"),
    ],
)
def test_what_can_be_read_in_two_ways_or_in_none_is_an_error_that_says_why(
    content: str | bytes, why: str, tmp_path: Path
) -> None:
    with pytest.raises(FormatError, match=why):
        loaded(tmp_path, content)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("u,y\n1,2\n3,4\n", {"u": [1.0, 3.0], "y": [2.0, 4.0]}),
        ("y\n1,2\n3,4\n", {"y": [1.2, 3.4]}),
        ("1,02\n3,40\n", {"column_1": [1.02, 3.4]}),  # nobody writes a whole number with a zero before it
        ("1,-2\n3,4\n", {"column_1": [1.0, 3.0], "column_2": [-2.0, 4.0]}),
        ("1,234;5,67\n", {"column_1": [1.234], "column_2": [5.67]}),  # no thousands have two digits
        ("0,123;4,567\n", {"column_1": [0.123], "column_2": [4.567]}),  # nor begin with a zero
    ],
)
def test_a_comma_that_one_rule_decides_is_not_asked_about(
    content: str, expected: dict[str, list[float]], tmp_path: Path
) -> None:
    assert columns(loaded(tmp_path, content)) == expected


def test_separator_and_decimal_mark_can_be_said_in_python(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("1,234;5,678\n2,345;6,789\n")

    (recording,) = Csv(decimal=",").read(path)

    assert columns(recording) == {"column_1": [1.234, 2.345], "column_2": [5.678, 6.789]}


def test_noise_of_a_serial_line_costs_the_names_it_hits_and_no_control_character_stays(
    tmp_path: Path,
) -> None:
    recording = loaded(tmp_path, b"\x00\xfe\x1b[2Jt,u\n" + b"0,1\n" * 200 + b"\x00\xff,2\n")

    assert len(recording["u"].values) == 201
    assert all(name.isprintable() for name in columns(recording))
    assert finding(recording.findings, "cell-not-a-number").rows == (202, 202)


table = st.integers(1, 4).flatmap(
    lambda width: st.lists(
        st.lists(st.floats(allow_nan=False), min_size=width, max_size=width), min_size=1, max_size=8
    )
)


@given(rows=table, separator=st.sampled_from([";", "\t", " ", "|"]), comma=st.booleans())
def test_any_numbers_come_out_as_they_were_written(
    rows: list[list[float]], separator: str, comma: bool
) -> None:
    lines = [separator.join(map(repr, row)) for row in rows]
    names = separator.join(f"name{k}" for k in range(len(rows[0])))
    text = "\n".join([names, *lines])

    read = text_table.parse(text.replace(".", ",") if comma else text, "x", decimal="," if comma else None)

    assert read.values.tolist() == rows
    assert [each.name for each in read.headings] == names.split(separator)


def test_a_table_of_numpy_comes_out_as_numpy_reads_it(tmp_path: Path) -> None:
    values = np.random.default_rng(3).normal(size=(1000, 5))
    text = io.StringIO()
    np.savetxt(text, values, delimiter=";", header="a;b;c;d;e")

    recording = loaded(tmp_path, text.getvalue(), "log.dat")

    expected = np.loadtxt(io.StringIO(text.getvalue()), delimiter=";")
    assert np.array_equal(np.column_stack([series.values for series in recording.series]), expected)


def test_half_a_million_rows_with_a_damaged_one_are_read_in_seconds(tmp_path: Path) -> None:
    lines = [f"{k * 0.002:.3f},{k % 7},{k * 1.1:.6f}\n" for k in range(500_000)]
    lines[400_000] = "800.0,#,#\n"
    begin = time.perf_counter()

    recording = loaded(tmp_path, "t,u,y\n" + "".join(lines))

    # Measured: 0.5 s; the limit catches what grows faster than the file, on a machine that is busy with other things.
    assert time.perf_counter() - begin < 10.0
    assert len(recording["y"].values) == 500_000
    assert finding(recording.findings, "cell-not-a-number").rows == (400_002, 400_002)


def test_our_own_table_says_what_it_is_to_people_and_other_programs(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    save(small(), path)
    first, names, *rows = path.read_text().splitlines()

    assert first.startswith("# servobench.recording/1 {")
    assert names == "t [s],applied [V],counts [V],notes [V]"
    assert rows == ["0.0,1.0,0.0,nan", "0.002,2.0,7.0,-1.0", "0.004,3.0,14.0,"]
    assert np.genfromtxt(path, delimiter=",", skip_header=2)[:, 1].tolist() == [1.0, 2.0, 3.0]


def test_our_own_table_without_its_first_line_is_a_foreign_one(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    save(small(), path)
    recording = loaded(tmp_path, path.read_text().partition("\n")[2])

    assert columns(recording)["applied"] == [1.0, 2.0, 3.0]
    assert recording["applied"].t is not None


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text[:-1].rpartition("\n")[0] + "\n",  # a row less
        lambda text: text + "1,2,3,4\n",
        lambda text: text.replace("7.0", "seven"),
        lambda text: text.replace("14.0,", "14.0,3"),
        lambda text: text.replace("2.0", ""),
        lambda text: text.replace('"rows": 3', '"rows": 2'),
        lambda text: text.replace('"timed"', '"time"'),
        lambda text: text.replace('"unit": "V"', '"unit": []', 1),
        lambda text: text.replace("{", "[", 1),
    ],
)
def test_our_own_table_that_was_changed_is_an_error_and_not_another_recording(
    change: Callable[[str], str], tmp_path: Path
) -> None:
    path = tmp_path / "run.csv"
    save(small(), path)
    changed = change(path.read_text())
    assert changed != path.read_text()

    with pytest.raises(FormatError, match=r"run\.csv"):
        loaded(tmp_path, changed, "run.csv")


def test_numbers_of_numpy_in_what_a_recording_knows_are_numbers(tmp_path: Path) -> None:
    channel = Channel(name="y", unit="counts", counter_bits=int(np.int64(24)), minimum=np.float64(0.5))
    told = info("example", "of rows", rows=(np.int64(1), np.int64(2)))  # type: ignore[arg-type]
    recording = Recording(
        name="run",
        series=(Series(channel=channel, values=np.arange(3.0), t=None),),
        source=Source(name="rig"),
        findings=(told,),
    )
    save(recording, tmp_path / "a.csv")

    (back,) = load(tmp_path / "a.csv")

    assert back.findings == (told,)
    assert back["y"].channel == channel


def cells_of_texts(path: Path) -> list[str]:
    """All cells of the lines with texts, as spreadsheets with different separators part them."""
    lines = path.read_text(encoding="utf-8").splitlines()[:2]
    return [
        cell
        for separator in ",;\t|"
        for blanks_are_skipped in (False, True)
        for row in csv.reader(lines, delimiter=separator, skipinitialspace=blanks_are_skipped)
        for cell in row
    ]


FORMULAS = [
    "=1+1",
    "+1",
    "-1+1",
    "@SUM(A1)",
    " =2*3",
    "a,=1+1",
    "b; @x",
    'c "=1"',
    "d\t-9+9",
    "e|+2",
    "f', '=3",
]


def test_no_text_of_a_recording_becomes_a_formula_in_a_spreadsheet(tmp_path: Path) -> None:
    shown = (f"{text} {number}" for number in range(20) for text in FORMULAS)
    series = tuple(
        Series(channel=Channel(name=next(shown), unit=text), values=np.arange(3.0), t=None)
        for text in FORMULAS
    )
    recording = Recording(
        name="=name",
        series=series,
        source=Source(name="@source"),
        experiment="notes = \"=cmd|' /C calc'!A0\"\n+1\n\t=2\n",
        findings=tuple(info("example", next(shown)) for _ in FORMULAS),
    )
    save(recording, tmp_path / "a.csv")

    dangerous = [cell for cell in cells_of_texts(tmp_path / "a.csv") if cell.strip()[:1] in set("=+-@")]
    assert dangerous == []
    (back,) = load(tmp_path / "a.csv")  # nothing is lost by it
    assert [each.channel for each in back.series] == [each.channel for each in series]
    assert (back.name, back.experiment, back.findings) == (
        recording.name,
        recording.experiment,
        recording.findings,
    )


def test_more_than_one_recording_has_no_place_in_a_table(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"holds one recording and there are 2; .*\.mcap"):
        save([small("a"), small("b")], tmp_path / "a.csv")


RealData = Callable[[str], Path]


def test_the_teaching_kit_is_read(real_data: RealData) -> None:
    (recording,) = load(real_data("undcmotor/und_DCmotor_prbs_open_exp.csv"))

    assert {name: len(values) for name, values in columns(recording).items()} == {
        "t": 4093,
        "u": 4093,
        "y": 4093,
    }
    assert codes(recording.findings) == ["time-recognised"]
    assert recording["y"].t is not None
    # Written with two decimals, so that steps are right to half of the last digit of a double at 80 s.
    assert np.allclose(np.diff(recording["y"].t), 0.02, atol=1e-13)


def test_names_with_blanks_before_them_are_read(real_data: RealData) -> None:
    (recording,) = load(real_data("qube1_koopman_closedloop/qube_20230828T150615_434_696_394.csv"))

    assert list(columns(recording))[:4] == ["t", "target_theta", "target_alpha", "theta"]
    assert len(recording["plant_input"].values) == 10_000
    assert recording["plant_input"].values[0] == -10.0


def test_half_a_million_rows_of_one_column_are_read_fast(real_data: RealData) -> None:
    begin = time.perf_counter()
    (recording,) = load(real_data("generator_sysidentpy/y_cc.csv"))

    assert time.perf_counter() - begin < 5.0  # measured: 0.2 s
    assert len(recording["column_1"].values) == 500_000
    assert recording["column_1"].values.min() == -143.8


def test_a_table_of_another_kind_of_motor_without_header_is_read(real_data: RealData) -> None:
    (recording,) = load(real_data("hydraulic_valve_motor/MotorRotation.csv"))

    assert {len(values) for values in columns(recording).values()} == {15_246}
    assert codes(recording.findings) == ["header-missing"]


def test_units_in_brackets_below_the_names_are_no_names(tmp_path: Path) -> None:
    table = "%n,volts in,position\n%[#],[V],[turns]\n2,0.5,1\n4,0.5,2\n6,1.0,3\n"
    recording = loaded(tmp_path, table)

    assert list(columns(recording)) == ["n", "volts in", "position"]
    assert [recording[name].channel.unit for name in ("volts in", "position")] == ["V", "turns"]


def test_what_a_program_says_between_its_samples_is_no_doubt(tmp_path: Path) -> None:
    """A line without a number is no sample that was damaged; one with a number in it may be."""
    rows = "".join(f"{k / 100},1,{k}\n" for k in range(20))
    recording = loaded(tmp_path, f"t,u,y\n{rows}>> new setpoint\n0.2,2,20\nDONE\n")

    assert columns(recording)["t"] == pytest.approx([k / 100 for k in range(21)])
    told = finding(recording.findings, "rows-text")
    assert told.severity is Severity.INFO
    assert told.rows == (22, 24)


@pytest.mark.parametrize("ragged", ["0,1\n", "0,1\n0.01,2\n", "0,1,2,3\n"])
def test_a_ragged_row_right_below_the_header_costs_itself_and_not_the_names(
    ragged: str, tmp_path: Path
) -> None:
    recording = loaded(tmp_path, f"t,u [V],y [rad]\n{ragged}0.02,1.5,2\n0.04,1.5,3\n0.06,1.5,4\n")

    assert columns(recording) == {"t": [0.02, 0.04, 0.06], "u": [1.5, 1.5, 1.5], "y": [2.0, 3.0, 4.0]}
    assert recording["u"].channel.unit == "V"
    told = [each for each in recording.findings if each.code in {"row-short", "row-long"}]
    assert [each.severity for each in told] == [Severity.WARNING]
    assert told[0].rows is not None
    assert told[0].rows[0] == 2


def test_a_table_that_lies_on_its_side_is_refused_with_the_way_to_turn_it(tmp_path: Path) -> None:
    upright = np.column_stack([0.01 * np.arange(60), np.ones(60)])

    with pytest.raises(FormatError, match=r"has 2 rows of 60 numbers, as if it lay on its side; .*\.T\)`"):
        loaded(tmp_path, "\n".join(" ".join(map(str, row)) for row in upright.T.tolist()), "log.txt")
    with pytest.raises(FormatError, match=r"loadtxt\(FILE, delimiter=','\)\.T"):
        loaded(tmp_path, "\n".join(",".join(map(str, row)) for row in upright.T.tolist()), "log.csv")
    assert len(loaded(tmp_path, "\n".join(" ".join(map(str, row)) for row in upright.tolist())).series) == 2
