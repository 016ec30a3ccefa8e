"""MATLAB's objects, written by mat-io in the shapes in which MATLAB and Simulink store them."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from servobench.recordings.formats.matfile import import_mat_io

STEP = 0.002
T = STEP * np.arange(50)


def opaque(name: str, **properties: Any) -> Any:
    import_mat_io()
    from matio.utils.matclass import MatlabOpaque

    return MatlabOpaque(properties, name)


def text(value: str) -> np.ndarray:
    return np.array([value])


def number(value: float) -> np.ndarray:
    return np.array([[float(value)]])


def timeseries(
    values: np.ndarray, *, name: str = "unnamed", unit: str = "", time_unit: str = "seconds"
) -> Any:
    """A timeseries with its times in full, as one that was made from a vector of times has them."""
    return opaque(
        "timeseries",
        Data_=np.asarray(values, dtype=np.float64),
        Time_=T[:, None],
        Name=text(name),
        TimeInfo=opaque(
            "tsdata.timemetadata", Units=text(time_unit), Start_=number(0), Length=number(len(T))
        ),
        DataInfo=opaque("tsdata.datametadata", Units=text(unit)),
    )


def even(values: np.ndarray, start: float, step: float) -> Any:
    """A timeseries without its times, as MATLAB keeps one whose times are even."""
    times = {"Start_": number(start), "Increment_": number(step), "Length": number(len(values))}
    about = opaque("tsdata.timemetadata", Units=text("milliseconds"), **times)
    return opaque("timeseries", Data_=values[:, None], Time_=np.empty((0, 0)), TimeInfo=about)


def save(path: Path, variables: dict[str, Any], version: str = "v7", *, compressed: bool = True) -> None:
    with warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", message="duration_to_mat"
        )  # it has no finer unit than the second, and keeps the value
        import_mat_io().save_to_mat(str(path), variables, version=version, do_compression=compressed)


def dataset() -> Any:
    """The dataset into which Simulink logs signals."""
    elements = np.empty((2, 1), dtype=object)
    for k, (name, values) in enumerate([("u", np.sign(np.sin(9 * T))), ("theta", np.cumsum(T))]):
        unit = "V" if name == "u" else "rad"
        inner = timeseries(values[:, None], name=name, unit=unit)
        elements[k, 0] = opaque("Simulink.SimulationData.Signal", Name=text(name), Values=inner)
    return opaque("Simulink.SimulationData.Dataset", Name=text("logsout"), Storage_=elements)


MARK_OF_OBJECTS = 0xDD000000


def interpolated(values: np.ndarray, function: str = "zoh") -> Any:
    """A timeseries with its interpolation, as MATLAB's own have: a handle to a function, which has the mark of objects alone."""
    handle = np.empty((2, 1), dtype=object)
    handle[0, 0], handle[1, 0] = np.array([[MARK_OF_OBJECTS]], dtype=np.uint32), text(function)
    series = even(values, 0.0, 1.0)
    way = opaque("tsdata.interpolation", Name=text(function), Fhandle=handle)
    series.properties["DataInfo"] = opaque("tsdata.datametadata", Units=text("V"), Interpolation=way)
    return series


def struct(**fields: Any) -> np.ndarray:
    made = np.empty((1, 1), dtype=[(name, object) for name in fields])
    made[0, 0] = tuple(fields.values())
    return made


def logged(
    stream: int, *, name: str = "", block: str = "model/Step", sample_type: str = "double", width: int = 1
) -> np.ndarray:
    """The struct by which Simulink describes a signal that it logged to a stream of the file."""
    path = np.empty((1, 1), dtype=object)
    path[0, 0] = text(block)
    kind = struct(
        ClassName=text(sample_type),
        Dimension=np.array([[width]], dtype=np.uint32),
        Complexity=np.array([[False]]),
    )
    times = np.array([[0.0, STEP, len(T)]])
    seconds = struct(Class=text("char"), Value=text("seconds"))
    values = struct(CompressedTime=times, DataR2=number(stream), TimeUnits=seconds, SignalAttributes=kind)
    return struct(ElementType=text("signal"), Name=text(name), BlockPath=path, Values=values)


def save_streams(path: Path, signals: list[np.ndarray], streams: list[np.ndarray]) -> None:
    """Write a Dataset as Simulink writes it to a file: signals described in a storage, and their samples in streams of bytes."""
    import h5py

    elements = np.empty((1, len(signals)), dtype=object)
    elements[0, :] = signals
    storage = opaque("Simulink.SimulationData.Storage.MatFileDatasetStorage", any=struct(Elements=elements))
    save(
        path,
        {"data": opaque("Simulink.SimulationData.Dataset", any=struct(Name=text("data"), Storage=storage))},
        "v7.3",
    )
    with h5py.File(path, "r+") as file:
        for k, samples in enumerate(streams):
            file[f"#sigstream#/{k}/#data#"] = np.frombuffer(samples.tobytes(), dtype=np.uint8)
