"""LabVIEW measurement files, written by hand after the specification."""

from pathlib import Path

import numpy as np
import pytest

from servobench.core.errors import FormatError, UsageError
from servobench.recordings.formats.base import load, save
from tests.recordings.formats.tables import codes, columns, finding, loaded, units
from tests.recordings.native.samples import small

HEAD = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t{point}\n"
    "Multi_Headings\t{several}\nX_Columns\t{x}\nTime_Pref\tRelative\nOperator\tsomebody\nDate\t2024/05/17\nTime\t09:30:00\n"
    "***End_of_Header***\t\n\t\n"
)
CHANNELS = (
    "Channels\t2\t\t\t\nSamples\t{n}\t{n}\t\t\nDate\t2024/05/17\t2024/05/17\t\t\nTime\t{time}\t{time}\t\t\n"
    "Y_Unit_Label\tVolts\tdeg\t\t\nX_Dimension\tTime\tTime\t\t\nX0\t{x0}\t{x0}\t\t\nDelta_X\t{step}\t{step}\t\t\n"
    "***End_of_Header***\t\t\t\t\n"
)


def head(x: str = "No", point: str = ".", several: str = "Yes") -> str:
    return HEAD.format(x=x, point=point, several=several)


def segment(
    rows: str, n: int = 3, time: str = "09:30:00.25", x0: str = "0.0", step: str = "0.5", names: str = ""
) -> str:
    names = names or "X_Value\tu\ty\tComment"
    return CHANNELS.format(n=n, time=time, x0=x0, step=step) + names + "\n" + rows


ROWS = "\t1.5\t10\tgo\n\t-1.5\t20\n\t0\t30\n"


def test_without_x_columns_times_come_from_x0_and_delta_x(tmp_path: Path) -> None:
    recording = loaded(tmp_path, head() + segment(ROWS, x0="0.25"), "a.lvm")

    assert recording.name == "a"
    assert columns(recording) == {"u": [1.5, -1.5, 0.0], "y": [10.0, 20.0, 30.0]}
    assert units(recording) == {"u": "Volts", "y": "deg"}
    assert recording["y"].t is not None
    assert recording["y"].t.tolist() == [0.25, 0.75, 1.25]
    assert recording.findings == ()


def test_one_x_column_is_that_of_every_channel(tmp_path: Path) -> None:
    rows = "0.0\t1.5\t10\tgo\n0.4\t-1.5\t20\n0.9\t0\t30\n"

    recording = loaded(tmp_path, head("One") + segment(rows), "a.lvm")

    assert columns(recording) == {"u": [1.5, -1.5, 0.0], "y": [10.0, 20.0, 30.0]}
    assert recording["u"].t is not None
    assert recording["u"].t.tolist() == [0.0, 0.4, 0.9]


def test_with_several_x_columns_each_channel_has_its_own_times_and_length(tmp_path: Path) -> None:
    rows = "0.0\t1.5\t0.1\t10\n0.4\t-1.5\t1.1\t20\n0.9\t0\t\t\n"
    text = head("Multi") + segment(rows, names="X_Value\tu\tX_Value\ty\tComment")

    recording = loaded(tmp_path, text.replace("Samples\t3\t3", "Samples\t3\t2"), "a.lvm")

    assert columns(recording) == {"u": [1.5, -1.5, 0.0], "y": [10.0, 20.0]}
    assert recording["u"].t is not None
    assert recording["y"].t is not None
    assert recording["u"].t.tolist() == [0.0, 0.4, 0.9]
    assert recording["y"].t.tolist() == [0.1, 1.1]


def test_a_decimal_comma_is_one_in_the_headers_too(tmp_path: Path) -> None:
    text = head(point=",") + segment(
        "\t1,5\t10\n\t-1,5\t20\n\t0\t30\n", time="09:30:00,25", x0="0,25", step="0,5"
    )

    recording = loaded(tmp_path, text, "a.lvm")

    assert columns(recording) == {"u": [1.5, -1.5, 0.0], "y": [10.0, 20.0, 30.0]}
    assert recording["y"].t is not None
    assert recording["y"].t.tolist() == [0.25, 0.75, 1.25]


def test_commas_may_separate(tmp_path: Path) -> None:
    text = (head("One") + segment("0.0\t1.5\t10\n0.5\t2.5\t20\n", n=2)).replace(
        "Separator\tTab", "Separator\tComma"
    )

    recording = loaded(tmp_path, text.replace("\t", ","), "a.lvm")

    assert columns(recording) == {"u": [1.5, 2.5], "y": [10.0, 20.0]}


