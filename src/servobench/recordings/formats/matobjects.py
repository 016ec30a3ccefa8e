"""MATLAB's objects in a MAT file: `timeseries`, in structs and Simulink's datasets too, `timetable` and `table`.

How MATLAB stores objects isn't published; the library mat-io reads them (the extra `matlab`).
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from servobench.core.channels import Array, Channel
from servobench.core.finding import Finding, info, warning
from servobench.core.units import is_unit
from servobench.recordings.formats.columns import Column, Heading, heading, quote
from servobench.recordings.formats.matfile import import_mat_io
from servobench.recordings.formats.signal_streams import (
    SAMPLE_TYPES,
    StreamedSignal,
    UnreadSignal,
    fields,
    is_logged_signal,
    samples,
)
from servobench.recordings.formats.times import time_findings
from servobench.recordings.recording import Series

_DEEPEST = 16  # objects inside objects
_MOST_CHANNELS = 100  # of one timeseries
_SECONDS = {
    "weeks": 604800.0, "days": 86400.0, "hours": 3600.0, "minutes": 60.0, "seconds": 1.0,
    "milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9,
}  # fmt: skip
"""The units that a timeseries can have its times in."""


Held: TypeAlias = Series | Column | StreamedSignal | UnreadSignal
"""The contents of a variable, before streams are read."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Objects:
    """The content of a file's objects: channels with times of their own (`series`), columns without, and `findings` on them."""

    series: tuple[Series, ...] = ()
    columns: tuple[Column, ...] = ()
    findings: tuple[Finding, ...] = ()


def objects(path: Path, names: Sequence[str]) -> Objects:
    """Return the contents of the variables of those names, as far as they can be read; the others are reported and left out."""
    try:
        import_mat_io()
    except ImportError:
        sentence = (
            f"MATLAB objects in {quote(names)} aren't read, as that needs mat-io: pip install "
            '"servobench[matlab]", or save the data as plain vectors (x = ts.Data; t = ts.Time).'
        )
        return Objects(findings=(warning("object-skipped", sentence),))
    variables = sorted({name.partition(".")[0] for name in names})
    try:
        content, doubts = _load(path, variables)
        series, columns, unread = _contents(content, path)
    except Exception as error:  # mat-io tells of what it can't read by errors of any type
        message = str(error).splitlines()[0][:120] if str(error) else repr(error)
        sentence = (
            f"MATLAB objects in {quote(names)} aren't read, as they are damaged or of an unknown "
            f"kind: {message}."
        )
        return Objects(findings=(warning("object-skipped", sentence),))
    findings = []
    if doubts:
        findings.append(
            warning("object-doubtful", f"The library that reads MATLAB's objects reports: {doubts[0]}")
        )
    if not series and not columns:
        sentence = f"The objects in {quote(names)} hold no signal: only timeseries, timetable and table do."
        findings.append(info("object-skipped", sentence))
    if unread:
        sentence = f"Only single real numbers at evenly spaced times are read as logged signals; not read: {quote(unread)}."
        findings.append(info("object-skipped", sentence))
    different = {each.t.tobytes(): each.t for each in series if each.t is not None}
    findings.extend(finding for t in different.values() for finding in time_findings(t))
    return Objects(series=tuple(series), columns=tuple(columns), findings=tuple(findings))


def _load(path: Path, variables: Sequence[str]) -> tuple[dict[str, Any], list[str]]:
    """The variables as mat-io reads them, and what it warns of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        content = import_mat_io().load_from_mat(str(path), variable_names=list(variables))
    return content, [" ".join(str(each.message).split())[:200] for each in caught]


def _contents(content: Mapping[str, Any], path: Path) -> tuple[list[Series], list[Column], list[str]]:
    """The series and the columns in the variables, and the names of signals that can't be read."""
    signals = [each for name, value in content.items() for each in _walk(name, value, 0)]
    series = [each for each in signals if isinstance(each, Series)]
    streamed = [each for each in signals if isinstance(each, StreamedSignal)]
    return (
        [*series, *samples(path, streamed)],
        [each for each in signals if isinstance(each, Column)],
        [each.name for each in signals if isinstance(each, UnreadSignal)],
    )


