"""Reading an experiment from a TOML file; all mistakes are reported at once, each with its line."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Self

from pydantic import TypeAdapter, ValidationError, ValidationInfo, field_validator, model_validator
from pydantic_core import ErrorDetails

from servobench.core import toml
from servobench.core.errors import ExperimentError, UsageError
from servobench.core.settings import PositiveFrequency, PositiveTime, Settings
from servobench.rig.experiment.experiment import (
    AnyController,
    DeviceChoice,
    Duration,
    Experiment,
    Seed,
    WhenLate,
)
from servobench.rig.experiment.limits import Limits
from servobench.rig.experiment.lines import Path as KeyPath
from servobench.rig.experiment.lines import line_of, lines_of_keys
from servobench.systems.signals.base import SIGNALS, AnySignal

_LONGEST_VALUE = 60  # characters of a value that a message repeats
_KEY = "[key]"  # stands in a place behind a key that is itself the mistake


class _ExperimentTable(Settings):
    """The table [experiment]; what isn't given is left to `Experiment`."""

    name: str = ""
    notes: str = ""
    duration: Duration = None
    sample_time: PositiveTime | None = None
    sample_rate: PositiveFrequency | None = None
    """Ticks in a second, in place of `sample_time` [Hz]."""
    seed: Seed = None
    chain: str = ""
    nominal: str = ""
    until: str = ""

    @model_validator(mode="after")
    def _one_pace(self) -> Self:
        if self.sample_time is not None and self.sample_rate is not None:
            raise ValueError("has both sample_time and sample_rate; leave one of them out")
        return self

    def fields(self) -> dict[str, Any]:
        """Return what was given, in the names of `Experiment`'s fields."""
        values = {name: getattr(self, name) for name in self.model_fields_set}
        rate = values.pop("sample_rate", None)
        return values if rate is None else {**values, "sample_time": 1 / rate}


class _File(Settings, defer_build=True):
    """The tables of an experiment's file."""

    experiment: _ExperimentTable = _ExperimentTable()
    controller: AnyController | None = None
    signal: AnySignal
    device: DeviceChoice = DeviceChoice()
    limits: Limits = Limits()
    when_late: WhenLate = WhenLate()

    @field_validator("signal", mode="plain")
    @classmethod
    def _in_the_controllers_unit(cls, signal: Any, info: ValidationInfo) -> Any:
        """Read the levels in the unit that the controller follows: volts only where the signal is the voltage."""
        if "controller" not in info.data:
            return signal  # a controller with a mistake, which is told; what its signal is in nobody knows before it is mended
        controller = info.data["controller"]
        unit = "V" if controller is None else controller.reference_unit
        return TypeAdapter(AnySignal).validate_python(signal, context={"V": unit})

    def fields(self) -> dict[str, Any]:
        """Return what was given, in the names of `Experiment`'s fields."""
        tables = {name: getattr(self, name) for name in self.model_fields_set if name != "experiment"}
        return {**self.experiment.fields(), **tables}


TABLES = tuple(_File.__annotations__)
"""The names of the tables that an experiment's file may have."""


def load_experiment(path: str | PathLike[str]) -> Experiment:
    """Return the experiment in a TOML file.

    Raises `ExperimentError`, with a line for each mistake, where the file can't be read or run as it's written.
    """
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError:
        raise ExperimentError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise ExperimentError(f"{path}: is a directory; expected a TOML file") from None
    except (OSError, ValueError) as error:  # no permission; a zero byte in the name
        raise ExperimentError(f"{path}: can't be read: {error}") from None
    return read_experiment(_decode(data, str(path)), str(path))


def read_experiment(text: str, name: str = "experiment") -> Experiment:
    """Return the experiment that a TOML text describes; `name` stands for the file in messages.

    Raises `ExperimentError`, with a line for each mistake.
    """
    return experiment_of(parse(text, name), text, name)


def experiment_of(tables: dict[str, Any], text: str, name: str) -> Experiment:
    """Return the experiment that tables describe; `text` is the TOML that they come from, for the lines in messages.

    Raises `ExperimentError`, with a line for each mistake.
    """
    try:
        fields = _File.model_validate(tables).fields()
    except ValidationError as error:
        raise explain(error, text, name) from None
    except RecursionError:
        raise ExperimentError(f"{name}: its arrays or tables are nested too deeply") from None
    try:
        return Experiment.model_validate(fields)
    except ValidationError as error:
        raise explain(error, text, name, ("experiment",)) from None


