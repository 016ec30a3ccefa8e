"""MAT files as MATLAB, Simulink, SciPy and others write them. SciPy and h5py write what is read here: another route."""

import io
import re
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse

from servobench.core.errors import FormatError
from servobench.recordings.formats import matfile
from servobench.recordings.formats.base import load, save
from servobench.recordings.loading.load import load as load_in_child
from servobench.recordings.recording import Recording
from tests.files import refill
from tests.recordings.formats.tables import codes, columns, finding
from tests.recordings.native.samples import small

T = 0.002 * np.arange(50)
U = np.sign(np.sin(9 * T))
Y = np.cumsum(U)


def mat(folder: Path, variables: dict[str, Any], **options: Any) -> Recording:
    """Write variables with SciPy and load the one recording that they are."""
    path = folder / "a.mat"
    scipy.io.savemat(path, variables, **options)
    (recording,) = load(path)
    return recording


def hdf5(folder: Path, fill: Callable[[h5py.File], None]) -> Path:
    """Write a version 7.3 file: HDF5 behind 512 bytes that begin as MATLAB's do."""
    path = folder / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        fill(file)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .".ljust(124) + b"\x00\x02IM")
    return path


def dataset(group: h5py.Group, name: str, matrix: np.ndarray, kind: str = "double") -> h5py.Dataset:
    """Add a matrix as MATLAB stores it: transposed, with its class."""
    made = group.create_dataset(name, data=np.atleast_2d(matrix).T)
    made.attrs["MATLAB_class"] = np.bytes_(kind)
    return made


@pytest.mark.parametrize("version", ["4", "5"])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("compressed", [False, True])
def test_vectors_are_channels_whether_they_stand_or_lie(
    version: str, turned: bool, compressed: bool, tmp_path: Path
) -> None:
    oned: Any = "row" if turned else "column"
    variables = {"t": T, "u": U, "y": Y, "k": 2.5}

    recording = mat(tmp_path, variables, format=version, oned_as=oned, do_compression=compressed)

    assert columns(recording) == {"t": T.tolist(), "u": U.tolist(), "y": Y.tolist(), "k": [2.5]}
    assert np.array_equal(recording["y"].t, T)
    assert recording["k"].t is None
    assert codes(recording.findings) == ["time-recognised"]


@pytest.mark.parametrize(
    "dtype", ["f4", "f8", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "bool", ">f8", ">i2"]
)
def test_numbers_of_every_type_keep_their_value(dtype: str, tmp_path: Path) -> None:
    values = np.array([0, 1, 3, 100, 1], dtype=dtype)

    assert columns(mat(tmp_path, {"x": values})) == {"x": values.astype(float).tolist()}


def test_a_variable_called_none_is_one_like_another(tmp_path: Path) -> None:
    """SciPy calls an object of MATLAB so."""
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"None": np.array([1.0, 2.0, 3.0])})

    (recording,) = load(path)

    np.testing.assert_array_equal(recording["None"].values, [1.0, 2.0, 3.0])


def test_whole_numbers_that_a_float_cannot_hold_are_reported(tmp_path: Path) -> None:
    recording = mat(tmp_path, {"x": np.array([0, 2**60 + 1], dtype=np.int64)})

    assert codes(recording.findings) == ["integer-rounded"]


def test_a_matrix_is_a_channel_for_each_column_and_a_lying_one_for_each_row(tmp_path: Path) -> None:
    recording = mat(tmp_path, {"a": np.column_stack([T, U]), "b": np.array([T, U, Y])})

    assert list(columns(recording)) == ["a_1", "a_2", "b_1", "b_2", "b_3"]
    assert recording["a_2"].values.tolist() == recording["b_2"].values.tolist() == U.tolist()
    assert codes(recording.findings) == ["matrix-as-channels"] * 2
    assert "one for each column" in recording.findings[0].sentence
    assert "one for each row" in recording.findings[1].sentence


