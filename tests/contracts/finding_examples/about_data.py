"""Findings on records before any fit, with sound records that don't have them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from servobench.core.finding import Finding, info
from servobench.identification.trust.doubts.base import about_data
from servobench.recordings.formats.mapping import assign
from servobench.recordings.formats.text_table import parse
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.measure import measure
from servobench.recordings.recording import Recording
from servobench.rig.motor.parameters import QUBE_SERVO_2
from tests.contracts.finding_examples.base import TIME, Example, driven, sound
from tests.datasets import QUANTUM, dataset
from tests.identification.trust.test_input_cut_off import cut_off
from tests.identification.trust.test_rest_to_state import RISING, begun
from tests.recordings.measurement.test_measure import recording


def _square() -> Dataset:
    """±2 V at 1 Hz: the shaft goes to and fro between two places."""
    return driven(np.where(TIME % 1.0 < 0.5, 2.0, -2.0))


def _stepped(late: int) -> Dataset:
    """A step to 3 V at row 500, which stands in the file so many rows late."""
    moved, told = (np.where(np.arange(5000) < row, 0.0, 3.0) for row in (500, 500 + late))
    return replace(driven(moved), u=told)


def _clipped() -> Dataset:
    """The sensor ends in the middle of the range."""
    y = _square().y
    return replace(_square(), y=np.minimum(y, y.min() + 0.5 * np.ptp(y)))


def _blocked_late() -> Dataset:
    """The shaft stands still for the last fifth of the record."""
    return replace(sound(), y=sound().y[np.minimum(np.arange(5000), 4000)])


def _within_a_count() -> Dataset:
    """The shaft stands at the edge between two counts."""
    y = _square().y
    return replace(_square(), y=np.where(y > y.mean(), QUANTUM, 0.0))


def _without(rows: NDArray[np.intp]) -> Dataset:
    """The record without some rows."""
    left, whole = np.setdiff1d(np.arange(5000), rows), sound()
    return replace(
        whole, t_input=whole.t_input[left], u=whole.u[left], t_output=whole.t_output[left], y=whole.y[left]
    )


def _said_to_rest(first: int) -> Dataset:
    """A speed that rises to 100 rad/s with 0.1 s from before the record on, whose first rows are cut off."""
    time = 0.005 * np.arange(400)
    speed = 100.0 * -np.expm1(-time / 0.1) + 0.1 * np.random.default_rng(5).standard_normal(len(time))
    whole = driven(np.full(400 - first, 5.0))
    at_times = {"t_input": time[first:], "t_output": time[first:], "y": speed[first:]}
    return replace(whole, **at_times, kind="speed", output_unit="rad/s", quantum=None, starts_at_rest=True)


def _duty_after(start: float, last: float = 0.0) -> Dataset:
    """40 % for a second and nothing, or a `last` duty, after that, recorded from a time after the start [s] on."""
    whole = replace(driven(np.where(TIME[:1000] < 1.0, 40.0, last)), input_unit="%")
    return replace(whole.part(start, 2.0), input_before=40.0 if start else 0.0)


def _already_turning() -> Dataset:
    """2 V throughout, begun when the motor was at its speed."""
    return replace(driven(np.full(3000, 2.0)).part(2.0, 6.0), input_before=2.0)


def _differenced(chain: str) -> Dataset:
    """A speed of which the file doesn't say that it is differenced, or says it."""
    return replace(dataset(seed=1, samples=500, chain="derivative"), applied=Chain.parse(chain))


def _speed_loop(share: float) -> Dataset:
    """A speed that follows its reference within 40 ms, and settles at a share of its value."""
    u = np.repeat([10.0, 30.0, 20.0, 40.0, 10.0], 500)
    lag = np.exp(-0.002 / 0.04)
    speed = np.zeros(len(u))
    for n in range(1, len(u)):
        speed[n] = u[n - 1] + (speed[n - 1] - u[n - 1]) * lag
    noise = 0.01 * np.random.default_rng(1).standard_normal(len(u))
    like = dataset(seed=1, samples=len(u), u=u, y=np.zeros(len(u)))
    return replace(like, y=share * speed + noise, kind="speed", output_unit="rad/s", quantum=None)


def _jittered(share: float) -> Dataset:
    """Samples that come late by chance, by up to a share of the sample time."""
    late = 0.002 * share * np.random.default_rng(1).random(5000)
    return replace(sound(), t_output=sound().t_output + late)


def _relay(noise: float) -> Dataset:
    """An ideal motor (24 rad/(s·V), 0.1 s) behind a relay of ±3 V that switches where the shaft is 0.5 rad off, more or less."""
    random, angle, speed, volts = np.random.default_rng(1), 0.0, 0.0, 3.0
    us, angles = [], []
    for _ in range(5000):
        us.append(volts)
        angles.append(angle)
        if volts * (angle + noise * random.standard_normal()) > 3.0 * 0.5:
            volts = -volts
        speed += (24.0 * volts - speed) * -np.expm1(-0.002 / 0.1)
        angle += 0.002 * speed
    return dataset(seed=1, u=np.array(us), y=np.floor(np.array(angles) / QUANTUM) * QUANTUM)


