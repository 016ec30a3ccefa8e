"""Findings on parameters that a record doesn't determine by themselves, and the case where none is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from servobench.core.finding import Finding, info, list_text, refusal
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import rounded_interval, share_explained, with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.models.motion import steady_speed
from servobench.identification.models.steady import speeds_by_level
from servobench.identification.uncertainty.composition import composition
from servobench.identification.uncertainty.identifiability import (
    Combination,
    ParameterStatus,
    State,
    may_be_zero,
)
from servobench.identification.uncertainty.status_text import in_words

_FOLLOWS = 50.0  # percent of the output: what explains so much shows that the input acts
_APART = 0.2  # of the larger one: by how much the speeds of records at one level differ at the least
_FEW = 6  # levels that a sentence lists
_ASKED_FOR = ("gain", "loop_gain", "time_constant")


def about_answers(
    answers: Mapping[str, ParameterStatus], combinations: Sequence[Combination], fit: Fit
) -> list[Finding]:
    """Return a finding for each of gain and time constant that isn't known by itself, or a refusal where nothing is known.

    `fit` is what the answers are of.
    """
    principal = [answers[name] for name in _ASKED_FOR if name in answers]
    lacking = [each for each in principal if each.state is not State.KNOWN]
    if principal and not combinations and all(each.state is State.UNKNOWN for each in principal):
        return [_nothing(principal, fit)]
    together = [
        _together(each, answers) for each in combinations if any(p.name in each.parameters for p in lacking)
    ]
    alone = [_alone(each) for each in lacking if each.state in (State.BOUNDED, State.UNKNOWN)]
    return together + alone


def _together(known: Combination, answers: Mapping[str, ParameterStatus]) -> Finding:
    *first, last = (parameter_in_words(name, answers[name].estimate.unit) for name in known.parameters)
    names = f"{', '.join(first)} and {last}"
    value = rounded_interval(known.estimate.value, known.estimate.interval, known.estimate.unit)
    sentence = f"The data determine {names} only together: {known.meaning} is {value}."
    return info("known-together", sentence, parameters=known.parameters)


def _alone(answer: ParameterStatus) -> Finding:
    name = parameter_in_words(answer.name, answer.estimate.unit)
    if answer.state is State.BOUNDED:
        sentence = f"The data show only that the {name} is {in_words(answer)}; to narrow that down, record {answer.remedy}."
    else:
        sentence = f"The data don't determine the {name}; record {answer.remedy}."
    return info("parameter-unknown", sentence, parameters=(answer.name,))


def _nothing(principal: Sequence[ParameterStatus], fit: Fit) -> Finding:
    names = " nor the ".join(parameter_in_words(answer.name, answer.estimate.unit) for answer in principal)
    if not may_be_zero(principal[0]):
        advice = f"record {principal[0].remedy}"
    elif fit.fit_percent > _FOLLOWS:
        advice = _any_gain(principal[0], fit)
    elif all(steady_speed(record.data) is not None for record in fit.records):
        advice = (
            "within each record input and speed stay as they are, which doesn't show how one follows the other. Record a step "
            "from rest, or change the input while recording"
        )
    else:
        advice = (
            f"this model explains {share_explained(fit.fit_percent)} of the output. Check that these two columns belong to one "
            "motor and that nothing else moves or holds the shaft, or record a larger input"
        )
    sentence = (
        f"The data determine neither the {names} nor any combination of them: {advice}.{_speeds_text(fit)}"
    )
    return refusal("nothing-known", sentence, parameters=tuple(answer.name for answer in principal))


def _end_speeds(fit: Fit) -> dict[float, float]:
    """The speeds that the motor settled at under an input, by its level."""
    speeds = speeds_by_level([record.data for record in fit.records])
    return {level: speed for level, speed in speeds.items() if level != 0.0 and speed != 0.0}


def _speeds_text(fit: Fit) -> str:
    """What is known all the same: the speeds that the motor settled at; the empty text where it settled nowhere, or at many."""
    apart = _speeds_apart(fit)
    if apart:
        return apart
    data, speeds = fit.records[0].data, _end_speeds(fit)
    if not 0 < len(speeds) <= _FEW:
        return ""
    texts = [
        f"{with_unit(speed, f'{data.position_unit}/s', 3)} at {with_unit(level, data.input_unit, 3)}"
        for level, speed in speeds.items()
    ]
    return f" The motor settled at {list_text(list(dict.fromkeys(texts)))}."


def _speeds_apart(fit: Fit) -> str:
    """The level at which two records settled at speeds that no model can have both, in words; the empty text where none is so."""
    each = [(record.data, speeds_by_level([record.data])) for record in fit.records]
    for level in sorted({level for _, speeds in each for level in speeds if level != 0.0}):
        settled = sorted(
            ((speeds[level], data) for data, speeds in each if level in speeds), key=lambda one: one[0]
        )
        (low, one), (high, other) = settled[0], settled[-1]
        if high - low > _APART * max(abs(low), abs(high)):
            unit = f"{one.position_unit}/s"
            return (
                f" At {with_unit(level, one.input_unit, 3)} the motor settled at {with_unit(low, unit, 3)} in {one.name}, and at "
                f"{with_unit(high, unit, 3)} in {other.name}: that isn't one motor in one state. Identify each file by itself."
            )
    return ""


def _any_gain(gain: ParameterStatus, fit: Fit) -> str:
    """The reason why a gain stays open although the output follows the input."""
    widest = max(composition(fit), key=lambda line: line.half_widths.get(gain.name, 0.0))
    advice = (
        "Record how the speed gets from one level to the next, with samples close enough to show it"
        if len(_end_speeds(fit)) > 1
        else "Record steps between several levels in open loop, each until the speed settles"
    )
    return (
        f"this model explains {fit.fit_percent:.0f} % of the output, but what it may be wrong by is as large as its gain "
        f"(largest contribution: {widest.source}). {advice}"
    )
