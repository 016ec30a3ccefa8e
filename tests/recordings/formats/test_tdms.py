"""TDMS files as LabVIEW writes them; npTDMS writes the segments that are read here."""

import struct
import sys
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import nptdms
import numpy as np
import pytest

from servobench.core.errors import FormatError, UsageError
from servobench.recordings.formats.base import load, save
from servobench.recordings.recording import Recording
from tests.recordings.formats.tables import codes, columns, finding, units
from tests.recordings.native.samples import small

START = datetime(2024, 5, 17, 9, 30)
U = np.sign(np.sin(0.3 * np.arange(40)))
Y = np.cumsum(U) / 7


def channel(name: str, values: Any, group: str = "run", **properties: Any) -> Any:
    return nptdms.ChannelObject(group, name, values, properties)


def waveform(name: str, values: Any, step: float, group: str = "run", **more: Any) -> Any:
    return channel(name, values, group, wf_increment=step, wf_start_offset=0.0, **more)


def tdms(folder: Path, *segments: Sequence[Any]) -> tuple[Recording, ...]:
    """Write segments with npTDMS and load the recordings that they are."""
    path = folder / "motors.tdms"
    with nptdms.TdmsWriter(path) as writer:
        for segment in segments:
            writer.write_segment(segment)
    return load(path)


def test_many_segments_are_one_channel(tmp_path: Path) -> None:
    segments = [
        [channel("u", U[k : k + 10], unit_string="V"), channel("y", Y[k : k + 10], unit_string="rad")]
        for k in range(0, 40, 10)
    ]

    (recording,) = tdms(tmp_path, *segments)

    assert recording.name == "motors"
    assert columns(recording) == {"u": U.tolist(), "y": Y.tolist()}
    assert units(recording) == {"u": "V", "y": "rad"}
    assert recording["u"].t is None


def test_each_group_is_a_recording(tmp_path: Path) -> None:
    found = tdms(
        tmp_path, [channel("u", U, "left"), channel("y", Y, "left"), channel("u", 2 * U, "right motor")]
    )

    assert [each.name for each in found] == ["left", "right motor"]
    assert columns(found[1]) == {"u": (2 * U).tolist()}


def test_input_and_output_keep_the_times_of_their_own_waveforms(tmp_path: Path) -> None:
    """An output that starts 2 ms later and is sampled at a quarter of the rate: t = start + k·increment, each its own."""
    (recording,) = tdms(
        tmp_path,
        [
            waveform("u", U, 0.001, wf_start_time=START, unit_string="V"),
            waveform("y", Y[:10], 0.004, wf_start_time=START + timedelta(milliseconds=2)),
        ],
    )

    assert recording["u"].t is not None
    assert recording["y"].t is not None
    assert recording["u"].t == pytest.approx(0.001 * np.arange(40), abs=1e-12)
    # npTDMS writes microseconds in 2^-64 s from a float: right to 2^-53 of them.
    assert recording["y"].t == pytest.approx(0.002 + 0.004 * np.arange(10), abs=1e-12)
    assert "differ by up to 0.002 s" in finding(recording.findings, "waveform-times").sentence


def test_a_start_that_nobody_has_set_is_no_start(tmp_path: Path) -> None:
    """LabVIEW writes midnight of 1904-01-01, the zero of its clock, where a waveform has no start time."""
    (recording,) = tdms(
        tmp_path,
        [
            waveform("u", U, 0.5, wf_start_time=datetime(1904, 1, 1)),
            waveform("y", Y, 0.5, wf_start_time=START),
        ],
    )

    assert recording["u"].t is not None
    assert recording["y"].t is not None
    assert recording["u"].t.tolist() == recording["y"].t.tolist() == (0.5 * np.arange(40)).tolist()


@pytest.mark.parametrize("step", [0.0, -0.1, float("nan"), "fast"])
def test_an_increment_that_is_none_gives_no_times(step: Any, tmp_path: Path) -> None:
    (recording,) = tdms(tmp_path, [channel("u", U, wf_increment=step)])

    assert recording["u"].t is None
    assert "waveform-times" not in codes(recording.findings)


