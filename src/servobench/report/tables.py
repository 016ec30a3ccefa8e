"""The tables of a result, as plain text."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from servobench.core.finding import Finding, Severity, by_weight
from servobench.core.parameter_names import PARAMETER_NAMES, parameter_in_words
from servobench.core.rounding import TWO_SIDED, Rounded, plain, round_value, rounded_interval, with_unit
from servobench.identification.result import Comparison, OperatingRange, Result
from servobench.identification.uncertainty.composition import parts_of
from servobench.identification.uncertainty.status_text import in_words
from servobench.recordings.measurement.dataset import Dataset
from servobench.report.mathml import symbol

_SYMBOL = re.compile(r"\w\s*=")  # one letter that stands for a number
_FOREMOST = 5
_RPM = 30 / np.pi  # in 1 rad/s


@dataclass(frozen=True, kw_only=True)
class Fact:
    """One thing that is known, a text under a heading."""

    heading: str
    text: str
    code: bool = False
    """Whether the text is for a machine, such as a check sum or a command."""


@dataclass(frozen=True, kw_only=True)
class ParameterRow:
    """One parameter as a row: its name, its meaning in words, the rounded estimate.

    `symbol` is HTML, `known` says whether the data determine it; `instead` is what they tell where they don't.
    """

    name: str
    symbol: str
    meaning: str
    estimate: Rounded
    instead: str = ""

    @property
    def known(self) -> bool:
        """Whether the value has an interval."""
        return bool(self.estimate.low) and not self.instead


@dataclass(frozen=True, kw_only=True)
class BudgetRow:
    """The budget of one parameter: its name, half of its interval in percent as text, and its parts.

    Each part is a source, its half-width in percent as text, its share of the variance in percent, its reason, and the
    number of its source's colour, the same in all rows.
    """

    name: str
    percent: str
    parts: tuple[tuple[str, str, float, str, int], ...]


@dataclass(frozen=True, kw_only=True)
class ComparisonRow:
    """One parameter with its nominal value, as texts: its name, both values, and the difference of the identified one.

    That in percent and in standard deviations; the judgement says whether the nominal value lies in the interval.
    """

    name: str
    nominal: str
    identified: str
    percent: str
    deviations: str
    judgement: str


def capital(text: str) -> str:
    """Return a text with a capital at its beginning, the rest as it is; a symbol, such as the τ of `τ = 1 s`, keeps its size."""
    return text if _SYMBOL.match(text) else text[:1].upper() + text[1:]


def parameter_rows(result: Result) -> tuple[ParameterRow, ...]:
    """Return the parameters of a fit, rounded to what is known of them, and the combinations that are known."""
    fit = result.fit
    if fit is None:
        return ()
    alone = [
        ParameterRow(
            name=parameter_in_words(parameter.name, estimate.unit),
            symbol=symbol(parameter.name),
            meaning=parameter.meaning,
            estimate=rounded_interval(estimate.value, estimate.interval, estimate.unit),
            instead=in_words(result.answers.get(parameter.name)),
        )
        for parameter, estimate in zip(fit.model.structure.parameters, fit.estimates.values(), strict=True)
    ]
    together = [
        ParameterRow(
            name=each.meaning,
            symbol="",
            meaning="known together only",
            estimate=rounded_interval(each.estimate.value, each.estimate.interval, each.estimate.unit),
        )
        for each in result.combinations
    ]
    return (*alone, *together)


def budget_rows(result: Result) -> tuple[BudgetRow, ...]:
    """Return what the intervals of gain, time constant and friction are made of, as far as they are known."""
    sources = list(dict.fromkeys(line.source for line in result.budget))
    rows = []
    for name in ("gain", "time_constant", "coulomb_voltage", "delay"):
        parts = parts_of(result.budget, result.answers.get(name))
        if parts:
            estimate = result.answers[name].estimate
            rows.append(
                BudgetRow(
                    name=parameter_in_words(name, estimate.unit),
                    percent=plain(100 * estimate.half_width / abs(estimate.value), 2),
                    parts=tuple(
                        (
                            line.source,
                            plain(percent, 2),
                            100 * line.shares[name],
                            line.reason,
                            sources.index(line.source),
                        )
                        for percent, line in parts
                    ),
                )
            )
    return tuple(rows)


def motor_rows(result: Result) -> tuple[ParameterRow, ...]:
    """Return the motor's own parameters, as far as they are determined."""
    return tuple(
        ParameterRow(
            name=parameter_in_words(name),
            symbol=symbol(name),
            meaning=PARAMETER_NAMES[name].meaning,
            estimate=rounded_interval(estimate.value, estimate.interval, estimate.unit),
        )
        for name, estimate in result.motor_parameters.items()
    )


