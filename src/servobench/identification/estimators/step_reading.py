"""Readings of steps as estimators: plain, and corrected for the measurement chain.

A reading includes the chain between shaft and data: a filter's lag is read as the motor's own. `StepReading` doesn't correct
it. `CorrectedReading` finds the motor whose simulated response, to the same input, through the same chain, at the same samples,
has the same reading as the data (indirect inference: Gouriéroux, Monfort and Renault 1993). It needs no formula for any filter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.core.finding import Finding, info, refusal, warning
from servobench.identification.estimators.base import Abilities, Fit, FittedRecord, hindrance
from servobench.identification.estimators.output_error import simulations
from servobench.identification.estimators.steps import (
    TEXTBOOK,
    Readings,
    Rule,
    omission_text,
    read_step,
    read_steps,
    textbook_speed,
)
from servobench.identification.models.base import STRUCTURES, Model, Structure
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset

_FEWEST = 3  # steps whose scatter gives a standard deviation
_LARGE = 0.02  # of the time constant: a lag in the reading that is worth a warning
_ROUNDS = 20
_SAME = 1e-7  # relative: the search for the motor that reads alike has ended


@dataclass(frozen=True)
class StepReading:
    """A reading of steps as it stands, under a name, with the rule for its time constant.

    It accepts positions and data behind a chain although it can't allow for them, so that the bias can be seen; then it warns.
    """

    name: str
    rule: Rule
    abilities: Abilities

    def supports(self, structure: Structure, data: Sequence[Dataset]) -> Finding | None:
        """Return a refusal for a structure that isn't a first-order motor without friction."""
        return refuse_data(self.name, replace(self.abilities, position=True, chain=True), structure, data)

    def fit(
        self, structure: Structure, data: Sequence[Dataset], starts: Sequence[Array] | None = None
    ) -> Fit:
        """Return the mean over the steps; `starts` are of no use here. Raises `NotIdentifiable` where no step can be read."""
        _check(self.supports(structure, data))
        readings = read_steps(data, self.rule)
        fit = _fit(self.name, structure, data, readings, readings.mean, np.eye(3))
        try:
            true, _ = read_alike(structure, data, readings, self.rule)
        except NotIdentifiable as error:
            return _with(
                fit, warning("chain-in-the-reading", _sentence(str(error)), parameters=("time_constant",))
            )
        return _with(fit, *_about_lag(self.name, data, float(readings.mean[1]), float(true[1])))


@dataclass(frozen=True)
class CorrectedReading:
    """A reading of steps by a `rule`, without what the measurement chain does to it, under a name of its own."""

    name: str
    rule: Rule
    abilities: Abilities

    def supports(self, structure: Structure, data: Sequence[Dataset]) -> Finding | None:
        """Return a refusal for a structure that isn't a first-order motor without friction."""
        return refuse_data(self.name, self.abilities, structure, data)

    def fit(
        self, structure: Structure, data: Sequence[Dataset], starts: Sequence[Array] | None = None
    ) -> Fit:
        """Return the motor that reads like the data; `starts` are of no use here. Raises `NotIdentifiable`."""
        _check(self.supports(structure, data))
        readings = read_steps(data, self.rule)
        values, slope = read_alike(structure, data, readings, self.rule)
        fit = _fit(self.name, structure, data, readings, values, slope)
        return _with(fit, *_about_correction(data, float(readings.mean[1]), float(values[1])))


def refuse_data(name: str, can: Abilities, structure: Structure, data: Sequence[Dataset]) -> Finding | None:
    """Return a refusal for what a reading of steps can't work on, None where it can."""
    lacking = hindrance(name, can, structure, data)
    if lacking is not None:
        return lacking
    names = {parameter.name for parameter in structure.parameters}
    if (
        {"gain", "time_constant", "delay"}
        < names
        <= {"gain", "time_constant", "delay", "coulomb_voltage", "offset_voltage"}
    ):
        return None
    return refusal(
        "estimator-unsuited",
        f"{name} reads gain, time constant and offset of a first-order motor (first_order_one_way, first_order); this structure "
        f"has {', '.join(parameter.name for parameter in structure.parameters)}.",
    )