def test_the_times_of_a_struct_belong_to_its_fields_and_those_above_to_all_of_that_length(
    tmp_path: Path,
) -> None:
    variables = {
        "t": 7 + T,
        "log": {"time": T, "u": U, "deep": {"y": Y}},
        "other": {"y": Y, "short": Y[:9]},
    }

    recording = mat(tmp_path, variables)

    first = {name: None if recording[name].t is None else recording[name].t[0] for name in columns(recording)}
    assert first == {
        "t": 7.0, "log.time": 0.0, "log.u": 0.0, "log.deep.y": 0.0, "other.y": 7.0, "other.short": None
    }  # fmt: skip


def test_simulinks_structure_with_time_has_its_times(tmp_path: Path) -> None:
    signals = np.array(
        [({"values": U[:, None], "label": "u"},), ({"values": Y[None, None, :], "label": "y"},)],
        dtype=[("s", object)],
    )["s"]
    fields = np.array(
        [(each["values"], each["label"]) for each in signals], dtype=[("values", object), ("label", object)]
    )

    recording = mat(tmp_path, {"out": {"time": T[:, None], "signals": fields, "blockName": "model/Scope"}})

    assert list(columns(recording)) == ["out.time", "out.signals_1.values", "out.signals_2.values"]
    assert np.array_equal(recording["out.signals_2.values"].t, T)
    assert recording["out.signals_2.values"].values.tolist() == Y.tolist()
    skipped = finding(recording.findings, "variable-skipped").sentence
    assert "out.blockName (text)" in skipped
    assert "out.signals_1.label (text)" in skipped


def test_what_is_no_vector_of_numbers_is_reported_and_costs_nothing_else(tmp_path: Path) -> None:
    cells = np.empty(2, dtype=object)
    cells[:] = ["a", U]
    variables = {
        "u": U, "name": "rig 3", "words": ["ab", "c"], "cells": cells, "z": U + 1j, "none": np.empty((0, 0)),
        "cube": np.zeros((3, 4, 5)), "image": np.zeros((200, 300)), "sparse": scipy.sparse.eye(5).tocsc(), "nothing": {},
    }  # fmt: skip

    recording = mat(tmp_path, {name: value for name, value in variables.items() if name != "nothing"})

    assert list(columns(recording)) == ["u"]
    sentence = finding(recording.findings, "variable-skipped").sentence
    assert re.findall(r"`(\w+) \((.*?)\)`", sentence) == [
        ("name", "text"), ("words", "text"), ("cells", "a cell array"), ("z", "complex numbers"), ("none", "empty"),
        ("cube", "3 x 4 x 5"), ("image", "200 x 300"), ("sparse", "a sparse matrix"),
    ]  # fmt: skip


def test_objects_of_matlab_are_reported(tmp_path: Path) -> None:
    # MATLAB's opaque class 17, as it writes a timeseries or a table; made by hand from the layout of such a variable.
    def element(kind: int, data: bytes) -> bytes:
        return np.array([kind, len(data)], "<u4").tobytes() + data + bytes(-len(data) % 8)

    flags = element(6, np.array([17, 0], "<u4").tobytes())
    opaque = element(
        14, flags + element(1, b"ts") + element(1, b"MCOS") + element(1, b"timeseries") + element(14, b"")
    )
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"u": U})
    path.write_bytes(path.read_bytes() + opaque)

    (recording,) = load(path)

    assert list(columns(recording)) == ["u"]
    assert "ts (an object)" in finding(recording.findings, "variable-skipped").sentence


@pytest.mark.parametrize(
    ("variables", "why"),
    [
        ({"name": "rig"}, r"no variables that are vectors of numbers; it has `name \(text\)`"),
        ({}, "it has none"),
    ],
)
def test_a_file_without_numbers_is_an_error_that_lists_what_it_has(
    variables: dict[str, Any], why: str, tmp_path: Path
) -> None:
    with pytest.raises(FormatError, match=why):
        mat(tmp_path, variables)


