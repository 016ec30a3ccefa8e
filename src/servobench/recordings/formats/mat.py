"""MATLAB's MAT files: versions 4, 5 and 7.3 are read, version 5 is written."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, final

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import FormatError
from servobench.core.finding import Finding, info
from servobench.recordings.formats import matfile, metadata
from servobench.recordings.formats.base import FORMATS
from servobench.recordings.formats.columns import (
    LARGEST_TABLE,
    LARGEST_WHOLE,
    Column,
    heading,
    printable,
    quote,
    recording_of,
)
from servobench.recordings.formats.matfile import Matrix, SkippedVariable, Variable
from servobench.recordings.formats.matobjects import Objects, objects
from servobench.recordings.recording import Recording, Series, Source

_OURS = "servobench"  # the variable with all that a recording knows beside its samples
_MOST_CHANNELS = 100  # of one matrix
_KEYWORDS = frozenset(
    {
        "break",
        "case",
        "catch",
        "classdef",
        "continue",
        "else",
        "elseif",
        "end",
        "for",
        "function",
        "global",
        "if",
    }
    | {"otherwise", "parfor", "persistent", "return", "spmd", "switch", "try", "while"}
)


@final
@FORMATS.member("mat")
@dataclass(frozen=True, kw_only=True)
class Mat:
    """MAT files. Each numeric variable is a channel, each column of a matrix `m` one of `m_1`, `m_2` and so on.

    Where a matrix has more columns than rows, its rows are the channels. A variable gets the times of a time vector of its
    length that stands beside it or further up (`out.time` for `out.signals.values`, as Simulink writes them).
    """

    suffixes: ClassVar[tuple[str, ...]] = (".mat",)
    written: ClassVar[tuple[str, ...]] = suffixes
    by_library: ClassVar[bool] = True

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether a file begins like a MAT file; version 4, which has no mark, must end in .mat too."""
        if matfile.is_level_7(head) or matfile.is_level_5(head):
            return True
        return path.suffix.lower() == ".mat" and matfile.is_level_4(head)

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the recordings in a file of ours, or the one that a foreign file is; raises `FormatError`."""
        variables = matfile.variables(path)
        ours = next(
            (each.value for each in variables if each.name == _OURS and isinstance(each.value, str)), None
        )
        if ours is not None and ours.startswith("{") and metadata.SCHEMA in ours:
            return _own(ours, variables, path.name)
        return (_foreign(variables, path),)

    def write(self, recordings: tuple[Recording, ...], path: Path) -> None:
        """Write recordings as variables in columns, several as one struct each, and all they know as a JSON text."""
        from scipy.io import savemat

        described: list[dict[str, Any]] = []
        content: dict[str, Any] = {}
        taken = {_OURS}
        for recording in recordings:
            struct = _identifier(recording.name, taken) if len(recordings) > 1 else ""
            names = set() if struct else taken
            table = metadata.table_of(recording, partial(_identifiers, taken=names))
            described.append({"struct": struct, **table.description})
            content.update({struct: table.columns} if struct else table.columns)
        text = metadata.as_text({"schema": metadata.SCHEMA, "recordings": described})
        with path.open("wb") as file:
            savemat(file, {**content, _OURS: text}, do_compression=True, oned_as="column")


def _identifiers(names: Sequence[str], taken: set[str]) -> list[str]:
    return [_identifier(name, taken) for name in names]


def _identifier(name: str, taken: set[str]) -> str:
    """A name that MATLAB takes for a variable and that isn't taken yet."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)[:24]
    if not plain[:1].isalpha() or plain in _KEYWORDS:
        plain = f"x_{plain}"
    new, number = plain, 1
    while new in taken:
        number += 1
        new = f"{plain}_{number}"
    taken.add(new)
    return new


def _own(text: str, variables: Iterable[Variable], name: str) -> tuple[Recording, ...]:
    vectors = {each.name: each.value for each in variables if isinstance(each.value, np.ndarray)}

    def recording(one: Any) -> Recording:
        struct = f"{one['struct']}." if one.get("struct") else ""
        return metadata.recording_of_table(one, lambda label: _vector(vectors[f"{struct}{label}"]), name)

    described = metadata.from_text(text, name)
    try:
        return tuple(recording(one) for one in described["recordings"])
    except (KeyError, TypeError, AttributeError) as error:
        raise FormatError(f"{name}: its variable `{_OURS}` doesn't describe the file ({error!r})") from None


