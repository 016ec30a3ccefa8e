"""The rig is commissioned in lock-step with the firmware in simavr: verified on simulated silicon, never on silicon."""

import pytest

from servobench.recordings.recording import Recording
from servobench.rig.commission import acceptance
from servobench.rig.commission.acceptance import Acceptance, commission
from servobench.rig.commission.bench import Bench as Commissioning
from servobench.rig.devices.base import Device
from servobench.rig.devices.faulty import with_faults
from servobench.rig.devices.guarded import Guarded
from servobench.rig.experiment import Experiment
from servobench.rig.experiment.experiment import DeviceChoice
from servobench.rig.loop.run import Look, run
from tests.rig.simavr.board import motor
from tests.rig.simavr.build import needed
from tests.rig.simavr.lockstep import Bench

INTERVALS = {
    "watchdog": ("time until the cut", 0.05),  # the board's default
    "dead_band": ("breakaway voltage forwards", motor().truth["coulomb_voltage"]),
}


def commissioned(**settings: object) -> tuple[Acceptance, list[float]]:
    """Commission a simulated rig; and the speeds of its shaft 0.5 s after each run [rad/s]."""
    sim, speeds = Bench(), []
    choice = DeviceChoice(name="rig", settings={"port": "simavr", **settings})

    def make(asked: DeviceChoice) -> Device:
        return with_faults(sim.rig(**asked.settings), asked.faults)

    def carry_out(asked: Experiment, name: str, look: Look | None) -> Recording:
        with make(asked.device) as device:
            recording = run(asked, Guarded(device, asked.limits, now=sim.now))
        sim.board.run(ms=500)
        speeds.append(float(sim.board.look().speed))
        return recording

    bench = Commissioning(make(choice), choice, carry_out)
    return commission(bench, "2026-11-23T12:00:00+00:00"), speeds


def test_a_rig_stops_by_itself_and_turns_the_right_way(monkeypatch: pytest.MonkeyPatch) -> None:
    needed()
    few = [pair for pair in acceptance.in_order() if pair[0] in {"rest", "stop", "watchdog", "sign"}]
    monkeypatch.setattr(acceptance, "in_order", lambda: few)
    found, speeds = commissioned()

    assert [(each.name, each.outcome.state) for each in found.checks] == [
        (name, "verified") for name in ("rest", "stop", "watchdog", "sign")
    ]
    assert set(speeds) == {0.0}


@pytest.mark.long
def test_a_rig_is_accepted_but_for_what_takes_a_hand_or_hours() -> None:
    needed()
    found, speeds = commissioned()
    states = {each.name: each.outcome.state for each in found.checks}

    assert {name: state for name, state in states.items() if state != "verified"} == {
        "turns": "unknown",  # nobody is there
        "counter": "unknown",  # 32 bits take a day
    }
    outcomes = {each.name: each.outcome for each in found.checks}
    for name, (figure, truth) in INTERVALS.items():
        (interval,) = [each.interval for each in outcomes[name].figures if each.name == figure]
        assert interval is not None
        assert interval[0] <= truth <= interval[1], name
    assert "device's own" in outcomes["stall"].found
    assert "firmware" in dict(found.settings)
    assert set(speeds) == {0.0}
