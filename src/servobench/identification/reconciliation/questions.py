"""From a fit and claims, or a fit and a data sheet, to the question that causes are judged by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable, UsageError
from servobench.core.estimate import Estimate
from servobench.core.parameter_names import parameter_in_words
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.models.nominal import nominal_values
from servobench.identification.reconciliation.base import Name, Question
from servobench.identification.reconciliation.claim import Claim, last_digit_half_width
from servobench.identification.reconciliation.reenactment import lags_of_fit, read_lags, reenact
from servobench.identification.uncertainty.identifiability import (
    Combination,
    ParameterStatus,
    State,
    combinations,
    parameter_statuses,
)
from servobench.identification.uncertainty.status_text import in_words
from servobench.rig.motor.parameters import MotorParameters

_UNIFORM = 1 / math.sqrt(3)  # the standard deviation of what is spread evenly over ± 1
_FEW_DIGITS = 4  # of a value that was written by hand; one with more was computed
_UNKNOWN = 0.5  # of an estimate: a larger standard deviation is a refusal in `doubts.uncertain`, too
_READINGS = {"step_63", "log_linear"}  # estimators that leave the measurement's lag in


def about_claims(
    fit: Fit, claims: Sequence[Claim], *, motor: MotorParameters | None = None, method: str | None = None
) -> Question:
    """Return the question how claims come from the figures of the data.

    Raises `UsageError` for two claims of one parameter, or a structure without what is claimed; `NotIdentifiable` where the
    data don't tell that.
    """
    names: tuple[Name, ...] = tuple(claim.name for claim in claims)
    if len(set(names)) != len(names):
        raise UsageError(f"{', '.join(names)}: claim each parameter once")
    _check(fit, names)
    if motor is not None:
        _check_units(fit)
    before = _figures(fit)
    after: dict[str, float] = {claim.name: abs(claim.value) for claim in claims}
    rounding = [_UNIFORM * claim.half_width / abs(claim.value) for claim in claims]
    readings = reenact(
        fit, (method,) if method else ("step_63", "log_linear", "rise_time", "arx", "output_error")
    )
    first = method or "step_63"
    is_speed = all(record.data.kind == "speed" for record in fit.records)
    own = next(each for each in readings if each.method == first)
    known = own.time_constant - before["time_constant"] if is_speed and not own.why_not else None
    return Question(
        origin="claim",
        names=names,
        before=before,
        after=after,
        covariance=_of_fit(fit, names) + np.diag(np.square(rounding)),
        fit=fit,
        motor=motor,
        friction=None if motor is None else max(1 / (before["gain"] * motor.motor_constant) - 1, 0.0),
        method=method,
        readings=readings,
        known_lag=known,
        lags=None if is_speed else read_lags(fit, first),
    )


def about_sheet(fit: Fit, motor: MotorParameters) -> Question:
    """Return the question how the figures of the data come from those of a data sheet.

    For a speed of unknown origin the delay is a third value: an undeclared lag shows in it.
    Raises `UsageError` for data in other units than V and rad or a structure without gain and time constant,
    `NotIdentifiable` if the data don't determine them.
    """
    _check_units(fit)
    unknown = any(record.data.kind == "speed" and not record.data.chain for record in fit.records)
    delay = unknown and "delay" in fit.model.names and bool(np.isfinite(fit["delay"].sd))
    names: tuple[Name, ...] = ("gain", "time_constant", "delay") if delay else ("gain", "time_constant")
    _check(fit, names)
    nominal = nominal_values(motor)
    lags = None
    if unknown and fit.estimator not in _READINGS:
        lags = lags_of_fit(fit, nominal["gain"], nominal["time_constant"])
    return Question(
        origin="data sheet",
        names=names,
        before=nominal,
        after=_figures(fit),
        covariance=_of_fit(fit, names, nominal["time_constant"]) + sheet_covariance(motor, names),
        fit=fit,
        motor=motor,
        friction=motor.resistance * motor.viscous_friction / motor.motor_constant**2,
        known_lag=_remaining_lag(fit) if fit.estimator in _READINGS else None,
        lags=lags,
    )


def is_known(estimate: Estimate) -> bool:
    """Return whether an estimate has a standard deviation of half its value at the most: else logarithms mean nothing."""
    return bool(estimate.sd <= _UNKNOWN * abs(estimate.value))


def sheet_covariance(motor: MotorParameters, names: Sequence[Name]) -> Array:
    """Return what the rounding of a sheet's values leaves open of its figures (D, D), as logarithms.

    A value that was written with up to four digits is known to half a unit of the last one, evenly spread.
    """
    written = ("resistance", "motor_constant", "rotor_inertia", "hub_inertia", "disc_inertia")
    columns = []
    for name in written:
        value = float(getattr(motor, name))
        half = last_digit_half_width(value)
        if value <= 0 or half < 0.5 * 10 ** (math.floor(math.log10(value)) - _FEW_DIGITS + 1):
            continue
        above, below = (
            _logs(nominal_values(replace(motor, **{name: value + side * half})), names) for side in (1, -1)
        )
        columns.append(_UNIFORM * 0.5 * (above - below))
    g = np.array(columns).reshape(-1, len(names))
    return np.asarray(g.T @ g, dtype=np.float64)


def _logs(values: dict[str, float], names: Sequence[Name]) -> Array:
    """ln of gain and time constant; a rounding doesn't move the delay by anything that matters."""
    return np.array([0.0 if name == "delay" else math.log(values[name]) for name in names])