def test_a_channel_of_time_stamps_is_the_time_whatever_its_name(tmp_path: Path) -> None:
    stamps = np.datetime64("2024-05-17T09:30:00.250", "us") + np.arange(40) * np.timedelta64(2500, "us")

    (recording,) = tdms(tmp_path, [channel("When", stamps), channel("u", U), channel("short", U[:3])])

    assert recording["u"].t is not None
    assert recording["u"].t == pytest.approx(0.0025 * np.arange(40), abs=1e-12)
    assert recording["short"].t is None
    assert units(recording)["When"] == "s"
    assert "time-stated" in codes(recording.findings)


def test_a_scaling_is_applied(tmp_path: Path) -> None:
    """A raw count c of a card is 0.5 + 0.25 c in volts, as the channel's linear scale says."""
    scale = {
        "NI_Number_Of_Scales": 1,
        "NI_Scale[0]_Scale_Type": "Linear",
        "NI_Scale[0]_Linear_Slope": 0.25,
        "NI_Scale[0]_Linear_Y_Intercept": 0.5,
        "NI_Scale[0]_Linear_Input_Source": np.uint32(0xFFFFFFFF),
        "NI_Scaling_Status": "unscaled",
    }
    (recording,) = tdms(
        tmp_path, [nptdms.ChannelObject("run", "u", np.array([0, 4, -8], dtype=np.int16), scale)]
    )

    assert columns(recording) == {"u": [0.5, 1.5, -1.5]}


def test_channels_that_are_no_numbers_are_reported_and_left_out(tmp_path: Path) -> None:
    (recording,) = tdms(
        tmp_path,
        [
            channel("remark", ["on", "off"]),
            channel("u", U),
            channel("z", np.array([1 + 2j])),
            channel("ok", np.array([True, False])),
        ],
    )

    assert columns(recording) == {"u": U.tolist(), "ok": [1.0, 0.0]}
    told = finding(recording.findings, "channel-skipped").sentence
    assert "`remark (text)`" in told
    assert "`z (complex numbers)`" in told


def test_a_file_without_numbers_says_what_it_has(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"no channels of numbers: group `log` has `remark \(text\)`"):
        tdms(tmp_path, [channel("remark", ["on", "off"], "log")])


def test_whole_numbers_that_a_float_cannot_hold_are_reported(tmp_path: Path) -> None:
    (recording,) = tdms(tmp_path, [channel("n", np.array([0, 2**60 + 1])), channel("m", np.array([1, 2]))])

    assert "`n`" in finding(recording.findings, "integer-rounded").sentence
    assert "`m`" not in finding(recording.findings, "integer-rounded").sentence


def test_a_file_that_is_cut_short_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    """LabVIEW leaves the size of a segment open (all ones) until it is closed; a crash leaves it so."""
    path = tmp_path / "motors.tdms"
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([channel("u", U)])
    data = bytearray(path.read_bytes())
    data[12:20] = b"\xff" * 8
    path.write_bytes(bytes(data[: -8 * 15]))

    (recording,) = load(path)

    assert columns(recording) == {"u": U[:25].tolist()}
    assert "recording-cut-short" in codes(recording.findings)


def test_a_length_that_is_a_lie_gives_what_is_there(tmp_path: Path) -> None:
    path = tmp_path / "motors.tdms"
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([channel("u", U)])
    data = path.read_bytes()
    count = struct.pack("<LQ", 1, 40)  # dimension and number of values in the raw data index
    assert data.count(count) == 1
    path.write_bytes(data.replace(count, struct.pack("<LQ", 1, 2**40)))

    assert columns(load(path)[0]) == {"u": U.tolist()}


def test_several_recordings_are_groups_of_one_segment(tmp_path: Path) -> None:
    path = tmp_path / "both.tdms"

    save([small("a"), small("b", samples=9)], path)

    assert path.read_bytes().count(b"TDSm") == 1
    with nptdms.TdmsFile.open(path) as file:
        assert [group.name for group in file.groups()] == ["a", "b"]
        assert file["b"]["applied"][:].tolist() == [1.0 + k for k in range(9)]
        assert file["b"]["applied"].properties["unit_string"] == "V"


def test_a_missing_library_is_reported_with_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.tdms"
    path.write_bytes(b"TDSm" + bytes(40))
    monkeypatch.setitem(sys.modules, "nptdms", None)

    with pytest.raises(UsageError, match=r'a\.tdms: npTDMS.*pip install "servobench\[labview\]"'):
        load(path)