def _walk(name: str, value: Any, depth: int) -> Iterator[Held]:
    """The channels in a value: an object, a table, or a struct or a cell array with some inside."""
    import pandas as pd

    if depth > _DEEPEST:
        return
    if isinstance(value, pd.DataFrame):
        yield from _table(name, value)
    elif getattr(value, "classname", None) == "timeseries" and isinstance(
        getattr(value, "properties", None), dict
    ):
        yield from _timeseries(name, value.properties)
    elif isinstance(getattr(value, "properties", None), dict):
        yield from _in_object(name, value, depth)
    elif is_logged_signal(value):
        yield from _signals(name, fields(value))
    elif isinstance(value, np.ndarray) and value.dtype.hasobject:
        items = value.ravel().tolist()
        for k, item in enumerate(items, 1):
            which = name if len(items) == 1 else f"{name}_{k}"
            if value.dtype.names:
                for field, inner in zip(value.dtype.names, item, strict=True):
                    yield from _walk(f"{which}.{field}", inner, depth + 1)
            else:
                yield from _walk(which, item, depth + 1)


def _in_object(name: str, value: Any, depth: int) -> Iterator[Held]:
    """The channels in an object of another class: what it holds, or in one of Simulink's what the signals in it are called."""
    own = _text(value.properties.get("Name"))
    for key, inner in _properties(value).items():
        if not str(value.classname).startswith("Simulink."):
            yield from _walk(f"{name}.{key}", inner, depth + 1)
        elif key == "Values" and own:
            yield from _walk(f"{name}.{own}", inner, depth + 1)
        elif isinstance(inner, np.ndarray) and inner.dtype == object:
            for each in inner.ravel().tolist():
                yield from _walk(name, each, depth + 1)
        else:
            yield from _walk(name, inner, depth + 1)


def _properties(value: Any) -> Mapping[str, Any]:
    """The properties of an object; a class that saves itself in its own way has a struct, which mat-io calls `any`, for them."""
    saved = fields(value.properties.get("any"))
    return (
        {**{key: inner for key, inner in value.properties.items() if key != "any"}, **saved}
        if saved
        else value.properties
    )


def _signals(name: str, signal: Mapping[str, Any]) -> Iterator[StreamedSignal | UnreadSignal]:
    """A signal that Simulink logged, called after itself or the block that it comes from."""
    name = f"{name}.{_signal_name(signal)}"
    about = fields(signal["Values"])
    kind = fields(about.get("SignalAttributes"))
    sample_type, width = _text(kind.get("ClassName")), _numbers(kind, "Dimension")
    times, stream = _numbers(about, "CompressedTime"), _number(about, "DataR2")
    factor = _SECONDS.get(_text(fields(about.get("TimeUnits")).get("Value")) or "seconds")
    is_scalar = sample_type in SAMPLE_TYPES and width is not None and width.prod() == 1
    if (
        not is_scalar
        or _number(kind, "Complexity")
        or times is None
        or times.size != 3
        or stream is None
        or factor is None
    ):
        yield UnreadSignal(name=name)
        return
    start, step, count = times.ravel().tolist()
    unit = _text(fields(about.get("DataUnits")).get("Value"))
    yield StreamedSignal(
        channel=Channel(name=name, unit=unit if unit and is_unit(unit) else None),
        stream=int(stream),
        sample_type=sample_type,
        start=start * factor,
        step=step * factor,
        count=int(count),
    )


def _signal_name(signal: Mapping[str, Any]) -> str:
    """The name of a logged signal; of one without a name, the last part of the path of its block."""
    blocks = signal["BlockPath"]
    block = blocks.ravel()[0] if isinstance(blocks, np.ndarray) and blocks.size else ""
    return _text(signal.get("Name")) or _text(block).rpartition("/")[2] or "signal"


