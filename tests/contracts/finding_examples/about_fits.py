"""Findings on a fit, with sound fits that don't have them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np

from servobench.core.finding import Finding, info
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.least_squares import lowest
from servobench.identification.estimators.output_error import remarks
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.doubts.base import about_fit
from servobench.identification.trust.doubts.lag_not_split import widen_for_lag_split
from servobench.identification.trust.explanations.hysteresis import play
from servobench.identification.trust.held_out import about_validation, validate_with
from servobench.identification.trust.validation import validate
from servobench.identification.uncertainty.identifiability import combinations, parameter_statuses
from servobench.identification.uncertainty.static_friction import with_static_friction
from servobench.identification.uncertainty.status_findings import about_answers
from servobench.recordings.measurement.dataset import Dataset
from tests.contracts.finding_examples.base import (
    TIME,
    Example,
    driven,
    fitted,
    sound,
    sound_fit,
    sprung,
    staircase,
    told,
    with_sd,
    with_values,
)
from tests.datasets import QUANTUM, dataset
from tests.identification.trust.test_input_late import fit_with_usual_delay
from tests.identification.trust.test_lag_not_split import fit_with
from tests.identification.trust.test_one_level_each import fit_of_levels
from tests.identification.trust.test_sensor_zero import fit_with_zero
from tests.identification.trust.test_small_swing import fit_of_swings
from tests.identification.trust.test_start_held import fit_of as fit_of_held_start
from tests.identification.trust.test_weight_by_speed import fit_of_arm
from tests.identification.uncertainty.test_static_friction import fit_of_ramps
from tests.rig.motor.reference import Truth


def _of_data(**changes: object) -> Fit:
    """The sound fit, of records that say something else of themselves."""
    fit = sound_fit()
    return replace(
        fit, records=tuple(replace(each, data=replace(each.data, **changes)) for each in fit.records)
    )


@cache
def _of_another_motor() -> Fit:
    """A swing of its own, under the input of another motor."""
    swing = np.sin(2 * np.pi * 0.9 * TIME[:2000])
    return fitted(replace(sound(samples=2000), y=np.floor(swing / QUANTUM) * QUANTUM))


@cache
def _as_speed() -> Fit:
    """A position that was said to be a speed."""
    return fitted(replace(sound(samples=2000), kind="speed", output_unit="rad/s", quantum=None))


@cache
def _one_way(offset: float) -> Fit:
    """1 to 3 V; of which an offset in volts is acted on and not in the file."""
    u = np.where(np.arange(3000) % 500 < 250, 3.0, 1.0)
    return fitted(replace(driven(u + offset), u=u), "first_order_one_way")


@cache
def _under_a_duty(lost: float) -> Fit:
    """5 to 10 V of a supply, of which a driver keeps some."""
    u = np.where(np.arange(3000) % 500 < 250, 10.0, 5.0)
    data = replace(driven(u - lost), u=u, findings=(info("duty-scaled", "The duty times 10 V."),))
    return fitted(data, "first_order_one_way")


@cache
def _up_and_down(width: float) -> Fit:
    """Up to 4 V and down again, a second a level, through so many volts of play to either side."""
    u = np.repeat([0.0, 1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 1.0, 0.0], 500)
    return fitted(told(u, play(u, width)), "first_order_one_way_rest")


@cache
def _near(level: float, swing: float) -> Fit:
    """A PRBS about a level [V]."""
    return fitted(driven(level + swing / 3.0 * sound(samples=2000).u))


@cache
def _about_rest(unit: str) -> Fit:
    """A PRBS of a motor that stands still at an input of 50."""
    return fitted(replace(sound(samples=2000), u=50.0 + 10.0 * sound(samples=2000).u, input_unit=unit))


@cache
def _ramp(rises: int) -> Fit:
    """From 0 to 3 V so many times in 10 s."""
    return fitted(driven(3.0 * ((rises * TIME / 10.0) % 1.0)))


@cache
def _coarse(counts: int) -> Fit:
    """The same record behind so many counts per turn."""
    step, fine = 2 * np.pi / counts, sound(samples=2000)
    return fitted(replace(fine, y=(np.floor(fine.y / step) + 0.5) * step, quantum=step))


@cache
def _slow(tau: float) -> Fit:
    """The sound fit with that time constant [s]."""
    return with_values(sound_fit(), time_constant=tau)


@cache
def _position_loop(unit: str) -> Fit:
    """A position that follows the input, in that unit."""
    u = np.repeat(np.random.default_rng(2).uniform(-1.0, 1.0, 20), 100)
    lag, y = np.exp(-0.002 / 0.02), np.zeros(2000)
    for n in range(1, 2000):
        y[n] = u[n - 1] + (y[n - 1] - u[n - 1]) * lag
    fit = sound_fit()
    (record,) = fit.records
    return replace(fit, records=(replace(record, data=replace(record.data, u=u, y=y, input_unit=unit)),))


def _from_search(converged: bool) -> list[Finding]:
    """Findings on a search that ended, or that its largest number of steps ended."""
    structure, data = STRUCTURES["first_order_coulomb"], [sound(samples=500)]
    minimum = lowest(structure, data, structure.guesses(data))
    return remarks(structure, data, replace(minimum, converged=converged))


def _statuses(fit: Fit) -> list[Finding]:
    return about_answers(parameter_statuses(fit), combinations(fit), fit)


def _validated(other: Dataset) -> list[Finding]:
    fit = sound_fit()
    return about_validation(fit, validate_with(fit, [other]), [other])


def _with_another_lag(chain: str) -> tuple[Finding, ...]:
    """A speed behind a low-pass of 50 rad/s, whose file says so or names another chain."""
    data = dataset(seed=1, kind="prbs", samples=2000, chain="derivative | lowpass 50 rad/s")
    return validate(fitted(replace(data, applied=type(data.applied).parse(chain), chain_known=True)))


def _example(code: str, faulty: Callable[[], Fit], like: Callable[[], Fit] = sound_fit) -> Example:
    def of(made: Callable[[], Fit]) -> list[Finding]:
        return about_fit(made())

    return Example(code=code, raised=partial(of, faulty), absent=partial(of, like))


@cache
def _one_way_that_reverses() -> Fit:
    """A motor that turns both ways, fitted by the structure for one."""
    return fitted(sound(samples=2000), "first_order_one_way")


@cache
def _with_spikes() -> Fit:
    """Two values are 0.5 rad off."""
    y = sound(samples=2000).y.copy()
    y[[700, 1400]] += 0.5
    return fitted(replace(sound(samples=2000), y=y))


@cache
def _speed_up_to(limit: float) -> Fit:
    """The speed [rad/s] at many levels, measured with noise behind a sensor that ends at a limit."""
    random = np.random.default_rng(5)
    u = np.repeat(random.uniform(-3.0, 3.0, 60), 100)
    data = dataset(seed=1, samples=len(u), u=u, chain="derivative")
    y = np.clip(data.y, -limit, limit) + random.normal(0.0, 0.5, len(data.y))
    return fitted(replace(data, y=y, applied=type(data.applied)(), quantum=None))


@cache
def _limited_to(limit: float) -> Fit:
    """A staircase of ±1 to ±3 V from a driver that gives no more than a limit [V]."""
    return fitted(told(staircase(), np.clip(staircase(), -limit, limit)))


def _with_gain(fit: Fit, times: float) -> Fit:
    """A fit with so many times its gain."""
    return with_values(fit, gain=times * fit.model["gain"])


@cache
def _on_a_spring(rate: float) -> Fit:
    """A motor that 3 V moves against a spring of `rate` V for a radian."""
    return fitted(sprung(rate), "first_order")


@cache
def _late(delay: float) -> Fit:
    """A motor in motion that a tenth of noise hides, and that answers `delay` [s] late."""
    data = dataset(seed=1, kind="prbs", samples=2000)
    noise = 0.1 * float(np.std(data.y)) * np.random.default_rng(1).standard_normal(len(data.y))
    late = replace(data, y=data.y + noise, t_output=data.t_output + delay, quantum=None)
    return fitted(late.part(0.5, 3.5))


@cache
def _speed_at(levels: tuple[float, ...], size: bool) -> Fit:
    """The speed [rad/s] at levels of half a second each, as it is or its `size`."""
    u = np.repeat(levels, 250)
    data = dataset(seed=1, samples=len(u), u=u, chain="derivative")
    y = np.abs(data.y) if size else data.y
    return fitted(replace(data, y=y, applied=type(data.applied)(), quantum=None))


@cache
def _in_a_loop(gain: float, late: int) -> Fit:
    """A speed of 60 rad/s with noise under a proportional controller [V s/rad], which takes it from so many rows before."""
    random, speeds = np.random.default_rng(3), np.zeros(1000)
    u, speed, keep = np.zeros(1000), 60.0, np.exp(-0.002 / 0.1)
    for n in range(1000):
        speeds[n] = speed + random.normal(0.0, 2.0)
        u[n] = 3.0 + gain * (60.0 - speeds[max(n - late, 0)])
        speed = keep * speed + (1.0 - keep) * 20.0 * u[n]
    data = dataset(seed=1, samples=1000, u=u, y=speeds)
    return fitted(replace(data, kind="speed", output_unit="rad/s", quantum=None), "first_order_one_way")


EXAMPLES = (
    _example("delay-within-a-call", lambda: _of_data(hidden_delay=0.01)),
    _example("delay-rare", lambda: _late(0.1), lambda: _late(0.0)),
    _example(
        "delay-within-row",
        lambda: with_values(_one_way(0.0), delay=-8e-4),
        lambda: with_sd(with_values(_one_way(0.0), delay=-8e-4), delay=1.0),
    ),
    _example("feedback-unnamed", lambda: _in_a_loop(0.3, 0), lambda: _in_a_loop(0.3, 3)),
    _example("fit-by-chance", _of_another_motor),
    _example("fit-poor", _of_another_motor),
    _example("friction-and-offset-together", lambda: _one_way(0.0)),
    _example("gain-against-motion", lambda: _with_gain(_one_way(0.0), -1.0), lambda: _one_way(0.0)),
    _example("gain-local", lambda: _near(3.0, 0.3), lambda: _near(0.0, 3.0)),
    _example(
        "input-hardly-matters",
        lambda: with_sd(with_values(_one_way(0.0), coulomb_voltage=-20.0), gain=1.0),
        lambda: with_values(_one_way(0.0), coulomb_voltage=-20.0),
    ),
    _example("input-is-a-goal", lambda: _position_loop("rad"), lambda: _position_loop("V")),
    _example("input-late", lambda: fit_with_usual_delay(50), lambda: fit_with_usual_delay(0)),
    _example("input-is-reference", lambda: _of_data(input_unit="rad")),
    _example("input-rests-off-zero", lambda: _about_rest("%"), lambda: _about_rest("V")),
    _example("input-too-slow", lambda: _ramp(1), lambda: _ramp(10)),
    _example("kind-mistaken", _as_speed),
    _example("one-level-each", lambda: fit_of_levels(57.3), lambda: fit_of_levels(1.0)),
    _example("output-spikes", _with_spikes),
    _example("sensor-zero", lambda: fit_with_zero(5.0), lambda: fit_with_zero(0.0)),
    _example("shaft-comes-to-rest", lambda: _position_loop("V"), lambda: _limited_to(3.0)),
    _example("shaft-runs-back", lambda: _on_a_spring(0.5), lambda: _on_a_spring(0.0)),
    _example("speed-by-direction", lambda: _up_and_down(0.15), lambda: _up_and_down(0.0)),
    _example(
        "speed-unsigned",
        lambda: _speed_at((1.0, 3.0, -2.0, -1.0, 2.0, -3.0), True),
        lambda: _speed_at((1.0, 3.0, -2.0, -1.0, 2.0, -3.0), False),
    ),
    _example("speed-levels-off", lambda: _limited_to(1.4), lambda: _limited_to(3.0)),
    _example("start-held", fit_of_held_start, lambda: fit_of_held_start(later=3.0, static=6.0, late=12)),
    _example("structure-reverses", _one_way_that_reverses),
    Example(
        code="lag-not-split",
        raised=lambda: widen_for_lag_split(fit_with(0.01, 2.0, 2.0, -0.9999)).findings,
        absent=lambda: widen_for_lag_split(sound_fit()).findings,
    ),
    _example(
        "loop-tells-little",
        lambda: with_sd(
            _of_data(reference=np.zeros(2000), reference_unit="rad"), gain=0.3, time_constant=0.3
        ),
        lambda: _of_data(reference=np.zeros(2000), reference_unit="rad"),
    ),
    Example(
        code="not-identifiable",
        raised=lambda: identify(sound().part(0.0, 0.005)).findings,
        absent=lambda: identify(sound(samples=2000)).findings,
    ),
    _example("weight-by-speed", lambda: fit_of_arm(0.5), lambda: fit_of_arm(0.0)),
    _example("driver-drop-possible", lambda: _under_a_duty(2.0), lambda: _under_a_duty(0.2)),
    _example("offset-found", lambda: _one_way(0.0)),
    _example("offset-negative", lambda: _one_way(1.0), lambda: _one_way(0.0)),
    _example("output-limited", lambda: _speed_up_to(35.0), lambda: _speed_up_to(100.0)),
    Example(
        code="parameter-at-bound",
        raised=lambda: _as_speed().findings,
        absent=lambda: sound_fit().findings,
    ),
    Example(
        code="parameter-unknown",
        raised=lambda: _statuses(with_sd(sound_fit(), time_constant=30.0)),
        absent=lambda: _statuses(sound_fit()),
    ),
    _example("record-too-short", lambda: _slow(3.0)),
    Example(
        code="residual-coloured",
        raised=lambda: _with_another_lag("derivative"),
        absent=lambda: validate(sound_fit()),
    ),
    Example(
        code="residual-follows-input",
        raised=lambda: _with_another_lag("derivative"),
        absent=lambda: _with_another_lag("derivative | lowpass 50 rad/s"),
    ),
    _example("resolution-coarse", lambda: _coarse(8)),
    _example("sampling-too-slow", lambda: _slow(0.001)),
    Example(
        code="search-not-settled",
        raised=lambda: _from_search(converged=False),
        absent=lambda: _from_search(converged=True),
    ),
    _example("sign-negative", lambda: with_values(sound_fit(), gain=-sound_fit().model["gain"])),
    Example(
        code="static-friction",
        raised=lambda: with_static_friction(fit_of_ramps(0.75)).findings,
        absent=lambda: with_static_friction(fit_of_ramps(0.5)).findings,
    ),
    _example(
        "structure-wrong", lambda: _of_data(findings=(info("bench-pendulum", "A pendulum hangs there."),))
    ),
    _example("swing-small", lambda: fit_of_swings(1.2, 2.0), lambda: fit_of_swings(1.2, 0.5)),
    _example("two-levels", sound_fit, lambda: fitted(driven(np.repeat([1.0, 3.0, -2.0, 2.0], 400)))),
    Example(
        code="validation-poor",
        raised=lambda: _validated(replace(sound(seed=4, samples=2000), u=-sound(seed=4, samples=2000).u)),
        absent=lambda: _validated(sound(seed=4, samples=2000)),
    ),
    Example(
        code="validation-worse",
        raised=lambda: _validated(
            dataset(seed=4, kind="prbs", hold=20, samples=2000, truth=Truth(inertia=3e-5))
        ),
        absent=lambda: _validated(sound(seed=4, samples=2000)),
    ),
)
