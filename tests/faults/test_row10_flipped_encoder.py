"""Row 10: an encoder that counts backwards. Under feedback the shaft runs away and is stopped; nothing else is taken for it."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from servobench.core.channels import Sample
from servobench.recordings.recording import Recording
from servobench.rig.devices.faults.base import fault_from, table_of
from servobench.rig.devices.faulty import Faulty
from servobench.rig.devices.twin import Twin, TwinSettings
from servobench.rig.experiment import Experiment, load_experiment
from servobench.rig.loop.run import run
from servobench.systems.control.pid import Pid
from servobench.systems.signals.constant import Constant
from servobench.systems.signals.square import Square
from servobench.systems.signals.step import Step
from tests.docs.pages import ROOT

POSITION = load_experiment(ROOT / "examples" / "position.toml")
SPEED = Pid(output="speed", kp=0.1, ki=1.0, cutoff=250.0)
WITHIN = 0.3  # s


def asked(signal: Any, law: Any, sample_time: float = 0.002, duration: float = 2.0) -> Experiment:
    return Experiment(signal=signal, controller=law, duration=duration, sample_time=sample_time)


def flipped(experiment: Experiment, since: str = "0s", **settings: Any) -> Recording:
    """Carry out an experiment on the twin, its encoder flipped from a time on."""
    device = Faulty(Twin(TwinSettings(**settings)), [fault_from(table_of(f"encoder_flipped from={since}"))])
    with device:
        return run(experiment, device)


def ended(recording: Recording) -> float:
    """Return the time of the last sample before the stop [s]; the reason has to be the flipped encoder."""
    assert recording.stopped.reason == "fault", recording.stopped.sentence
    assert "the shaft accelerates against the voltage" in recording.stopped.sentence
    assert "swap its channels A and B, the motor's leads, or the sign" in recording.stopped.sentence
    assert "encoder-flipped" in {finding.code for finding in recording.findings}
    return float(recording["counts"].t[-1])  # type: ignore[index]


def check_not_found(recording: Recording) -> None:
    assert "encoder-flipped" not in {finding.code for finding in recording.findings}


@pytest.mark.promise("S51")
@pytest.mark.parametrize("sample_time", [0.001, 0.002, 0.005, 0.01])
@pytest.mark.parametrize("angle", [7.0, -7.0])
def test_a_position_loop_is_stopped_within_0_3_s(sample_time: float, angle: float) -> None:
    law = Pid(output="position", kp=3.0, ki=10.0, kd=0.1, cutoff=250.0)

    assert ended(flipped(asked(Constant(value=angle), law, sample_time))) <= WITHIN


@pytest.mark.promise("S51")
@pytest.mark.parametrize("speed", [60.0, -60.0])
def test_a_speed_loop_is_stopped_within_0_3_s(speed: float) -> None:
    assert ended(flipped(asked(Constant(value=speed), SPEED))) <= WITHIN


@pytest.mark.promise("S51")
def test_swapped_leads_of_the_motor_are_the_same_to_the_guard() -> None:
    class Swapped(Twin):
        def write(self, voltage: float) -> float:
            return -super().write(-voltage)

    with Swapped() as motor:
        assert ended(run(POSITION, motor)) <= WITHIN


@pytest.mark.promise("S51")
def test_one_that_flips_in_mid_run_is_found_within_0_3_s_of_the_next_step() -> None:
    # The loop stands still at 2 s, and the square wave of 0.4 Hz steps at 2.5 s: nothing runs away before.
    assert 2.5 < ended(flipped(POSITION, "2s")) <= 2.5 + WITHIN


@pytest.mark.promise("S51")
@pytest.mark.parametrize("counts", [500, 2048, 8192, 65536])
@pytest.mark.parametrize("disc", [None, 1e-4], ids=["0.1 s", "0.5 s"])
def test_it_is_found_with_any_encoder_and_on_a_heavy_motor(counts: int, disc: float | None) -> None:
    assert ended(flipped(POSITION, counts_per_rev=counts, disc_inertia=disc)) <= WITHIN


def test_without_feedback_the_sign_is_not_watched() -> None:
    recording = flipped(Experiment(signal=Square(low=-3, high=3, frequency=1), duration=2.0))

    assert recording.stopped.reason == "finished"


# What is no flipped encoder.

RIGHT: dict[str, tuple[Any, Any]] = {
    "square position": (POSITION.signal, POSITION.controller),
    "speed back and forth": (Square(low=-100, high=100, frequency=2), SPEED),
    "braking": (Square(low=5, high=200, frequency=1), SPEED),
    "too large a gain": (
        Square(low=-7, high=7, frequency=1),
        Pid(output="position", kp=40.0, cutoff=250.0),
    ),
    "held by friction": (Constant(value=0.1), Pid(output="position", kp=1.0, cutoff=250.0)),
}


@pytest.mark.promise("S51")
@pytest.mark.parametrize("name", RIGHT)
@pytest.mark.parametrize("counts", [12, 2048, 65536])
def test_a_loop_whose_sign_is_right_is_not_stopped(name: str, counts: int) -> None:
    with Twin(TwinSettings(counts_per_rev=counts, delay=0.004)) as motor:
        check_not_found(run(asked(*RIGHT[name], duration=4.0), motor))


@pytest.mark.promise("S51")
def test_a_blocked_shaft_is_not_taken_for_it() -> None:
    fault = fault_from(table_of("blocked_shaft from=1s for=1s"))
    with Faulty(Twin(), [fault]) as motor:
        check_not_found(run(POSITION, motor))


class Moved(Twin):
    """A twin whose shaft somebody turns: its counts follow a function of time [rad], whatever the voltage is."""

    def __init__(self, angle: Callable[[float], float]) -> None:
        super().__init__()
        self.angle = angle

    def read(self) -> Sample:
        sample = super().read()
        return replace(sample, counts=round(self.angle(sample.time) * 2048 / (2 * math.pi)), current=None)


HANDS: dict[str, Callable[[float], float]] = {
    "a pull": lambda t: 3.0 * min(t, 1.0) ** 3 * (10 - 15 * min(t, 1.0) + 6 * min(t, 1.0) ** 2),
    "a quick pull": lambda t: 1.5 * min(t / 0.3, 1.0) ** 2 * (3 - 2 * min(t / 0.3, 1.0)),
    "to and fro": lambda t: 2.0 * math.sin(4 * t),
    "ever faster": lambda t: t * t,
}


@pytest.mark.promise("S51")
@pytest.mark.parametrize("hand", HANDS)
@pytest.mark.parametrize("law", [POSITION.controller, SPEED], ids=["position", "speed"])
def test_a_shaft_that_a_hand_turns_against_the_voltage_is_not_taken_for_it(hand: str, law: Any) -> None:
    with Moved(HANDS[hand]) as motor:
        check_not_found(run(asked(Constant(value=0.0), law), motor))


class Loaded(Twin):
    """A twin with a weight at its shaft from 0.3 s on, worth a voltage [V]: what acts is the written one less that."""

    def __init__(self, weight: float) -> None:
        super().__init__(TwinSettings(amplifier_limit=30.0))
        self.weight, self.now = weight, 0.0

    def read(self) -> Sample:
        sample = super().read()
        self.now = sample.time
        return sample

    def write(self, voltage: float) -> float:
        weight = self.weight if self.now > 0.3 else 0.0
        return super().write(voltage - weight) + weight


@pytest.mark.promise("S51")
@pytest.mark.parametrize("weight", [2.0, -2.0, 4.0])
@pytest.mark.parametrize("speed", [0.0, -30.0, 30.0])
def test_a_weight_that_is_held_lowered_or_lifted_is_not_taken_for_it(weight: float, speed: float) -> None:
    # Lowered at -30 rad/s it takes 4 - 30/23.7 - 0.2 = 2.5 V against the motion, for good: the motor brakes.
    with Loaded(weight) as motor:
        check_not_found(run(asked(Step(final=speed, start=0.8), SPEED), motor))
