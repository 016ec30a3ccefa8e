"""MATLAB's objects in MAT files.

mat-io writes what is read here, in the shapes that are known of MATLAB's own files; none of those was at hand.
"""

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servobench.core.errors import FormatError
from servobench.recordings.formats.base import load
from servobench.recordings.formats.mapping import assign
from servobench.recordings.recording import Recording
from tests.recordings.formats.matlab_objects import (
    T,
    dataset,
    even,
    interpolated,
    logged,
    opaque,
    save,
    save_streams,
    text,
    timeseries,
)
from tests.recordings.formats.tables import codes, finding

U = np.sign(np.sin(9 * T))
Y = np.cumsum(U)
VERSIONS = ["v7", "v7.3"]


def mat(folder: Path, variables: dict[str, Any], version: str = "v7") -> Recording:
    path = folder / "a.mat"
    save(path, variables, version)
    (recording,) = load(path)
    return recording


@pytest.mark.parametrize("version", VERSIONS)
def test_a_timeseries_is_a_channel_with_its_own_times_and_its_unit(version: str, tmp_path: Path) -> None:
    recording = mat(tmp_path, {"theta": timeseries(Y[:, None], unit="deg"), "x": Y}, version)

    assert [each.channel.name for each in recording.series] == ["x", "theta"]
    assert recording["theta"].values.tolist() == Y.tolist()
    assert recording["theta"].t.tolist() == T.tolist()
    assert recording["theta"].channel.unit == "deg"
    assert recording["x"].t is None
    assert recording.findings == ()


@pytest.mark.parametrize("version", VERSIONS)
def test_even_times_that_are_not_stored_are_made_of_start_and_step(version: str, tmp_path: Path) -> None:
    recording = mat(tmp_path, {"u": even(U, 500.0, 2.0)}, version)

    assert np.allclose(recording["u"].t, 0.5 + 0.002 * np.arange(50), rtol=0, atol=1e-12)


@pytest.mark.parametrize("version", VERSIONS)
def test_timeseries_in_structs_and_in_simulinks_datasets_are_found(version: str, tmp_path: Path) -> None:
    recording = mat(tmp_path, {"log": {"u": timeseries(U[:, None])}, "out": dataset()}, version)

    assert [each.channel.name for each in recording.series] == [
        "log.u",
        "out.u",
        "out.theta",
    ]
    assert recording["out.theta"].channel.unit == "rad"
    assert "variable-skipped" not in codes(recording.findings)


@pytest.mark.parametrize("version", VERSIONS)
def test_the_mark_of_objects_alone_in_a_handle_to_a_function_is_no_damage(
    version: str, tmp_path: Path
) -> None:
    recording = mat(tmp_path, {"sig_volt": interpolated(U)}, version)

    assert recording["sig_volt"].values.tolist() == U.tolist()
    assert recording["sig_volt"].channel.unit == "V"


def test_signals_that_simulink_streamed_to_the_file_are_channels(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    signals = [logged(1, name="speed", sample_type="single"), logged(0, block="model/Step")]
    save_streams(path, signals, [U, Y.astype(np.float32)])

    (recording,) = load(path)

    assert [each.channel.name for each in recording.series] == ["data.speed", "data.Step"]
    assert recording["data.Step"].values.tolist() == U.tolist()
    assert recording["data.speed"].values.tolist() == Y.astype(np.float32).tolist()
    assert np.allclose(recording["data.speed"].t, T, rtol=0, atol=1e-15)


def test_a_streamed_signal_of_another_kind_is_reported_and_the_others_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    save_streams(path, [logged(0, name="u"), logged(1, name="pose", width=3)], [U, np.tile(Y, 3)])

    (recording,) = load(path)

    assert [each.channel.name for each in recording.series] == ["data.u"]
    assert "`data.pose`" in finding(recording.findings, "object-skipped").sentence


@pytest.mark.parametrize("stream", [1, -1, 2**40])
def test_a_streamed_signal_without_its_samples_is_refused(stream: int, tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    save_streams(path, [logged(stream, name="u")], [U[:-1], U[:-1]])

    with pytest.raises(FormatError, match=r"samples of `data\.u`"):
        load(path)


def test_samples_along_the_last_dimension_and_several_columns_are_channels(tmp_path: Path) -> None:
    turned = np.stack([U, Y])[None]  # 1 x 2 x N
    recording = mat(tmp_path, {"a": timeseries(turned), "b": timeseries(np.column_stack([U, Y]))})

    assert [each.channel.name for each in recording.series] == ["a_1", "a_2", "b_1", "b_2"]
    assert recording["a_2"].values.tolist() == recording["b_2"].values.tolist() == Y.tolist()


@pytest.mark.parametrize(("said", "seconds"), [("milliseconds", 1e-3), ("minutes", 60.0)])
def test_times_are_in_seconds_whatever_unit_they_are_stored_in(
    said: str, seconds: float, tmp_path: Path
) -> None:
    recording = mat(tmp_path, {"u": timeseries(U[:, None], time_unit=said)})

    assert np.array_equal(recording["u"].t, T * seconds)


@pytest.mark.parametrize("version", VERSIONS)
def test_a_timetable_has_its_times_and_a_table_is_columns(version: str, tmp_path: Path) -> None:
    import pandas as pd

    index = pd.to_timedelta(np.arange(50) * 2, unit="ms")
    frame = pd.DataFrame({"u_V": U, "theta_deg": Y}, index=index)
    frame.index.name = "Time"
    table = pd.DataFrame({"t": T, "y": Y})

    recording = mat(tmp_path, {"log": frame, "plain": table}, version)

    assert recording["log.u_V"].values.tolist() == U.tolist()
    assert recording["log.theta_deg"].channel.unit == "deg"
    assert np.allclose(recording["log.u_V"].t, T, rtol=0, atol=1e-12)
    assert np.array_equal(recording["plain.y"].t, T)


def test_two_timeseries_become_input_and_output_of_an_identification(tmp_path: Path) -> None:
    recording = mat(
        tmp_path, {"voltage": timeseries(U[:, None], unit="V"), "theta": timeseries(Y[:, None], unit="rad")}
    )

    assigned = assign(recording)

    assert (assigned.input, assigned.output) == ("voltage", "theta")


def test_objects_that_hold_no_signal_are_reported(tmp_path: Path) -> None:
    recording = mat(tmp_path, {"x": Y, "rig": opaque("Rig", Serial=text("7"))})

    assert "`rig (an object)`" in finding(recording.findings, "variable-skipped").sentence
    assert "`rig`" in finding(recording.findings, "object-skipped").sentence


def test_without_the_library_the_rest_is_read_and_the_sentence_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.mat"
    save(path, {"x": Y, "theta": timeseries(Y[:, None])})
    save(tmp_path / "b.mat", {"theta": timeseries(Y[:, None])})
    monkeypatch.setitem(sys.modules, "matio", None)

    (recording,) = load(path)

    assert recording["x"].values.tolist() == Y.tolist()
    assert 'pip install "servobench[matlab]"' in finding(recording.findings, "object-skipped").sentence
    with pytest.raises(FormatError, match=re.escape("servobench[matlab]")):
        load(tmp_path / "b.mat")
