"""Row 9: an encoder that is stuck or unplugged at speed. No quadrature error tells it; a motor's motion does."""

import math
import re
from functools import cache
from itertools import product

import numpy as np
import pytest

from servobench.rig.experiment import Limits
from servobench.rig.experiment.limits import Plausibility
from servobench.rig.motor.parameters import QUBE_SERVO_2
from tests.faults.doubles import Bench, Stuck, drive

WITHIN = 0.1  # s


@pytest.mark.promise("S8")
@pytest.mark.parametrize("toggling", [False, True], ids=["unplugged", "one channel stuck"])
@pytest.mark.parametrize("current_sensor", [True, False], ids=["with current", "without current"])
@pytest.mark.parametrize("sample_time", [0.0005, 0.002, 0.005])
@pytest.mark.parametrize("voltage", [2.0, -2.0, 3.0, -10.0])
def test_it_is_found_at_speed_within_100_ms(
    voltage: float, sample_time: float, current_sensor: bool, toggling: bool
) -> None:
    since = 0.6  # s; 95 % of the speed are reached in 0.3 s
    with Stuck(since, toggling=toggling, current_sensor=current_sensor) as motor:
        guarded = drive(motor, lambda t: voltage, sample_time=sample_time, duration=1.0)

        assert guarded.fault is not None
        assert guarded.fault.code == "encoder-stands-still"
        assert since < guarded.fault.time <= since + WITHIN
        assert motor.reached[-1] == 0.0


@pytest.mark.promise("S8")
@pytest.mark.parametrize(("resistance", "constant", "inertia"), list(product([0.8, 1.2], repeat=3)))
def test_it_is_found_within_100_ms_on_a_motor_20_percent_off_its_data_sheet(
    resistance: float, constant: float, inertia: float
) -> None:
    for current_sensor in (True, False):
        with Stuck(0.8, current_sensor=current_sensor, **off(resistance, constant, inertia)) as motor:
            guarded = drive(motor, lambda t: 2.0, duration=1.2)

            assert guarded.fault is not None
            assert 0.8 < guarded.fault.time <= 0.8 + WITHIN


@pytest.mark.promise("S8")
def test_one_that_is_dead_from_the_start_is_found_by_the_current() -> None:
    with Stuck(0.0) as motor:
        guarded = drive(motor, lambda t: 2.0, duration=1.0)

        assert guarded.fault is not None
        assert guarded.fault.code == "encoder-stands-still"
        assert guarded.fault.time <= WITHIN


@pytest.mark.promise("S8")
def test_one_without_a_current_sensor_that_is_dead_from_the_start_looks_like_a_blocked_shaft() -> None:
    # What decision 0018 says can't be done: nothing tells the two apart, so the stall monitor's 3 s above 5 V are what is left.
    with Stuck(0.0, current_sensor=False) as motor:
        slow = drive(motor, lambda t: 4.0, duration=4.0)
        assert slow.fault is None
    with Stuck(0.0, current_sensor=False) as motor:
        fast = drive(motor, lambda t: 6.0, duration=4.0)
        assert fast.fault is not None
        assert fast.fault.code == "stalled"


@pytest.mark.promise("S8")
def test_nothing_is_found_where_no_motor_is_known_or_nothing_is_asked() -> None:
    with Stuck(0.6) as motor:
        assert drive(motor, lambda t: 2.0, duration=1.0, limits=Limits(plausibility=None)).fault is None
    with Stuck(0.6, current_sensor=False) as motor:
        numbers = Plausibility(gain="23.8 rad/(s·V)", time_constant=0.1)  # type: ignore[arg-type]
        by_numbers = drive(motor, lambda t: 2.0, duration=1.0, limits=Limits(plausibility=numbers))
        assert by_numbers.fault is not None


@pytest.mark.promise("S8")
def test_a_voltage_that_is_late_or_never_comes_is_no_fault_of_the_encoder() -> None:
    # A delay that the device doesn't know of, and an amplifier that is off: the shaft stands, and the winding draws nothing.
    for settings in ({"delay": "60 ms"}, {"delay": "150 ms"}, {"dead_band": "10 V"}):
        for voltage in (2.0, 10.0):
            with Bench(**settings) as motor:
                square = drive(motor, lambda t, u=voltage: u if t % 0.8 < 0.4 else -u, duration=3.0)
                assert square.fault is None, square.fault


