"""The verb identify: from data to a result, with the reasons to trust it or not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from servobench._version import __version__
from servobench.doubts.base import about_data, about_fit
from servobench.errors import NotIdentifiable, UsageError
from servobench.estimators.base import ESTIMATORS, Estimator, Fit
from servobench.estimators.prediction_error import (
    THRESHOLD,
    PredictionError,
    disturbance_test,
    rounding_explains,
)
from servobench.estimators.repetition import period, repeats
from servobench.estimators.second_weighing import weighed_twice
from servobench.explanations.base import explain, unexplained
from servobench.finding import Finding, info, refusal
from servobench.held_out import about_validation, cross_validate, validate_with
from servobench.finding import Finding, Verdict, info, refusal, verdict, warning
from servobench.measurement.dataset import Dataset
from servobench.missing_terms import fast_pole_doubt, missing_terms
from servobench.models.nominal import nominal_values
from servobench.models.search import smoothed_speed
from servobench.motor.parameters import MotorParameters, data_sheet
from servobench.motor_parameters.combined import MotorEstimates, motor_parameters
from servobench.motor_parameters.current import has_current
from servobench.reconciliation.asking import reconcile
from servobench.motor_parameters.current_input import about_current_input
from servobench.plausibility import about_data, about_fit
from servobench.result import Comparison, OperatingRange, Provenance, Result, Validation
from servobench.structure_choice import chosen
from servobench.validate import explains_the_colour, validate
from servobench.winding import about_winding


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
    gravity the data ask for (see `servobench.structure_choice`), and the estimator by a likelihood-ratio test for a random
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
    findings += about_data(records)
    method = ESTIMATORS["output_error" if estimator == "auto" else estimator]
    fit: Fit | None = None
    validation: Validation | None = None
    comparisons: tuple[Comparison, ...] = ()
    motor = MotorEstimates()
    refused = any(finding.severity == "refusal" for finding in findings)
    try:
        if not refused:
            allow = _allowing_for_disturbance if estimator == "auto" else _as_it_is
            choice = chosen(method, records, structure, estimator, allow)
            fit = replace(choice.fit, covariance=choice.fit.covariance + fast_pole_doubt(choice.fit))
            validation = _validation(method, records, fit, validate_on)
            findings += [
                *choice.findings,
                *fit.findings,
                *about_fit(fit, _parameters(nominal)),
                *about_winding(fit),
                *about_current_input(fit),
                *validate(fit),
                *missing_terms(choice.shown),
                *about_validation(fit, validation),
            ]
            comparisons = _compare(fit, nominal)
            findings += _causes(fit, nominal)
            motor = motor_parameters(fit, known=known) if known or has_current(fit) else motor
            findings += motor.findings
            if (known or has_current(fit)) and verdict(findings) is not Verdict.REFUSED:
                motor = motor_parameters(fit, known=known)
                findings += motor.findings
    except NotIdentifiable as error:
        fit = None
        findings.append(refusal("not-identifiable", f"{error}."))
    if unexplained(findings):
        findings += explain(records)
    return Result(
        data=records,
        fit=fit,
        findings=tuple(_once(findings)),
        validation=validation,
        operating_range=_operating_range(records),
        nominal=comparisons,
        motor_parameters=motor.estimates,
        provenance=Provenance(
            version=__version__,
            created=datetime.now(UTC).isoformat(timespec="seconds"),
            inputs_sha256=tuple(sorted({record.source.sha256 for record in records if record.source.sha256})),
        ),
    )


def _check_together(records: Sequence[Dataset]) -> None:
    if not records:
        raise UsageError("nothing to identify: expected at least one dataset")
    for what in ("input_unit", "output_unit", "kind"):
        found = sorted({str(getattr(record, what)) for record in records})
        if len(found) > 1:
            raise UsageError(
                f"the records can't be fitted together: their {what.replace('_', ' ')}s are {' and '.join(found)}"
            )


def _as_it_is(fit: Fit) -> Fit:
    """The fit itself, of an estimator that was asked for by its name."""
    return fit


def _allowing_for_disturbance(fit: Fit) -> Fit:
    """The fit itself, or prediction error's where the residuals say that a random torque acts on the motor.

    Where every count is where it should be there is nothing to allow for, or nothing but rounding.
    Where a random torque leaves coloured innovations it isn't what acts on the motor; then output error is the safer of two wrong
    noise models, with a covariance that allows for what the other one makes of the same data.
    """
    counted = _where_rounding_repeats(fit)
    if counted is not None:
        return counted
    if rounding_explains(fit):
        return fit
    test = disturbance_test(fit)
    if test is None:
        return fit
    allowing = fit
    if test.likelihood_ratio > THRESHOLD:
        counted = _by_counts(fit)
        if counted is not None:
            return counted
        allowing = PredictionError().fit_after(fit)
    return allowing if explains_the_colour(allowing) else weighed_twice(fit)


def _where_rounding_repeats(fit: Fit) -> Fit | None:
    """The fit of the interval likelihood where a motor goes to and fro over the same counts; None where that isn't so.

    Rounding then repeats with the input, and no average over the record makes it less. Taken as bins, the counts say more. But a
    few distinct errors decide, so that by how much the two estimates differ is part of the covariance.
    """
    again = fit.model.structure.friction and any(
        record.data.quantum and (length := period(record.data)) and repeats(record.residual, length)
        for record in fit.records
    )
    if not again:
        return None
    data = [record.data for record in fit.records]
    counts = ESTIMATORS["interval_likelihood"]
    if counts.supports(fit.model.structure, data) is not None:
        return None
    counted = counts.fit(fit.model.structure, data, [fit.vector])
    if any(finding.severity != "info" for finding in counted.findings):
        return None
    sentence = (
        "The motor goes to and fro over the same counts, so the encoder's rounding repeats with the input and doesn't "
        "average out. The estimator interval_likelihood takes each count for what it is."
    )
    apart = counted.model.theta - fit.model.theta
    return replace(
        counted,
        covariance=counted.covariance + np.outer(apart, apart),
        findings=(*counted.findings, info("rounding-repeats", sentence)),
    )


def _by_counts(fit: Fit) -> Fit | None:
    """The fit of the interval likelihood where rounding alone looks like a random torque; None where it isn't that.

    Where speed and encoder beat slowly (nearly a whole number of counts in each few samples), rounding wanders like a shaft under
    a random torque. But it leaves each count where it belongs, which a torque doesn't.
    """
    if not rounding_explains(fit, times=5.0):
        return None
    data = [record.data for record in fit.records]
    counted = ESTIMATORS["interval_likelihood"].fit(fit.model.structure, data, [fit.vector])
    if not rounding_explains(counted, times=0.5):
        return None
    sentence = (
        "The encoder's rounding comes and goes slowly in these data: the speed is near a simple fraction of counts per sample. "
        "The estimator interval_likelihood takes each count for what it is; to output_error it would look like a moving shaft."
    )
    return replace(counted, findings=(*counted.findings, info("rounding-beats", sentence)))


def _validation(
    method: Estimator, data: Sequence[Dataset], fit: Fit, others: Sequence[Dataset]
) -> Validation | None:
    return validate_with(fit, others) if others else cross_validate(method, data, fit)


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
            f"nominal values are in V and rad, the data are in {data.input_unit} and {data.position_unit}: leave nominal out"
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
        if name in estimates
    )


def _causes(fit: Fit, nominal: str | MotorParameters | None) -> list[Finding]:
    """What explains the difference to the nominal values."""
    if nominal is None:
        return []
    return reconcile(fit, data_sheet(nominal).motor if isinstance(nominal, str) else nominal)


def _operating_range(records: Sequence[Dataset]) -> OperatingRange:
    inputs = np.concatenate([record.u for record in records])
    speeds = np.concatenate([smoothed_speed(record) for record in records])
    return OperatingRange(
        input=(float(inputs.min()), float(inputs.max())), speed=(float(speeds.min()), float(speeds.max()))
    )


def _once(findings: Sequence[Finding]) -> list[Finding]:
    """The findings without repetitions, in their order."""
    return list(dict.fromkeys(findings))
