"""The explanation of a difference: from a result and claims, or a fit and a data sheet, to causes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from servobench.core.arguments import check_type
from servobench.core.errors import NotIdentifiable, UsageError
from servobench.core.estimate import Estimate
from servobench.core.finding import Finding, Severity, Verdict, info, lower_first, warning
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import TWO_SIDED, plain, rounded_interval, with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.models.nominal import nominal_values
from servobench.identification.reconciliation.base import CAUSES, Question
from servobench.identification.reconciliation.claim import Claim
from servobench.identification.reconciliation.explanation import Difference, Explanation
from servobench.identification.reconciliation.judgement import JudgedCause, judge
from servobench.identification.reconciliation.probabilities import (
    CHANCE,
    SOMETHING_ELSE,
    TOLD,
    Hypothesis,
    chance_is_enough,
    participation,
    weigh,
    without,
)
from servobench.identification.reconciliation.questions import (
    about_claims,
    about_sheet,
    is_known,
    unknown_clause,
)
from servobench.identification.reconciliation.readings import Reading
from servobench.identification.reconciliation.reenactment import check_method
from servobench.identification.reconciliation.sentences import difference_sentences, likeliest, sentences
from servobench.identification.result import Result
from servobench.rig.motor.parameters import MotorParameters, nominal_motor

_ALIKE = 1 / 3  # of the first one's probability: evidence "barely worth mentioning" (Jeffreys)
_NO_CAUSE = (CHANCE, SOMETHING_ELSE)


def explain(
    result: Result,
    claims: Sequence[Claim | str] | Mapping[str, float] = (),
    *,
    nominal: str | MotorParameters | None = None,
    method: str | None = None,
) -> Explanation:
    """Return why claimed figures, or those of a data sheet, differ from what data say of a motor.

    `claims` are texts such as `tau=0.13` or `gain=23.8`, or a mapping of such values; without any, the data sheet `nominal` is
    what is explained. With both, the sheet is what is known of the motor, so that causes have sizes in ohms and kg·m².
    `method` is how the claim was found, where that is known (`step_63`, `log_linear`, `rise_time`, `arx`, `output_error`).
    Data that can't support a model give an explanation without differences, whose sentences say so. Raises `UsageError` where
    there is nothing to explain, `UnknownName`, and `NotIdentifiable` where the data leave open what is claimed.
    """
    check_method(method)
    motor = nominal_motor(nominal)
    stated = _claims(claims, result)
    if not stated and motor is None:
        raise UsageError("nothing to explain: name a claim, such as tau=0.13, or a data sheet")
    if result.fit is None or result.verdict is Verdict.REFUSED:
        refusals = [each.sentence for each in result.findings if each.severity == "refusal"]
        return Explanation(
            verdict=result.verdict,
            findings=result.findings,
            origin="claim" if stated else "data sheet",
            sentences=("These data can't support a model to compare the figure with.", *refusals),
        )  # fmt: skip
    if not stated:
        return _explain(about_sheet(result.fit, _require_parameters(motor)), result)
    known = tuple(claim for claim in stated if _can_be_judged(claim, result.fit))
    unknown = {
        claim: unknown_clause(result.answers[claim.name], result.combinations)
        for claim in stated
        if claim not in known
    }
    if not known:
        raise NotIdentifiable(f"there is nothing to compare with: {'; '.join(unknown.values())}")
    explanation = _explain(about_claims(result.fit, known, motor=motor, method=method), result)
    rest = [f"{claim.text} can't be judged: {why}." for claim, why in unknown.items()]
    return replace(explanation, sentences=(*rest, *_about_signs(known, result.fit), *explanation.sentences))


def _can_be_judged(claim: Claim, fit: Fit) -> bool:
    """Whether the data say what a claim is about, or the model doesn't have it, which is said elsewhere."""
    return claim.name not in fit.model.names or is_known(fit[claim.name])


def _about_signs(claims: Sequence[Claim], fit: Fit) -> tuple[str, ...]:
    """A sentence where a claimed gain has the other sign; what is explained further is its size."""
    if not any(claim.name == "gain" and claim.value * fit["gain"].value < 0 for claim in claims):
        return ()
    return (
        "The claimed gain has the opposite sign: the motor's leads or the encoder's channels are swapped, or the two figures "
        "count opposite directions as positive. Apart from the sign:",
    )


