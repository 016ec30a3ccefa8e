"""Parquet and Arrow files of others; pyarrow writes the tables that are read here."""

import sys
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from servobench.core.errors import FormatError, UsageError
from servobench.recordings.formats.base import load, save
from servobench.recordings.recording import Recording
from tests.recordings.formats.tables import codes, columns, finding, units
from tests.recordings.native.samples import small

T = 0.002 * np.arange(50)
U = np.sign(np.sin(9 * T))
Y = np.cumsum(U)
STAMPS = np.datetime64("2024-05-17T09:30:00.25", "us") + np.arange(50) * np.timedelta64(2500, "us")


def _feather(table: Any, path: Path) -> None:
    import pyarrow.feather

    pyarrow.feather.write_feather(table, str(path), compression="lz4")


def _stream(table: Any, path: Path) -> None:
    options = pa.ipc.IpcWriteOptions(compression="zstd")
    with pa.ipc.new_stream(str(path), table.schema, options=options) as writer:
        writer.write_table(table, max_chunksize=7)


WRITERS = {
    "log.parquet": lambda table, path: pq.write_table(table, path, row_group_size=7),
    "log.feather": _feather,
    "log.arrows": _stream,
}


@pytest.fixture(params=WRITERS)
def file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """The path of a file to write and to read, one of each kind."""
    return tmp_path / request.param


def loaded(file: Path, table: Any) -> Recording:
    """Write a table and load the recording that it is."""
    WRITERS[file.name](table, file)
    (recording,) = load(file)
    return recording


def test_columns_are_channels_and_several_row_groups_one_table(file: Path) -> None:
    recording = loaded(file, pa.table({"t": T, "u [V]": U, "y": Y}))

    assert columns(recording) == {"t": T.tolist(), "u": U.tolist(), "y": Y.tolist()}
    assert units(recording) == {"t": None, "u": "V", "y": None}
    assert recording["y"].t is not None
    assert recording["y"].t.tolist() == T.tolist()


def test_units_come_from_the_metadata_of_fields_and_schema(file: Path) -> None:
    fields = [
        pa.field("u", pa.float64(), metadata={"unit": "V"}),
        pa.field("y", pa.float64(), metadata={"units": "deg"}),
        pa.field("w", pa.float64()),
        pa.field("x", pa.float64(), metadata={"unit": "furlong"}),
    ]
    table = pa.Table.from_arrays([U, Y, Y, Y], schema=pa.schema(fields, metadata={"units": '{"w": "rad/s"}'}))

    recording = loaded(file, table)

    assert units(recording) == {"u": "V", "y": "deg", "w": "rad/s", "x": None}
    assert "'furlong'" in finding(recording.findings, "unit-unknown").sentence


@pytest.mark.parametrize(
    "array",
    [
        pa.array([0, 1, 3, 100], pa.int8()), pa.array([0, 1, 3, 100], pa.uint64()), pa.array([0, 1, 3, 100], pa.float32()),
        pa.array(np.array([0, 1, 3, 100], np.float16)), pa.array([Decimal(0), Decimal(1), Decimal(3), Decimal(100)]),
        pa.array([0, 1, 3, 100], pa.int16()).dictionary_encode(),
    ],
    ids=lambda array: str(array.type),
)  # fmt: skip
def test_numbers_of_every_type_keep_their_value(array: Any, file: Path) -> None:
    assert columns(loaded(file, pa.table({"x": array}))) == {"x": [0.0, 1.0, 3.0, 100.0]}


def test_truth_values_are_zero_and_one(file: Path) -> None:
    assert columns(loaded(file, pa.table({"on": [True, False, True]}))) == {"on": [1.0, 0.0, 1.0]}


def test_time_stamps_count_from_the_first_and_are_the_time(file: Path) -> None:
    recording = loaded(file, pa.table({"when": STAMPS, "u": U}))

    assert recording["u"].t is not None
    # A whole number of microseconds over 10^6 is rounded once, and so is 0.0025 k: two units in the last place at most.
    assert recording["u"].t == pytest.approx(0.0025 * np.arange(50), rel=4.5e-16, abs=0)
    assert "2024-05-17T09:30:00.25" in finding(recording.findings, "time-stamps").sentence
    assert units(recording)["when"] == "s"


def test_durations_and_times_of_day_are_seconds(file: Path) -> None:
    spans = pa.array([0, 1500, 3000], pa.duration("ms"))
    clock = pa.array([3_600_000_000, 3_600_500_000, None], pa.time64("us"))

    recording = loaded(file, pa.table({"elapsed": spans, "day": clock}))

    assert recording["elapsed"].values.tolist() == [0.0, 1.5, 3.0]
    assert recording["day"].values[:2].tolist() == [3600.0, 3600.5]
    assert np.isnan(recording["day"].values[2])


def test_stamps_of_input_and_output_share_one_zero(file: Path) -> None:
    """Structs with a time in each: the output's stamps begin 1 ms after the input's."""
    first = np.datetime64("2024-05-17T09:30:00", "ns") + np.arange(4) * np.timedelta64(10, "ms")
    second = first + np.timedelta64(1, "ms")
    table = pa.table(
        {
            "drive": pa.StructArray.from_arrays([pa.array(first), pa.array([0.0, 1, 1, 1])], ["stamp", "u"]),
            "encoder": pa.StructArray.from_arrays(
                [pa.array(second), pa.array([0.0, 0, 1, 2])], ["stamp", "y"]
            ),
        }
    )

    recording = loaded(file, table)

    assert recording["drive.u"].t is not None
    assert recording["encoder.y"].t is not None
    assert recording["drive.u"].t == pytest.approx([0.0, 0.01, 0.02, 0.03], abs=1e-15)
    assert recording["encoder.y"].t == pytest.approx([0.001, 0.011, 0.021, 0.031], abs=1e-15)


