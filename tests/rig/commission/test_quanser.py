"""A QUBE is commissioned on the stand-in: verified on simulated hardware only."""

import pytest

from servobench.compat.quanser import install
from servobench.recordings.recording import Recording
from servobench.rig.commission.acceptance import commission
from servobench.rig.commission.bench import Bench
from servobench.rig.devices.base import Device, connect
from servobench.rig.devices.faulty import with_faults
from servobench.rig.devices.guarded import Guarded
from servobench.rig.experiment import Experiment
from servobench.rig.experiment.experiment import DeviceChoice
from servobench.rig.loop.run import Look, run


@pytest.mark.parametrize(("watchdog", "state"), [(0.2, "unknown"), (0.0, "unsupported")])
def test_all_is_verified_but_what_takes_a_hand_minutes_or_a_look_at_the_shaft(
    watchdog: float, state: str
) -> None:
    """The stand-in can't be read after its watchdog expired; whether a board can, nobody has said."""
    choice = DeviceChoice(name="quanser", settings={"watchdog": watchdog})

    def make(asked: DeviceChoice) -> Device:
        return with_faults(connect(asked.name, **asked.settings), asked.faults)

    with install(quiet=True, ignore_threads=True) as stand_in:

        def carry_out(asked: Experiment, name: str, look: Look | None) -> Recording:
            with make(asked.device) as device:
                return run(asked, Guarded(device, asked.limits, now=stand_in.timebase.now))

        bench = Bench(make(choice), choice, carry_out)
        found = commission(bench, "2026-11-23T12:00:00+00:00")
        at_rest = stand_in.board.motion.plant.state.speed == 0.0

    states = {each.name: each.outcome.state for each in found.checks if each.outcome.state != "verified"}
    assert states == {"watchdog": state, "turns": "unknown", "counter": "unknown"}
    assert at_rest
