"""Stretches in which the shaft stands still: between pulses it should, under a pulse it shouldn't.

The recordings are of `tests.rig.motor.reference`: 20 rad/(s·V) or so, 0.1 s, behind 2048 counts/rev at 200 Hz.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.identification.identify import identify
from servobench.identification.trust.doubts.base import DOUBTS
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import QUANTUM, dataset
from tests.rig.motor.reference import Truth, march

SAMPLE_TIME = 0.005
SAMPLES = 2000


def pulses(
    width: float, period: float, *, both_ways: bool = False, between: float = 0.0
) -> NDArray[np.float64]:
    """Pulses of 4 V, the first after 0.1 s; every second one backwards where they go both ways."""
    number, phase = np.divmod(np.arange(SAMPLES) * SAMPLE_TIME - 0.1 + 1e-9, period)
    sign = np.where((number % 2 == 1) & both_ways, -1.0, 1.0)
    return np.where((phase < width) & (number >= 0), 4.0 * sign, between)


def recorded(u: NDArray[np.float64], quantum: float = QUANTUM, late: int = 0) -> Dataset:
    angle = march(Truth(), u, SAMPLE_TIME)[:, 2]
    angle = np.concatenate([np.full(late, angle[0]), angle[: len(angle) - late]])
    y = (np.floor(angle / quantum) + 0.5) * quantum
    data = dataset(seed=1, samples=SAMPLES, sample_time=SAMPLE_TIME, u=u, y=y)
    return data if quantum == QUANTUM else _replaced(data, quantum)


def _replaced(data: Dataset, quantum: float) -> Dataset:
    from dataclasses import replace

    return replace(data, quantum=quantum)


def blocked(data: Dataset, start: float, end: float) -> Dataset:
    """The same, with the shaft held for some time: it stands, and goes on from there."""
    from dataclasses import replace

    first, last = int(start / SAMPLE_TIME), int(end / SAMPLE_TIME)
    steps = np.diff(data.y, prepend=data.y[0])
    steps[first:last] = 0.0
    return replace(data, y=data.y[0] + np.cumsum(steps))


def told(data: Dataset) -> set[str]:
    return {finding.code for finding in DOUBTS["flats"].about_data([data])}


@pytest.mark.parametrize("both_ways", [False, True])
@pytest.mark.parametrize("period", [1.0, 2.0])
@pytest.mark.parametrize("width", [0.01, 0.05, 0.1, 0.5])
def test_a_motor_that_rests_between_pulses_is_not_called_blocked(
    width: float, period: float, both_ways: bool
) -> None:
    assert told(recorded(pulses(width, period, both_ways=both_ways))) == set()


def test_a_bias_that_friction_holds_between_pulses_is_not_called_blocked() -> None:
    """The reference motor's Coulomb voltage is 8.4 · 8e-4/0.042 = 0.16 V."""
    assert told(recorded(pulses(0.05, 1.0, between=0.12))) == set()


@pytest.mark.parametrize("late", [3, 7, 40])
def test_pulses_that_act_after_they_have_ended_are_not_called_lost(late: int) -> None:
    assert told(recorded(pulses(0.01, 1.0), late=late)) == set()


def test_a_pulse_that_a_coarse_sensor_may_miss_is_not_called_lost() -> None:
    u = pulses(0.01, 1.0)
    way = float(np.ptp(march(Truth(), u, SAMPLE_TIME)[:, 2])) / 10
    assert told(recorded(u, quantum=1.6 * way)) <= {"motion-too-small"}


@pytest.mark.parametrize("both_ways", [False, True])
@pytest.mark.parametrize("width", [0.05, 0.1, 0.5])
def test_a_shaft_that_is_held_under_a_pulse_is_reported(width: float, both_ways: bool) -> None:
    sound = recorded(pulses(width, 1.0, both_ways=both_ways))
    assert told(blocked(sound, 5.05, 6.05)) == {"output-stops"}
    assert told(blocked(sound, 7.05, 10.0)) == {"output-stops"}