def read_alike(
    structure: Structure, data: Sequence[Dataset], readings: Readings, rule: Rule
) -> tuple[Array, Array]:
    """Return the values (3,) of the motor that reads like the data, and the derivatives (3, 3) of its readings by them.

    Newton's method on the simulated readings. Raises `NotIdentifiable` where no such motor is found.
    """
    wanted = np.nan_to_num(readings.mean)
    free = [0, 1] if readings.through_standstill else [0, 1, 2]
    values, slope = wanted.copy(), np.eye(3)
    for _ in range(_ROUNDS):
        here = _reading_of_simulation(structure, data, readings, rule, values)
        slope = _slope(structure, data, readings, rule, values)
        if not (np.isfinite(here).all() and np.isfinite(slope).all()):
            break
        change = np.zeros(3)
        change[free] = np.linalg.lstsq(slope[np.ix_(free, free)], (wanted - here)[free], rcond=None)[0]
        # The first steps are cut: a time constant may lose no more than half of itself at once.
        change[1] = np.clip(change[1], -0.5 * values[1], values[1])
        values = values + change
        if values[1] < 1e-3 * wanted[1]:
            break
        if np.all(np.abs(change) <= _SAME * _scale(readings, values)):
            return values, slope
    raise NotIdentifiable(
        f"no motor gives this reading behind the measurement chain: it is {wanted[1]:.3g} s, which the chain alone "
        "may cause. Record the position or a less filtered speed, or use output_error"
    )


def _scale(readings: Readings, values: Array) -> Array:
    """The scales of gain, time constant and lost input (3,); the last is that of the input's levels."""
    largest = max(max(abs(step.before), abs(step.after)) for step in readings.steps)
    return np.array([abs(float(values[0])), abs(float(values[1])), largest])


def _slope(
    structure: Structure, data: Sequence[Dataset], readings: Readings, rule: Rule, values: Array
) -> Array:
    """The derivatives (3, 3) of the simulated readings by the values, by central differences."""
    slope = np.eye(3)
    for n in range(2 if readings.through_standstill else 3):
        width = 1e-4 * float(_scale(readings, values)[n])
        side = np.eye(3)[n] * width
        after, before = (
            _reading_of_simulation(structure, data, readings, rule, values + sign * side) for sign in (1, -1)
        )
        slope[:, n] = (after - before) / (2 * width)
    return slope


def _check(lacking: Finding | None) -> None:
    if lacking is not None:
        raise NotIdentifiable(lacking.sentence.rstrip("."))


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def _with(fit: Fit, *findings: Finding) -> Fit:
    return replace(fit, findings=(*fit.findings, *findings))


def _theta(structure: Structure, values: Array) -> Array:
    """Gain, time constant and lost input as the structure's parameters; the delay is held at zero."""
    parameters = {"gain": values[0], "time_constant": values[1], "delay": 0.0}
    return np.array(
        [parameters.get(parameter.name, np.nan_to_num(values[2])) for parameter in structure.parameters]
    )


def _reading_of_simulation(
    structure: Structure, data: Sequence[Dataset], readings: Readings, rule: Rule, values: Array
) -> Array:
    """The mean of the same steps, read off the response of a motor with those values (3,).

    It starts at the speed that is read first; whatever is wrong with that has decayed where a step is read.
    """
    theta = _theta(structure, values)
    speeds = []
    for record in data:
        start = {
            "start_position": float(record.y[0]),
            "start_speed": float(textbook_speed(record.y, record)[0]),
        }
        own = [start.get(parameter.name, 0.0) for parameter in structure.nuisance(record)]
        speeds.append(textbook_speed(structure.predict(np.append(theta, own), record).y, record))
    simulated_readings = [
        read_step(step, data[step.record].t_output, speeds[step.record], rule) for step in readings.steps
    ]
    mean = np.mean(simulated_readings, axis=0)
    return np.asarray(np.where(np.isnan(readings.mean), 0.0, mean), dtype=np.float64)


def _fit(
    name: str, structure: Structure, data: Sequence[Dataset], readings: Readings, values: Array, slope: Array
) -> Fit:
    """The fit for values (3,); the covariance of the readings' mean is carried back to them through the slope (3, 3)."""
    theta = _theta(structure, values)
    spread = _spread(readings, slope)
    names = [parameter.name for parameter in structure.parameters]
    place = [names.index("gain"), names.index("time_constant"), *_friction_places(names)]
    covariance = np.diag(np.full(len(names), np.inf))
    covariance[np.ix_(place, place)] = spread
    records = _records(structure, data, theta)
    sd = float(np.sqrt(np.mean(np.concatenate([r.residual[r.valid] for r in records]) ** 2)))
    return Fit(
        model=Model(structure=structure, theta=theta, data=data[0]),
        covariance=covariance,
        estimator=name,
        structure=STRUCTURES.name_of(structure),
        converged=True,
        status=f"read {len(readings.steps)} step(s)",
        residual_sd=sd,
        records=tuple(replace(record, innovations=record.residual / (sd or 1.0)) for record in records),
        intervals=_intervals(names, theta, covariance, len(readings.steps)),
        findings=tuple(_remarks(name, readings, data)),
    )


def _friction_places(names: Sequence[str]) -> list[int]:
    return [n for n, name in enumerate(names) if name in {"coulomb_voltage", "offset_voltage"}]