def reconcile(fit: Fit, parameters: MotorParameters) -> list[Finding]:
    """Return what explains the difference between a fit and a data sheet: the causes, their probabilities,
    and a deciding experiment.

    Of one value alone, only whether it differs: its cause needs both. Empty if the data determine neither. Raises `UsageError`
    for data in other units than V and rad.

    >>> import servobench as sb
    >>> with sb.connect("twin") as motor:
    ...     recording = sb.run(sb.Experiment(duration="3 s"), motor)
    >>> from servobench.rig.motor.parameters import data_sheet
    >>> [found.code for found in reconcile(sb.identify(recording).fit, data_sheet("qube_servo_2").motor)]
    ['nominal-agrees']
    """
    check_type("fit", fit, Fit, "the fit of a Result, result.fit")
    known = [name for name in ("gain", "time_constant") if name in fit.model.names and is_known(fit[name])]
    if len(known) < 2:
        return [_one_alone(name, fit[name], nominal_values(parameters)[name]) for name in known]
    question = about_sheet(fit, parameters)
    difference_text = " ".join(difference_sentences(_differences(question), question))
    if chance_is_enough(question):
        return [info("nominal-agrees", difference_text, parameters=("gain", "time_constant"))]
    causes, hypotheses = _weigh(question)
    explained = likeliest(question, causes, hypotheses, _alike(causes[0], hypotheses))
    first = causes[0]
    make_finding = warning if first.name == "encoder_scale" and first.probability > 0.5 else info
    return [
        make_finding(
            "nominal-differs", " ".join((difference_text, *explained)), parameters=("gain", "time_constant")
        ),
        info("deciding-experiment", _decisive(causes, hypotheses), parameters=("gain", "time_constant")),
    ]


def _one_alone(name: str, estimate: Estimate, nominal: float) -> Finding:
    """Whether the gain or the time constant, of which the data tell one only, is what a data sheet says."""
    low, high = estimate.interval
    words, ratio = parameter_in_words(name, estimate.unit), estimate.value / nominal
    data = rounded_interval(estimate.value, estimate.interval, estimate.unit)
    sentence = (
        f"The {words} from the data is {data}; the data sheet says {with_unit(nominal, estimate.unit, 3)}"
    )
    if low <= nominal <= high:
        return info("nominal-agrees", f"{sentence}, within the interval.", parameters=(name,))
    times = f"{plain(ratio, 2)} times as much" if ratio > 0 else "the opposite sign"
    return info(
        "nominal-differs",
        f"{sentence}, so the data give {times}. To find the cause, the data have to determine both gain and time constant.",
        parameters=(name,),
    )


def _claims(claims: Sequence[Claim | str] | Mapping[str, float], result: Result) -> tuple[Claim, ...]:
    unit = "rad/(s·V)"
    if result.fit is not None and "gain" in result.fit.model.names:
        unit = result.fit["gain"].unit
    check_type(
        "claims", claims, (Mapping, Sequence), 'texts such as "tau=0.13", or a dict such as {"tau": 0.13}'
    )
    entries = (
        [f"{name}={value!r}" for name, value in claims.items()] if isinstance(claims, Mapping) else claims
    )
    for each in entries:
        check_type("a claim", each, (Claim, str), "a text such as 'tau=0.13', or a Claim")
    return tuple(each if isinstance(each, Claim) else Claim.parse(each, unit) for each in entries)


def _require_parameters(motor: MotorParameters | None) -> MotorParameters:
    if motor is None:
        raise UsageError("there is no data sheet to compare the data with: name one")
    return motor


def _reservations(result: Result) -> list[str]:
    """What speaks against the model that a figure is compared with: of a doubtful result the first reason."""
    if result.verdict is not Verdict.DOUBTFUL:
        return []
    reasons = [finding.sentence for finding in result.findings if finding.severity == Severity.WARNING]
    return [
        f"The result from these data is doubtful, and the rest is only right if the model is. {reason}"
        for reason in reasons[:1]
    ]


