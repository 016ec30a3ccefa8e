"""The verb identify: from data to a result, with the reasons to trust it or not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

import numpy as np

from servobench._version import __version__
from servobench.core.errors import NotIdentifiable, UsageError
from servobench.core.finding import Finding, Verdict, refusal, verdict
from servobench.identification.choice.noise_choice import (
    allowing_for_disturbance,
    as_it_is,
    with_counts_as_bins,
)
from servobench.identification.choice.records_apart import with_what_records_tell
from servobench.identification.choice.restored_counts import with_counts_restored
from servobench.identification.choice.structure_choice import chosen
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.estimators.unseen_torque import with_unseen_torque
from servobench.identification.models.level import single_level
from servobench.identification.models.motion import smoothed_speed
from servobench.identification.models.nominal import nominal_values
from servobench.identification.models.nonlinear.structure import SINE
from servobench.identification.models.stretches import stretches_of_motion
from servobench.identification.motor_parameters.combined import MotorEstimates, motor_parameters
from servobench.identification.motor_parameters.current import has_current
from servobench.identification.motor_parameters.current_input import about_current_input
from servobench.identification.reconciliation.asking import reconcile
from servobench.identification.result import Comparison, OperatingRange, Provenance, Result, Validation
from servobench.identification.trust.doubts.base import about_data, about_fit
from servobench.identification.trust.doubts.chain_unknown import with_unknown_chain
from servobench.identification.trust.doubts.host_delay import with_what_the_computer_hides
from servobench.identification.trust.doubts.lag_not_split import with_what_the_lag_tells
from servobench.identification.trust.doubts.single_level import (
    with_gain_and_friction_apart,
    with_what_one_level_tells,
)
from servobench.identification.trust.explanations.base import Causes, unexplained
from servobench.identification.trust.held_out import about_validation, cross_validate, validate_with
from servobench.identification.trust.missing_terms import (
    missing_terms,
    superfluous_terms,
    with_fast_pole,
    with_missing_terms,
)
from servobench.identification.trust.validation import validate
from servobench.identification.trust.winding import about_winding
from servobench.identification.uncertainty.answers import Answer, Combination, answers, combinations
from servobench.identification.uncertainty.model_error import with_model_error
from servobench.identification.uncertainty.rounded_times import with_rounded_times
from servobench.identification.uncertainty.stated import about_answers
from servobench.identification.uncertainty.unresolved import with_unresolved_time_constant
from servobench.identification.uncertainty.weak_priors import with_weak_priors
from servobench.recordings.measurement.dataset import Dataset
from servobench.rig.motor.parameters import MotorParameters, data_sheet


def identify(
    data: Dataset | Sequence[Dataset],
    structure: str = "auto",
    estimator: str = "auto",
    nominal: str | MotorParameters | None = None,
    validate_on: Sequence[Dataset] = (),
    known: Mapping[str, float | tuple[float, float]] | None = None,
) -> Result:
    """Return the model that fits the data best, how well it is known, and the reasons to trust it or not.

    Several datasets are fitted jointly: they share the parameters, and each has its own start state. `structure` and
    `estimator` are names, or "auto": then the structure is chosen by whether the motor turned both ways and which friction and
    gravity the data ask for (see `choice.structure_choice`), and the estimator by a likelihood-ratio test for a random
    torque. `nominal` is the name of a data sheet, or parameters, to hold the result against. `validate_on` are further datasets
    to try the model on; without any, records, input levels or stretches are left out in turn (`held_out`). Where a current was
    measured, or `known` states a value, the motor's own parameters come along, as far as they are determined: see
    `motor_parameters`.
    Data that can't support a model give a refused result, not an error. Raises `UsageError` for names that aren't
    known, a structure and an estimator that can't go together, or data that don't.
    """
    records = (data,) if isinstance(data, Dataset) else tuple(data)
    _check_together(records)
    findings = [finding for record in records for finding in record.findings]
    records, restored = with_counts_restored(records, estimator)
    findings += [*restored, *about_data(records, _parameters(nominal))]
    records, left_out = stretches_of_motion(records)
    findings += left_out
    judged = _Judged(causes=Causes(records))
    try:
        if verdict(findings) is not Verdict.REFUSED:
            judged = _judged(records, structure, estimator, nominal, validate_on, known)
    except NotIdentifiable as error:
        judged = replace(judged, findings=(refusal("not-identifiable", f"{error}."),))
    findings += judged.findings
    if unexplained(findings):
        told = {finding.code for finding in findings}
        causes = judged.causes.explain(judged.fit.fit_percent if judged.fit else np.nan)
        findings += [cause for cause in causes if cause.code not in told and not _in_model(cause, judged.fit)]
    return Result(
        data=records,
        fit=judged.fit,
        answers=judged.answers,
        combinations=judged.combinations,
        findings=tuple(_once(findings)),
        validation=judged.validation,
        operating_range=_operating_range(records),
        nominal=judged.nominal,
        motor_parameters=judged.motor.estimates,
        provenance=Provenance(
            version=__version__,
            created=datetime.now(UTC).isoformat(timespec="seconds"),
            inputs_sha256=tuple(sorted({record.source.sha256 for record in records if record.source.sha256})),
        ),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Judged:
    """A fit and what was made of it, nothing where there is no fit; and what may be wrong with the records."""

    causes: Causes
    fit: Fit | None = None
    answers: Mapping[str, Answer] = field(default_factory=dict)
    combinations: tuple[Combination, ...] = ()
    findings: tuple[Finding, ...] = ()
    validation: Validation | None = None
    nominal: tuple[Comparison, ...] = ()
    motor: MotorEstimates = field(default_factory=MotorEstimates)


def _judged(
    records: tuple[Dataset, ...],
    structure: str,
    estimator: str,
    nominal: str | MotorParameters | None,
    validate_on: Sequence[Dataset],
    known: Mapping[str, float | tuple[float, float]] | None,
) -> _Judged:
    """Fit what was asked for, or what the data need, and weigh what came out."""
    method = ESTIMATORS["output_error" if estimator == "auto" else estimator]
    allow = allowing_for_disturbance if estimator == "auto" else as_it_is
    choice = chosen(method, records, structure, estimator, allow)
    fit = with_counts_as_bins(choice.fit) if estimator == "auto" else choice.fit
    one_level = single_level(records) is not None
    fit = with_weak_priors(fit) if one_level else fit
    fit = with_what_records_tell(with_fast_pole(fit), method, allow)
    if estimator == "auto":
        fit = with_unseen_torque(fit)
    fit = with_missing_terms(fit, choice.shown)
    fit = with_rounded_times(fit)
    fit = with_unresolved_time_constant(with_model_error(fit, one_level))
    fit = with_what_the_lag_tells(with_unknown_chain(with_what_the_computer_hides(fit)))
    fit = with_gain_and_friction_apart(fit)
    told = answers(fit), combinations(fit)
    fit = with_what_one_level_tells(fit)
    validation = validate_with(fit, validate_on) if validate_on else cross_validate(method, records, fit)
    findings = [
        *choice.findings,
        *fit.findings,
        *about_answers(*told),
        *about_fit(fit, _parameters(nominal)),
        *about_winding(fit),
        *about_current_input(fit),
        *validate(fit),
        *missing_terms(choice.shown),
        *superfluous_terms(fit),
        *about_validation(fit, validation, validate_on),
        *_causes(fit, nominal),
    ]
    motor = MotorEstimates()
    if (known or has_current(fit)) and verdict(findings) is not Verdict.REFUSED:
        motor = motor_parameters(fit, known=known)
    return _Judged(
        causes=choice.causes,
        fit=fit,
        answers=told[0],
        combinations=told[1],
        findings=(*findings, *motor.findings),
        validation=validation,
        nominal=_compare(fit, nominal),
        motor=motor,
    )


def _in_model(cause: Finding, fit: Fit | None) -> bool:
    """Whether a cause is gravity, which a plain motor lacks, and the model that was fitted has it already."""
    return fit is not None and SINE.name in cause.parameters and SINE.name in fit.model.names


def _check_together(records: Sequence[Dataset]) -> None:
    if not records:
        raise UsageError("nothing to identify: expected at least one dataset")
    for what in ("input_unit", "output_unit", "kind"):
        found = sorted({str(getattr(record, what)) for record in records})
        if len(found) > 1:
            raise UsageError(
                f"the records can't be fitted together: their {what.replace('_', ' ')}s are {' and '.join(found)}"
            )


def _parameters(nominal: str | MotorParameters | None) -> MotorParameters | None:
    return data_sheet(nominal).motor if isinstance(nominal, str) else nominal


def _compare(fit: Fit, nominal: str | MotorParameters | None) -> tuple[Comparison, ...]:
    """The estimates beside the nominal values, for data in volts and radians."""
    motor = _parameters(nominal)
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
        if name in estimates and np.isfinite(estimates[name].sd)
    )


def _causes(fit: Fit, nominal: str | MotorParameters | None) -> list[Finding]:
    """What explains the difference to the nominal values."""
    motor = _parameters(nominal)
    return [] if motor is None else reconcile(fit, motor)


def _operating_range(records: Sequence[Dataset]) -> OperatingRange:
    inputs = np.concatenate([record.u for record in records])
    speeds = np.concatenate([smoothed_speed(record) for record in records])
    return OperatingRange(
        input=(float(inputs.min()), float(inputs.max())), speed=(float(speeds.min()), float(speeds.max()))
    )


def _once(findings: Sequence[Finding]) -> list[Finding]:
    """The findings without repetitions, in their order."""
    return list(dict.fromkeys(findings))