def test_what_is_read_is_what_scipy_reads(tmp_path: Path) -> None:
    random = np.random.default_rng(8)
    kinds = ["f8", "f4", "i2", "u4", "i8"]
    variables = {
        f"v{k}": (100 * random.normal(size=(int(random.integers(1, 9)), int(random.integers(1, 9))))).astype(
            kinds[k % 5]
        )
        for k in range(40)
    }
    path = tmp_path / "a.mat"
    for version in ("4", "5"):
        # Version 4 has no 64-bit integers and turns them into floats.
        scipy.io.savemat(path, variables, format=version)
        expected = {name: value for name, value in scipy.io.loadmat(path).items() if name in variables}

        found = {each.name: each.value for each in matfile.variables(path)}

        assert found.keys() == expected.keys()
        assert all(np.array_equal(found[name], expected[name]) for name in variables)


def test_version_7_3_is_read(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        dataset(file, "t", T)
        dataset(file, "u", U[:, None])
        dataset(file, "counts", Y.astype(np.int32), "int32")
        dataset(file, "on", (U > 0).astype(np.uint8), "logical")
        dataset(file, "m", np.column_stack([U, Y]))
        dataset(file, "name", np.array([ord(letter) for letter in "rig"], dtype=np.uint16), "char")
        dataset(file, "none", np.array([0, 0], dtype=np.uint64)).attrs["MATLAB_empty"] = np.uint8(1)
        log = file.create_group("log")
        log.attrs["MATLAB_class"] = np.bytes_("struct")
        dataset(log, "y", Y)

    (recording,) = load(hdf5(tmp_path, fill))

    assert columns(recording) == {
        "counts": Y.tolist(), "log.y": Y.tolist(), "m_1": U.tolist(), "m_2": Y.tolist(), "on": (U > 0).tolist(),
        "t": T.tolist(), "u": U.tolist(),
    }  # fmt: skip
    assert all(np.array_equal(series.t, T) for series in recording.series)
    skipped = finding(recording.findings, "variable-skipped").sentence
    assert "name (text)" in skipped
    assert "none (empty)" in skipped


def test_an_array_of_structs_in_version_7_3_is_followed_to_its_fields(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        kept = file.create_group("#refs#")
        out = file.create_group("out")
        out.attrs["MATLAB_class"] = np.bytes_("struct")
        dataset(out, "time", T)
        signals = out.create_group("signals")
        signals.attrs["MATLAB_class"] = np.bytes_("struct")
        references = [dataset(kept, name, values).ref for name, values in (("a", U), ("b", Y))]
        signals.create_dataset(
            "values", data=np.array([references], dtype=h5py.ref_dtype).T, dtype=h5py.ref_dtype
        )

    (recording,) = load(hdf5(tmp_path, fill))

    assert list(columns(recording)) == ["out.signals_1.values", "out.signals_2.values", "out.time"]
    assert recording["out.signals_2.values"].values.tolist() == Y.tolist()


def test_links_out_of_a_version_7_3_file_are_not_followed_and_circles_end(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "secret.h5", "w") as secret:
        secret["x"] = U
        secret.create_dataset("stored", data=U)

    def fill(file: h5py.File) -> None:
        dataset(file, "u", U)
        file["outside"] = h5py.ExternalLink(str(tmp_path / "secret.h5"), "/x")
        file["soft"] = h5py.SoftLink("/u")
        circle = file.create_group("circle")
        circle["again"] = circle
        layout = h5py.VirtualLayout(shape=(50,), dtype="f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "secret.h5"), "stored", shape=(50,))
        file.create_virtual_dataset("virtual", layout)

    (recording,) = load(hdf5(tmp_path, fill))

    assert list(columns(recording)) == ["u"]
    sentence = finding(recording.findings, "variable-skipped").sentence
    assert all(
        said in sentence for said in ("outside (a link)", "soft (a link)", "virtual (kept in another file)")
    )


def test_a_variable_that_says_it_is_huge_is_an_error_and_not_a_full_memory(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        made = file.create_dataset("huge", shape=(10**9, 10**3), dtype="f8", chunks=(1000, 1000))
        made.attrs["MATLAB_class"] = np.bytes_("double")

    with pytest.raises(FormatError, match="more memory than a file of its size may"):
        load(hdf5(tmp_path, fill))


def damaged_files(data: bytes, seed: int) -> list[bytes]:
    random = np.random.default_rng(seed)
    made = []
    for k in range(200):
        damaged = bytearray(data)
        if k % 3 == 0:
            del damaged[int(random.integers(0, len(data))) :]
        for place in random.integers(0, len(damaged), 1 + k % 4) if damaged else []:
            damaged[int(place)] ^= 1 << int(random.integers(0, 8))
        made.append(bytes(damaged))
    return made


def version_4() -> bytes:
    file = io.BytesIO()
    scipy.io.savemat(file, {"t": T, "u": U, "name": "rig"}, format="4")
    return file.getvalue()


def version_5() -> bytes:
    cells = np.empty(2, dtype=object)
    cells[:] = ["a", U]
    file = io.BytesIO()
    scipy.io.savemat(
        file, {"t": T, "log": {"u": U, "deep": {"y": Y}}, "name": "rig", "cells": cells, "m": np.eye(3, 7)}
    )
    return file.getvalue()


def version_7_3(folder: Path) -> bytes:
    def fill(file: h5py.File) -> None:
        dataset(file, "t", T)
        dataset(file, "u", U)
        log = file.create_group("log")
        log.attrs["MATLAB_class"] = np.bytes_("struct")
        dataset(log, "y", Y)

    return hdf5(folder, fill).read_bytes()


@pytest.mark.parametrize("version", ["4", "5", "7.3"])
def test_a_damaged_file_is_a_recording_or_a_format_error_and_takes_little_memory(
    version: str, tmp_path: Path
) -> None:
    data = {"4": version_4, "5": version_5, "7.3": lambda: version_7_3(tmp_path)}[version]()
    path = tmp_path / "a.mat"
    for damaged in damaged_files(data, seed=2):
        refill(path, damaged)
        tracemalloc.start()
        try:
            said = load_in_child(path)[0].source.name
        except FormatError as error:
            said = str(error)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()

        assert "a.mat" in said
        assert most < 20e6


def test_our_own_file_has_variables_that_matlab_users_expect(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    save(small(), path)

    found = scipy.io.loadmat(path, squeeze_me=True)

    assert found["t"].tolist() == [0.0, 0.002, 0.004]
    assert found["applied"].tolist() == [1.0, 2.0, 3.0]
    assert found["counts"].tolist() == [0.0, 7.0, 14.0]
    assert "servobench.recording/1" in str(found["servobench"])


def test_several_recordings_of_ours_are_structs(tmp_path: Path) -> None:
    path = tmp_path / "runs.mat"
    save([small("slow forward"), small("end")], path)

    found = scipy.io.loadmat(path, squeeze_me=True, simplify_cells=True)

    assert found["slow_forward"]["counts"].tolist() == [0.0, 7.0, 14.0]
    assert found["x_end"]["t"].tolist() == [0.0, 0.002, 0.004]


def test_our_own_file_that_lacks_a_variable_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    save(small(), path)
    found = scipy.io.loadmat(path)
    scipy.io.savemat(path, {"servobench": found["servobench"], "t": found["t"]})

    with pytest.raises(FormatError, match="servobench"):
        load(path)


RealData = Callable[[str], Path]


@pytest.mark.parametrize("name", ["DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"])
def test_the_emps_benchmark_is_read_as_scipy_reads_it(name: str, real_data: RealData) -> None:
    path = real_data(f"emps/{name}")
    (recording,) = load(path)

    expected = scipy.io.loadmat(path, squeeze_me=True)

    assert {"t", "vir", "qm", "qg", "gtau"} <= columns(recording).keys()
    assert all(
        np.array_equal(series.values, np.ravel(expected[series.channel.name])) for series in recording.series
    )
    assert np.array_equal(recording["qm"].t, expected["t"])


def test_a_matrix_without_names_becomes_channels(real_data: RealData) -> None:
    path = real_data("qube3_ip_velocity/a00834778_P7_I+P.mat")
    (recording,) = load(path)

    expected = scipy.io.loadmat(path)["data"]
    assert list(columns(recording)) == ["data_1", "data_2", "data_3"]
    assert np.array_equal([series.values for series in recording.series], expected)
    assert codes(recording.findings) == ["matrix-as-channels"]
