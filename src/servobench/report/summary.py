"""The sentences at the top of a report: its subject, the result, and how far to trust it."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from servobench.core.estimate import Estimate
from servobench.core.finding import Severity, Verdict, list_text
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import (
    SPACE,
    Rounded,
    count_text,
    percent,
    plain,
    round_value,
    rounded_interval,
    with_unit,
)
from servobench.identification.estimators.base import Fit
from servobench.identification.result import Result
from servobench.identification.uncertainty.identifiability import State
from servobench.identification.uncertainty.propagation import Derived
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Recording
from servobench.report.history import experiment_table

if TYPE_CHECKING:
    from markupsafe import Markup

_CODE = re.compile(r"`([^`]+)`|(?<![\w-])(--[a-z][\w-]*)")


def title(result: Result, recordings: Sequence[Recording]) -> str:
    """Return what the report is about: the experiment and its device, or the names of the data."""
    experiments = [_experiment_name(recording) for recording in recordings]
    if len(recordings) == 1 and recordings[0].info is not None:
        name = f"Experiment ‘{experiments[0]}’" if experiments[0] else "Experiment"
        return f"{name} on {recordings[0].info.name}"
    names = list(dict.fromkeys(data.name for data in result.data))
    if len(names) < 3:
        return " and ".join(names)
    return f"{names[0]} and {len(names) - 1} more records"


def answer(result: Result) -> str:
    """Return the answer in one sentence: the two most important parameters, or why there is no model."""
    if result.verdict is Verdict.REFUSED or result.fit is None:
        refusals = [finding for finding in result.findings if finding.severity is Severity.REFUSAL]
        return (
            f"These data can't support a model. {refusals[0].sentence}" if refusals else "No model was found."
        )
    return _model_sentence(result.fit, result)


def reason(result: Result) -> str:
    """Return why the verdict is what it is."""
    grave = (Severity.WARNING, Severity.DANGER)
    warnings = sum(finding.severity in grave for finding in result.findings)
    refusals = sum(finding.severity is Severity.REFUSAL for finding in result.findings)
    if refusals:
        return (
            f"{count_text(refusals, 'finding')} {'speaks' if refusals == 1 else 'speak'} against any model."
        )
    if warnings:
        return f"{count_text(warnings, 'warning')}: read {'it' if warnings == 1 else 'them'} before you use the numbers."
    return "No check found anything against it."


def fit_text(fit_percent: float) -> str:
    """Return how much of an output a simulation explains."""
    return f"{percent(fit_percent)} %" if math.isfinite(fit_percent) else "an unknown part"


def sentence(text: str) -> Markup:
    """Return a text as HTML, with a full stop at its end; what stands between backticks, and an option, is set as code."""
    from markupsafe import Markup, escape

    stripped = text.rstrip()
    whole = str(escape(stripped if stripped.endswith((".", "!", "?", ":", "…")) else f"{stripped}."))
    return Markup(_CODE.sub(lambda match: f"<code>{match[1] or match[2]}</code>", whole))


def loss_text(fit: Fit) -> str:
    """Return what takes a part of the input before the linear part gets it: friction, an offset, both or nothing."""
    names = {
        "coulomb_voltage": "friction",
        "coulomb_voltage_forward": "friction",
        "offset_voltage": "the offset",
        "gravity_voltage_sine": "gravity",
    }
    words = [word for name, word in names.items() if name in fit.model.names]
    return list_text(words)


def feedback(derived: Mapping[str, Derived], data: Dataset, sample_time: float) -> str:
    """Return what unit feedback of the position, computed every `sample_time` [s], would do, with its margins."""
    phase, gain = derived["phase_margin"], derived["gain_margin"]
    loop = (
        f"unit feedback of the position (1 {data.input_unit} for each {data.position_unit}), computed every "
        f"{with_unit(sample_time, 's', 3)},"
    )
    if phase.value <= 0 or gain.value <= 1:
        return f"With {loop} the loop would be unstable."
    margin = (
        f"the phase margin is {_with_interval(_rescale(phase, math.degrees), '°')} at "
        f"{_with_interval(derived['gain_crossover'], 'rad/s')}"
        if math.isfinite(phase.value)
        else "the loop's gain never reaches 1"
    )
    if not math.isfinite(gain.value):
        least = _decibels(gain.interval[0])
        limit = f" ({plain(least, 3)} dB at least)" if math.isfinite(least) else ""
        return f"With {loop} {margin}, and no gain makes it unstable{limit}."
    at = with_unit(derived["phase_crossover"].value, "rad/s", 3)
    return f"With {loop} {margin}, the gain margin {_with_interval(_rescale(gain, _decibels), 'dB')} at {at}."


def quantity(what: str, derived: Derived) -> str:
    """Return a sentence with a quantity and its interval; an empty one where there is none."""
    return f"{what} {_with_interval(derived, derived.unit)}." if math.isfinite(derived.value) else ""


def _model_sentence(fit: Fit, result: Result) -> str:
    estimates = fit.estimates
    data = fit.model.data
    if not {"gain", "time_constant"} <= set(estimates):
        named = [
            f"{parameter_in_words(name, estimate.unit)} {_interval(estimate)}"
            for name, estimate in list(estimates.items())[:2]
        ]
        return f"The model {fit.structure} was found: {', '.join(named)}."
    known = {name for name in ("gain", "time_constant") if _is_known(result, name)}
    if known != {"gain", "time_constant"} or not all(map(math.isfinite, estimates["gain"].interval)):
        alone = [f"{parameter_in_words(name)} {_interval(estimates[name])}" for name in sorted(known)]
        together = [f"{each.meaning} {_interval(each.estimate)}" for each in result.combinations]
        return f"Known: {', '.join([*alone, *together]) or 'bounds only, see the table'}."
    gain = _interval(estimates["gain"], f"{data.position_unit}/s")
    unit = {"V": "volt", "%": "per cent", "A": "ampere"}.get(data.input_unit, data.input_unit)
    return (
        f"Each {unit} adds {gain} to the steady speed, and the motor covers 63.2 % of a step in "
        f"{_interval(estimates['time_constant'])}."
    )


def _is_known(result: Result, name: str) -> bool:
    answer = result.answers.get(name)
    return answer is None or answer.state is State.KNOWN


def _interval(estimate: Estimate, unit: str = "") -> Rounded:
    return rounded_interval(estimate.value, estimate.interval, unit or estimate.unit)


def _experiment_name(recording: Recording) -> str:
    own = experiment_table(recording).get("experiment", {})
    return str(own.get("name", "")) if isinstance(own, dict) else ""


def _with_interval(derived: Derived, unit: str) -> str:
    """A value with its interval: as ± where it lies evenly about it, or else as its ends."""
    low, high = derived.interval
    half = 0.5 * (high - low)
    if derived.method == "first order" or math.isnan(half):
        return _degrees(str(round_value(derived.value, half, unit)))
    value, least, most = (_degrees(with_unit(x, unit, 3)) for x in (derived.value, low, high))
    return f"{value} (95 %: {least} to {most})" if math.isfinite(high) else f"{value} (95 %: {least} or more)"


def _degrees(text: str) -> str:
    """The same with the degree sign where it belongs, at its number."""
    return text.replace(f"{SPACE}°", "°")


def _rescale(derived: Derived, scale: Callable[[float], float]) -> Derived:
    """The same quantity on another scale, which grows with the old one."""
    low, high = derived.interval
    return replace(derived, value=scale(derived.value), interval=(scale(low), scale(high)))


def _decibels(factor: float) -> float:
    return 20 * math.log10(factor) if factor > 0 else math.nan if math.isnan(factor) else -math.inf
