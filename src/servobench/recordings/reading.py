"""Data of any kind, converted for identification: the one entry for Python and for the command line."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from servobench.core.arguments import check_type
from servobench.core.errors import FormatError, UnknownName, UsageError
from servobench.recordings.adapters.base import recordings_in, unique_names
from servobench.recordings.arrays import recordings_of_arrays
from servobench.recordings.evidence import Evidence, evidence_of
from servobench.recordings.formats.mapping import Mapping
from servobench.recordings.formats.roles import ColumnSpec
from servobench.recordings.formats.timing import seconds
from servobench.recordings.loading.load import load_two_columns
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Recording


class ReadingOptions(TypedDict, total=False):
    """Options for reading data that aren't a `Dataset` yet, as the command line's options of the same names.

    Columns are `COL` or `COL:UNIT`.
    """

    time: str
    """The column of the times, such as `t:ms`."""
    input: str
    """The column of what drives the motor, such as `u:V`."""
    input_value: str | Sequence[str]
    """An input that no column holds, such as `50:%`; a list has one for each of the data."""
    output: str
    """The column of what was measured, such as `angle:deg`; its unit decides whether that is a position or a speed."""
    reference: str
    """The column of a feedback loop's reference."""
    supply: str
    """The supply of the amplifier if the input is a duty: a column, or a constant such as `7.4 V`."""
    current: str
    """The column of the armature's current."""
    mapping: str | os.PathLike[str] | Mapping
    """A mapping, or the TOML file of one; the other options come before it."""
    recordings: Sequence[str]
    """The names of the recordings that are meant; all without it."""
    sample_time: float | str
    """The time between samples [s], or a text such as `20 ms`, where there are no times."""
    counts_per_rev: float
    """The counts in one turn of the shaft, edges of both channels included [counts/rev]."""
    chain: str
    """The stages between the shaft and the output, such as `derivative | lowpass 50 rad/s`; `none` if there are none."""
    t: ArrayLike | Sequence[ArrayLike]
    """Times (N,) [s]; a list of arrays for several records, as `u` and `y`."""
    u: ArrayLike | Sequence[ArrayLike]
    """Input (N,), in `input_unit`."""
    y: ArrayLike | Sequence[ArrayLike]
    """Output (N,), in `output_unit`."""
    input_unit: str
    """The unit of the input, such as `V`."""
    output_unit: str
    """The unit of the output, such as `rad` or `rpm`."""


_TEXTS = ("time", "input", "output", "reference", "supply", "current", "chain")
_UNITS = ("input_unit", "output_unit")
_ARRAYS = ("t", "u", "y")
_KNOWN = tuple(ReadingOptions.__annotations__)


@dataclass(frozen=True, kw_only=True)
class _Said:
    """The options, checked, by what they are about."""

    mapping: Mapping
    base: Mapping
    units: dict[str, str]
    values: tuple[str, ...] = ()

    @property
    def names_second_column(self) -> bool:
        """Whether a role is given to the second column by its number, or by the name that it has where no row names it."""
        columns = (getattr(each, role) for each in (self.mapping, self.base) for role in _TEXTS[:6])
        return any(ColumnSpec.parse(text).column in ("2", "column_2") for text in columns if text)

    def of(self, recording: Recording, part: int = 0) -> Mapping:
        """The mapping for a recording of a part of the data: the mapping's file, overridden by the options, with their units."""
        own = self.base.of(recording.name).override_with(self.mapping)
        if self.values:
            own = own.override_with(Mapping(input_value=self.values[part if len(self.values) > 1 else 0]))
        for role, unit in self.units.items():
            column = getattr(own, role) or getattr(recording, role)
            if column is None:
                raise UsageError(
                    f'{role}_unit is {unit!r}, but no column is named as the {role}: say {role}="COL:{unit}"'
                )
            name = column if column in recording else ColumnSpec.parse(column).column
            settings: dict[str, Any] = {role: f"{name}:{unit}"}
            own = own.override_with(Mapping(**settings))
        return own


def datasets_in(
    data: object = None, *, starts_at_rest: bool = False, argument: str = "data", **options: Any
) -> tuple[Dataset, ...]:
    """Return the datasets in the given data: datasets as they are, and `measure` of the rest.

    `options` are those of `ReadingOptions`; `starts_at_rest` is as for `measure`. Raises `UsageError`, which names the argument,
    and what reading and `measure` raise.
    """
    check_type("starts_at_rest", starts_at_rest, bool, "True or False")
    parts = evidence_in(data, argument=argument, **options)
    return tuple(each if isinstance(each, Dataset) else each.dataset(starts_at_rest) for each in parts)


