"""Logs of Teleplot."""

from pathlib import Path

import pytest

from servobench.core.errors import FormatError, UsageError
from servobench.recordings.formats.mapping import assign
from servobench.recordings.formats.teleplot import Teleplot
from tests.recordings.formats.tables import columns, finding, loaded, units
from tests.recordings.native.samples import small

LOG = "".join(
    f">duty:{1709642096000 + 10 * k}:{k % 2}\n>speed:{1709642096004 + 10 * k}:{0.5 * k}§rpm|g\n"
    for k in range(30)
)


def test_each_name_is_a_channel_with_times_of_its_own(tmp_path: Path) -> None:
    recording = loaded(tmp_path, LOG, "log.txt")

    assert columns(recording)["speed"][:3] == [0.0, 0.5, 1.0]
    assert units(recording) == {"duty": None, "speed": "rpm"}
    assert recording["speed"].t is not None
    assert recording["speed"].t[:3].tolist() == pytest.approx([0.004, 0.014, 0.024])
    assert assign(recording, input="duty:%").output == "speed"


def test_several_points_in_a_line_are_several_samples(tmp_path: Path) -> None:
    recording = loaded(tmp_path, ">y:0:1;10:2;20:3\n>y:30:4\n>y:40:5\n", "log.txt")

    assert columns(recording)["y"] == [1.0, 2.0, 3.0, 4.0, 5.0]


def test_other_lines_are_reported_with_their_rows(tmp_path: Path) -> None:
    recording = loaded(tmp_path, LOG + "restarting\n", "log.txt")

    assert finding(recording.findings, "rows-text").rows == (61, 61)


def test_a_log_without_times_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    path.write_text(">y:1\n>y:2\n")

    with pytest.raises(FormatError, match="0 names with times and values"):
        Teleplot().read(path)


def test_a_log_of_teleplot_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="can't be written"):
        Teleplot().write((small(),), tmp_path / "log.txt")
