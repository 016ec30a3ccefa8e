"""Start, a change of the signal and a switch of the controller: what is put out then, tick by tick, in virtual time."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from servobench.panel.preview import preview_signal
from servobench.rig.clock import clock_for
from servobench.rig.devices.base import connect
from servobench.rig.devices.guarded import Guarded
from servobench.rig.experiment import Experiment
from servobench.rig.loop.messages import Command, Order
from servobench.rig.loop.place import Place
from servobench.rig.loop.references import References
from servobench.rig.loop.ticks import Drive, run_ticks
from servobench.systems.control.pid import Pid
from servobench.systems.signals.prbs import PRBS
from servobench.systems.signals.square import Square
from servobench.systems.signals.step import Step

SAMPLE_TIME = 0.002
START = 100  # the tick at which Start takes effect


class Kept:
    """Keeps all ticks."""

    def __init__(self) -> None:
        self.places: list[Place] = []

    def add(self, place: Place) -> None:
        self.places.append(place)

    def column(self, name: str) -> np.ndarray:
        return np.array([getattr(each, name) for each in self.places])


def driven(ticks: int, commands: dict[int, Command], experiment: Experiment | None = None) -> Kept:
    """Let the twin stand at zero volts, as the panel does, and give it commands that take effect at those ticks."""
    asked = experiment or Experiment(sample_time=SAMPLE_TIME)
    kept = Kept()
    with connect("twin") as inner:
        device = Guarded(inner, asked.limits)
        drive = Drive(asked, device, References(asked.signal, SAMPLE_TIME), enabled=False)

        def command(place: Place) -> None:
            if found := commands.get(place.tick.index + 1):
                drive.change(Order(number=place.tick.index, command=found))

        device.start(SAMPLE_TIME, asked.seed)
        clock = clock_for("virtual")
        clock.start(SAMPLE_TIME)
        run_ticks(ticks, device, clock, drive, kept, (command,))
        assert not drive.refused
    return kept


SIGNALS: dict[str, Any] = {
    "step": Step(final=4.0),
    "square of 6 V": Square(low=-6.0, high=6.0, frequency=0.8),
    "PRBS of 3 V": PRBS(low=-3.0, high=3.0, bit_time=0.1, order=5),
}


@pytest.mark.promise("S47")
@pytest.mark.parametrize("signal", SIGNALS.values(), ids=SIGNALS)
def test_start_puts_out_the_signal_from_its_first_sample_and_nothing_beyond_its_preview(signal: Any) -> None:
    kept = driven(START + 1500, {START: Command(enabled=True, signal=signal)})

    applied = kept.column("applied")
    assert not applied[:START].any()
    # By the signal's own definition, as the whole run of a file has it.
    np.testing.assert_array_equal(applied[START:], signal(np.arange(1500) * SAMPLE_TIME))
    experiment = Experiment(sample_time=SAMPLE_TIME, signal=signal)
    shown = preview_signal(
        {"signal": experiment.model_dump(mode="json")["signal"], "duration": 3.0}, experiment
    )
    assert min(shown["low"]) <= applied[START:].min()
    assert applied[START:].max() <= max(shown["high"])


@pytest.mark.promise("S47")
def test_a_step_that_is_started_reads_the_motors_time_constant() -> None:
    kept = driven(START + 1000, {START: Command(enabled=True, signal=SIGNALS["step"])})

    angle = np.array([each.tick.sample.counts for each in kept.places[START:]]) * 2 * math.pi / 2048
    # A first-order motor from rest lags behind its final speed by τ for good: θ(T) = ω (T - τ).
    T, speed = 999 * SAMPLE_TIME, (angle[-1] - angle[-501]) / (500 * SAMPLE_TIME)
    # 99.2 ms by its data sheet: R (J_rotor + J_hub + J_disc)/k². A count at each end of the 1 s in which it turns at 91 rad/s is
    # 2·3.1 mrad/91 rad of T; the winding, 1.16 mH/8.4 ohm, adds 0.14 ms.
    assert T - angle[-1] / speed == pytest.approx(0.0992, abs=0.0005)


@pytest.mark.promise("S47")
def test_another_signal_in_the_middle_is_put_out_at_once() -> None:
    kept = driven(
        START + 400,
        {
            START: Command(enabled=True, signal=Step(final=-6.0)),
            START + 200: Command(signal=Step(final=6.0)),
        },
    )

    np.testing.assert_array_equal(kept.column("applied")[START:], 200 * [-6.0] + 200 * [6.0])


@pytest.mark.promise("S47")
def test_open_loop_after_a_controller_puts_out_its_signal_at_once() -> None:
    experiment = Experiment(
        sample_time=SAMPLE_TIME, controller=Pid(output="speed", kp=0.1, ki=1), signal=Step(final=100.0)
    )
    kept = driven(
        START + 800,
        {
            START: Command(enabled=True),
            START + 500: Command(controller={"type": "open_loop"}, signal=Step(final=2.0)),  # type: ignore[arg-type]
        },
        experiment,
    )

    applied = kept.column("applied")
    assert applied[START + 499] > 3.5  # the controller held 100 rad/s, by 4 V and friction
    np.testing.assert_array_equal(applied[START + 500 :], 300 * [2.0])


@pytest.mark.promise("S38")
def test_a_controller_that_takes_over_from_open_loop_goes_on_with_its_voltage() -> None:
    kept = driven(
        START + 600,
        {
            START: Command(enabled=True, signal=Step(final=4.0)),
            START + 500: Command(
                controller={"type": "pid", "output": "speed", "kp": 0.1, "ki": 1.0},  # type: ignore[arg-type]
                signal=Step(final=60.0),
            ),
        },
    )

    assert kept.column("applied")[START + 500] == pytest.approx(4.0, abs=1e-12)