def _in_a_loop(u: NDArray[np.float64], y: NDArray[np.float64]) -> Dataset:
    """A loop that was to stay at 1 rad, with these voltages and angles."""
    like = dataset(seed=1, samples=len(u), u=u, y=y)
    return replace(like, reference=np.ones(len(u)), reference_unit="rad")


def _loop_at_its_limits(period: int) -> Dataset:
    """3 V to and fro in so many samples."""
    u = np.where(np.arange(1000) % period < period / 2, 3.0, -3.0)
    return _in_a_loop(u, 1.0 + 0.1 * np.sin(np.arange(1000)))


def _step_to(end: float) -> Dataset:
    """The shaft goes from 0 to there."""
    y = end * -np.expm1(-np.arange(1000) / 100.0)
    return _in_a_loop(np.linspace(1.0, 0.0, 1000), y)


def _with_current(scale: float) -> Dataset:
    """The reference motor's speed times a scale, and the current that its back-emf leaves."""
    data, motor = driven(np.repeat([3.0, -3.0, 2.0, -2.0], 500)), QUBE_SERVO_2.motor
    speed = np.gradient(data.y, data.t_output)
    current = (data.u - motor.motor_constant * speed) / motor.resistance
    return replace(data, y=scale * data.y, quantum=scale * QUANTUM, current=current)


def _twice(angle: float) -> list[Dataset]:
    """A record, and the same whose angle counts from elsewhere by so much [rad]."""
    return [sound(), replace(sound(), name="another", y=sound().y + angle)]


def _again() -> list[Dataset]:
    """A record, and that of a motor that starts elsewhere within a count, under the same input."""
    return [sound(), replace(dataset(seed=2, u=sound().u), name="another")]


def _table(code: str) -> Dataset:
    """Each row another voltage, in order."""
    u = np.linspace(-3.0, 3.0, 41)
    found = (info(code, "The sample time is given."),) if code else ()
    return replace(dataset(seed=1, samples=41, u=u, y=20.0 * u), findings=found)


def _slow(code: str) -> Dataset:
    """A sample each second."""
    found = (info(code, "The times are in seconds."),) if code else ()
    whole = sound()
    return replace(whole, t_input=500 * whole.t_input, t_output=500 * whole.t_output, findings=found)


def _wrapped(size: float) -> Dataset:
    """An angle that is kept within half a turn to either side of 0, where the size is a turn."""
    data = sound()
    return measure(recording((data.y + size / 2) % size - size / 2, "rad", t=data.t_output, u=data.u))


def _of_duty(unit: str) -> Recording:
    """A column `duty` whose unit is said to be that."""
    data = sound()
    column = recording(data.y, "rad", t=data.t_output, u=data.u)
    renamed = [
        replace(each, channel=replace(each.channel, name="duty", unit=None)) for each in column.series[:1]
    ]
    return assign(replace(column, series=(*renamed, *column.series[1:]), input=None), input=f"duty{unit}")


def _in_counts(size: float) -> Dataset:
    """Whole numbers times a size, which are called counts."""
    data = sound()
    return measure(recording(size * np.rint(100 * data.y), "counts", t=data.t_output, u=data.u))


def _counted_in_each_row(missing: slice) -> Dataset:
    """An encoder that is set back to zero in each row, without some of the rows."""
    data = sound()
    counts = np.diff(np.rint(100 * data.y), prepend=0.0)
    left = np.delete(np.arange(len(counts)), missing)
    return measure(recording(counts[left], "counts", t=data.t_output[left], u=data.u[left]), "accumulate")


def _example(code: str, faulty: Callable[[], Dataset], like: Callable[[], Dataset]) -> Example:
    def of(made: Callable[[], Dataset]) -> list[Finding]:
        return about_data([made()])

    return Example(code=code, raised=partial(of, faulty), absent=partial(of, like))


def _under_5_volts(sense: float) -> Dataset:
    """1 s of 5 V, and another whose voltage goes that way and is written as 5 V."""
    turned = driven(np.repeat([5.0, 5.0 * sense], 500))
    return replace(turned, u=np.full(1000, 5.0))


def _against_a_stop(at: int) -> Dataset:
    """2 s of 5 V, in which the shaft comes to an end stop at that sample."""
    turned = driven(np.full(1000, 5.0))
    return replace(turned, y=turned.y[np.minimum(np.arange(1000), at)])


def _towards(goal: float) -> Dataset:
    """A position that settles at 1 rad, under a voltage in proportion to its distance from a goal [rad]."""
    y = -np.expm1(-np.arange(1000) / 100.0)
    return dataset(seed=1, samples=1000, u=3.0 * (goal - y), y=y)


def _read_every(rows: int) -> Dataset:
    """A record whose rows were read so many at once, at half of the time between samples, and then waited for."""
    late = 0.001 * (np.arange(5000) % rows)
    return replace(sound(), t_input=sound().t_input - late, t_output=sound().t_output - late)


