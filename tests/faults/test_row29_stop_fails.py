"""Row 29: the device's own stop fails, or does nothing. What counts is the shaft's motion, not that stop was called."""

import math

import pytest

from servobench.core.errors import DeviceError, UsageError
from servobench.core.finding import Severity
from servobench.rig.devices.guarded import Guarded
from servobench.rig.devices.twin import Twin, TwinSettings
from servobench.rig.loop.run import run
from tests.rig.loop.shaft import experiment

SAMPLE_TIME = 0.01  # s, that of the experiment
LONG = 3.0  # s; by then a shaft that isn't driven stands: τ is 0.1 s


class Broken(Twin):
    """A twin whose stop, and then whose write, may fail; like the real ones it has a watchdog, of 50 ms, that any write feeds."""

    WATCHDOG = 0.05  # s

    def __init__(self, *, stop: str = "raises", write: str = "works") -> None:
        super().__init__(TwinSettings(torque_noise=0.0))
        self.how_it_stops, self.how_it_writes = stop, write
        self.stopping = False
        self.written_after = 0

    def write(self, voltage: float) -> float:
        if self.stopping:
            self.written_after += 1
            if self.how_it_writes == "raises":
                raise DeviceError("the port is gone")
        return super().write(voltage)

    def stop(self) -> None:
        self.stopping = True
        if self.how_it_stops == "raises":
            raise DeviceError("stop was refused")

    def left_alone(self, duration: float) -> tuple[float, float]:
        """Let time pass with nobody writing; return the speed then and the angle [rad/s, rad]."""
        state = self.coast(self.WATCHDOG)
        Twin.stop(self)  # what its watchdog does; nothing has fed it
        state = self.coast(duration)
        return state.speed, state.angle


def at_full_speed(device: Twin) -> None:
    assert device.state.speed > 30.0


@pytest.mark.promise("S19")
@pytest.mark.parametrize("how", ["raises", "is swallowed"])
def test_the_guard_writes_zero_volts_itself_where_stop_fails_or_does_nothing(how: str) -> None:
    device = Broken(stop=how)
    device.__enter__()

    run(experiment(), device)

    at_full_speed(device)
    assert device.coast(LONG).speed == 0.0


@pytest.mark.promise("S19")
def test_where_nothing_can_be_written_either_the_devices_own_watchdog_is_left_to_starve() -> None:
    device = Broken(write="raises")
    device.__enter__()
    guarded = Guarded(device)

    recording = run(experiment(), guarded)
    at_full_speed(device)
    tries = device.written_after
    for _ in range(100):
        guarded.stop()  # somebody who is anxious
    assert device.written_after == tries
    speed, angle = device.left_alone(LONG)

    assert speed == 0.0
    # 50 ms on at that speed, and then the time constant's worth of it: it was left alone at once.
    most = 60.0 * (Broken.WATCHDOG + SAMPLE_TIME + 0.2)
    assert angle - recording["counts"].values[-1] * 2 * math.pi / 2048 < most
    assert guarded.fault is not None
    assert guarded.fault.code == "stop-failed"
    assert [finding.code for finding in recording.findings] == ["stop-failed"]
    assert recording.findings[0].severity is Severity.DANGER
    assert recording.findings[0].sentence.startswith("SWITCH OFF THE SUPPLY: at ")
    assert "zero volts were not confirmed" in recording.findings[0].sentence
    with pytest.raises(UsageError, match="a fault is latched"):
        guarded.start(SAMPLE_TIME, 0)


@pytest.mark.promise("S19")
def test_without_the_guard_the_shaft_would_turn_on() -> None:
    # The tests above can fail: such a stop by itself leaves the motor at its speed.
    with Twin() as motor:
        motor.start(SAMPLE_TIME, 0)
        for _ in range(100):
            motor.read()
            motor.write(2.0)
        assert motor.coast(LONG).speed > 30.0
