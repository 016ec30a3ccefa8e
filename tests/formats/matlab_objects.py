"""MATLAB's objects, written by mat-io in the shapes in which MATLAB and Simulink store them."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from servobench.formats.matobjects import import_library

STEP = 0.002
T = STEP * np.arange(50)


def opaque(name: str, **properties: Any) -> Any:
    import_library()
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
        import_library().save_to_mat(str(path), variables, version=version, do_compression=compressed)


def dataset() -> Any:
    """What Simulink logs signals into."""
    elements = np.empty((2, 1), dtype=object)
    for k, (name, values) in enumerate([("u", np.sign(np.sin(9 * T))), ("theta", np.cumsum(T))]):
        unit = "V" if name == "u" else "rad"
        inner = timeseries(values[:, None], name=name, unit=unit)
        elements[k, 0] = opaque("Simulink.SimulationData.Signal", Name=text(name), Values=inner)
    return opaque("Simulink.SimulationData.Dataset", Name=text("logsout"), Storage_=elements)
