"""The claimed method applied to these data, and the values that it gives.

Readings of steps (63.2 %, the logarithmic slope, rise time over 2.197) use the speed as it is, including its lag.
The two regressions leave the measurement chain out: ARX, y[k+1] = a y[k] + b u[k] + c with τ = -T/ln a, and the output error of a
first-order model. Positions are differenced and filtered first, as in textbooks. If a record has no steps, the reading is taken
from the simulated speed of the fitted motor after steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable, UnknownName
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.estimators.log_linear import log_slope
from servobench.identification.estimators.step_63 import time_to_63
from servobench.identification.estimators.steps import TEXTBOOK, Rule, read_steps, time_at
from servobench.identification.models.base import STRUCTURES
from servobench.identification.reconciliation.readings import Lags, Reading
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset

_SAMPLES = 20_000  # at the most, of a simulated step
_CUTOFFS = (
    10.0,
    14.0,
    20.0,
    28.0,
    40.0,
    56.0,
    80.0,
    112.0,
    160.0,
    225.0,
)  # rad/s, of filters behind encoders
_LONG = 8.0  # time constants that a simulated step lasts: e^-8 = 0.03 % are left
_BY_EYE = 0.03  # of a time constant: what a reading by hand is off by


def rise_time(t: Array, part: Array) -> float:
    """Return the time from 10 to 90 % of the way, `part` (N,) at t (N,) [s], over ln 9: a first-order lag's time constant [s]."""
    return (time_at(t, part, 0.9) - time_at(t, part, 0.1)) / math.log(9.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Regression:
    """Gain [unit of the data] and time constant [s] of an ARX regression, and the covariance (2, 2) that it states itself."""

    gain: float
    time_constant: float
    covariance: Array


def arx(data: Sequence[Dataset]) -> Regression:
    """Return the least-squares regression of each sample on the one before and the input: y[k+1] = a y[k] + b u[k] + c.

    Its covariance is the textbook's, s² (X'X)⁻¹, carried over to K = b/(1 - a) and τ = -T/ln a (Ljung 1999,
    section 4.2). Raises `NotIdentifiable` where
    the pole makes no first-order lag.
    """
    rows, goals = [], []
    for record in data:
        # That which holds for most of the step to come: what stands beside the sample in the file.
        middle = record.t_output + 0.5 * record.sample_time
        held = record.u[np.maximum(np.searchsorted(record.t_input, middle, side="right") - 1, 0)]
        ok = record.valid[:-1]
        rows.append(np.column_stack([record.y[:-1], held[:-1], np.ones(len(record.y) - 1)])[ok])
        goals.append(record.y[1:][ok])
    x, y = np.concatenate(rows), np.concatenate(goals)
    coefficients = np.linalg.lstsq(x, y, rcond=None)[0]
    a, b, _ = (float(value) for value in coefficients)
    if not 0 < a < 1:
        raise NotIdentifiable(f"the regression gives a pole at {a:.3g}, which isn't a first-order lag")
    step, left = data[0].sample_time, y - x @ coefficients
    variance = float(left @ left) / max(len(y) - 3, 1)
    slopes = np.array([[b / (1 - a) ** 2, 1 / (1 - a), 0.0], [step / (a * math.log(a) ** 2), 0.0, 0.0]])
    return Regression(
        gain=b / (1 - a),
        time_constant=-step / math.log(a),
        covariance=slopes @ (variance * np.linalg.pinv(x.T @ x)) @ slopes.T,
    )


def _regression(data: Sequence[Dataset], fit: Fit) -> tuple[float, float]:
    regression = arx(data)
    return regression.gain, regression.time_constant


def _by_rule(rule: Rule) -> Callable[[Sequence[Dataset], Fit], tuple[float, float]]:
    def read(data: Sequence[Dataset], fit: Fit) -> tuple[float, float]:
        gain, tau, _ = read_steps(data, rule).mean
        return float(gain), float(tau)

    return read


def _without_chain(data: Sequence[Dataset], fit: Fit) -> tuple[float, float]:
    bare = [replace(record, declared=Chain(), applied=Chain()) for record in data]
    structure = STRUCTURES[fit.structure.replace("second_order", "first_order")]
    bare_fit = ESTIMATORS["output_error"].fit(structure, bare)
    return bare_fit["gain"].value, bare_fit["time_constant"].value


BY_HAND: Mapping[str, Rule] = {"step_63": time_to_63, "log_linear": log_slope, "rise_time": rise_time}
METHODS: Mapping[str, Callable[[Sequence[Dataset], Fit], tuple[float, float]]] = {
    **{name: _by_rule(rule) for name, rule in BY_HAND.items()},
    "arx": _regression,
    "output_error": _without_chain,
}
AS_RECORDED = "as recorded"
SPOKEN: Mapping[str, str] = {
    "step_63": "the time to 63.2 % of each step",
    "log_linear": "the slope of the logarithm of each step",
    "rise_time": "the rise time from 10 to 90 % over 2.197",
    "arx": "an ARX regression",
    "output_error": "a first-order fit that ignores the chain",
}


def check_method(name: str | None) -> None:
    """Raise `UnknownName` for a method that can't be re-enacted."""
    if name is not None and not (isinstance(name, str) and name in METHODS):
        raise UnknownName("method to re-enact", name, METHODS)


def reenact(fit: Fit, methods: Sequence[str] = tuple(METHODS), chain: str = TEXTBOOK) -> tuple[Reading, ...]:
    """Return what each method reads off the data behind a fit.

    `chain` makes a speed of data that hold a position; data that are a speed already are read as they stand.
    """
    data = [as_speed(record.data, chain) for record in fit.records]
    text = " or ".join(sorted({str(record.chain) or AS_RECORDED for record in data}))
    return tuple(_reading(name, data, fit, text) for name in methods)


def as_speed(data: Dataset, chain: str) -> Dataset:
    """Return the data as a speed: as they stand, or a position put through a chain."""
    if data.kind == "speed":
        return data
    stages = Chain.parse(chain)
    return replace(
        data,
        y=stages(data.y, data.t_output),
        kind="speed",
        output_unit=f"{data.output_unit}/s",
        quantum=None,
        applied=data.applied + stages,
    )


def _reading(name: str, data: Sequence[Dataset], fit: Fit, chain: str) -> Reading:
    read, by_hand = METHODS[name], name in BY_HAND
    gain, tau, simulated, why_not = math.nan, math.nan, False, ""
    try:
        gain, tau = read(data, fit)
    except NotIdentifiable as error:
        why_not = str(error)
    if why_not and by_hand:
        try:
            gain, tau = read([_steps_of(fit, data[0])], fit)
            simulated, why_not = True, ""
        except NotIdentifiable as error:
            why_not = str(error)
    return Reading(
        method=name,
        chain=chain,
        gain=gain,
        time_constant=tau,
        by_hand=by_hand,
        simulated=simulated,
        why_not=why_not,
    )


def _steps_of(fit: Fit, like: Dataset) -> Dataset:
    """The speed of the fitted motor behind the chain of some data, for steps between two levels of one sign that they reach."""
    tau, step = fit["time_constant"].value, like.sample_time
    held = int(min(_LONG * max(tau, 5 * step) / step, _SAMPLES / 6))
    if held < 3:
        raise NotIdentifiable(f"a time constant of {tau:.3g} s can't be read from samples {step:.3g} s apart")
    high = float(np.percentile(np.abs(like.u), 99))
    u = np.tile(np.repeat([high, 0.5 * high], held), 3)
    t = np.asarray(step * np.arange(len(u)), dtype=np.float64)
    record = replace(
        like,
        name="simulated steps",
        t_input=t,
        u=u,
        input_before=high,
        t_output=t,
        rows=None,
        y=np.zeros(len(t)),
        declared=Chain(),
        applied=like.chain,
        reference=None,
        current=None,
        findings=(),
    )
    own = np.zeros(len(fit.model.structure.nuisance(record)))
    return replace(record, y=fit.model.simulate(record, own))


def read_lags(fit: Fit, method: str) -> Lags | None:
    """Return what filters add to the time constant that a method reads off the counts behind a fit; None where it reads none."""
    tau = fit["time_constant"].value
    lags = []
    for cutoff in _CUTOFFS:
        reading = reenact(fit, (method,), f"derivative | lowpass {cutoff:g} rad/s")[0]
        extra = reading.time_constant - tau
        # A filter makes a step no earlier: where it is read so, the input changed before the filter had settled.
        if not reading.why_not and extra > -_BY_EYE * tau:
            lags.append((cutoff, extra, 0.0))
    return _lags(lags)


def lags_of_fit(fit: Fit, gain: float, time_constant: float) -> Lags | None:
    """Return what unmentioned filters add to the time constant and the delay of a fit like this one.

    A motor of that gain and time constant is simulated under the same inputs, its speed filtered, and fitted as if it weren't.
    """
    structure = fit.model.structure
    values = {"gain": gain, "time_constant": time_constant}
    theta = np.array(
        [values.get(name, value) for name, value in zip(fit.model.names, fit.model.theta, strict=True)]
    )
    lags = []
    for cutoff in _CUTOFFS[::2]:
        stages = Chain.parse(f"lowpass {cutoff:g} rad/s")
        data = []
        for record in fit.records:
            y = structure.predict(np.append(theta, record.nuisance), record.data).y
            data.append(replace(record.data, y=stages(y - y[0], record.data.t_output) + y[0], quantum=None))
        try:
            again = ESTIMATORS["output_error"].fit(
                structure, data, [np.append(theta, fit.vector[len(theta) :])]
            )
        except NotIdentifiable:
            continue  # behind so slow a filter nothing is left of the motor; the faster ones say what there is
        delay = again["delay"].value - fit["delay"].value if "delay" in fit.model.names else 0.0
        lags.append((cutoff, again["time_constant"].value - time_constant, delay))
    return _lags(lags)


def _lags(lags: Sequence[tuple[float, float, float]]) -> Lags | None:
    """Sorted by what they add; None for less than two."""
    if len(lags) < 2:
        return None
    cutoffs, extra, delays = np.array(sorted(lags, key=lambda each: each[1])).T
    return Lags(cutoffs=cutoffs, extra=extra, delays=delays)
