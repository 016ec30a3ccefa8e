"""The verb identify: from data to a result, with the reasons to trust it or not.

The model and its fit: source: see `identification.estimators.output_error`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import Unpack

import numpy as np

from servobench._version import __version__
from servobench.core.arguments import check_mapping, check_type
from servobench.core.errors import NotIdentifiable, UsageError
from servobench.core.finding import Finding, Severity, Verdict, list_text, refusal, verdict
from servobench.core.parameter_names import plain_words
from servobench.identification.choice.noise_choice import (
    allow_for_disturbance,
    as_it_is,
    with_counts_as_bins,
)
from servobench.identification.choice.records_apart import widen_for_disagreement
from servobench.identification.choice.restored_counts import with_counts_restored
from servobench.identification.choice.structure_choice import Choice, choose_structure
from servobench.identification.estimators.base import ESTIMATORS, Estimator, Fit
from servobench.identification.estimators.prediction_error import rounding_explains
from servobench.identification.estimators.sizes import WEAK, friction_spread
from servobench.identification.estimators.unseen_torque import with_unseen_torque
from servobench.identification.models.common_parameters import TIME_CONSTANT
from servobench.identification.models.level import single_level
from servobench.identification.models.motion import smooth_speed
from servobench.identification.models.nominal import nominal_values
from servobench.identification.models.nonlinear.structure import SINE
from servobench.identification.models.stretches import doubt_rests, stretches_of_motion
from servobench.identification.motor_parameters.combination import MotorEstimates, motor_parameters
from servobench.identification.motor_parameters.current import has_current
from servobench.identification.motor_parameters.current_input import about_current_input
from servobench.identification.reconciliation.reconcile import reconcile
from servobench.identification.result import Comparison, OperatingRange, Provenance, Result, Validation
from servobench.identification.trust.doubts.base import about_data, about_fit
from servobench.identification.trust.doubts.chain_unknown import with_unknown_chain
from servobench.identification.trust.doubts.host_delay import widen_for_host_delay
from servobench.identification.trust.doubts.lag_not_split import widen_for_lag_split
from servobench.identification.trust.doubts.single_level import (
    widen_for_gain_friction_split,
    widen_for_single_level,
)
from servobench.identification.trust.doubts.spikes import without_spikes
from servobench.identification.trust.explanations.base import Causes, is_unexplained
from servobench.identification.trust.held_out import about_validation, cross_validate, validate_with
from servobench.identification.trust.missing_terms import (
    missing_terms,
    superfluous_terms,
    with_missing_terms,
)
from servobench.identification.trust.other_output import with_other_output
from servobench.identification.trust.validation import validate
from servobench.identification.trust.winding import about_winding
from servobench.identification.uncertainty.changes_between_rows import with_changes_between_rows
from servobench.identification.uncertainty.creeping_rest import with_creeping_rest
from servobench.identification.uncertainty.curved_valley import with_curved_valley
from servobench.identification.uncertainty.fall_of_friction import with_fall_of_friction
from servobench.identification.uncertainty.friction_near_rest import with_friction_near_rest
from servobench.identification.uncertainty.friction_range import with_friction_range
from servobench.identification.uncertainty.identifiability import (
    Combination,
    ParameterStatus,
    State,
    combinations,
    parameter_statuses,
)
from servobench.identification.uncertainty.model_error import with_model_error
from servobench.identification.uncertainty.one_lag import with_one_lag
from servobench.identification.uncertainty.rounded_times import with_rounded_times
from servobench.identification.uncertainty.rounding_that_stays import with_rounding_that_stays
from servobench.identification.uncertainty.scatter_between_runs import with_scatter_between_runs
from servobench.identification.uncertainty.small_departures import with_small_departures
from servobench.identification.uncertainty.static_friction import with_static_friction
from servobench.identification.uncertainty.status_findings import about_answers
from servobench.identification.uncertainty.unresolved_time_constant import with_unresolved_time_constant
from servobench.identification.uncertainty.weak_priors import with_weak_priors
from servobench.recordings.evidence import Evidence
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.shared_samples import share_samples
from servobench.recordings.reading import ReadingOptions, evidence_in, further_evidence_in
from servobench.recordings.recording import Recording
from servobench.rig.motor.parameters import MotorParameters, nominal_motor

# What follows from another finding, which says more; one after the other, as a finding that was left out leaves nothing else out.
# Speeds that settle by the levels of the input are no chance, either.
_CONSEQUENCES = {
    "kind-mistaken": ("nothing-known",),
    "output-stops": ("delay-negative", "shaft-comes-to-rest"),
    "motion-stopped": ("output-stops",),
    "gain-falls": ("speed-levels-off", "output-limited"),
    "speed-levels-off": ("structure-wrong", "fit-by-chance", "fit-poor", "offset-negative", "output-limited"),
    "shaft-runs-back": ("structure-wrong", "structure-reverses", "fit-poor"),
}


def identify(
    data: object = None,
    structure: str = "auto",
    estimator: str = "auto",
    nominal: str | MotorParameters | None = None,
    validate_on: object = (),
    known: Mapping[str, float | tuple[float, float]] | None = None,
    *,
    starts_at_rest: bool = False,
    **options: Unpack[ReadingOptions],
) -> Result:
    """Return the model that fits the data best, how well it is known, and the reasons to trust it or not.

    `data` is a `Dataset`, a `Recording`, the path of a file, a DataFrame (pandas, polars, Arrow, xarray), a time response of
    python-control, or a list of these; arrays are given as `t`, `u` and `y` with their units. `options` say
    how to read data that aren't a `Dataset` yet, as on the command line: see `ReadingOptions`.
    `starts_at_rest` says that the shaft is at rest when each record begins. Everything that was recognised
    rather than stated is a finding.

    Several records are fitted jointly: they share the parameters, and each has its own start state.
    `structure` and `estimator` are names, or "auto". Then the structure depends on whether the motor turned
    both ways, and on the friction and gravity that the data need (see `choice.structure_choice`); the
    estimator depends on a likelihood-ratio test for a random torque. `nominal` is the name of a data sheet,
    or parameters, to compare the result with. `validate_on` are further data, read in the same way, to test
    the model on; without any, records, input levels or stretches are left out in turn (`held_out`). If a
    current was measured, or `known` gives a value, the result includes the motor's own parameters, as far as
    they are determined: see `motor_parameters`. Data that can't support a model give a refused result, not an
    error. Raises `UsageError` for unreadable data, unknown names, a structure and an estimator that don't fit
    together, or data that don't; `MissingInformation` if the data need more information.

    >>> import numpy as np
    >>> t = np.arange(0, 2, 0.002)
    >>> u = np.where(t % 1 < 0.5, 2.0, 4.0)
    >>> y = np.zeros(len(t))
    >>> for k in range(len(t) - 1):  # a motor of 20 rad/(s·V) and 0.1 s
    ...     y[k + 1] = y[k] + (1 - np.exp(-0.02)) * (20 * u[k] - y[k])
    >>> result = identify(t=t, u=u, y=y, input_unit="V", output_unit="rad/s", chain="none")
    >>> round(result["gain"].value, 3), round(result["time_constant"].value, 4)
    (20.0, 0.1)
    """
    check_type("structure", structure, str, "a name, or 'auto'")
    check_type("estimator", estimator, str, "a name, or 'auto'")
    check_type("starts_at_rest", starts_at_rest, bool, "True or False")
    sheet = nominal_motor(nominal)
    if known is not None:
        check_mapping("known", known, '{"resistance": 8.4}')
    parts = evidence_in(data, **options)
    others: tuple[Evidence | Dataset, ...] = ()
    if not (isinstance(validate_on, Sequence) and not len(validate_on)):
        others = further_evidence_in(validate_on, argument="validate_on", **options)
    return identify_evidence(
        parts, structure, estimator, sheet, validate_on=others, known=known, starts_at_rest=starts_at_rest
    )


def identify_evidence(
    parts: Sequence[Evidence | Dataset],
    structure: str = "auto",
    estimator: str = "auto",
    nominal: str | MotorParameters | None = None,
    *,
    validate_on: Sequence[Evidence | Dataset] = (),
    known: Mapping[str, float | tuple[float, float]] | None = None,
    starts_at_rest: bool = False,
) -> Result:
    """Return what `identify` does, for data of which all that has to be said is said."""
    recordings = [part.recording for part in parts if isinstance(part, Evidence)]
    try:
        records = _datasets(parts, starts_at_rest)
    except NotIdentifiable as error:
        return _without_data(recordings, error)
    others = _validation_data(validate_on, starts_at_rest, records)
    result = _identify(records, structure, estimator, nominal, others, known)
    return with_other_output(result, recordings)


def _datasets(parts: Sequence[Evidence | Dataset], starts_at_rest: bool) -> tuple[Dataset, ...]:
    return tuple(part if isinstance(part, Dataset) else part.dataset(starts_at_rest) for part in parts)


def _validation_data(
    parts: Sequence[Evidence | Dataset], starts_at_rest: bool, records: Sequence[Dataset]
) -> tuple[Dataset, ...]:
    """The records to try the model on: usable ones, and others than those that it is fitted to."""
    try:
        others = _datasets(parts, starts_at_rest)
    except NotIdentifiable as error:
        raise UsageError(f"the data to validate on can't be used: {error}") from error
    for other in others:
        if any(share_samples(record, other) for record in records):
            raise UsageError(
                f"{other.name} can't validate the model, which is fitted to the same samples; give another recording of the "
                "motor, or none: then parts of the data are left out in turn"
            )
    return others


def _without_data(recordings: Sequence[Recording], error: NotIdentifiable) -> Result:
    findings = [finding for recording in recordings for finding in recording.findings]
    nowhere = (np.nan, np.nan)
    return Result(
        data=(),
        fit=None,
        findings=(*findings, refusal("not-identifiable", f"{error}.")),
        validation=None,
        operating_range=OperatingRange(input=nowhere, speed=nowhere),
        nominal=(),
        provenance=_provenance(recordings),
    )


def _provenance(sources: Sequence[Recording | Dataset]) -> Provenance:
    return Provenance(
        version=__version__,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        inputs_sha256=tuple(sorted({each.source.sha256 for each in sources if each.source.sha256})),
    )


def _identify(
    records: tuple[Dataset, ...],
    structure: str,
    estimator: str,
    nominal: str | MotorParameters | None,
    validate_on: Sequence[Dataset],
    known: Mapping[str, float | tuple[float, float]] | None,
) -> Result:
    _check_together(records)
    findings = [finding for record in records for finding in record.findings]
    records, restored = with_counts_restored(records, estimator)
    if restored:  # of the same encoder: in differences the model would be tested on rounding
        validate_on, others = with_counts_restored(validate_on, estimator)
        restored += others
    findings += [*restored, *about_data(records, nominal_motor(nominal))]
    if estimator == "auto":
        records, spikes = without_spikes(records)
        validate_on, others = without_spikes(validate_on)
        findings += [*spikes, *others]
    records, left_out = stretches_of_motion(records)
    judged = _Judgement(causes=Causes(records))
    try:
        if verdict(findings) is not Verdict.REFUSED:
            judged = _judge(records, structure, estimator, nominal, validate_on, known)
    except NotIdentifiable as error:
        judged = replace(judged, findings=(refusal("not-identifiable", f"{error}."),))
    findings += [*_about_rests(left_out, judged.fit), *judged.findings]
    simulated = judged.fit.fit_percent if judged.fit else np.nan
    if is_unexplained(_without_consequences(findings), simulated):
        codes = {finding.code for finding in findings}
        causes = judged.causes.explain(simulated, _relative_half_width(judged.answers))
        new = [cause for cause in causes if cause.code not in codes and not _in_model(cause, judged.fit)]
        findings = [*new, *findings]  # what is wrong says more than that something is
    return Result(
        data=records,
        fit=judged.fit,
        answers=judged.answers,
        combinations=judged.combinations,
        findings=tuple(_once(_without_consequences(findings))),
        validation=judged.validation,
        operating_range=_operating_range(records),
        nominal=judged.nominal,
        motor_parameters=judged.motor.estimates,
        provenance=_provenance(records),
    )


def _about_rests(left_out: Sequence[Finding], fit: Fit | None) -> list[Finding]:
    """The findings on rests that were left out of closed loops: a doubt where something random moves the shaft."""
    if fit is None or not left_out:
        return list(left_out)
    loops = tuple(record for record in fit.records if record.data.closed_loop)
    counted = all(record.data.quantum for record in loops)
    quiet = rounding_explains(replace(fit, records=loops)) if counted else fit.disturbance is None
    return list(left_out) if quiet else list(map(doubt_rests, left_out))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Judgement:
    """A fit and what was made of it, nothing where there is no fit; and what may be wrong with the records."""

    causes: Causes
    fit: Fit | None = None
    answers: Mapping[str, ParameterStatus] = field(default_factory=dict)
    combinations: tuple[Combination, ...] = ()
    findings: tuple[Finding, ...] = ()
    validation: Validation | None = None
    nominal: tuple[Comparison, ...] = ()
    motor: MotorEstimates = field(default_factory=MotorEstimates)


def _judge(
    records: tuple[Dataset, ...],
    structure: str,
    estimator: str,
    nominal: str | MotorParameters | None,
    validate_on: Sequence[Dataset],
    known: Mapping[str, float | tuple[float, float]] | None,
) -> _Judgement:
    """Fit what was requested, or what the data need, and weigh what came out."""
    method = ESTIMATORS["output_error" if estimator == "auto" else estimator]
    allow = allow_for_disturbance if estimator == "auto" else as_it_is
    choice = choose_structure(method, records, structure, estimator, allow)
    fit = choice.fit if choice.computed else _with_allowances(choice, method, records, estimator, allow)
    while choice.below is not None and choice.loses(fit):
        choice = choice.below
        fit = _with_allowances(choice, method, records, estimator, allow)
    statuses, combined = parameter_statuses(fit), combinations(fit)
    fit = widen_for_single_level(fit)
    validation = validate_with(fit, validate_on) if validate_on else cross_validate(method, records, fit)
    findings = [
        *_causes(fit, nominal),
        *_about_known([*choice.restate(fit), *fit.findings], statuses),
        *about_answers(statuses, combined, fit),
        *_about_known(about_fit(fit, nominal_motor(nominal)), statuses),
        *about_winding(fit),
        *about_current_input(fit),
        *([] if choice.computed else validate(fit)),
        *missing_terms(choice.terms),
        *superfluous_terms(fit),
        *about_validation(fit, validation, validate_on),
    ]
    motor = MotorEstimates()
    if (known or has_current(fit)) and verdict(findings) is not Verdict.REFUSED:
        motor = motor_parameters(fit, known=known)
    return _Judgement(
        causes=choice.causes,
        fit=fit,
        answers=statuses,
        combinations=combined,
        findings=(*findings, *motor.findings),
        validation=validation,
        nominal=_compare(fit, nominal, statuses),
        motor=motor,
    )


def _relative_half_width(answers: Mapping[str, ParameterStatus]) -> float:
    """Half of the gain's interval as a part of the gain; 0 where the gain isn't known."""
    gain = answers.get("gain")
    if gain is None or gain.state is not State.KNOWN:
        return 0.0
    return gain.estimate.half_width / abs(gain.estimate.value)


def _about_known(findings: Sequence[Finding], answers: Mapping[str, ParameterStatus]) -> list[Finding]:
    """The findings without those on the value of a parameter that isn't known by itself, or on an end of its range.

    A time constant that the data don't tell ends anywhere, at next to nothing as well; that is no sign of a wrong model.
    """
    return [each for each in findings if not _is_about_unknown(each, answers)]


def _is_about_unknown(finding: Finding, answers: Mapping[str, ParameterStatus]) -> bool:
    unknown = answers.get(finding.parameters[0]) if finding.parameters else None
    if unknown is None or unknown.state is State.KNOWN:
        return False
    if finding.code == "offset-found":
        return True
    lenient = finding.severity is Severity.INFO or finding.parameters == (TIME_CONSTANT.name,)
    return finding.code == "parameter-at-bound" and lenient


def _with_allowances(
    choice: Choice,
    method: Estimator,
    records: tuple[Dataset, ...],
    estimator: str,
    allow: Callable[[Fit], Fit],
) -> Fit:
    """The fit with all the lines of its budget: what the data and experience say that a model may be wrong by."""
    fit = with_counts_as_bins(choice.fit) if estimator == "auto" else choice.fit
    one_level = single_level(records) is not None
    # Any gain with its own friction makes the motion of a motor that ran under one level in a direction.
    fit = with_weak_priors(fit) if one_level or friction_spread(fit) > WEAK else fit
    fit = with_creeping_rest(fit)
    fit = widen_for_disagreement(
        with_small_departures(
            with_static_friction(
                with_fall_of_friction(with_friction_near_rest(with_one_lag(with_friction_range(fit))))
            )
        ),
        method,
        allow,
    )
    if estimator == "auto":
        fit = with_unseen_torque(fit)
    fit = with_missing_terms(fit, choice.terms)
    fit = with_changes_between_rows(with_rounded_times(with_curved_valley(fit)))
    fit = with_scatter_between_runs(with_rounding_that_stays(fit))
    fit = with_unresolved_time_constant(with_model_error(fit, one_level))
    fit = widen_for_lag_split(with_unknown_chain(widen_for_host_delay(fit)))
    return widen_for_gain_friction_split(fit)


def _in_model(cause: Finding, fit: Fit | None) -> bool:
    """Whether a cause is gravity, which a plain motor lacks, and the model that was fitted has it already."""
    return fit is not None and SINE.name in cause.parameters and SINE.name in fit.model.names


def _check_together(records: Sequence[Dataset]) -> None:
    if not records:
        raise UsageError("nothing to identify: expected at least one dataset")
    for what in ("input_unit", "output_unit", "kind"):
        first = {str(getattr(record, what)): record.name for record in reversed(records)}
        if len(first) > 1:
            each = [f"{value} in {name}" for value, name in sorted(first.items())]
            raise UsageError(
                f"the records can't be fitted together: their {plain_words(what)} is {list_text(each)}; choose columns of one "
                "kind and unit, or identify the records one by one"
            )


def _compare(
    fit: Fit, nominal: str | MotorParameters | None, answers: Mapping[str, ParameterStatus]
) -> tuple[Comparison, ...]:
    """The known estimates compared with the nominal values, for data in volts and radians."""
    motor = nominal_motor(nominal)
    if motor is None:
        return ()
    data = fit.records[0].data
    if data.input_unit != "V" or data.position_unit != "rad":
        raise UsageError(
            f"a data sheet is in V and rad, the data are in {data.input_unit} and {data.position_unit}: leave nominal out"
            + (
                ", or say the counts in a turn (`counts_per_rev=...`)"
                if data.position_unit == "counts"
                else ""
            )
        )
    estimates = fit.estimates
    return tuple(
        Comparison(
            name=name,
            nominal=value,
            identified=estimates[name].value,
            sd=estimates[name].sd,
            unit=estimates[name].unit,
        )
        for name, value in nominal_values(motor).items()
        if name in estimates and answers[name].state is State.KNOWN
    )


def _causes(fit: Fit, nominal: str | MotorParameters | None) -> list[Finding]:
    """The findings that explain the difference from the nominal values."""
    motor = nominal_motor(nominal)
    return [] if motor is None else reconcile(fit, motor)


def _operating_range(records: Sequence[Dataset]) -> OperatingRange:
    inputs = np.concatenate([record.u for record in records])
    speeds = np.concatenate([smooth_speed(record) for record in records])
    return OperatingRange(
        input=(float(inputs.min()), float(inputs.max())), speed=(float(speeds.min()), float(speeds.max()))
    )


def _without_consequences(findings: Sequence[Finding]) -> list[Finding]:
    """The findings without those that follow from another one, which says more."""
    left = list(findings)
    for cause, consequences in _CONSEQUENCES.items():
        if any(each.code == cause for each in left):
            left = [each for each in left if each.code not in consequences]
    return left


def _once(findings: Sequence[Finding]) -> list[Finding]:
    """The findings without repetitions, in their order."""
    return list(dict.fromkeys(findings))