def test_empty_cells_are_nan_and_reported(file: Path) -> None:
    recording = loaded(file, pa.table({"u": [1.0, None, 3.0], "n": pa.array([None, 2, 3], pa.int32())}))

    assert np.isnan(recording["u"].values).tolist() == [False, True, False]
    assert np.isnan(recording["n"].values).tolist() == [True, False, False]
    assert [each.rows for each in recording.findings if each.code == "cell-empty"] == [(2, 2), (1, 1)]


def test_columns_that_are_no_numbers_are_reported_and_left_out(file: Path) -> None:
    table = pa.table(
        {
            "note": ["a", "b"],
            "kind": pa.array(["x", "y"]).dictionary_encode(),
            "u": [1.0, 2.0],
            "many": [[1.0], [2.0, 3.0]],
            "motor": [{"y": 1.0, "name": "m"}, {"y": 2.0, "name": "m"}],
            "nothing": pa.nulls(2),
        }
    )

    recording = loaded(file, table)

    assert columns(recording) == {"u": [1.0, 2.0], "motor.y": [1.0, 2.0]}
    told = finding(recording.findings, "column-skipped").sentence
    assert all(
        f"`{name}" in told
        for name in ("note (text", "kind (text", "many (list", "motor.name (text", "nothing (empty")
    )


def test_whole_numbers_that_a_float_cannot_hold_are_reported(file: Path) -> None:
    recording = loaded(file, pa.table({"n": [0, 2**60 + 1], "m": [1, 2]}))

    assert [each.sentence[:3] for each in recording.findings if each.code == "integer-rounded"] == ["`n`"]


def test_a_file_without_numbers_says_what_it_has(file: Path) -> None:
    with pytest.raises(FormatError, match=rf"{file.name} has no columns of numbers; it has `note \(text\)`"):
        loaded(file, pa.table({"note": ["a"]}))


def test_a_stream_that_is_cut_short_gives_the_batches_before_the_cut(tmp_path: Path) -> None:
    path = tmp_path / "log.arrows"
    WRITERS["log.arrows"](pa.table({"u": U}), path)
    path.write_bytes(path.read_bytes()[:-400])

    (recording,) = load(path)

    count = len(recording["u"].values)
    assert 0 < count < 50
    assert count % 7 == 0
    assert recording["u"].values.tolist() == U[:count].tolist()
    assert "recording-cut-short" in codes(recording.findings)


@pytest.mark.parametrize("suffix", [".parquet", ".arrow"])
def test_more_than_one_recording_is_refused(suffix: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="holds one recording and there are 2"):
        save([small("a"), small("b")], tmp_path / f"a{suffix}")


@pytest.mark.parametrize("suffix", [".parquet", ".arrow"])
def test_others_read_what_is_written(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    save(small(), path)
    table = pq.read_table(path) if suffix == ".parquet" else pa.ipc.open_file(path).read_all()

    assert table.column("applied").to_pylist() == [1.0, 2.0, 3.0]
    assert table.column("notes").to_pylist()[1:] == [-1.0, None]
    assert table.schema.field("applied").metadata == {b"unit": b"V"}


def test_a_table_that_claims_a_billion_rows_is_refused(tmp_path: Path) -> None:
    """The number of rows of a batch without columns is a claim and nothing else."""
    path = tmp_path / "a.arrows"
    batch = pa.record_batch({"u": pa.nulls(10**9)})
    with pa.ipc.new_stream(str(path), batch.schema) as writer:
        writer.write_batch(batch)
    assert path.stat().st_size < 1000

    with pytest.raises(FormatError, match=r"says that it has 1000000000 rows"):
        load(path)


def test_feather_of_version_1_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "a.feather"
    path.write_bytes(b"FEA1" + bytes(40))

    with pytest.raises(FormatError, match="Feather file of version 1"):
        load(path)


@pytest.mark.parametrize(("suffix", "head"), [(".parquet", b"PAR1"), (".arrow", b"ARROW1\0\0")])
def test_a_missing_library_is_reported_with_what_to_install(
    suffix: str, head: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(head + bytes(40))
    monkeypatch.setitem(sys.modules, "pyarrow", None)

    with pytest.raises(UsageError, match=rf'a\{suffix}: pyarrow.*pip install "servobench\[parquet\]"'):
        load(path)
    with pytest.raises(UsageError, match=r"pip install"):
        save(small(), path)


@pytest.mark.parametrize("dictionary", [True, False])
def test_a_parquet_file_of_no_rows_says_so(dictionary: bool, tmp_path: Path) -> None:
    path = tmp_path / "empty.parquet"
    table = pa.table({"t": [0.0, 1.0], "u": [1.0, 2.0]})
    pq.write_table(table.slice(0, 0), path, use_dictionary=dictionary)

    with pytest.raises(FormatError, match="no rows, only the columns `t`, `u`"):
        load(path)