def _spread(readings: Readings, slope: Array) -> Array:
    """The covariance (3, 3) of the mean, carried back through the slope; infinite where the scatter can't be known."""
    n = len(readings.steps)
    known = ~np.isnan(readings.mean) & (n >= _FEWEST)
    out = np.diag(np.full(3, np.inf))
    if known.any():
        back = np.linalg.inv(slope[np.ix_(known, known)])
        scatter = np.atleast_2d(np.cov(readings.values[:, known], rowvar=False)) / n
        # Steps that are all read alike are known to the last digit, not better.
        floor = np.diag(np.spacing(np.abs(readings.mean[known])) ** 2)
        out[np.ix_(known, known)] = back @ (scatter + floor) @ back.T
    return out


def _intervals(
    names: Sequence[str], theta: Array, covariance: Array, steps: int
) -> dict[str, tuple[float, float]]:
    """Student's intervals: the scatter of a few steps is itself not well known."""
    from scipy.special import stdtrit

    if steps < _FEWEST:
        return {}
    half = float(stdtrit(steps - 1, 0.975)) * np.sqrt(np.diag(covariance))
    return {
        name: (float(value - h), float(value + h))
        for name, value, h in zip(names, theta, half, strict=True)
        if np.isfinite(h)
    }


def _records(structure: Structure, data: Sequence[Dataset], theta: Array) -> tuple[FittedRecord, ...]:
    """Each record simulated with these parameters; its start state by linear least squares, as the output is linear in it."""
    joint = [theta]
    for record in data:
        resting = structure.predict(np.append(theta, np.zeros(len(structure.nuisance(record)))), record)
        columns = resting.jacobian[resting.valid, len(theta) :]
        start = np.linalg.lstsq(columns, (record.y - resting.y)[resting.valid], rcond=None)[0]
        joint.append(np.asarray(start, dtype=np.float64))
    return simulations(structure, data, np.concatenate(joint))


def _remarks(name: str, readings: Readings, data: Sequence[Dataset]) -> list[Finding]:
    """The findings on a reading, by any rule."""
    n = len(readings.steps)
    findings = []
    if any(record.kind == "position" for record in data):
        findings.append(
            info(
                "speed-derived",
                f"{name} needs a speed, so the position was differenced and filtered with 50/(s + 50), as textbooks "
                "do. That adds a lag of 20 ms and half a sample and amplifies the encoder's rounding; an estimator "
                "that uses the position avoids both.",
                parameters=("time_constant",),
            )
        )
    if n < _FEWEST:
        sentence = f"{n} step(s) could be read; a scatter needs {_FEWEST}, so there are no intervals."
        findings.append(warning("scatter-unknown", sentence, parameters=("gain", "time_constant")))
    else:
        sentence = (
            f"{n} steps were read; the intervals are their scatter and don't include an error common to all."
        )
        findings.append(info("intervals-from-scatter", sentence, parameters=("gain", "time_constant")))
    findings.append(
        info("delay-not-read", f"{name} reads no delay: it is fixed at zero.", parameters=("delay",))
    )
    if readings.left_out:
        findings.append(info("steps-left-out", _sentence(f"not read: {omission_text(readings.left_out)}")))
    if readings.through_standstill:
        sentence = (
            "The steps start, end or pass at rest, where friction acts differently, so friction is read as a lower "
            "gain. Record steps between two speeds in the same direction."
        )
        findings.append(warning("friction-in-the-gain", sentence, parameters=("gain", "time_constant")))
    return findings


def _about_lag(name: str, data: Sequence[Dataset], read: float, true: float) -> list[Finding]:
    """The effect of the measurement chain on a reading that ignores it."""
    lag = (read - true) / true
    if not any(record.kind == "position" or record.chain for record in data) and abs(lag) < _LARGE:
        return []
    chains = sorted({_chain_text(record) for record in data})
    sentence = (
        f"The measurement chain ({' or '.join(chains)}) is part of the reading: a motor of {true:.4g} s reads "
        f"{read:.4g} s here, {100 * lag:+.2g} %. {name}_corrected removes that."
    )
    severity = warning if abs(lag) >= _LARGE else info
    return [severity("chain-in-the-reading", sentence, parameters=("time_constant",))]


def _about_correction(data: Sequence[Dataset], read: float, true: float) -> list[Finding]:
    chains = sorted({_chain_text(record) for record in data})
    sentence = (
        f"{read:.4g} s was read; a motor of {true:.4g} s, simulated and measured in the same way "
        f"({' or '.join(chains)}), reads the same."
    )
    return [info("reading-corrected", sentence, parameters=("time_constant",))]


def _chain_text(data: Dataset) -> str:
    derived = Chain.parse(TEXTBOOK) if data.kind == "position" else Chain()
    return str(data.chain.linear + derived) or "none"