def evidence_in(
    data: object = None, *, argument: str = "data", **options: Any
) -> tuple[Evidence | Dataset, ...]:
    """Return the recordings in the given data, with roles, units and times; a `Dataset` as it is.

    Recordings of one name are called after their files, or numbered, so that each can be told from the others.
    Raises `UsageError`, which names the argument, for what can't be read or doesn't go together; `MissingInformation` where
    something has to be said first.
    """
    datasets = _datasets(data, argument, options)
    return datasets or _evidence(recordings_meant(data, argument=argument, **options))


def recordings_meant(
    data: object = None, *, argument: str = "data", **options: Any
) -> tuple[tuple[Recording, Mapping], ...]:
    """Return the selected recordings in the given data, each with the information stated about it.

    Raises what `evidence_in` does, but for what has to be said first.
    """
    pairs, mapping = _look(data, argument, options)
    recordings = [each for each, _ in pairs]
    select(
        recordings, tuple(mapping.base.each)
    )  # a name that isn't there would change nothing, and is a mistake
    names = {each.name for each in select(recordings, mapping.mapping.recordings or mapping.base.recordings)}
    return tuple((each, mapping.of(each, part)) for each, part in pairs if each.name in names)


def mapping_of(**options: Any) -> Mapping:
    """Return options of `ReadingOptions` as one mapping, for a recording that is still to come; raises `UsageError`.

    >>> mapping_of(output="angle:deg", sample_time="2 ms").sample_time
    0.002
    """
    mapping = _parse_options(_without_empty(options))
    if len(mapping.values) > 1:
        raise UsageError(
            f"`input_value=...` is given {len(mapping.values)} times for one recording; give it once"
        )
    own = mapping.base.override_with(mapping.mapping)
    return own.override_with(Mapping(input_value=mapping.values[0])) if mapping.values else own


def further_evidence_in(data: object, *, argument: str, **options: Any) -> tuple[Evidence | Dataset, ...]:
    """Return the same for further data, without the options that select recordings: all recordings."""
    other_options = {name: value for name, value in options.items() if name not in (*_ARRAYS, "recordings")}
    if (
        len(set(_values(other_options.get("input_value") or ()))) > 1
    ):  # each belongs to one of the data that these come beside
        del other_options["input_value"]
    datasets = _datasets(data, argument, other_options)
    if datasets:
        return datasets
    pairs, mapping = _look(data, argument, other_options)
    return _evidence([(each, mapping.of(each)) for each, _ in pairs])


def _look(
    data: object, argument: str, options: dict[str, Any]
) -> tuple[tuple[tuple[Recording, int], ...], _Said]:
    """The recordings that there are, each with the number of its part in a list of data, and what was said of them."""
    options = _without_empty(options)
    mapping = _parse_options(options)
    if any(name in options for name in _ARRAYS):
        return tuple((each, 0) for each in _of_arrays(data, argument, options)), mapping
    parts = data if isinstance(data, list | tuple) and len(mapping.values) > 1 else [data]
    if len(mapping.values) > 1 and len(parts) != len(mapping.values):
        raise UsageError(
            f"input_value has {len(mapping.values)} values, and {argument} {len(parts)}; give one, or one for each in a list"
        )
    return tuple(
        (each, k) for k, part in enumerate(parts) for each in _read(part, argument, mapping)
    ), mapping


def recordings_as_stated(data: object, *, argument: str = "data", **options: Any) -> tuple[Recording, ...]:
    """Return the recordings in the given data; options of `ReadingOptions` decide where a file may be read in two ways.

    Rows such as `7,25` may be two whole numbers, or one with a decimal comma: two if an option names the second column.
    Raises what `recordings_in` raises.
    """
    return _read(data, argument, _parse_options(_without_empty(options)))


def _read(data: object, argument: str, stated: _Said) -> tuple[Recording, ...]:
    if isinstance(data, list | tuple) and data:
        return tuple(each for k, part in enumerate(data) for each in _read(part, f"{argument}[{k}]", stated))
    try:
        return recordings_in(data, argument)
    except FormatError as error:
        from servobench.recordings.formats.text_table import OneOrTwoColumns

        is_open = isinstance(error, OneOrTwoColumns) and stated.names_second_column
        if is_open and isinstance(data, str | os.PathLike):
            return load_two_columns(data)
        raise


def _without_empty(options: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}


def _evidence(recordings: Sequence[tuple[Recording, Mapping]]) -> tuple[Evidence, ...]:
    """The recordings as they were said to be, each under a name of its own."""
    parts = [evidence_of(recording, mapping) for recording, mapping in recordings]
    named = unique_names([part.recording for part in parts])
    return tuple(replace(part, recording=own) for part, own in zip(parts, named, strict=True))