def _timeseries(name: str, properties: Mapping[str, Any]) -> Iterator[Series]:
    """The channels of a timeseries: one, or one for each column of its data."""
    data = _numbers(properties, "Data")
    about_time = _inner(properties, "TimeInfo")
    if data is None:
        return
    t = _times(_numbers(properties, "Time"), about_time, data.shape)
    if t is None or not t.size or t.size not in data.shape:
        return
    # Samples stand along the first dimension, or along the last where each is a matrix.
    axis = 0 if data.shape[0] == t.size else data.shape.index(t.size)
    table = np.moveaxis(data, axis, 0).reshape(t.size, -1)
    if table.shape[1] > _MOST_CHANNELS:
        return
    unit = _unit(_inner(properties, "DataInfo"))
    for k in range(table.shape[1]):
        which = name if table.shape[1] == 1 else f"{name}_{k + 1}"
        yield Series(channel=Channel(name=which, unit=unit), values=np.ascontiguousarray(table[:, k]), t=t)


def _times(t: Array | None, about: Mapping[str, Any], shape: Sequence[int]) -> Array | None:
    """The times [s] of a timeseries; even ones aren't stored, only their start, their step and their number are."""
    factor = _SECONDS.get(_text(_property(about, "Units")) or "seconds")
    if factor is None:
        return None
    if t is None or not t.size:
        start, step, count = (_number(about, key) for key in ("Start", "Increment", "Length"))
        if start is None or step is None or count not in shape:
            return None
        t = start + step * np.arange(int(count or 0), dtype=np.float64)
    return np.ascontiguousarray(t.ravel() * factor)


def _unit(about: Mapping[str, Any]) -> str | None:
    """The unit that a timeseries says of its data, if it is one: a text, or Simulink's object that has a name."""
    unit = _property(about, "Units")
    inner = getattr(unit, "properties", None)
    symbol = _text(inner.get("Name") if isinstance(inner, dict) else unit)
    return symbol if symbol and is_unit(symbol) else None


def _property(properties: Mapping[str, Any], name: str) -> Any:
    """A property as it is stored: MATLAB keeps those that are computed under the name with an underscore."""
    for key in (f"{name}_", name):
        value = properties.get(key)
        if value is not None and not (isinstance(value, np.ndarray) and not value.size):
            return value
    return None


def _inner(properties: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    inner = getattr(_property(properties, name), "properties", None)
    return inner if isinstance(inner, dict) else {}


def _numbers(properties: Mapping[str, Any], name: str) -> Array | None:
    value = _property(properties, name)
    return value.astype(np.float64) if isinstance(value, np.ndarray) and value.dtype.kind in "biuf" else None


def _number(properties: Mapping[str, Any], name: str) -> float | None:
    values = _numbers(properties, name)
    return float(values.ravel()[0]) if values is not None and values.size == 1 else None


def _text(value: Any) -> str:
    if isinstance(value, np.ndarray) and value.dtype.kind in "UTO" and value.size == 1:
        value = value.ravel()[0]
    return value.strip() if isinstance(value, str) else ""


def _table(name: str, frame: Any) -> Iterator[Series | Column]:
    """The numeric columns of a timetable, with the times that its rows are called after, or of a table."""
    index, t = frame.index, None
    if index.dtype.kind in "mM":
        step = index.to_numpy().astype(f"{index.dtype.kind}8[ns]")
        first = step[0] if index.dtype.kind == "M" and len(step) else step[:0].dtype.type(0, "ns")
        t = (step - first) / np.timedelta64(1, "ns") / 1e9
    for key in frame.columns:
        values = frame[key].to_numpy()
        if values.dtype.kind not in "biuf" or values.ndim != 1:
            continue
        label = heading(str(key))
        which = Heading(name=f"{name}.{label.name}", unit=label.unit, from_name=label.from_name)
        values = np.ascontiguousarray(values, dtype=np.float64)
        if t is None:
            yield Column(heading=which, values=values)
        else:
            yield Series(channel=Channel(name=which.name, unit=which.unit), values=values, t=t)