def _explain(question: Question, result: Result) -> Explanation:
    causes, hypotheses = _weigh(question)
    differences = _differences(question)
    agrees = chance_is_enough(question)
    alike = _alike(causes[0], hypotheses)
    lines = [*_reservations(result), *difference_sentences(differences, question)]
    if not agrees:
        lines += sentences(question, causes, hypotheses, alike)
    return Explanation(
        verdict=result.verdict,
        findings=result.findings,
        origin=question.origin,
        differences=differences,
        agrees=agrees,
        readings=question.readings,
        nearest=_nearest(question),
        causes=causes,
        hypotheses=hypotheses,
        alike=() if agrees else alike,
        decision=causes[0].decision if causes[0].possible and not agrees else None,
        sentences=tuple(lines) if agrees else (*lines, _decisive(causes, hypotheses)),
    )


def _weigh(question: Question) -> tuple[tuple[JudgedCause, ...], tuple[Hypothesis, ...]]:
    """All causes, the most probable first and those that can't be one last, and the sets of those that can."""
    hypotheses = weigh(question)
    judged_causes = [judge(name, question, hypotheses) for name in CAUSES.names()]
    excluded = {each.name for each in judged_causes if not each.possible}
    causes = sorted(judged_causes, key=lambda each: (not each.possible, -each.probability))
    return tuple(causes), without(hypotheses, excluded)


def _differences(question: Question) -> tuple[Difference, ...]:
    """The figures of the data and the other ones, with halves of their 95 % intervals."""
    differences = []
    for n, name in enumerate(question.names):
        estimate = question.fit[name]
        data, half = question.fit[name].value, TWO_SIDED * estimate.sd
        is_claim = question.origin == "claim"
        other = question.after[name] if is_claim else question.before[name]
        scale = question.before["time_constant"] if name == "delay" else other
        own = question.covariance[n, n] - (estimate.sd / (scale if name == "delay" else abs(data))) ** 2
        differences.append(
            Difference(
                name=name,
                unit=estimate.unit,
                data=abs(data) if name == "gain" else data,
                data_half=half,
                other=other,
                other_half=TWO_SIDED * float(np.sqrt(max(own, 0.0))) * scale,
            )
        )
    return tuple(differences)


def _nearest(question: Question) -> Reading | None:
    """The reading that is nearest to the claim; None without any."""

    def far(reading: Reading) -> float:
        return sum(
            abs(float(np.log(abs(getattr(reading, name)) / question.after[name]))) for name in question.names
        )

    usable = [each for each in question.readings if not each.why_not and each.time_constant > 0]
    return min(usable, key=far, default=None)


def _alike(first: JudgedCause, hypotheses: Sequence[Hypothesis]) -> tuple[str, ...]:
    """The causes that may stand in the place of the first one, in the likeliest set with it, about as probably."""
    best = next((each for each in hypotheses if first.name in each.causes), None)
    if best is None:
        return ()
    rest = set(best.causes) - {first.name}
    alternatives: list[str] = []
    for each in hypotheses:
        others = set(each.causes) - rest
        replaced = rest < set(each.causes) and len(others) == 1 and not others & {first.name, *_NO_CAUSE}
        if replaced and each.probability > _ALIKE * best.probability:
            alternatives += others
    return tuple(alternatives)


def _decisive(causes: Sequence[JudgedCause], hypotheses: Sequence[Hypothesis]) -> str:
    """The experiment that tells the first cause from the one that is likeliest without it."""
    first = causes[0]
    if not first.possible:
        return "No cause remains: check how both figures were found."
    instead = participation(tuple(each for each in hypotheses if first.name not in each.causes))
    rivals = [each for each in causes[1:] if each.possible and instead.get(each.name, 0.0) >= TOLD]
    if not rivals:
        return f"To decide whether it is {first.label}: {lower_first(first.decision.sentence)}"
    second = max(rivals, key=lambda each: instead[each.name])
    return f"To decide between {first.label} and {second.label}: {lower_first(first.decision.sentence)}"