def _figures(fit: Fit) -> dict[str, float]:
    """The sense of rotation is no difference here, so that a gain counts without its sign."""
    return {
        name: abs(fit[name].value) if name == "gain" else fit[name].value
        for name in ("gain", "time_constant", "delay")
        if name in fit.model.names
    }


def _of_fit(fit: Fit, names: Sequence[Name], scale: float = 1.0) -> Array:
    """The covariance (D, D) of ln K, ln τ and the delay over a time constant."""
    at = [fit.model.names.index(name) for name in names]
    size = [scale if name == "delay" else abs(fit[name].value) for name in names]
    return np.asarray(fit.covariance[np.ix_(at, at)] / np.outer(size, size), dtype=np.float64)


def _check(fit: Fit, names: Sequence[Name]) -> None:
    for name in {"gain", "time_constant", *names}:
        if name not in fit.model.names:
            raise UsageError(
                f"the structure {fit.structure} has no {parameter_in_words(name)}; take first_order, or auto"
            )
    for name in names:
        if name != "delay" and not is_known(fit[name]):
            clause = unknown_clause(parameter_statuses(fit, (name,))[name], combinations(fit))
            raise NotIdentifiable(f"there is nothing to compare with: {clause}")


def unknown_clause(answer: ParameterStatus, together: Sequence[Combination]) -> str:
    """Return what the data say of a parameter that they don't determine, and what would tell it, as a clause.

    `answer` is theirs for the parameter, `together` are the combinations that they know.
    """
    what = f"the data don't determine the {parameter_in_words(answer.name, answer.estimate.unit)}"
    whole = next((each for each in together if each.name == answer.combination), None)
    if answer.state is State.BOUNDED:
        what += f", only that it is {in_words(answer)}"
    elif whole is not None:
        what += f" alone, only that {whole.meaning} is {whole.estimate}"
    return f"{what}; to determine it, record {answer.remedy or 'more steps'}"


def _check_units(fit: Fit) -> None:
    data = fit.records[0].data
    if data.input_unit != "V" or data.position_unit != "rad":
        raise UsageError(
            f"a data sheet is in V and rad, but the data are in {data.input_unit} and {data.position_unit}: leave it out"
        )


def _remaining_lag(fit: Fit) -> float | None:
    """The measurement's lag in a reading of steps: the reading less that of its corrected sister from the same data.

    None where that finds no motor that reads so: then nothing is known of the lag.
    """
    corrected = ESTIMATORS[f"{fit.estimator}_corrected"]
    try:
        again = corrected.fit(fit.model.structure, [record.data for record in fit.records])
    except NotIdentifiable:
        return None
    return fit["time_constant"].value - again["time_constant"].value
