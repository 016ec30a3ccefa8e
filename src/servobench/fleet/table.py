"""All motors in one table: what is examined together, and the files that pandas, DuckDB and a spreadsheet open."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import StorageError
from servobench.core.rounding import SPACE, TWO_SIDED, with_unit
from servobench.fleet.limits import Judgement, Limits
from servobench.fleet.outliers import distances, farthest_plain
from servobench.fleet.parts import arrow_schema, part_files, read_rows, rows_in, settings_in
from servobench.fleet.row import IDENTIFIED, Row

_Stated: TypeAlias = tuple[float, float, float, str]  # a value, its interval's ends, and their unit
_SAME_LEVEL = 0.05  # of the input: what a level differs by from motor to motor
_OFTEN = 0.5  # of the motors with a result: a parameter that is known of fewer isn't examined
_TOO_LONG = {"sentences", "budget"}  # for a cell of a spreadsheet
_ADDED_TEXTS = ("decision", "decided_by", "rule")
_ADDED = (*_ADDED_TEXTS, "consumer_risk", "producer_risk", "distance", "outlier")


@dataclass(frozen=True, kw_only=True, eq=False)
class Parameter:
    """One parameter of all motors: `value`, `low` and `high` (N,) in `unit`, NaN where it isn't known of one."""

    name: str
    """Its name in programs; of one that holds at a level, `speed_at_6_V` where the motors have several levels."""
    unit: str
    value: Array
    low: Array
    high: Array

    @property
    def u(self) -> Array:
        """The standard uncertainties (N,): half of the 95 % interval over 1.96."""
        half: Array = (self.high - self.low) / (2 * TWO_SIDED)
        return half


@dataclass(frozen=True, kw_only=True, eq=False)
class Fleet:
    """The results of all motors together, in the order of the rows.

    `texts` are the columns from the names of files. `limits` and `judgements` are None and empty without limits. `distance`
    (N,) is that of `outliers.distances` over `parameters`, NaN where they aren't all known; beyond `farthest` a motor is an
    outlier.
    """

    files: tuple[str, ...]
    stamps: tuple[str, ...]
    """The file's version: it changes when the file does."""
    texts: Mapping[str, tuple[str, ...]]
    outcomes: tuple[str, ...]
    """Identified, unusable or crashed."""
    verdicts: tuple[str, ...]
    """Empty where there is no result."""
    reasons: tuple[str, ...]
    """The reason why there is no result, or why it isn't trusted."""
    findings: Mapping[str, int]
    """The number of motors with a finding of that code."""
    parameters: tuple[Parameter, ...]
    limits: Limits | None
    judgements: tuple[Judgement, ...]
    distance: Array
    farthest: float
    cpu_seconds: float
    """The time for all files together [s]."""

    @property
    def outlying(self) -> NDArray[np.bool_]:
        """Whether a motor is an outlier (N,)."""
        is_outlier: NDArray[np.bool_] = np.nan_to_num(self.distance, nan=0.0) > self.farthest
        return is_outlier

    def counts(self, what: str) -> dict[str, int]:
        """Return how many motors there are of each of the `outcomes`, `verdicts` or `decisions`."""
        each_outcome = (
            [str(each.decision) for each in self.judgements] if what == "decisions" else getattr(self, what)
        )
        return dict(Counter(each for each in each_outcome if each))


