"""Row 3: a device that is unplugged in the middle of a run.

The run ends as `device_lost`, what was recorded is kept, no stale sample stands among it, the file opens, and nothing goes on
by itself.
"""

from pathlib import Path

import numpy as np
import pytest

from servobench.core.errors import DeviceError
from servobench.recordings.native.reader import read
from servobench.recordings.recording import Recording
from servobench.rig.devices.base import Device
from servobench.rig.devices.faults.base import fault_from, table_of
from servobench.rig.devices.faulty import Faulty
from servobench.rig.devices.twin import Twin, TwinSettings
from servobench.rig.experiment import DeviceChoice, Experiment
from servobench.rig.loop.live import run_live
from servobench.rig.loop.run import run
from servobench.rig.lost_device import DeviceLost

H = 0.002
EXPERIMENT = Experiment(duration=3.0, sample_time=H)
UNPLUGGED = [
    0,
    1,
    2,
    249,
    250,
    251,
    700,
    1499,
]  # the first sample that doesn't arrive; a block of the file has 250


def unplugged(at: int, motor: Twin | None = None) -> Faulty:
    return Faulty(motor or Twin(), [fault_from(table_of(f"device_unplugged from={at * H!r}s"))])


def lost(device: Device, to: Path | None = None) -> Recording:
    with device, pytest.raises(DeviceLost, match="unplugged on purpose") as caught:
        run(EXPERIMENT, device, to=to)
    return caught.value.recording


@pytest.fixture(scope="module")
def whole() -> Recording:
    with Twin() as motor:
        return run(EXPERIMENT, motor)


@pytest.mark.promise("S18")
@pytest.mark.parametrize("at", UNPLUGGED)
def test_the_run_ends_as_lost_and_keeps_exactly_the_samples_before(
    at: int, whole: Recording, tmp_path: Path
) -> None:
    recording = lost(unplugged(at), tmp_path / "run.mcap")

    assert recording.stopped.reason == "device_lost"
    for name in ("commanded", "applied", "counts", "current", "scheduled", "late"):
        assert np.array_equal(recording[name].values, whole[name].values[:at])
    assert np.array_equal(recording["counts"].t, whole["counts"].t[:at])  # type: ignore[index]


@pytest.mark.promise("S18")
@pytest.mark.parametrize("at", UNPLUGGED)
def test_its_file_opens_and_says_the_same(at: int, tmp_path: Path) -> None:
    recording = lost(unplugged(at), tmp_path / "run.mcap")

    (found,) = read(tmp_path / "run.mcap")
    assert found.series == recording.series
    assert found.stopped == recording.stopped
    assert "faults-injected" in [finding.code for finding in found.findings]
    assert not (tmp_path / "run.mcap.part").exists()


@pytest.mark.promise("S18")
def test_no_sample_after_it_is_taken_and_no_voltage_handed_on() -> None:
    motor = Twin()
    written: list[float] = []
    write = motor.write
    motor.write = lambda voltage: written.append(voltage) or write(voltage)  # type: ignore[method-assign, func-returns-value]
    device = unplugged(500, motor)
    with device:
        with pytest.raises(DeviceLost):
            run(EXPERIMENT, device)
        count = len(written)
        for _ in range(3):  # nothing resumes by itself
            with pytest.raises(DeviceError):
                device.read()
            with pytest.raises(DeviceError):
                device.write(1.0)
        assert motor.coast(5.0).speed == 0.0

    assert len(written) == count
    assert sum(voltage != 0.0 for voltage in written) <= 500


@pytest.mark.promise("S18")
def test_a_device_that_is_plugged_in_again_needs_a_run_of_its_own(whole: Recording) -> None:
    device = unplugged(500)
    first = lost(device)
    again = lost(device)

    assert again.series == first.series  # from the beginning, and not where the other ended


@pytest.mark.promise("S18")
def test_a_restart_of_the_device_is_no_way_on() -> None:
    """A device that comes back by itself has lost its position: the run ends, without one sample of the new count."""
    device = Faulty(Twin(), [fault_from(table_of("restart from=1s"))])
    with device:
        recording = run(EXPERIMENT, device)  # the guard is the first to see it

    assert recording.stopped.reason == "fault"
    assert "the encoder stepped" in recording.stopped.sentence
    with Twin() as motor:
        plain = run(EXPERIMENT, motor)
    assert np.array_equal(recording["counts"].values, plain["counts"].values[:500])


def test_an_unplugged_encoder_is_reported_as_injected_and_the_recording_goes_on() -> None:
    device = Faulty(Twin(TwinSettings()), [fault_from(table_of("encoder_unplugged from=1s"))])
    with device:
        recording = run(Experiment(duration=1.5, sample_time=H), device)

    assert set(recording["counts"].values[500:]) == {recording["counts"].values[500]}
    assert "faults-injected" in [finding.code for finding in recording.findings]


@pytest.mark.promise("S18")
def test_in_a_process_of_its_own_the_loop_ends_the_same_and_keeps_what_there_was(tmp_path: Path) -> None:
    """In host time: how many samples there are depends on the machine, that all of them are from before doesn't."""
    chosen = DeviceChoice(settings={"timing": "host"}, faults=(table_of("device_unplugged from=0.2s"),))
    with pytest.raises(DeviceLost, match="unplugged on purpose") as caught:
        run_live(Experiment(duration=30.0, sample_time=H, device=chosen), to=tmp_path / "run.mcap")

    recording = caught.value.recording
    assert recording.stopped.reason == "device_lost"
    # A hundred, and some where the first sample came late on a busy machine; of 15,000 that were asked for.
    assert len(recording["counts"].values) < 200
    assert [finding.code for finding in recording.findings].count("faults-injected") == 1
    (found,) = read(tmp_path / "run.mcap")
    assert found.series == recording.series