def _beside_position(part: float) -> Recording:
    """A sine's position, and `part` of its speed as the output."""
    t = 0.01 * np.arange(300)
    speed = recording(part * 40.0 * np.cos(t), "rad/s", t=t, u=np.cos(t))
    (output,) = (each for each in speed.series if each.channel.name == speed.output)
    angle = replace(
        output, channel=replace(output.channel, name="angle", unit="rad"), values=40.0 * np.sin(t)
    )
    return assign(replace(speed, series=(*speed.series, angle)))


def _slipped(angle: float) -> Dataset:
    """A shaft that slips in its coupling by an angle [rad], once."""
    return replace(sound(), y=sound().y + np.where(np.arange(5000) > 3210, angle, 0.0))


EXAMPLES = (
    Example(
        code="angle-wraps",
        raised=lambda: _wrapped(2 * np.pi).findings,
        absent=lambda: _wrapped(1e6).findings,
    ),
    _example("chain-unknown", lambda: _differenced(""), lambda: _differenced("derivative")),
    Example(
        code="counts-lost",
        raised=lambda: _counted_in_each_row(slice(1000, 1150)).findings,
        absent=lambda: _counted_in_each_row(slice(0, 0)).findings,
    ),
    Example(
        code="counts-not-whole",
        raised=lambda: _in_counts(0.5).findings,
        absent=lambda: _in_counts(1.0).findings,
    ),
    Example(
        code="data-repeated",
        raised=lambda: about_data(_twice(1.0)),
        absent=lambda: about_data(_again()),
    ),
    Example(
        code="factor-off",
        raised=lambda: about_data([_with_current(4.0)], QUBE_SERVO_2.motor),
        absent=lambda: about_data([_with_current(1.0)], QUBE_SERVO_2.motor),
    ),
    # Rows 1000 to 1149 hold several bits of the PRBS; a single row is no gap.
    _example("coast-only", lambda: _duty_after(0.4), lambda: _duty_after(0.0)),
    _example("gap-input-unknown", lambda: _without(np.arange(1000, 1150)), sound),
    _example("input-constant", _already_turning, sound),
    _example("input-is-output", lambda: replace(sound(), u=0.01 * sound().y), sound),
    _example("input-settles-at-output", lambda: _speed_loop(1.0), lambda: _speed_loop(0.9)),
    _example("limit-cycle", lambda: _relay(0.1), sound),
    _example("loop-proportional", lambda: _towards(1.0), lambda: _towards(2.0)),
    _example("loop-runs-away", lambda: _step_to(-5.0), lambda: _step_to(1.0)),
    _example("loop-swings", lambda: _loop_at_its_limits(20), lambda: _loop_at_its_limits(1000)),
    _example("motion-reversed", lambda: _under_5_volts(-1.0), lambda: _under_5_volts(1.0)),
    _example("motion-stopped", lambda: _against_a_stop(700), lambda: _against_a_stop(1000)),
    _example("motion-too-small", _within_a_count, _square),
    _example("moves-before-input", lambda: _stepped(25), lambda: _stepped(0)),
    _example("not-at-rest", lambda: _said_to_rest(50), lambda: _said_to_rest(0)),
    _example("output-clipped", _clipped, _square),
    _example("slows-down-only", lambda: _duty_after(0.4, 20.0), lambda: _duty_after(0.4, 60.0)),
    _example("input-cut-off", lambda: cut_off(2.0), lambda: cut_off(3.0)),
    _example("output-jumps", lambda: _slipped(2 * np.pi), lambda: _slipped(0.0)),
    _example("output-still", lambda: replace(sound(), y=np.zeros(5000)), sound),
    _example("output-stops", _blocked_late, sound),
    _example(
        "period-short",
        lambda: driven(np.resize([1.0, 3.0, 2.0], 300)),
        lambda: driven(np.resize(np.arange(6.0), 300)),
    ),
    _example("rest-to-state", lambda: begun(RISING), lambda: begun(RISING + 20.0)),
    _example("single-level", lambda: driven(np.where(TIME[:2000] < 0.4, 0.0, 2.0)), sound),
    _example("size-absurd", lambda: replace(sound(), u=1000 * sound().u), sound),
    Example(
        code="unit-contradicted",
        raised=lambda: _of_duty(":V").findings,
        absent=lambda: _of_duty(":%").findings,
    ),
    _example("table-static", lambda: _table("sample-time-given"), lambda: _table("")),
    Example(
        code="position-disagrees",
        raised=lambda: _beside_position(0.9).findings,
        absent=lambda: _beside_position(0.97).findings,
    ),
    Example(
        code="thousands-separated",
        raised=lambda: parse("y\n1'013\n", "log.csv").findings,
        absent=lambda: parse("y\n1013\n", "log.csv").findings,
    ),
    _example("time-uneven", lambda: _jittered(0.9), lambda: _jittered(0.0)),
    _example("times-of-reading", lambda: _read_every(200), lambda: _read_every(1)),
    _example("time-unit-doubtful", lambda: _slow("time-recognised"), lambda: _slow("")),
)