@pytest.mark.parametrize(
    ("time", "x0"),
    [("09:30:00.25", "1.5"), ("09:30:01.75", "0.0"), ("09:30:02.2", "0.0")],
    ids=["by X0", "by the clock", "by the clock, a little late"],
)
def test_segments_that_go_on_are_one_recording(time: str, x0: str, tmp_path: Path) -> None:
    recording = loaded(tmp_path, head() + segment(ROWS) + "\t\n" + segment(ROWS, time=time, x0=x0), "a.lvm")

    later = 1.95 if time == "09:30:02.2" else 1.5
    assert recording["u"].values.tolist() == 2 * [1.5, -1.5, 0.0]
    assert recording["u"].t is not None
    assert recording["u"].t == pytest.approx([0.0, 0.5, 1.0, later, later + 0.5, later + 1.0], abs=1e-9)
    assert "segments-joined" in codes(recording.findings)


@pytest.mark.parametrize(
    "time", ["09:30:00.25", "09:29:00", "09:45:00"], ids=["again", "before", "long after"]
)
def test_segments_that_do_not_go_on_are_several_recordings(time: str, tmp_path: Path) -> None:
    path = tmp_path / "a.lvm"
    path.write_text(head() + segment(ROWS) + "\n" + segment(ROWS, time=time))

    found = load(path)

    assert [each.name for each in found] == ["a 1", "a 2"]
    assert [each["u"].values.tolist() for each in found] == 2 * [[1.5, -1.5, 0.0]]
    assert (
        "are 2 recordings, which begin in rows `24`, `38`"
        in finding(found[0].findings, "segments-apart").sentence
    )


def test_channels_that_begin_at_different_times_do_so_in_the_recording(tmp_path: Path) -> None:
    text = head() + segment(ROWS).replace("09:30:00.25\t09:30:00.25", "09:30:00.25\t09:30:00.35")

    recording = loaded(tmp_path, text, "a.lvm")

    assert recording["u"].t is not None
    assert recording["y"].t is not None
    assert (recording["y"].t - recording["u"].t) == pytest.approx([0.1, 0.1, 0.1], abs=1e-12)


def test_special_blocks_are_skipped(tmp_path: Path) -> None:
    special = "***Start_Special***\nSpectra\t1\n***End_of_Header***\nX_Value\tz\n0\t1\n***End_Special***\n"

    recording = loaded(tmp_path, head() + special + segment(ROWS), "a.lvm")

    assert columns(recording) == {"u": [1.5, -1.5, 0.0], "y": [10.0, 20.0, 30.0]}


def test_cells_that_are_no_numbers_are_nan_and_reported_with_their_rows(tmp_path: Path) -> None:
    recording = loaded(tmp_path, head() + segment("\t1.5\t10\n\tx\t20\n\t0\t30\n"), "a.lvm")

    assert np.isnan(recording["u"].values).tolist() == [False, True, False]
    assert finding(recording.findings, "cell-not-a-number").rows == (25, 25)


def test_fewer_samples_than_the_header_says_are_reported(tmp_path: Path) -> None:
    recording = loaded(tmp_path, head() + segment(ROWS, n=5), "a.lvm")

    assert [each.code for each in recording.findings] == 2 * ["samples-missing"]


def test_no_increment_gives_no_times(tmp_path: Path) -> None:
    recording = loaded(tmp_path, head() + segment(ROWS, step="0"), "a.lvm")

    assert recording["u"].t is None


def test_it_is_known_by_its_content(tmp_path: Path) -> None:
    recording = loaded(tmp_path, head() + segment(ROWS), "a.txt")

    assert recording.source.format == "lvm"
    assert "format-by-content" in codes(recording.findings)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("LabVIEW Measurement\t\nSeparator\tTab\n", "lacks a header that ends in"),
        (head(), r"no segment: a second \*\*\*End_of_Header\*\*\* is missing"),
        (head("Two") + segment(ROWS), "X_Columns 'Two'; expected"),
        (head() + segment("", names="X_Value\t\t"), "names no channels"),
        (head() + segment(""), "no channels with numbers"),
    ],
)
def test_what_cannot_be_read_is_reported(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=f"a.lvm.*{message}"):
        loaded(tmp_path, text, "a.lvm")


def test_it_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="can't be written"):
        save(small(), tmp_path / "a.lvm")