def test_a_shaft_that_is_held_under_a_constant_input_is_reported() -> None:
    u = np.where(np.arange(SAMPLES) < 200, 0.0, 2.0)
    assert told(recorded(u)) == set()
    assert told(blocked(recorded(u), 6.0, 8.0)) == {"output-stops"}


def test_a_shaft_that_is_held_under_a_sine_before_a_level_is_reported() -> None:
    """The level above the sine's amplitude, at which the motor turns evenly, isn't the least that drives it."""
    t = SAMPLE_TIME * np.arange(SAMPLES)
    u = np.where(t < 9.3, 3.0 * np.sin(np.pi * t), 3.6)

    assert told(blocked(recorded(u), 6.4, 8.0)) == {"output-stops"}


def test_a_dead_zone_after_a_coast_is_not_called_a_blocked_shaft() -> None:
    """A motor comes from full speed under next to no input, and stays where 0.4 V don't overcome its friction, until 1 V does."""
    u = np.repeat([4.0, 0.05, 0.4, 1.0], [400, 60, 100, 100])
    stiff = Truth(coulomb_torque=3.2e-3)
    whole = dataset(seed=1, samples=len(u), sample_time=SAMPLE_TIME, u=u, truth=stiff, chain="derivative")

    assert told(whole.part(402 * SAMPLE_TIME, len(u) * SAMPLE_TIME)) == set()


def test_a_shaft_that_hasnt_moved_yet_may_be_held_by_static_friction() -> None:
    """One that has turned under this input was stopped by something else."""
    turning = recorded(np.full(SAMPLES, 2.0))
    at_first, later = (
        DOUBTS["flats"].about_data([blocked(turning, begin, begin + 2.0)])[0].sentence for begin in (0.0, 6.0)
    )

    assert "static friction held the shaft" in at_first
    assert "static friction" not in later
    assert "the shaft was blocked" in later


def slow_wheel(at_rest: bool = False) -> Dataset:
    """Counts of a wheel with 24 of them in a turn, differenced: 0 or 1 a sample, or trembling on the edge of one."""
    from dataclasses import replace

    u = np.where(np.arange(SAMPLES) < 200, 0.0, 0.8)
    angle = march(Truth(), u, SAMPLE_TIME)[:, 2]
    quantum = 2 * np.pi / 24
    counts = np.floor(angle / quantum) if not at_rest else np.arange(SAMPLES) // 7 % 2
    y = np.diff(counts, prepend=counts[0]) * quantum / SAMPLE_TIME
    position = dataset(seed=1, samples=SAMPLES, sample_time=SAMPLE_TIME, u=u, y=y)
    return replace(position, kind="speed", output_unit="rad/s", quantum=None)


def test_a_wheel_that_counts_less_than_once_a_sample_moves() -> None:
    assert np.ptp(slow_wheel().y) > 0
    assert "output-still" not in told(slow_wheel())


def test_a_wheel_that_trembles_on_the_edge_of_a_count_stands_still() -> None:
    assert "motion-too-small" in told(slow_wheel(at_rest=True))


def test_a_tachometer_that_trembles_by_its_last_digit_stands_still() -> None:
    from dataclasses import replace

    data = slow_wheel()
    dither = 100.0 + np.arange(SAMPLES) // 7 % 2
    assert "motion-too-small" in told(replace(data, y=0.1 * dither))


def differentiated(u: NDArray[np.float64], counts_per_rev: int) -> Dataset:
    """A speed that was differentiated from the counts of a coarse encoder."""
    from dataclasses import replace

    counts = np.floor(march(Truth(), u, SAMPLE_TIME)[:, 2] * counts_per_rev / (2 * np.pi))
    speed = np.diff(counts, prepend=counts[0]) * 2 * np.pi / counts_per_rev / SAMPLE_TIME
    return replace(recorded(u), y=speed, quantum=None, kind="speed", output_unit="rad/s")