def fleet_in(folder: Path, limits: Limits | None = None) -> Fleet:
    """Return what is known of all motors in the results in a folder.

    Raises `FormatError` where there are none, `UsageError` where limits have the unit of another quantity.
    """
    settings_in(folder)
    texts = _text_columns(folder)
    known: dict[str, dict[int, _Stated]] = {}
    levels: dict[str, dict[int, tuple[str, float]]] = {}
    rows: list[tuple[str, ...]] = []
    columns: dict[str, list[str]] = {name: [] for name in texts}
    findings: Counter[str] = Counter()
    judgements: list[Judgement] = []
    seconds = 0.0
    for number, row in enumerate(rows_in(folder)):
        rows.append((row["file"], row["stamp"], row["outcome"], row.get("verdict", ""), row["reason"]))
        for name, column in columns.items():
            column.append(row.get(name, ""))
        findings.update(set(row.get("findings", ())))
        seconds += row.get("cpu_seconds", 0.0)
        for name in _parameters_in(row):
            known.setdefault(name, {})[number] = (
                row[name], row[f"{name}_low"], row[f"{name}_high"], row[f"{name}_unit"],
            )  # fmt: skip
            if f"{name}_input" in row:
                level = row.get(f"{name}_input_unit", ""), row[f"{name}_input"]
                levels.setdefault(name, {})[number] = level
        if limits is not None:
            judgements.append(limits.judge(row))
    files, stamps, outcomes, verdicts, reasons = zip(*rows, strict=True) if rows else ((),) * 5
    limited = {limit.parameter for limit in limits.limits} if limits else set()
    results = sum(outcome == IDENTIFIED for outcome in outcomes)
    parameters = tuple(
        _parameter(own, part, len(rows))
        for name, estimates in known.items()
        if len(estimates) >= _OFTEN * results or name in limited
        for own, part in _by_level(name, estimates, levels.get(name, {})).items()
    )
    common = [each for each in parameters if np.isfinite(each.value).sum() >= _OFTEN * results]
    return Fleet(
        files=files,
        stamps=stamps,
        texts={name: tuple(column) for name, column in columns.items()},
        outcomes=outcomes,
        verdicts=verdicts,
        reasons=reasons,
        findings=dict(findings.most_common()),
        parameters=parameters,
        limits=limits,
        judgements=tuple(judgements),
        distance=distances(
            np.column_stack([each.value for each in common]), np.column_stack([each.u for each in common])
        )
        if common
        else np.full(len(rows), np.nan),
        farthest=farthest_plain(results, len(common)),
        cpu_seconds=seconds,
    )


def _text_columns(folder: Path) -> tuple[str, ...]:
    from servobench.fleet.name_pattern import NamePattern

    pattern = settings_in(folder).get("pattern")
    return NamePattern(pattern).names if pattern else ()


def _parameters_in(row: Row) -> list[str]:
    """The parameters that a row knows."""
    names = [
        name.removesuffix("_state")
        for name, value in row.items()
        if name.endswith("_state") and value == "known"
    ]
    return [name for name in names if {name, f"{name}_low", f"{name}_high", f"{name}_unit"} <= set(row)]


def _by_level(
    name: str, estimates: Mapping[int, _Stated], levels: Mapping[int, tuple[str, float]]
) -> dict[str, dict[int, _Stated]]:
    """Values of a parameter by level of the input, if it holds at a level and the motors have several.

    Levels within 5 % of the lowest of them are one level, named after their median. Rows without a level stay together.
    """
    parts: list[list[int]] = []
    for number in sorted(set(estimates) & set(levels), key=lambda each: levels[each]):
        first = levels[parts[-1][0]] if parts else None
        unit, level = levels[number]
        if first is not None and first[0] == unit and abs(level - first[1]) <= _SAME_LEVEL * abs(first[1]):
            parts[-1].append(number)
        else:
            parts.append([number])
    if len(parts) < 2:
        return {name: dict(estimates)}
    named: dict[str, dict[int, _Stated]] = {}
    for part in parts:
        unit = levels[part[0]][0]
        at = with_unit(float(np.median([levels[n][1] for n in part])), "" if unit == "1" else unit)
        own = f"{name.removesuffix('level')}{at}".replace(SPACE, "_").replace("−", "-")
        named.setdefault(own, {}).update((number, estimates[number]) for number in part)
    rest = {number: each for number, each in estimates.items() if number not in levels}
    return {**named, name: rest} if rest else named


def _parameter(name: str, estimates: Mapping[int, _Stated], count: int) -> Parameter:
    """A parameter in the unit that most motors have it in; the others are left out."""
    unit = Counter(each[3] for each in estimates.values()).most_common(1)[0][0]
    numbers = np.full((count, 3), np.nan)
    for place, (value, low, high, own) in estimates.items():
        if own == unit:
            numbers[place] = value, low, high
    return Parameter(name=name, unit=unit, value=numbers[:, 0], low=numbers[:, 1], high=numbers[:, 2])


