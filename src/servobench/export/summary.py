"""The motor in a result, without its data: the contents of a file `result.json`, and everything that an export needs."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from servobench.core.arguments import check_type
from servobench.core.channels import LARGEST_VALUE, LONGEST_STEP, SHORTEST_STEP, SMALLEST_VALUE, Array
from servobench.core.errors import FormatError, NotIdentifiable, UnknownName, UsageError
from servobench.core.estimate import Estimate
from servobench.core.parameter_names import parameter_in_words
from servobench.core.units import is_unit, unit
from servobench.identification.result import SCHEMA, SCHEMAS, Result
from servobench.identification.uncertainty.cautions import cautions
from servobench.systems.interop import hand_over, to_control
from servobench.systems.transfer_function import TransferFunction

if TYPE_CHECKING:
    import control

_LARGEST = 50_000_000  # bytes; a result has some ten thousand
_LARGEST_NUMBER = LARGEST_VALUE**2  # a variance is the square of a value


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ResultSummary:
    """An identified motor: its parameters with their intervals and covariance (P, P), and its transfer function to the speed.

    `structure` is the name of its model structure. The rows of the covariance stand in the order of `estimates`; NaN stands
    where it isn't known. `input_range` holds the smallest and the largest input of the data. `comment` is what a file without
    findings of its own should say: where the motor comes from, the verdict's reasons and the `cautions`, which say what the data
    don't determine. `document` is the whole result as plain data of the schema `servobench.result/2`.
    """

    estimates: Mapping[str, Estimate]
    covariance: Array
    transfer_function: TransferFunction
    verdict: str
    structure: str
    input_range: tuple[float, float]
    comment: tuple[str, ...]
    cautions: tuple[str, ...]
    document: Mapping[str, Any]

    @classmethod
    def of(cls, result: Result) -> ResultSummary:
        """Return what a result says; raises `NotIdentifiable` where it is refused or has no model."""
        return cls.from_document(result.to_dict(), "the result")

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> ResultSummary:
        """Return what a file says that `--json` or a run made, or the one in a run folder.

        Raises `UsageError` if there is no such file, `FormatError` if it contains no result, `NotIdentifiable` if the result is
        refused.
        """
        file = Path(path)
        file = file / "result.json" if file.is_dir() else file
        if not file.is_file():
            raise UsageError(
                f"there is no result {file}; `servobench run` writes one into its folder, and "
                "`servobench identify FILE --json` prints one"
            )
        if file.stat().st_size > _LARGEST:
            raise FormatError(f"{file} isn't a result: it has {file.stat().st_size} bytes")
        try:
            document = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise FormatError(
                f"{file} can't be read as a result: {error}; expected the JSON of `servobench identify --json`"
            ) from None
        return cls.from_document(document, str(file))

    @classmethod
    def from_document(cls, document: Any, name: str) -> ResultSummary:
        """Return what plain data of the schema `servobench.result/2` say; `name` is what messages call them.

        Raises `FormatError` for what is no such result, `NotIdentifiable` for one that was refused.
        """
        if not isinstance(document, dict) or document.get("schema") not in SCHEMAS:
            schema = document.get("schema") if isinstance(document, dict) else type(document).__name__
            raise FormatError(f"{name} isn't a result: expected the schema {SCHEMA!r}, found {schema!r}")
        if document.get("verdict") == "refused" or document.get("transfer_function") is None:
            raise NotIdentifiable(f"{name} is refused, so it contains no model. {_reasons(document)}")
        try:
            return cls._of(document)
        except KeyError as error:
            raise FormatError(f"{name} is incomplete: it lacks {error}, which {SCHEMA} has") from None
        except (TypeError, ValueError, AttributeError, OverflowError) as error:
            raise FormatError(f"{name} is incomplete: {error} while reading {SCHEMA}") from None

    @classmethod
    def _of(cls, document: dict[str, Any]) -> ResultSummary:
        estimates = {name: _estimate(e) for name, e in document["parameters"].items()}
        names = document["covariance"]["parameters"]
        matrix = np.array(
            [[_number(x) for x in row] for row in document["covariance"]["matrix"]], dtype=float
        )
        if names != list(estimates) or matrix.shape != (len(names), len(names)):
            raise ValueError(f"a covariance of {names} beside the parameters {list(estimates)}")
        system = document["transfer_function"]
        low, high = (_number(end) for end in document["operating_range"]["input"])
        _sample_times(document)
        open_questions = tuple(map(_one_line, cautions(document)))
        return cls(
            estimates=estimates,
            covariance=matrix,
            transfer_function=TransferFunction(
                numerator=tuple(map(_coefficient, system["numerator"])),
                denominator=tuple(map(_coefficient, system["denominator"])),
                delay=_number(system["delay"]),
                output=str(system["output"]),
                unit=str(system["unit"]),
            ),
            verdict=str(document["verdict"]),
            structure=str(document["structure"]),
            input_range=(low, high),
            comment=(*_comment(document), *open_questions),
            cautions=open_questions,
            document=document,
        )

    def __getitem__(self, name: str) -> Estimate:
        """Return the estimate of a parameter, with its unit and its interval; raises `UnknownName` where there is none."""
        if name not in self.estimates:
            raise UnknownName("parameter", name, self.estimates)
        return self.estimates[name]

    def to_control(self) -> control.TransferFunction:
        """Return the model as a `control.TransferFunction`, its delay as `systems.interop.to_control` has it."""
        return to_control(self.model)

    def __str__(self) -> str:
        """Each parameter with half of its interval, and where the result comes from."""
        lines = [
            f"{parameter_in_words(name, estimate.unit):16} {estimate}"
            for name, estimate in self.estimates.items()
        ]
        return "\n".join(
            [*lines, f"G(s) = {self.transfer_function}, in {self.transfer_function.unit}", *self.comment]
        )

    def __repr__(self) -> str:
        """The verdict and each parameter in one line."""
        parts = ", ".join(f"{name} {estimate}" for name, estimate in self.estimates.items())
        return f"<Answer {self.verdict}: {parts}>"

    @property
    def states(self) -> Mapping[str, str]:
        """How far each parameter is known, by name: `known`, `combination`, `bounded` or `unknown`; empty if not stated."""
        return {name: str(each.get("state", "")) for name, each in self.document["parameters"].items()}

    @property
    def combinations(self) -> Mapping[str, Estimate]:
        """The combinations of parameters that are known where not all of their parts are, by their meaning."""
        return {
            str(each["meaning"]): _estimate(each) for each in self.document.get("combinations", {}).values()
        }

    @property
    def units(self) -> tuple[str, str]:
        """The units of position and input, such as `rad` and `V`, which the unit of the gain is made of."""
        position, _, rest = self.transfer_function.unit.partition("/(s·")
        return position, rest.removesuffix(")")

    @property
    def model(self) -> TransferFunction:
        """The transfer function that is exported as a model: `systems.interop.handed_over` says which delay it has."""
        return self._export_model[0]

    @property
    def model_comment(self) -> tuple[str, ...]:
        """The comment, and a sentence more where the delay is left out of the model."""
        sentence = self._export_model[1]
        return (*self.comment, sentence) if sentence else self.comment

    @property
    def _export_model(self) -> tuple[TransferFunction, str]:
        delay = self.estimates.get("delay")
        return hand_over(self.transfer_function, delay.interval if delay else None)

    @property
    def user_unit(self) -> tuple[str, float] | None:
        """The unit of position in the files that the data came from, and how many of it one of `units` is; None if not stated."""
        user_units = [each.get("user_unit") for each in self.document.get("records", [])]
        if not user_units or any(not isinstance(each, dict) or each != user_units[0] for each in user_units):
            return None
        symbol, factor = user_units[0].get("name"), user_units[0].get("factor")
        if (
            not isinstance(symbol, str)
            or not isinstance(factor, int | float)
            or not 0 < factor <= LARGEST_VALUE
        ):
            return None
        return (symbol, float(factor)) if is_unit(symbol) and unit(symbol).quantity == "position" else None

    @property
    def sample_time(self) -> float | None:
        """The sample time of the data [s] that the result was made from, of several records the shortest; None if not stated."""
        known = _sample_times(self.document)
        return float(f"{min(known):.9g}") if known else None  # what rounding the times left


def load_result(path: str | os.PathLike[str]) -> ResultSummary:
    """Return the contents of a `result.json`, or of the one in a run folder: parameters, covariance and
    transfer function.

    Raises `UsageError` if there is no such file, `FormatError` if it contains no result, `NotIdentifiable` if the result is
    refused.

    >>> import json
    >>> import servobench as sb
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> with sb.connect("twin") as motor:
    ...     result = sb.identify(sb.run(sb.Experiment(duration="2 s"), motor))
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder) / "result.json"
    ...     _ = file.write_text(json.dumps(result.to_dict()))
    ...     load_result(file)["gain"].value == result["gain"].value
    True
    """
    check_type("path", path, (str, os.PathLike), "the path of a result.json")
    return ResultSummary.read(path)


def _sample_times(document: Mapping[str, Any]) -> list[float]:
    """The sample times of the data [s], as far as they are stated; raises `ValueError` for one that no recording has."""
    stated = [(each.get("sample_time") or {}).get("median") for each in document.get("records", [])]
    known = [_number(each) for each in stated if each is not None]
    for each in known:
        if not SHORTEST_STEP <= each <= LONGEST_STEP:
            raise ValueError(f"a sample time of {each:g} s")
    return known


def _comment(document: Mapping[str, Any]) -> tuple[str, ...]:
    made = document["provenance"]
    lines = [
        f"Identified by servobench {made['version']}, {made['created']}; verdict: {document['verdict']}."
    ]
    lines += [f"{f['severity']}: {f['sentence']}" for f in document["findings"] if f["severity"] == "warning"]
    return tuple(_one_line(line) for line in lines)


def _reasons(document: Mapping[str, Any]) -> str:
    refusals = [f["sentence"] for f in document.get("findings", []) if f.get("severity") == "refusal"]
    return _one_line(" ".join(refusals)) or "It has no model."


def _one_line(text: str) -> str:
    return " ".join(str(text).split())


def _estimate(plain: Mapping[str, Any]) -> Estimate:
    low, high = (_number(end) for end in plain["interval"])
    value = _number(plain["value"])
    if not math.isfinite(value):
        raise ValueError("a parameter without a value")
    return Estimate(
        value=value,
        sd=_number(plain["sd"]),
        interval=(low, high),
        level=float(plain["level"]),
        unit=str(plain["unit"]),
    )


def _coefficient(value: object) -> float:
    """A coefficient of a transfer function: zero, or of a size that a motor's can have."""
    number = _number(value)
    if number != 0 and not SMALLEST_VALUE <= abs(number) <= LARGEST_VALUE:
        raise ValueError(f"a coefficient of {number:g}")
    return number


def _number(value: object) -> float:
    """A number of JSON; null, which stands for one that isn't known, is NaN."""
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} where a number belongs")
    number = float(value)
    if math.isfinite(number) and abs(number) > _LARGEST_NUMBER:
        raise ValueError(f"{number:g}, which no motor has")
    return number