def _datasets(data: object, argument: str, options: dict[str, Any]) -> tuple[Dataset, ...]:
    """The datasets where that is what is given, none where all is still to be read."""
    parts = data if isinstance(data, list | tuple) else [data]
    datasets = tuple(each for each in parts if isinstance(each, Dataset))
    if datasets and len(datasets) < len(parts):
        raise UsageError(
            f"{argument} mixes Datasets with data that are still to be read; make Datasets of all of them with measure()"
        )
    nonempty = _without_empty(options)
    if datasets and nonempty:
        raise UsageError(
            f"{argument} consists of Datasets, which have columns, units and chain already: leave {' and '.join(nonempty)} out"
        )
    return datasets


def _of_arrays(data: object, argument: str, options: dict[str, Any]) -> tuple[Recording, ...]:
    array_names = [name for name in _ARRAYS if name in options]
    if data is not None:
        raise UsageError(f"both {argument} and {' and '.join(array_names)} are given; give one or the other")
    if not {"u", "y"} <= set(array_names):
        raise UsageError(
            f"only {' and '.join(array_names)} given: give the input as u= and the output as y=, arrays of the same length"
        )
    columns = [name for name in (*_TEXTS[:6], "input_value") if name in options]
    if columns:
        raise UsageError(f"{columns[0]} refers to a column, and arrays have none: leave it out")
    return recordings_of_arrays(
        options["u"], options["y"], options.get("t"), options.get("input_unit"), options.get("output_unit")
    )


def select(recordings: Sequence[Recording], names: Sequence[str]) -> list[Recording]:
    """Return the recordings that have one of some names, all of them where there are no names.

    Raises `UnknownName`, which lists the names that there are.
    """
    known = [recording.name for recording in recordings]
    for name in names:
        if name not in known:
            raise UnknownName("recording", name, known)
    return [recording for recording in recordings if not names or recording.name in names]


def _parse_options(options: dict[str, Any]) -> _Said:
    """The options, each of the type that it has to have; raises an error that names the one that isn't."""
    for name in options:
        if name not in _KNOWN:
            raise UnknownName("option", name, _KNOWN)
    settings = {}
    for name in (*_TEXTS, *_UNITS):
        if name in options:
            if not isinstance(options[name], str):
                raise UsageError(
                    f"{name} is {options[name]!r}; expected a text such as {name}={_EXAMPLES[name]!r}"
                )
            settings[name] = options[name]
    values = _values(options.get("input_value", ()))
    if values and "input" in settings:
        raise UsageError("both input and input_value are given; give one of them")
    units = {name.removesuffix("_unit"): settings.pop(name) for name in _UNITS if name in settings}
    if "u" in options:  # whose unit the recording has already
        units = {}
    return _Said(
        mapping=Mapping(
            **settings,
            sample_time=seconds(options["sample_time"]) if "sample_time" in options else None,
            counts_per_rev=_turn(options.get("counts_per_rev")),
            recordings=_names(options.get("recordings", ())),
        ),
        base=_mapping(options.get("mapping")),
        units=units,
        values=values,
    )


_EXAMPLES = {
    "time": "t:ms", "input": "u:V", "output": "angle:deg", "reference": "r:deg", "supply": "7.4 V", "current": "i:A",
    "chain": "derivative | lowpass 50 rad/s", "input_unit": "V", "output_unit": "rad",
}  # fmt: skip


def _turn(counts_per_rev: Any) -> float | None:
    if counts_per_rev is None:
        return None
    if (
        isinstance(counts_per_rev, bool)
        or not isinstance(counts_per_rev, int | float | np.number)
        or not 0 < counts_per_rev < np.inf
    ):
        raise UsageError(f"`counts_per_rev={counts_per_rev}`: expected a number above 0, such as 2048")
    return float(counts_per_rev)


def _names(names: Any) -> tuple[str, ...]:
    if not isinstance(names, list | tuple) or not all(isinstance(name, str) for name in names):
        raise UsageError(f'recordings is {names!r}; expected a list of names, such as ["run 1"]')
    return tuple(names)


def _values(option: Any) -> tuple[str, ...]:
    values = (
        (option,) if isinstance(option, str) else tuple(option) if isinstance(option, list | tuple) else None
    )
    if values is None or not all(isinstance(each, str) for each in values):
        raise UsageError(
            f'input_value is {option!r}; expected a value with its unit, such as "50:%", or a list with one for each of the data'
        )
    return values


def _mapping(mapping: Any) -> Mapping:
    if mapping is None:
        return Mapping()
    if isinstance(mapping, Mapping):
        return mapping
    if isinstance(mapping, str | os.PathLike):
        return Mapping.read(mapping)
    raise UsageError(f"mapping is {mapping!r}; expected the path of a TOML file, or a Mapping")
