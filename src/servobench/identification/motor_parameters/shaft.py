"""The observations from a fit: K, τ and u_c, and with a measured current 1/R and k/R, with one covariance.

The regression of the current uses the model's own speed, so it shares the model's uncertainty: both are functions of the fit's
parameters, and the covariance is carried over by their derivatives.
"""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, info
from servobench.core.parameter_names import parameter_in_words
from servobench.identification.estimators.base import Fit
from servobench.identification.motor_parameters.current import (
    current_coefficients,
    current_line,
    doubts,
    has_current,
)
from servobench.identification.motor_parameters.observation import Law, Motor, Observation, nothing, stiffness


def shaft_and_current(fit: Fit) -> Observation:
    """Return what the fit and the current of its records tell; nothing, with a finding, where the structure isn't a motor's."""
    hindrance = _hindrance(fit)
    if hindrance:
        return nothing(hindrance)
    theta, covariance = _with_lag(fit)
    line = current_line(fit, theta[:-1], float(theta[-1])) if has_current(fit) else None
    doubt = doubts(line) if has_current(fit) else None
    used = line is not None and doubt is None
    values = _numbers(fit, theta, used)
    slopes = _slopes(fit, theta, covariance, used)
    spread = slopes @ covariance @ slopes.T
    if used and line is not None:
        spread[-2:, -2:] += line.covariance[:2, :2]
    if not (np.isfinite(values).all() and np.isfinite(spread).all() and (np.diag(spread) > 0).all()):
        return nothing(_about_parameters("the model isn't known well enough; the other findings say why"))
    return Observation(
        laws=_laws(fit, used),
        values=values,
        covariance=spread,
        sentence=f"the measured current ({line.samples} samples)" if used and line is not None else "",
        findings=(doubt,) if doubt else (),
    )


def _hindrance(fit: Fit) -> Finding | None:
    data = fit.records[0].data
    if not {"gain", "time_constant"} <= set(fit.model.names):
        why = f"the structure {fit.structure} has no gain and time constant: fit a first- or second-order one"
    elif data.input_unit != "V" or data.position_unit != "rad":
        why = f"they need data in V and rad, but these are in {data.input_unit} and {data.position_unit}"
    elif not fit.model["gain"] > 0:
        why = "the gain isn't positive: invert the sign of the input or of the output"
    elif _unknown(fit):
        why = f"the {_unknown(fit)} isn't known to within half its value"
    else:
        return None
    return _about_parameters(why)


def _unknown(fit: Fit) -> str:
    """The gain or the time constant, where it isn't known; empty otherwise."""
    vague = [name for name in ("gain", "time_constant") if not fit.sd(name) < 0.5 * abs(fit.model[name])]
    return parameter_in_words(vague[0]) if vague else ""


def _about_parameters(why: str) -> Finding:
    return info("motor-parameters-not-told", f"The motor's own parameters can't be found: {why}.")


def _with_lag(fit: Fit) -> tuple[Array, Array]:
    """The fit's parameters and the winding's lag (P + 1,) and their covariance.

    What a first-order fit calls delay may be a delay, the lag, or both: the lag is half of it, and as either end is as likely as
    any other part (a motor whose amplifier is fast has nothing but the lag), half of it is its standard deviation, too.
    """
    count = len(fit.model.theta)
    covariance = np.zeros((count + 1, count + 1))
    # What the data say nothing about (an infinite variance) isn't looked for here either.
    known = np.isfinite(np.diag(fit.covariance))
    covariance[:count, :count] = np.where(np.outer(known, known), fit.covariance, 0.0)
    if "electrical_time_constant" in fit.model.names:
        return np.append(fit.model.theta, 0.0), covariance
    delay = max(fit.model["delay"], 0.0) if "delay" in fit.model.names else 0.0
    covariance[count, count] = (0.5 * delay) ** 2
    return np.append(fit.model.theta, 0.5 * delay), covariance


def _numbers(fit: Fit, theta: Array, with_current: bool) -> Array:
    """K, τ + τ₂, u_c and τ_e where there are such, then 1/R and k/R, for parameters and a lag (P + 1,)."""
    value = dict(zip(fit.model.names, theta[:-1], strict=True))
    tau = float(value["time_constant"])
    winding = value.get("electrical_time_constant")
    # τ + τ₂ = τ²/(τ - τ_e)
    numbers = [value["gain"], tau + theta[-1] if winding is None else tau**2 / (tau - winding)]
    if "coulomb_voltage" in value and fit.model["coulomb_voltage"] > 0:
        numbers.append(value["coulomb_voltage"])
    if winding is not None:
        numbers.append(winding)
    if with_current:
        lag = float(theta[-1] if winding is None else winding)
        numbers += list(current_coefficients(fit, theta[:-1], lag)[:2])
    return np.array(numbers, dtype=np.float64)


def _slopes(fit: Fit, theta: Array, covariance: Array, with_current: bool) -> Array:
    """The derivatives of the numbers by parameters and lag, over half a standard deviation either way."""
    columns = []
    for n, sd in enumerate(np.sqrt(np.diag(covariance))):
        step = np.zeros(len(theta))
        step[n] = 0.5 * sd
        if sd == 0.0:
            columns.append(np.zeros(len(_laws(fit, with_current))))
            continue
        after, before = _numbers(fit, theta + step, with_current), _numbers(fit, theta - step, with_current)
        columns.append((after - before) / (2 * step[n]))
    return np.column_stack(columns)


def _laws(fit: Fit, with_current: bool) -> tuple[Law, ...]:
    names = fit.model.names
    laws: list[Law] = [lambda m: m["motor_constant"] / stiffness(m), _both_lags]
    if "coulomb_voltage" in names and fit.model["coulomb_voltage"] > 0:
        laws.append(lambda m: m["coulomb_torque"] * m["resistance"] / m["motor_constant"])
    if "electrical_time_constant" in names:
        laws.append(_winding_lag)
    if with_current:
        laws += [lambda m: 1.0 / m["resistance"], lambda m: m["motor_constant"] / m["resistance"]]
    return tuple(laws)


def _both_lags(motor: Motor) -> float:
    """τ + τ₂ = (J R + L b)/(R b + k²)."""
    drag = motor.get("inductance", 0.0) * motor["viscous_friction"]
    return (motor["inertia"] * motor["resistance"] + drag) / stiffness(motor)


def _winding_lag(motor: Motor) -> float:
    """τ τ₂/(τ + τ₂) = J L/(J R + L b), what a second-order fit calls electrical time constant."""
    j, l = motor["inertia"], motor["inductance"]
    return j * l / (j * motor["resistance"] + l * motor["viscous_friction"])