def test_a_wheel_that_turns_by_less_than_a_count_a_row_is_not_called_blocked() -> None:
    """At 2 V, 44 rad/s: 12 counts a turn make 0.4 counts in 5 ms."""
    slow = differentiated(np.where(np.arange(SAMPLES) < 200, 0.0, 2.0), 12)
    assert len(np.unique(slow.y)) == 2

    assert told(slow) == set()


def test_a_motion_of_two_counts_is_too_small_and_not_blocked() -> None:
    u = np.where(np.arange(SAMPLES) < 1900, 0.0, 2.0)
    data = recorded(u, quantum=float(np.ptp(march(Truth(), u, SAMPLE_TIME)[:, 2])) / 1.5)
    assert 0 < np.ptp(data.y) <= 2 * (data.quantum or 0.0)

    assert told(data) == {"motion-too-small"}


def test_a_speed_that_flickers_by_one_step_does_not_travel() -> None:
    from dataclasses import replace

    moving = differentiated(np.where(np.arange(SAMPLES) < 200, 0.0, 2.0), 12)
    flicker = np.random.default_rng(1).choice([-1.0, 0.0, 1.0], SAMPLES)

    assert told(replace(moving, y=flicker)) == {"motion-too-small"}


def test_a_coarse_encoder_that_stands_while_the_motor_turns_round_is_not_called_blocked() -> None:
    """30 ms of 4 V either way, 12 counts a turn: the shaft goes to and fro within a count for a while."""
    u = 4.0 * np.sign(np.sin(2 * np.pi * 2.0 * np.arange(SAMPLES) * SAMPLE_TIME))
    u[1000:1200] = 4.0 * np.sign(np.sin(2 * np.pi * 17.0 * np.arange(200) * SAMPLE_TIME))

    assert told(recorded(u, quantum=2 * np.pi / 3)) == set()