def off(resistance: float, constant: float, inertia: float, friction: float = 1.0) -> dict[str, float]:
    """Return the settings of a twin whose parameters are those parts of its data sheet's."""
    motor = QUBE_SERVO_2.motor
    return {
        "resistance": resistance * motor.resistance,
        "motor_constant": constant * motor.motor_constant,
        "rotor_inertia": inertia * motor.rotor_inertia,
        "hub_inertia": inertia * motor.hub_inertia,
        "disc_inertia": inertia * motor.disc_inertia,
        "coulomb_torque": friction * 8e-4,
    }


def excitations(ticks: int, seed: int) -> list[np.ndarray]:
    """Return what a motor is driven with here: squares about and beside zero, two binary noises, sines, steps and a ramp."""
    random = np.random.default_rng(seed)
    t = 0.005 * np.arange(ticks)
    steps = random.uniform(-10, 10, ticks // 40 + 1)
    return [
        np.where(np.sin(2 * math.pi * 0.4 * t) >= 0, 3.0, 1.0),
        10 * np.sign(np.sin(2 * math.pi * 1.7 * t) + 1e-9),
        2.001 * np.sign(np.sin(2 * math.pi * 3.0 * t) + 1e-9),
        10 * np.repeat(random.choice([-1.0, 1.0], ticks // 4 + 1), 4)[:ticks],
        3 * np.repeat(random.choice([-1.0, 1.0], ticks // 20 + 1), 20)[:ticks],
        sum(2 * np.sin(2 * math.pi * f * t + f) for f in (0.3, 1.1, 2.3, 5.9, 12.1)),
        np.repeat(steps, 40)[:ticks],
        10 * (t / t[-1]) - 1.0,
        np.where(np.sin(2 * math.pi * 0.7 * t) >= 0, 10.0, -2.0),
    ]


@cache
def check_no_alarm(number: int, motor: tuple[float, ...]) -> float:
    """Hold that a motor raises none under any signal; the time [s] that was simulated. The few motors are some of the many."""
    ticks, simulated = 4500, 0.0
    for voltages in excitations(ticks, number):
        with Bench(
            current_sensor=number % 2 == 0,
            current_noise="5 mA",
            torque_noise="20 uN·m/√Hz",
            **off(*motor),
        ) as device:
            guarded = drive(device, voltages.tolist(), sample_time=0.005, seed=number)
            assert guarded.fault is None, guarded.fault
            assert guarded.findings() == ()
            simulated += ticks * 0.005
    return simulated


@pytest.mark.promise("S8")
@pytest.mark.parametrize(("within", "least"), [(0, 0.4), pytest.param(10, 1.0, marks=pytest.mark.long)])
def test_motors_within_20_percent_raise_no_alarm(within: int, least: float) -> None:
    # With and without a current sensor, at the corners and at random within the tolerance, each under 9 signals; hours in all.
    random = np.random.default_rng(9)
    corners = [(*corner, 1.2) for corner in product([0.8, 1.2], repeat=3)]
    motors = [*corners, *(tuple(random.uniform(0.8, 1.2, 4)) for _ in range(within))]
    assert sum(check_no_alarm(number, motor) for number, motor in enumerate(motors)) >= 3600 * least


@pytest.mark.promise("S8")
def test_the_sentence_tells_how_long_the_voltage_turned_the_motor_and_not_how_long_a_smaller_one_did() -> (
    None
):
    with Stuck(0.3) as motor:
        guarded = drive(motor, lambda t: 1.0 if t < 0.55 else 3.0, duration=1.0)

    assert guarded.fault is not None
    found = re.search(
        r"stood still for (\d+) ms, of which the last ([\d.]+) ms under 2 V or more \(3 V",
        guarded.fault.sentence,
    )
    assert found, guarded.fault.sentence
    # Two counts of leeway at 1 V are passed in a sample or two; the voltage rose 250 ms after the encoder stuck.
    assert float(found[1]) - float(found[2]) == pytest.approx(250, abs=4)
