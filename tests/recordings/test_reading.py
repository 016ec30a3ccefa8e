"""Data at hand in Python come in as a file does, and a mistake gets a sentence that names the argument."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import control
import numpy as np
import pandas
import polars
import pyarrow
import pytest
import xarray

import servobench as sb
from servobench.core.errors import FormatError, MissingInformation, UnitError, UnknownName, UsageError
from servobench.recordings.adapters.base import unique_names
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.reading import datasets_in, evidence_in

GAIN, TAU, STEP = 20.0, 0.1, 0.002
T = np.arange(0, 2, STEP)
U = np.where(T % 1 < 0.5, 2.0, 4.0)


def speed(u: Any = U, gain: float = GAIN, tau: float = TAU) -> Any:
    """A motor without friction, by its exact recursion."""
    y = np.zeros(len(u))
    for k in range(len(u) - 1):
        y[k + 1] = y[k] + (1 - np.exp(-STEP / tau)) * (gain * u[k] - y[k])
    return y


Y = speed()
COLUMNS = {"t": T, "u": U, "speed": Y}
REST: dict[str, Any] = {"chain": "none", "starts_at_rest": True}
AS_COLUMNS: dict[str, Any] = {"input": "u:V", "output": "speed:rad/s", **REST}
AS_ARRAYS: dict[str, Any] = {"t": T, "u": U, "y": Y, "input_unit": "V", "output_unit": "rad/s", **REST}


def structured() -> Any:
    table = np.zeros(len(T), dtype=[(name, float) for name in COLUMNS])
    for name, values in COLUMNS.items():
        table[name] = values
    return table


def indexed_by_time() -> Any:
    frame = pandas.DataFrame({"u": U, "speed": Y}, index=pandas.to_timedelta(T, unit="s"))
    return frame


def response() -> Any:
    return control.TimeResponseData(T, Y, inputs=U, issiso=True)


TABLES = {
    "dict": lambda: COLUMNS,
    "pandas": lambda: pandas.DataFrame(COLUMNS),
    "pandas with times as index": indexed_by_time,
    "polars": lambda: polars.DataFrame(COLUMNS),
    "arrow": lambda: pyarrow.table(COLUMNS),
    "structured array": structured,
}


def same(data: Dataset) -> None:
    """Assert that the data are unchanged, but for the steps of a clock of whole nanoseconds."""
    assert np.allclose(data.t_input, T, rtol=0, atol=1e-9)
    assert np.array_equal(data.u, U)
    assert np.array_equal(data.y, Y)
    assert (data.input_unit, data.output_unit, data.kind) == ("V", "rad/s", "speed")
    assert data.chain_known


@pytest.mark.parametrize("kind", TABLES)
def test_every_kind_of_table_gives_the_same_dataset(kind: str) -> None:
    (data,) = datasets_in(TABLES[kind](), **AS_COLUMNS)
    same(data)


def test_xarray_gives_the_same_dataset() -> None:
    (data,) = datasets_in(xarray.Dataset({"u": ("t", U), "speed": ("t", Y)}, coords={"t": T}), **AS_COLUMNS)
    same(data)


def test_a_file_a_recording_and_a_dataset_give_the_same_dataset(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    pandas.DataFrame(COLUMNS).to_csv(file, index=False, float_format="%.17g")
    for data in (str(file), file, sb.load(file)[0], [file]):
        same(datasets_in(data, **AS_COLUMNS)[0])
    (measured,) = datasets_in(file, **AS_COLUMNS)
    assert datasets_in(measured) == (measured,)


def test_arrays_and_a_time_response_give_the_same_dataset() -> None:
    same(datasets_in(**AS_ARRAYS)[0])
    same(datasets_in(response(), input_unit="V", output_unit="rad/s", **REST)[0])
    evenly = {name: value for name, value in AS_ARRAYS.items() if name != "t"}
    same(datasets_in(**evenly, sample_time="2 ms")[0])


def test_lists_of_arrays_are_several_records_which_may_share_their_times() -> None:
    several = {**AS_ARRAYS, "u": [U, 0.5 * U], "y": [Y, speed(0.5 * U)]}
    first, second = datasets_in(**several)
    same(first)
    assert np.array_equal(second.u, 0.5 * U)
    assert first.name != second.name


def test_what_isnt_a_number_is_left_out_and_said() -> None:
    frame = pandas.DataFrame({**COLUMNS, "remark": ["x"] * len(T)})
    (recording,) = sb.inspect(frame)
    assert "remark" not in {channel.name for channel in recording.channels}
    assert any("`remark`" in finding.sentence for finding in recording.findings)


def test_a_missing_cell_is_not_a_number() -> None:
    cells: list[float | None] = list(Y)
    cells[7] = None
    (data,) = datasets_in(polars.DataFrame({**COLUMNS, "speed": cells}), **AS_COLUMNS)
    assert len(data.y) == len(Y) - 1


def test_an_option_means_what_the_option_of_the_command_means(tmp_path: Path) -> None:
    mapping = tmp_path / "m.toml"
    mapping.write_text('input = "u:V"\noutput = "speed:rad/s"\nchain = "none"\n')
    same(datasets_in(COLUMNS, mapping=mapping, starts_at_rest=True)[0])
    counts = {"t": T, "u": U, "angle": np.round(100 * np.cumsum(Y) * STEP)}
    (data,) = datasets_in(
        counts, input="u:V", output="angle:counts", counts_per_rev=2048, starts_at_rest=True
    )
    assert data.output_unit == "rad"
    assert data.starts_at_rest


def test_a_result_of_arrays_answers_by_name() -> None:
    result = sb.identify(**AS_ARRAYS)
    low, high = result["gain"].interval
    assert low <= GAIN <= high
    assert float(result["time_constant"]) == result["time_constant"].value
    assert "rad/(s·V)" in str(result["gain"])
    with pytest.raises(UnknownName, match="no parameter called 'tau'"):
        result["tau"]


WRONG: dict[str, tuple[dict[str, Any], type[Exception], str]] = {
    "nothing": ({}, UsageError, "data is None; expected"),
    "an empty list": ({"data": []}, UsageError, "data is an empty list"),
    "a list of numbers": ({"data": [1, 2]}, UsageError, r"data\[0\] is 1 \(int\).*t=, u=, y="),
    "a bare array": ({"data": np.zeros((3, 2))}, UsageError, r"ndarray and shape \(3, 2\)"),
    "data and arrays": ({"data": COLUMNS, **AS_ARRAYS}, UsageError, "both data and t and u and y"),
    "no output": ({"t": T, "u": U}, UsageError, "give the input as u= and the output as y="),
    "no unit": ({"t": T, "u": U, "y": Y, "output_unit": "rad"}, UsageError, "input_unit is missing"),
    "lengths": ({**AS_ARRAYS, "y": Y[:-1]}, UsageError, "u has 1000 values, y 999, t 1000"),
    "texts": ({**AS_ARRAYS, "u": ["a"] * len(T)}, UsageError, "u is a list that doesn't hold numbers"),
    "a text": (
        {**AS_ARRAYS, "u": [*U[:5], "abc", *U[6:]]},
        UsageError,
        r"u is a list that doesn't hold numbers: u\[5\] is 'abc'; expected",
    ),
    "beyond all floats": (
        {**AS_ARRAYS, "y": [10**400] * len(T)},
        UsageError,
        "y is a list that doesn't hold numbers",
    ),
    "a matrix": ({**AS_ARRAYS, "y": np.zeros((len(T), 2))}, UsageError, r"y has shape \(1000, 2\)"),
    "a column that isn't there": (
        {"data": COLUMNS, "input": "v:V"},
        UnknownName,
        "no column for the input of dict called 'v'",
    ),
    "a unit that doesn't exist": (
        {**AS_ARRAYS, "input_unit": "furlong"},
        UnitError,
        "'furlong' isn't a known unit",
    ),
    "a duty with its name for a unit": (
        {"data": COLUMNS, "input": "u:pwm", "output": "speed:rad/s"},
        UnitError,
        "'pwm' isn't a known unit; a duty is in %, or in PWM/N .* `u:PWM/255`",
    ),
    "an unknown option": ({"data": COLUMNS, "inputs": "u:V"}, UnknownName, "no option called 'inputs'"),
    "an option of a wrong type": ({"data": COLUMNS, "input": 3}, UsageError, "input is 3; expected a text"),
    "counts of a wrong type": (
        {"data": COLUMNS, "counts_per_rev": "x"},
        UsageError,
        "`counts_per_rev=x`: expected",
    ),
    "a mapping of a wrong type": (
        {"data": COLUMNS, "mapping": 3},
        UsageError,
        "mapping is 3; expected the path",
    ),
    "a missing unit": ({"data": {"t": T, "u": U, "x": Y}}, MissingInformation, "output"),
    "columns of arrays": ({**AS_ARRAYS, "input": "u"}, UsageError, "input refers to a column"),
    "a dict of frames": (
        {"data": {"run 1": pandas.DataFrame({"t": T, "u": T}), "run 2": pandas.DataFrame({"t": T, "u": T})}},
        UsageError,
        r"'run 1' is a DataFrame.* as a list",
    ),
    "a dict of tables": ({"data": {"run 1": {"t": T, "u": T}}}, UsageError, r"'run 1' is a dict.* as a list"),
    "two dimensions": ({"data": {"t": T, "u": np.zeros((len(T), 2))}}, UsageError, "'u' has shape"),
    "rows of several lengths": ({"data": {"t": T, "u": U[:5]}}, UsageError, "5 to 1000 rows"),
    "a recording that isn't there": (
        {"data": COLUMNS, "recordings": ["x"]},
        UnknownName,
        "no recording called 'x'",
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_mistake_is_a_sentence_that_names_the_argument(wrong: str) -> None:
    arguments, kind, words = WRONG[wrong]
    with pytest.raises(kind, match=words):
        datasets_in(**arguments)


def test_times_as_dates_masks_and_columns_of_one_are_read_as_a_table_is() -> None:
    same(datasets_in(**{**AS_ARRAYS, "t": (T * 1e9).round().astype("timedelta64[ns]")})[0])
    hidden = np.ma.masked_array(np.where(T[7] == T, 1e9, Y), mask=T[7] == T)
    (data,) = datasets_in(**{**AS_ARRAYS, "y": hidden})
    assert len(data.y) == len(Y) - 1
    assert data.y.max() == Y.max()
    with pytest.raises(UsageError, match=r"y\.ravel\(\)"):
        datasets_in(**{**AS_ARRAYS, "y": Y[:, None]})
    with pytest.raises(UsageError, match="complex numbers"):
        datasets_in(**{**AS_ARRAYS, "y": Y + 1j})
    with pytest.raises(UsageError, match="starts_at_rest is 'no'"):
        datasets_in(**{**AS_ARRAYS, "starts_at_rest": "no"})


def test_a_column_that_stands_twice_and_an_index_in_a_time_zone() -> None:
    frame = pandas.DataFrame(COLUMNS)
    with pytest.raises(UsageError, match="can't be read as a table"):
        datasets_in(pandas.concat([frame, frame["u"]], axis=1), **AS_COLUMNS)
    zoned = pandas.DatetimeIndex(pandas.to_datetime((T * 1e9).round(), unit="ns")).tz_localize("UTC")
    same(datasets_in(frame[["u", "speed"]].set_index(zoned), **AS_COLUMNS)[0])


def test_datasets_beside_what_is_still_to_be_read_are_refused() -> None:
    (data,) = datasets_in(**AS_ARRAYS)
    with pytest.raises(UsageError, match="make Datasets of all of them"):
        datasets_in([data, COLUMNS])
    with pytest.raises(UsageError, match="leave input out"):
        datasets_in(data, input="u:V")


def test_a_time_response_of_several_outputs_is_refused() -> None:
    several = control.TimeResponseData(T, np.stack([Y, Y]), inputs=U)
    with pytest.raises(UsageError, match="1 inputs, 2 outputs"):
        datasets_in(several, input_unit="V", output_unit="rad/s")


def test_a_column_of_numbers_with_a_few_texts_is_read_and_says_so() -> None:
    """As in a file: a logger that writes an error in place of a value leaves a column of objects."""
    frame = pandas.DataFrame({"t": [0.0, 0.1, 0.2], "u": [1.0, 2.0, 3.0], "y": [1.0, "err", 3.0]})

    [found] = evidence_in(frame, time="t:s", input="u:V", output="y:rad")

    [finding] = [each for each in found.recording.findings if each.code == "cell-not-a-number"]
    assert "'err'" in finding.sentence
    assert "row 2" in finding.sentence


def recordings_from(*sources: str) -> list[sb.Recording]:
    arrays = {name: value for name, value in AS_ARRAYS.items() if name != "starts_at_rest"}
    recording = evidence_in(None, argument="data", **arrays)[0].recording
    return [
        replace(recording, name=Path(path).stem, source=replace(recording.source, name=path))
        for path in sources
    ]


@pytest.mark.parametrize(
    ("sources", "names"),
    [
        (("a/log.csv", "b/log.csv"), ["a/log", "b/log"]),
        (("x/a/log.csv", "y/a/log.csv", "x/b/log.csv"), ["x/a/log", "y/a/log", "x/b/log"]),
        (("a/log.csv", "a/log.csv"), ["log 1", "log 2"]),
        (("a/log.csv", "./b/../a/log.csv", str(Path("a/log.csv").absolute())), ["log 1", "log 2", "log 3"]),
        (("a/log.csv", "a/log.mat", "b/log.csv"), ["log 1", "log 2", "b/log"]),
        (("a/log.csv", "other.csv"), ["log", "other"]),
        (("", ""), [" 1", " 2"]),
    ],
)
def test_files_of_one_name_are_told_apart_by_their_folders(
    sources: tuple[str, ...], names: list[str]
) -> None:
    assert [each.name for each in unique_names(recordings_from(*sources))] == names


def test_of_recordings_in_files_of_one_name_each_has_its_folder_before_its_own_name() -> None:
    recordings = [replace(each, name="run") for each in recordings_from("a/log.csv", "b/log.csv")]

    assert [each.name for each in unique_names(recordings)] == ["a/log run", "b/log run"]
    assert unique_names(()) == ()


def whole_numbers(folder: Path) -> Path:
    """Times [ms] and speeds [rpm], whole and separated by commas, without names: each row may be one number as well."""
    rows = [f"{round(1e4 * speed)},{5 * k}" for k, speed in enumerate(speed_of_step())]
    file = folder / "log.csv"
    file.write_text("\n".join(rows), encoding="utf-8")
    return file


def speed_of_step() -> Any:
    return -np.expm1(-0.005 * np.arange(200) / TAU)


@pytest.mark.parametrize("second", ["2:ms", "column_2:ms"])
def test_an_option_that_names_the_second_column_says_that_there_are_two(tmp_path: Path, second: str) -> None:
    file = whole_numbers(tmp_path)
    for data in (file, str(file), [file]):
        (record,) = datasets_in(data, input_value="6:V", output="1:rpm", time=second)

        assert record.t_output[-1] == pytest.approx(0.995)
        np.testing.assert_allclose(record.y, np.round(1e4 * speed_of_step()) * np.pi / 30, rtol=1e-12)


def test_a_mapping_that_names_the_second_column_says_so_too(tmp_path: Path) -> None:
    mapping = tmp_path / "mapping.toml"
    mapping.write_text('time = "2:ms"\noutput = "1:rpm"\ninput_value = "6:V"\n', encoding="utf-8")
    (record,) = datasets_in(whole_numbers(tmp_path), mapping=mapping)

    assert len(record.y) == 200


def test_whole_numbers_behind_commas_of_which_no_option_names_the_second_are_asked_about(
    tmp_path: Path,
) -> None:
    with pytest.raises(
        FormatError, match=r"two whole numbers or one .* by its number, such as `output=2:UNIT`"
    ):
        datasets_in(whole_numbers(tmp_path), input_value="6:V", output="1:rpm")


def test_what_is_said_of_a_recording_beside_its_columns_is_left_out() -> None:
    told = {"time_s": T, "voltage_v": U, "angle_rad": Y, "meta": {"serial": "A1"}}

    (described,) = sb.inspect(told)
    assert [channel.name for channel in described.channels] == ["time_s", "voltage_v", "angle_rad"]
