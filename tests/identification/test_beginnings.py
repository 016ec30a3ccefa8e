"""The beginning of a record is part of the model: a rest, an input that isn't in the file, a rest that the user reports."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.channels import Channel
from servobench.identification.identify import identify
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.measure import measure
from servobench.recordings.recording import Recording, Series, Source
from tests.datasets import QUANTUM, dataset, prbs
from tests.rig.motor.reference import Truth, march

STEP = 0.002
MOTOR = Truth(coulomb_torque=8e-4, inductance=1e-9)
STIFFNESS = MOTOR.resistance * MOTOR.viscous_friction + MOTOR.motor_constant**2
GAIN, TAU = MOTOR.motor_constant / STIFFNESS, MOTOR.inertia * MOTOR.resistance / STIFFNESS


@pytest.mark.parametrize("rest", [0.02, 0.1, 0.18])
def test_a_short_rest_before_a_one_way_run_is_part_of_the_model(rest: float) -> None:
    """Gain and time constant within three standard deviations, and trusted; without friction that holds they were 0.25 % off."""
    t = np.arange(3000) * STEP
    u = np.where((0.4 * t + 0.1) % 1.0 < 0.5, 3.0, 1.0)
    u[t < rest] = 0.0
    result = identify(dataset(seed=1, u=u, samples=3000, truth=MOTOR))
    assert result.fit is not None
    assert result.fit.structure == "first_order_one_way_rest"
    for name, value in (("gain", GAIN), ("time_constant", TAU)):
        assert abs(result.fit[name].value - value) < 3 * result.fit[name].sd
        assert abs(result.fit[name].value / value - 1) < 1e-3


def test_a_record_that_begins_in_mid_motion_answers_to_nothing_that_isnt_in_it() -> None:
    """Three samples of delay at 50 Hz, and an input that changes with the first row: gain and time constant were 1 and 6 % off.

    The bound for 400 samples is some 1e-5 of the gain and 1e-4 of the time constant.
    """
    step, samples, begins = 0.02, 600, 200
    u = 2.0 + prbs(samples, 10, np.random.default_rng(5)) / 3.0
    begins += int(np.flatnonzero(np.diff(u[begins:]))[0]) + 1
    late = np.concatenate([np.zeros(3), u[:-3]])
    whole = dataset(seed=3, u=late, samples=samples, sample_time=step, truth=MOTOR)
    t, rows = np.arange(samples - begins) * step, slice(begins, None)
    columns = (
        Series(channel=Channel(name="u", unit="V"), values=u[rows], t=t),
        Series(channel=Channel(name="y", unit="rad", resolution=QUANTUM), values=whole.y[rows], t=t),
    )
    recording = Recording(name="cut", series=columns, input="u", output="y", source=Source(name="cut"))
    fit = identify(measure(recording)).fit
    assert fit is not None
    assert abs(fit["gain"].value / GAIN - 1) < 1e-3
    assert abs(fit["time_constant"].value / TAU - 1) < 1e-2
    at_rest = measure(replace(recording, input_before=0.0))
    assert len(at_rest.y) == len(t)


def test_who_knows_that_the_motor_starts_at_rest_gets_a_time_constant_from_one_level() -> None:
    samples = 1000
    u = np.full(samples, 3.0)
    whole = dataset(seed=3, u=u, samples=samples, truth=MOTOR)
    t = np.arange(samples) * STEP
    columns = (
        Series(channel=Channel(name="u", unit="V"), values=u, t=t),
        Series(channel=Channel(name="y", unit="rad", resolution=QUANTUM), values=whole.y, t=t),
    )
    recording = Recording(name="step", series=columns, input="u", output="y", source=Source(name="step"))
    data = measure(recording, starts_at_rest=True)
    assert data.input_before == 0.0
    fit = identify(data).fit
    assert fit is not None
    assert fit.records[0].nuisance[1] == 0.0
    # The bound from rounding alone is 1e-4 of it; the interval allows for a model error that one event can't show.
    assert abs(fit["time_constant"].value / TAU - 1) < 1e-3


def test_a_shaft_that_sets_off_under_the_first_rows_input_answers_to_what_came_with_it() -> None:
    """Three samples of delay, and an input that is on from the first row: the model's shaft set off three samples too early.

    The residual was 1,500 times the rounding then. Rounding alone lets gain and time constant be known to some 1e-5 of them.
    """
    samples = 400
    u = np.where(np.arange(samples) // 50 % 2 == 0, 3.0, 1.0)
    late = np.concatenate([np.zeros(3), u[:-3]])
    whole = dataset(seed=3, u=late, samples=samples, sample_time=0.02, truth=MOTOR)
    columns = (
        Series(channel=Channel(name="u", unit="V"), values=u, t=whole.t_input),
        Series(channel=Channel(name="y", unit="rad", resolution=QUANTUM), values=whole.y, t=whole.t_output),
    )
    recording = Recording(name="cold", series=columns, input="u", output="y", source=Source(name="cold"))
    fit = identify(measure(recording)).fit
    assert fit is not None
    assert fit.residual_sd < 1.2 * QUANTUM / np.sqrt(12)
    for name, value in (("gain", GAIN), ("time_constant", TAU)):
        assert abs(fit[name].value / value - 1) < 1e-3
        assert fit[name].sd / value < 1e-3


def test_a_staircase_whose_first_level_moves_nothing_has_friction_and_no_delay_of_that_level() -> None:
    """A friction of 2.8 V on stairs of 2.5 V: 0.3 V and a delay of a whole stair were a minimum, and a guess lay at the kink.

    Counts of an encoder with 2,048 in a turn show friction and time constant to some 0.1 % here.
    """
    step, hold = 0.008, 25
    motor = MOTOR._replace(coulomb_torque=1.4e-2)
    friction = motor.coulomb_torque * motor.resistance / motor.motor_constant
    u = np.concatenate([np.zeros(4), np.repeat([2.502, 5.0, 7.5, 10.0], hold)])
    fit = identify(dataset(seed=4, u=u, samples=len(u), sample_time=step, truth=motor)).fit
    assert fit is not None
    assert abs(fit["coulomb_voltage"].value / friction - 1) < 0.01
    assert abs(fit["time_constant"].value / TAU - 1) < 0.01
    assert abs(fit["delay"].value) < 0.1 * step


def of_speed(t: np.ndarray, u: np.ndarray, speed: np.ndarray) -> Dataset:
    """A record of voltages [V] and measured speeds [rad/s] at times t [s], all (N,)."""
    columns = (
        Series(channel=Channel(name="u", unit="V"), values=u, t=t),
        Series(channel=Channel(name="speed", unit="rad/s"), values=speed, t=t),
    )
    source = Source(name="speeds")
    return measure(
        Recording(name="speeds", series=columns, input="u", output="speed", source=source, chain="none")
    )


def test_what_a_tachometer_shows_at_rest_is_no_evidence_of_a_delay_before_a_ramp() -> None:
    """A ramp from rest with a friction of 0.64 V: delay and friction do the same, but for 0.5 rad/s that the tachometer shows.

    A model without friction creeps under the 5 mV before the ramp, which made its delay of 0.69 s "known" to 13 %.
    """
    step, rest, samples = 0.033, 92, 236
    motor = MOTOR._replace(coulomb_torque=3.2e-3)
    t = np.arange(samples) * step
    u = np.maximum(t - rest * step, 0.0) + 0.005
    speed = np.gradient(march(motor, u, step, step=3.3e-5)[:, 2], step)
    random = np.random.default_rng(2)
    zero = np.where(random.random(samples) < 0.7, 1.05, 0.0)  # a converter's last digit
    speed = np.where(speed == 0.0, zero, speed + random.normal(0.0, 0.2, samples))
    result = identify(of_speed(t, u, speed))
    assert abs(result.answers["gain"].estimate.value / GAIN - 1) < 0.02
    delay = result.answers["delay"]
    assert delay.state != "known" or delay.estimate.interval[0] < step


@pytest.mark.parametrize(("seed", "bend"), [(3, 0.0), (3, 0.08), (1, 0.2)])
def test_a_ramp_that_bends_a_little_shows_the_gain_and_no_lag_of_half_a_minute(
    seed: int, bend: float
) -> None:
    """A motor that turns all the time, by up to 3 % slower at its end: "gain not known", with a time constant of 40 s.

    The slope of the speed over the voltage is known to 1 % from 240 speeds that scatter by 4 of 130 rad/s.
    """
    t = 0.05 * np.arange(240)
    u = 2.0 + t / 3.0
    speed = 22.0 * (u - 0.7) - bend * (u - 2.0) ** 2 + np.random.default_rng(seed).normal(0.0, 4.0, len(t))
    gain = identify(of_speed(t, u, speed)).answers["gain"]
    slope = float(np.polyfit(u, speed, 1)[0])
    assert gain.state == "known"
    assert gain.estimate.interval[0] < slope < gain.estimate.interval[1]


STAIRS = np.repeat(
    np.array([0, 2, 4, 6, 8, 6, 4, 2, 0, -2, -4, -6, -8, -6, -4, -2, 0], dtype=np.float64), 200
)


def stairs_logged(late: int) -> Dataset:
    """Stairs of 2 s to a motor that levels of 2 V don't move, of which the file has the input so many rows of 10 ms late."""
    motor = MOTOR._replace(coulomb_torque=1e-2, inertia=4 * MOTOR.inertia)
    speed = np.gradient(march(motor, STAIRS, 0.01, step=1e-5)[:, 2], 0.01)
    shown = np.concatenate([np.zeros(late), STAIRS[: len(STAIRS) - late]])
    return of_speed(0.01 * np.arange(len(STAIRS)), shown, speed)


def codes(data: Dataset) -> set[str]:
    return {finding.code for finding in identify(data).findings}


@pytest.mark.parametrize("late", [20, 40])
def test_an_input_that_is_logged_long_after_it_acted_is_misaligned_and_no_motor_without_a_lag(
    late: int,
) -> None:
    """Stairs of 2 s, 0.2 or 0.4 s late: "time constant at most 0.1 s", trusted, for 0.4 s."""
    assert "delay-negative" in codes(stairs_logged(late))
    assert "delay-negative" not in codes(stairs_logged(0))


def test_no_input_is_called_late_where_the_shaft_sets_off_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """The late stairs, as if their first motion had come right after the input."""
    monkeypatch.setattr("servobench.identification.trust.doubts.delay._sets_off_in_time", lambda *_: True)

    assert "delay-negative" not in codes(stairs_logged(20))