def _vector(matrix: Matrix) -> Array:
    if matrix.size != max(matrix.shape, default=0):
        raise ValueError(f"a matrix of shape {matrix.shape}")
    return np.array(matrix, dtype=np.float64).ravel()


def _foreign(variables: Sequence[Variable], path: Path) -> Recording:
    columns: list[Column] = []
    findings: list[Finding] = []
    skipped: list[tuple[str, SkippedVariable]] = []
    for variable in variables:
        value = variable.value
        channels: list[Column] | SkippedVariable = (
            value if isinstance(value, SkippedVariable) else SkippedVariable(what="text")
        )
        if isinstance(value, np.ndarray):
            channels, channel_findings = _channels(variable.name, value)
            findings.extend(channel_findings)
        if isinstance(channels, SkippedVariable):
            skipped.append((variable.name, channels))
        else:
            columns.extend(channels)
    held = _objects(path, [name for name, what in skipped if what.is_object])
    columns.extend(held.columns)
    taken = {each.channel.name for each in held.series}
    left_out = [f"{name} ({what.what})" for name, what in skipped if not _within(name, taken)]
    count = len(columns) + len(held.series)
    if not count:
        why = "".join(f" {each.sentence}" for each in held.findings)
        raise FormatError(
            f"{path.name} has no variables that are vectors of numbers; it has {quote(left_out) or 'none'}.{why}"
        )
    if count > LARGEST_TABLE:
        raise FormatError(f"{path.name} has {count} columns; expected at most {LARGEST_TABLE} channels")
    if left_out:
        sentence = f"Variables that aren't numbers in columns aren't read: {quote(left_out)}."
        findings.append(info("variable-skipped", sentence))
    source = Source(name=path.name, format="mat")
    findings.extend(held.findings)
    recording = recording_of(columns, name=path.stem, source=source, findings=findings)
    named = {each.channel.name for each in recording.series}
    return replace(recording, series=(*recording.series, *_rename(held.series, named)))


def _objects(path: Path, names: Sequence[str]) -> Objects:
    """The content of a file's objects, which are read only where there are some."""
    return objects(path, names) if names and matfile.has_objects(path) else Objects()


def _within(name: str, taken: set[str]) -> bool:
    """Whether a variable, or something in it, is among the channels."""
    return any(each == name or each.startswith((f"{name}.", f"{name}_")) for each in taken)


def _rename(series: Iterable[Series], taken: set[str]) -> Iterator[Series]:
    """The series, those whose names are taken with a number behind."""
    for each in series:
        name, number = (plain := printable(each.channel.name)), 1
        while name in taken:
            number += 1
            name = f"{plain}_{number}"
        taken.add(name)
        yield replace(each, channel=replace(each.channel, name=name))


def _channels(name: str, matrix: Matrix) -> tuple[list[Column] | SkippedVariable, list[Finding]]:
    """The columns that a matrix is, and what is to be known of that."""
    shape = " x ".join(map(str, matrix.shape))
    long = [size for size in matrix.shape if size != 1]
    if not matrix.size:
        return SkippedVariable(what="empty"), []
    if len(long) > 2 or (len(long) == 2 and min(long) > _MOST_CHANNELS):
        return SkippedVariable(what=shape), []
    values = np.array(matrix, dtype=np.float64)
    findings = []
    if matrix.dtype.kind in "iu" and np.abs(values).max() >= LARGEST_WHOLE:
        findings.append(
            info("integer-rounded", f"`{name}` has whole numbers too large to be kept to the last digit.")
        )
    if len(long) < 2:
        return [Column(heading=heading(name), values=values.ravel())], findings
    table = values.reshape(long, order="F")
    by_rows = table.shape[0] < table.shape[1]
    table = np.ascontiguousarray(table if by_rows else table.T)
    sentence = f"`{name}` ({shape}) is taken as {len(table)} channels, `{name}_1` to `{name}_{len(table)}`, one for each "
    findings.append(info("matrix-as-channels", f"{sentence}{'row' if by_rows else 'column'}."))
    return [Column(heading=heading(f"{name}_{k}"), values=row) for k, row in enumerate(table, 1)], findings