def write_tables(folder: Path, fleet: Fleet) -> tuple[Path, Path]:
    """Write `motors.parquet` and `motors.csv` into the folder of the results, and return their paths.

    One part is in memory at a time. The CSV is for spreadsheets, without the columns `sentences` and `budget`. Raises
    `StorageError`.
    """
    from servobench.recordings.formats.arrow_table import pyarrow

    pa, parquet = pyarrow("pyarrow", "motors.parquet"), pyarrow("pyarrow.parquet", "motors.parquet")
    columns = _columns(folder, fleet)
    texts = (*fleet.texts, *_ADDED_TEXTS)
    schema = arrow_schema(columns, texts)
    table, sheet = folder / "motors.parquet", folder / "motors.csv"
    beside = [path.with_name(f"{path.name}.unfinished") for path in (table, sheet)]
    plain = [name for name in columns if name not in _TOO_LONG]
    try:
        with (
            beside[1].open("w", newline="", encoding="utf-8-sig") as file,  # as a spreadsheet expects it
            parquet.ParquetWriter(beside[0], schema, compression="zstd") as writer,
        ):
            out = csv.writer(file)
            out.writerow(plain)
            for rows in _rows_with_decisions(folder, fleet):
                writer.write_table(pa.Table.from_pylist(rows, schema=schema))
                out.writerows([_cell(row.get(name)) for name in plain] for row in rows)
        for part, path in zip(beside, (table, sheet), strict=True):
            part.replace(path)
    except OSError as error:
        raise StorageError(f"{folder}: the tables can't be written: {error.strerror or error}") from error
    return table, sheet


def _rows_with_decisions(folder: Path, fleet: Fleet) -> Iterator[list[Row]]:
    """The rows of each part with what is known only of all together."""
    number = 0
    outlying = fleet.outlying
    for path in part_files(folder):
        rows = read_rows(path)
        for row in rows:
            if fleet.judgements:
                judged = fleet.judgements[number]
                row |= {"decision": str(judged.decision), "decided_by": judged.decided_by}
                row |= {"consumer_risk": judged.consumer_risk, "producer_risk": judged.producer_risk}
                row["rule"] = fleet.limits.rule.name if fleet.limits else None
            if np.isfinite(fleet.distance[number]):
                row |= {"distance": float(fleet.distance[number]), "outlier": bool(outlying[number])}
            number += 1
        yield rows


def _columns(folder: Path, fleet: Fleet) -> list[str]:
    """The columns of all parts: what a file's name tells and what came of it first, then the parameters, then the rest."""
    part_names = [name for path in part_files(folder) for name in _names_in(path)]
    names = list(dict.fromkeys(part_names))
    first = [
        "file",
        *fleet.texts,
        *(_ADDED_TEXTS if fleet.judgements else ()),
        "outcome",
        "verdict",
        "reason",
    ]
    added = [
        name for name in _ADDED if name not in first and (fleet.judgements or name in ("distance", "outlier"))
    ]
    parameters = [name for name in names if _is_of_parameter(name, set(names))]
    rest = [name for name in names if name not in {*first, *parameters}]
    return [*first, *added, *parameters, *rest]


def _is_of_parameter(name: str, columns: set[str]) -> bool:
    return any(
        name.endswith(ending) and f"{name[: len(name) - len(ending)]}_state" in columns
        for ending in ("", "_sd", "_low", "_high", "_unit", "_state", "_input", "_input_unit")
    )


def _names_in(path: Path) -> Sequence[str]:
    from servobench.recordings.formats.arrow_table import pyarrow

    names: list[str] = pyarrow("pyarrow.parquet", path.name).read_schema(path).names
    return names


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return " ".join(value) if isinstance(value, list) else str(value)


DOCUMENT = "servobench.fleet/1"


def fleet_document(fleet: Fleet, files: Sequence[Path], others: Sequence[str]) -> dict[str, Any]:
    """Return what came of all motors as plain data of the schema `servobench.fleet/1`."""
    return {
        "schema": DOCUMENT,
        "motors": len(fleet.files),
        "outcomes": fleet.counts("outcomes"),
        "verdicts": fleet.counts("verdicts"),
        "rule": fleet.limits.rule.name if fleet.limits else None,
        "decisions": fleet.counts("decisions"),
        "outliers": [file for file, is_odd in zip(fleet.files, fleet.outlying, strict=True) if is_odd],
        "left_out": list(others),
        "files": [str(path) for path in files],
    }