def explain(
    error: ValidationError | UsageError, text: str, name: str, prefix: KeyPath = ()
) -> ExperimentError:
    """Return an error found in a part of an experiment's file as a user reads it: file, line, field, value, what was expected.

    `text` is the file's text and `name` its name. `prefix` leads to the part that was checked, such as
    `("device", "settings")` for the settings that a device's own model refused.
    """
    lines = lines_of_keys(text)
    problems: list[tuple[int, str]] = []
    for location, sentence in _sentences(error):
        path = tuple(part for part in location if part != _KEY)
        line = line_of((*prefix, *path), lines)
        place = name if line is None else f"{name}:{line}"
        where = _path_text((*prefix, *path))
        problems.append((line or 0, f"{place}: {where}: {sentence}" if where else f"{place}: {sentence}"))
    return ExperimentError(
        "\n".join(message for _, message in sorted(problems, key=lambda problem: problem[0]))
    )


def _sentences(error: ValidationError | UsageError) -> list[tuple[KeyPath, str]]:
    if isinstance(error, UsageError):
        return [((), str(error))]
    problems = error.errors(include_url=False)
    return [(each["loc"], _sentence(each)) for each in problems if not _follows(each, problems)]


def _follows(problem: ErrorDetails, problems: Sequence[ErrorDetails]) -> bool:
    """Whether an array is too short only because of mistakes in its items, which are reported separately."""
    depth = len(problem["loc"])
    return problem["type"] == "too_short" and any(
        len(each["loc"]) > depth and each["loc"][:depth] == problem["loc"] for each in problems
    )


def _sentence(problem: ErrorDetails) -> str:
    """One problem in our words; what the validator says of an "Input" is said of the value that stands in the file."""
    code, message = problem["type"], problem["msg"].removeprefix("Value error, ")
    if code == "missing":
        if problem["loc"] == ("signal",):
            known = ", ".join(SIGNALS.names())
            return f'is missing; add a table [signal] with type = "..." (one of {known})'
        return "is missing"
    value = repr(problem["input"])
    if len(value) > _LONGEST_VALUE:
        value = value[: _LONGEST_VALUE - 3] + "..."
    if code in {"model_type", "dict_type", "mapping_type"}:
        return f"{value} should be a table"
    if code == "tuple_type":
        if isinstance(problem["input"], dict) and isinstance(problem["loc"][-1], str):
            name = problem["loc"][-1]
            return f"is a single table; expected a list of tables, each starting with [[{name}]] in double brackets"
        return f"{value} should be an array"
    if code == "too_short":
        least = problem["ctx"]["min_length"]
        return f"{value} has too few entries; expected at least {least}"
    if code == "string_type":
        return f"{value} should be a text in quotes"
    return re.sub(r"^(Input|Tuple|String)\b", lambda _: value, message)


def _path_text(path: KeyPath) -> str:
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).removeprefix(".")


def _decode(data: bytes, name: str) -> str:
    """The text in a file's bytes; a byte order mark, which some editors on Windows put before UTF-8, is no part of it."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        utf16 = " (it looks like UTF-16)" if data[:2] in {b"\xff\xfe", b"\xfe\xff"} else ""
        raise ExperimentError(f"{name}:{line}: this isn't UTF-8{utf16}; save the file as UTF-8") from None


def _line_text(text: str, line: int) -> str:
    """The content of a line, and its likely mistake."""
    lines = text.split("\n")
    stands = lines[line - 1].strip() if line <= len(lines) else ""
    if not stands:
        return ""
    value = stands if len(stands) <= _LONGEST_VALUE else f"{stands[: _LONGEST_VALUE - 3]}..."
    hint = next((f"; {hint}" for pattern, hint in _OFTEN if re.search(pattern, stands)), "")
    return f": `{value}`{hint}"


_OFTEN = (
    ("[“”„‟«»‘’]", 'texts need straight quotes, as "text"'),
    (r"=\s*(True|False)\b", "the words are true and false, in lower case"),
    (r"=\s*[A-Za-z]", 'expected quotes around a text, as name = "text"'),
)


def parse(text: str, name: str) -> dict[str, Any]:
    """Return the tables in a TOML text; raises `ExperimentError` with file and line where it is none."""
    try:
        return toml.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = str(error)
        place = re.search(r" \(at (?:line (\d+), column (\d+)|end of document)\)$", message)
        line = int(place[1]) if place and place[1] else text.count("\n") + 1
        column = f" (column {place[2]})" if place and place[2] else " (end of the file)"
        reason = message[: place.start()] if place else message
        raise ExperimentError(
            f"{name}:{line}: this isn't TOML: {reason}{column}{_line_text(text, line)}"
        ) from None
    except RecursionError:
        raise ExperimentError(f"{name}: its arrays or tables are nested too deeply") from None
    except ValueError as error:  # a number of thousands of digits
        raise ExperimentError(f"{name}: this can't be read as TOML: {error}") from None