def test_a_shaft_that_turns_round_within_a_count_is_not_called_blocked() -> None:
    """±2 V change sides every 0.4 s, and 24 counts in a turn: about each turning point the shaft stays in a count for 60 ms."""
    u = np.where(np.arange(SAMPLES) // 80 % 2 == 0, 2.0, -2.0)
    quantum = 2 * np.pi / 24
    short = recorded(u, quantum=quantum).part(1.0, 2.2)

    assert told(short) == set()


@pytest.mark.parametrize("both_ways", [False, True])
@pytest.mark.parametrize("width", [0.1, 0.5])
def test_a_speed_that_stays_zero_under_a_pulse_is_reported_and_one_that_rests_between_them_is_not(
    width: float, both_ways: bool
) -> None:
    from dataclasses import replace

    sound = differentiated(pulses(width, 1.0, both_ways=both_ways), 2048)
    dead = np.arange(SAMPLES) * SAMPLE_TIME < 3.1

    assert told(sound) == set()
    assert told(replace(sound, y=np.where(dead, 0.0, sound.y))) == {"output-stops"}


def test_a_speed_that_is_zero_at_its_goal_is_not_called_blocked() -> None:
    from dataclasses import replace

    sound = differentiated(pulses(0.5, 1.0), 2048)
    dead = np.arange(SAMPLES) * SAMPLE_TIME < 3.1

    assert told(replace(sound, y=np.where(dead, 0.0, sound.y), input_unit="rad/s")) == set()


def test_a_motor_that_sets_off_at_the_end_of_a_rest_is_not_called_blocked() -> None:
    """A hundred rows, 49 counts in a turn: three of the six rows that stand still are driven, and two of them are the delay."""
    u = np.concatenate([np.zeros(4), np.full(32, 1.04), np.full(32, -1.04), np.full(32, 1.04)])
    motor = Truth(
        resistance=1.0,
        inductance=1e-6,
        motor_constant=1 / 84.0,
        inertia=0.146 / 84.0**2,
        viscous_friction=0.0,
        coulomb_torque=0.117 / 84.0,
    )
    quantum, late = 2 * np.pi / 49, 2
    angle = march(motor, np.concatenate([np.zeros(late), u])[: len(u)], 0.0147)[:, 2]
    y = (np.floor(angle / quantum + 0.3) + 0.5) * quantum
    data = dataset(seed=1, samples=len(u), sample_time=0.0147, u=u, y=y)
    assert told(_replaced(data, quantum)) == set()


@pytest.mark.parametrize("speed", [3.0, -0.73])
@pytest.mark.parametrize("quantum", [None, QUANTUM])
def test_a_shaft_that_turns_evenly_under_an_alternating_input_is_none_of_its_own(
    speed: float, quantum: float | None
) -> None:
    t = 0.005 * np.arange(800)
    y = speed * t if quantum is None else quantum * np.round(speed * t / quantum)
    u = np.repeat([3.0, -3.0, 6.0, -6.0], 200)
    even = replace(dataset(seed=1, u=u, y=y, samples=800, sample_time=0.005), quantum=quantum)

    assert told(even) == {"output-still"}
    assert "output-still" not in told(replace(even, u=np.full(800, 3.0), input_before=3.0))
    assert "output-still" not in told(replace(even, y=y + np.linspace(0.0, 0.2, 800) ** 2))
    assert "output-still" not in told(replace(even, u=np.tile([6.0, 0.0], 400)))  # too fast for a motor
    assert "output-still" not in told(replace(even, y=np.round(y / 3.0), quantum=1.0))  # four counts


@pytest.mark.parametrize("late", [0, 10])
def test_a_start_behind_a_coarse_encoder_is_no_blocked_shaft(late: int) -> None:
    """115 counts in a turn: a motor of 0.25 s needs some 60 ms for the first one, and the delay stands before it."""
    t = 0.006 * np.arange(260)
    setting_off = np.maximum(t - 0.1 - 0.006 * late, 0.0)
    angle = 9.0 * (setting_off + 0.25 * np.expm1(-setting_off / 0.25))
    quantum = 2 * np.pi / 115
    y = np.floor(angle / quantum) * quantum
    data = dataset(seed=1, samples=260, sample_time=0.006, u=np.where(t < 0.1, 0.0, 0.5), y=y)

    assert told(replace(data, quantum=quantum)) == set()


def switched_off(off: float) -> NDArray[np.float64]:
    """Levels of 2 and 4 V, and nothing from a time [s] on, though 4 V are logged."""
    t = np.arange(SAMPLES) * SAMPLE_TIME
    return np.where(t < off, np.where(t < 1.0, 0.0, np.where(t < 5.0, 2.0, 4.0)), 0.0)


@pytest.mark.parametrize("as_speed", [False, True])
def test_a_motor_that_runs_down_under_an_input_was_switched_off(as_speed: bool) -> None:
    """The last half second of ten, most of which it still slows down."""
    data = recorded(switched_off(9.5))
    if as_speed:
        data = replace(
            data, kind="speed", y=np.gradient(data.y, SAMPLE_TIME), output_unit="rad/s", quantum=None
        )
    logged = replace(data, u=switched_off(11.0))

    assert told(data) == set()
    assert told(logged) == {"output-stops"}
    (stop,) = (each for each in identify(logged).findings if each.code == "output-stops")
    assert "after 9.5" in stop.sentence


STEADY = np.arange(400) * 0.005


def under_one_input(
    speed: NDArray[np.float64], *, as_position: bool, t: NDArray[np.float64] = STEADY
) -> Dataset:
    """A motor under 5 V all the time, by its speed [rad/s] at times t [s], or by its position behind 2048 counts per turn."""
    like = dataset(seed=1, samples=len(t), sample_time=0.005, u=np.full(len(t), 5.0), y=np.zeros(len(t)))
    like = replace(like, input_before=5.0, t_input=t, t_output=t)
    if as_position:
        way = np.concatenate([[0.0], np.cumsum(np.diff(t) * 0.5 * (speed[1:] + speed[:-1]))])
        return replace(like, y=(np.floor(way / QUANTUM) + 0.5) * QUANTUM)
    noisy = speed + 0.2 * np.random.default_rng(1).standard_normal(len(speed))
    return replace(like, y=noisy, kind="speed", output_unit="rad/s", quantum=None)


def after(begin: float, tau: float) -> NDArray[np.float64]:
    """What is left of a speed that falls with a time constant from some moment on."""
    return np.exp(-np.maximum(STEADY - begin, 0.0) / tau)


SPEED = 80.0 * -np.expm1(-STEADY / 0.1)


@pytest.mark.parametrize("as_position", [False, True])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_run_down_that_the_end_of_the_record_cuts_short_is_reported(
    sense: float, as_position: bool
) -> None:
    (finding,) = DOUBTS["flats"].about_data(
        [under_one_input(sense * SPEED * after(1.85, 0.12), as_position=as_position)]
    )

    assert finding.code == "output-stops"
    assert "although the input stays at 5\u00a0V" in finding.sentence
    assert "Use only the rows up to 1.8" in finding.sentence


def test_one_row_for_each_slot_shows_a_run_down_too() -> None:
    """Times [s] of the slots of a disc: 100 at 80 slots a second, and then six that each take a third longer."""
    steps = np.concatenate([np.full(100, 0.0125), 0.0125 * (4.0 / 3.0) ** np.arange(1, 7)])
    t = np.concatenate([[0.0], np.cumsum(np.round(steps, 3))])
    data = replace(
        under_one_input(np.ones(len(t)), as_position=False, t=t),
        y=np.arange(len(t), dtype=np.float64),
        kind="position",
        output_unit="counts",
        quantum=1.0,
    )

    assert told(data) == {"output-stops"}


@pytest.mark.parametrize("as_position", [False, True])
@pytest.mark.parametrize(
    "speed",
    [
        pytest.param(SPEED, id="a step"),
        pytest.param(SPEED * (1.0 + 0.12 * np.sin(40.0 * STEADY)), id="a ripple"),
        pytest.param(SPEED * (1.0 - 0.2 * STEADY), id="a supply that weakens"),
        pytest.param(SPEED * after(1.95, 0.4), id="a little slower at the end"),
        pytest.param(80.0 * np.exp(-STEADY) * np.sin(6.0 * STEADY), id="a pendulum that swings"),
        pytest.param(80.0 * (1.0 + 0.6 * np.cos(3.0 * STEADY)), id="a pendulum that goes round"),
        pytest.param(80.0 / np.cosh(1.7 * STEADY - 1.5), id="a pendulum that just fails to go round"),
        pytest.param(SPEED * np.exp(-STEADY / 0.8), id="a weight that is lifted to its balance"),
    ],
)
def test_no_other_motion_under_one_input_is(speed: NDArray[np.float64], as_position: bool) -> None:
    assert told(under_one_input(speed, as_position=as_position)) == set()


@pytest.mark.parametrize("as_position", [False, True])
def test_a_false_value_at_the_end_of_a_record_is_no_run_down(as_position: bool) -> None:
    data = under_one_input(SPEED, as_position=as_position)
    y = data.y.copy()
    y[-1] -= 30 * QUANTUM if as_position else 50.0

    assert told(replace(data, y=y)) == set()


def test_a_slow_swing_into_the_end_of_a_range_is_found_beside_fast_motions() -> None:
    """Three swings of 5 s that end at 1.5 of 2 rad, then two seconds of motions that are seven times as fast."""
    t = np.arange(3400) * SAMPLE_TIME
    slow = np.minimum(2.0 * np.sin(2 * np.pi * t / 5), 1.5)
    fast = 1.4 * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * t / 0.5))
    y = np.round(np.where(t < 15.0, slow, fast) / 1e-3) * 1e-3
    data = dataset(seed=1, samples=3400, sample_time=SAMPLE_TIME, u=np.cos(2 * np.pi * t / 5), y=y)

    about = DOUBTS["flats"].about_data
    assert about is not None
    assert [each.code for each in about([replace(data, quantum=1e-3)])] == ["output-clipped"]