def finding_groups(findings: Sequence[Finding]) -> tuple[tuple[Finding, ...], ...]:
    """Return the findings, the weightiest first; those of one code and severity in one group."""
    return tuple(by_weight(findings))


def foremost(findings: Sequence[Finding]) -> int:
    """Return how many groups of findings stand in the open: five, or more where more speak against the result."""
    groups = finding_groups(findings)
    return max(_FOREMOST, sum(group[0].severity is not Severity.INFO for group in groups))


def comparison_rows(comparisons: Sequence[Comparison]) -> tuple[ComparisonRow, ...]:
    """Return the estimates with their nominal values."""
    return tuple(_comparison_row(comparison) for comparison in comparisons)


def operating_range(limits: OperatingRange, data: Dataset) -> tuple[Fact, ...]:
    """Return the smallest and largest input and speed."""
    speed_unit = f"{data.position_unit}/s"
    low, high = limits.speed
    speed = f"{_span(low, high)} {speed_unit}"
    if speed_unit == "rad/s":
        speed += f" ({_span(low * _RPM, high * _RPM)} rpm)"
    return (
        Fact(heading="Input", text=f"{_span(*limits.input)} {data.input_unit}"),
        Fact(
            heading="Speed",
            text=f"{speed}, from differences of the position" if data.kind == "position" else speed,
        ),
    )


def provenance(result: Result) -> tuple[Fact, ...]:
    """Return what a result was made with and from."""
    fit = result.fit
    facts = [
        Fact(heading="Software", text=f"servobench {result.provenance.version}"),
        Fact(
            heading="Identified", text=result.provenance.created.replace("T", " ").replace("+00:00", " UTC")
        ),
    ]
    if fit is not None:
        facts.append(Fact(heading="Model structure", text=fit.structure, code=True))
        facts.append(Fact(heading="Estimator", text=fit.estimator, code=True))
        facts.append(Fact(heading="Search", text=fit.status))
    chains = sorted({str(data.chain) for data in result.data if data.chain})
    facts += [Fact(heading="Measurement chain", text=chain, code=True) for chain in chains]
    facts += [
        Fact(heading="SHA-256 of the data", text=digest, code=True)
        for digest in result.provenance.inputs_sha256
    ]
    return tuple(facts)


def _comparison_row(comparison: Comparison) -> ComparisonRow:
    half = TWO_SIDED * comparison.sd
    known = np.isfinite(half) and half > 0
    difference = comparison.identified - comparison.nominal
    percent = f"{_sign_text(100 * difference / comparison.nominal)} %" if comparison.nominal else "–"
    inside = abs(difference) <= half
    return ComparisonRow(
        name=parameter_in_words(comparison.name, comparison.unit),
        nominal=with_unit(comparison.nominal, comparison.unit),
        identified=str(round_value(comparison.identified, half, comparison.unit)),
        percent=percent,
        deviations=_sign_text(comparison.z) if known else "–",
        judgement=("within the interval of the data" if inside else "outside the interval of the data")
        if known
        else "not determined",
    )


def _sign_text(value: float) -> str:
    text = plain(value, 3)
    return f"+{text}" if value > 0 else text


def _span(low: float, high: float) -> str:
    return f"{plain(low, 3)} to {plain(high, 3)}" if low != high else plain(low, 3)
