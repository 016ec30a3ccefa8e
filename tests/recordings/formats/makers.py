"""A small valid file of every format, each with a few channels, for tests that damage it."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType

from servobench.core.channels import Channel
from servobench.recordings.formats.base import FORMATS, save
from servobench.recordings.recording import Recording, Series, Source
from tests.recordings.formats import bags, matlab_objects, wpilogs

T = 0.01 * np.arange(20)
U = np.sign(np.sin(9 * T))
Y = np.cumsum(U) / 8


def recording() -> Recording:
    """Return a recording whose input and output have times of their own."""
    series = (
        Series(channel=Channel(name="u", unit="V"), values=U, t=T),
        Series(channel=Channel(name="y", unit="rad"), values=Y[::2], t=T[::2] + 0.001),
    )
    return Recording(name="run", series=series, source=Source(name="made up"), input="u", output="y")


def _lvm(path: Path) -> None:
    head = "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t,\nX_Columns\tNo\n***End_of_Header***\t\n\n"
    clock = "Date\t2024/05/17\t2024/05/17\nTime\t09:30:0{k},25\t09:30:0{k},25\n"
    segment = (
        "Channels\t2\nSamples\t10\t10\n" + clock + "Y_Unit_Label\tVolts\trad\nX_Dimension\tTime\tTime\n"
        "X0\t0,0\t0,0\nDelta_X\t0,1\t0,1\n***End_of_Header***\t\t\nX_Value\tu\ty\tComment\n"
    )
    rows = [f"\t{u:.3f}\t{y:.3f}\n".replace(".", ",") for u, y in zip(U, Y, strict=True)]
    text = head + "".join(segment.format(k=k) + "".join(rows[10 * k : 10 * k + 10]) for k in range(2))
    path.write_text(text, encoding="utf-8")


def _sysid_json(path: Path) -> None:
    rows = ", ".join(f"[{t:.2f}, {u:.1f}, {y:.3f}, 0.5]" for t, u, y in zip(T, U, Y, strict=True))
    path.write_text(
        '{"sysid": true, "units": "Rotations", "unitsPerRotation": 1.0, "fast-forward": [' + rows + "]}"
    )


def make(name: str, folder: Path) -> Path:
    """Return the path of a small valid file of a format in a folder, by our writer or else by its maker."""
    path = folder / f"a{FORMATS[name].suffixes[0]}"
    if name in MAKERS:
        MAKERS[name](path)
    else:
        assert FORMATS[name].written, f"{name} is only read: add what makes a file of it to MAKERS"
        save(recording(), path)
    return path


def _foreign_tdms(path: Path) -> None:
    """Waveforms, scaled counts, time stamps, text and two groups, in three segments."""
    import nptdms

    scale = {
        "NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "Linear", "NI_Scale[0]_Linear_Slope": 0.25,
        "NI_Scale[0]_Linear_Y_Intercept": 0.5, "NI_Scale[0]_Linear_Input_Source": np.uint32(0xFFFFFFFF),
    }  # fmt: skip
    stamps = np.datetime64("2024-05-17T09:30:00", "us") + np.arange(20) * np.timedelta64(10, "ms")
    wave = {"wf_increment": 0.01, "wf_start_offset": 0.0, "wf_start_time": stamps[0], "unit_string": "V"}
    counts = np.arange(20, dtype=np.int16)
    with nptdms.TdmsWriter(path) as writer:
        for _ in range(2):
            writer.write_segment([
                nptdms.ChannelObject("left", "u", U, wave), nptdms.ChannelObject("left", "counts", counts, scale),
                nptdms.ChannelObject("left", "remark", ["on", "off"]),
            ])  # fmt: skip
        writer.write_segment(
            [nptdms.ChannelObject("right", "when", stamps), nptdms.ChannelObject("right", "y", Y)]
        )


def _foreign_table() -> object:
    import pyarrow as pa

    stamps = np.datetime64("2024-05-17T09:30:00", "us") + np.arange(20) * np.timedelta64(10, "ms")
    return pa.table(
        {
            "when": stamps,
            "u": pa.array(U, mask=np.arange(20) == 3),
            "motor": [{"y": y, "on": True} for y in Y],
            "kind": pa.array(["a", "b"] * 10).dictionary_encode(),
            "n": pa.array(list(range(10)) * 2, pa.int16()).dictionary_encode(),
        }
    )


def _foreign_parquet(path: Path) -> None:
    import pyarrow.parquet as pq

    pq.write_table(_foreign_table(), path, row_group_size=8)


def _foreign_arrow(path: Path) -> None:
    import pyarrow as pa

    table = _foreign_table()
    options = pa.ipc.IpcWriteOptions(compression="lz4")
    with pa.ipc.new_stream(str(path), table.schema, options=options) as writer:  # type: ignore[attr-defined]
        writer.write_table(table, max_chunksize=8)


def _foreign_csv(path: Path) -> None:
    rows = "".join(f"{t:.2f}; {u:.1f}; {y:.3f}\n" for t, u, y in zip(T, U, Y, strict=True))
    path.write_text("% motor 3\n% t [s]; u [V]; y [rad]\n" + rows.replace(".", ",") + "\n% end\n")


def _foreign_mat(path: Path) -> None:
    import scipy.io

    scipy.io.savemat(path, {"t": T, "data": {"u": U, "y": Y}, "note": "a"}, do_compression=True)


def mat_objects(path: Path) -> None:
    matlab_objects.save(path, _objects(), compressed=False)  # so that damage gets at what is inside


def mat_streams_7(path: Path) -> None:
    t = matlab_objects.T
    matlab_objects.save_streams(path, [matlab_objects.logged(0, name="u")], [np.sin(t)])


def mat_objects_7(path: Path) -> None:
    matlab_objects.save(path, _objects(), "v7.3")


def _objects() -> dict[str, object]:
    t = matlab_objects.T
    series = matlab_objects.timeseries(np.sin(t)[:, None], name="angle", unit="rad")
    return {
        "theta": series,
        "volt": matlab_objects.interpolated(np.sin(t)),
        "log": {"u": matlab_objects.even(t, 0.0, 2.0)},
        "out": matlab_objects.dataset(),
        "x": t,
    }


def bench(
    load: Sequence[int] = (0, 5, 65535, 65530, 3, 9), torque: Sequence[bool] = (True,) * 6
) -> dict[str, Any]:
    """The JSON document of a servo bench, with as many readings as there are loads."""
    entries = [
        {
            "position": 0.01 * k, "speed": 0.5, "load": each, "input_volts": 7.3 - 0.1 * k, "temp": 28, "timestamp": 0.004 * k,
            "goal_position": 0.02 * k, "torque_enable": on,
        }
        for k, (each, on) in enumerate(zip(load, torque, strict=True))
    ]  # fmt: skip
    settings = {"mass": 0.49, "length": 0.1, "kp": 100, "vin": 7.4, "motor": "xl330", "trajectory": "sin_sin"}
    return {**settings, "entries": entries}


def servo_bench_json(path: Path) -> None:
    path.write_text(json.dumps(bench()))


def mcap_ros2(path: Path) -> None:
    bags.bag(path, compression=CompressionType.NONE, enable_crcs=False)  # so that damage gets at the messages


def mcap_ros2_packed(path: Path) -> None:
    bags.bag(path)


def mcap_json(path: Path) -> None:
    content = [{"u": k, "motor": {"theta": 0.1 * k}} for k in range(20)]
    bags.of_json(path, content, CompressionType.LZ4)


def wpilog_robot(path: Path) -> None:
    path.write_bytes(wpilogs.robot())


def wpilog_sysid(path: Path) -> None:
    path.write_bytes(wpilogs.sysid())


def _json_table(path: Path) -> None:
    rows = [{"t": t, "u": u, "y": y} for t, u, y in zip(T.tolist(), U.tolist(), Y.tolist(), strict=True)]
    path.write_text(json.dumps(rows))


def _teleplot(path: Path) -> None:
    rows = zip(T.tolist(), U.tolist(), Y.tolist(), strict=True)
    path.write_text("".join(f">u:{1000 * t}:{u}\n>y:{1000 * t}:{y}§rad\n" for t, u, y in rows))


MAKERS: dict[str, Callable[[Path], None]] = {
    "lvm": _lvm,
    "json_table": _json_table,
    "teleplot": _teleplot,
    "sysid_json": _sysid_json,
    "servo_bench_json": servo_bench_json,
    "tdms foreign": _foreign_tdms,
    "parquet foreign": _foreign_parquet,
    "arrow foreign": _foreign_arrow,
    "csv foreign": _foreign_csv,
    "mat foreign": _foreign_mat,
    "mat objects": mat_objects,
    "mat objects 7.3": mat_objects_7,
    "mat streams 7.3": mat_streams_7,
    "rosbag": mcap_ros2,
    "wpilog": wpilog_robot,
    "wpilog sysid": wpilog_sysid,
    "rosbag ros2": mcap_ros2,
    "rosbag packed": mcap_ros2_packed,
    "rosbag json": mcap_json,
}
"""Makers of files: under the name of a format that can't be written, or under a format's name and the sort of file."""
