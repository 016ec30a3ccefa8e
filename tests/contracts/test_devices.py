"""Every device, including those of later files and plug-ins."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servobench.compat.quanser import install
from servobench.core.channels import DeviceInfo, Sample
from servobench.core.errors import DeviceError, UsageError
from servobench.recordings.native.writer import save
from servobench.rig.devices.base import DEVICES, Device, RunEnded
from servobench.rig.devices.guarded import Guarded
from servobench.rig.devices.quanser import Quanser
from servobench.rig.devices.twin import Twin
from servobench.rig.experiment import Experiment
from servobench.rig.loop.run import run
from tests.rig.simavr.board import motor
from tests.rig.simavr.build import needed
from tests.rig.simavr.lockstep import Bench

SAMPLE_TIME = 0.002  # s
NAMES = DEVICES.names()
DRIVEN = [name for name in NAMES if name != "replay"]  # what a voltage moves
REPEATABLE = [
    name for name in NAMES if name != "rig"
]  # where a run's start puts the shaft back, as no real motor does


def _recorded(folder: Path) -> Path:
    """A file with 0.4 s of the twin, for what plays files."""
    path = folder / "recorded.mcap"
    with Twin(Twin.Settings(tachometer=True)) as motor:
        save([run(Experiment(duration=0.4, sample_time=SAMPLE_TIME), motor)], path)
    return path


def _secret(folder: Path) -> Path:
    """A secret, for what draws motors from one."""
    path = folder / "secret"
    path.write_bytes(bytes(range(32)))
    path.chmod(0o600)
    return path


EXAMPLES: dict[str, Callable[[Path], dict[str, Any]]] = {
    "assigned": lambda folder: {"secret": _secret(folder), "exercise": "step", "student": "ada"},
    "replay": lambda folder: {"file": _recorded(folder)},
}
"""Settings for the devices whose settings don't all have defaults."""

Make = Callable[[], Any]


def making(name: str, folder: Path) -> Make:
    """Return a function that makes the device of that name; the rig is simulated, as is its firmware."""
    if name == "rig":
        needed()
        # An edge of the encoder is near: the shortest motion shows.
        return Bench(motor(start=0.01)).rig
    kind = DEVICES[name]
    required = [field for field, given in kind.Settings.model_fields.items() if given.is_required()]
    if required and name not in EXAMPLES:
        pytest.fail(
            f"the device {name!r} needs settings ({', '.join(required)}): add some for it to EXAMPLES"
        )
    settings = EXAMPLES[name](folder) if name in EXAMPLES else {}
    return lambda: kind(kind.Settings(**settings))


@pytest.fixture(params=NAMES)
def make(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Make]:
    with standing_in(request.param):
        yield making(request.param, tmp_path)


@pytest.fixture(params=REPEATABLE)
def make_repeatable(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Make]:
    with standing_in(request.param):
        yield making(request.param, tmp_path)


@pytest.fixture(params=DRIVEN)
def make_driven(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Make]:
    with standing_in(request.param):
        yield making(request.param, tmp_path)


@contextmanager
def standing_in(name: str) -> Iterator[None]:
    """Install the stand-in where a device needs one; its motor is at rest at each start, as a run's contract expects."""
    if name != "quanser":
        yield
        return
    start = Quanser.start
    with install(quiet=True) as bench, pytest.MonkeyPatch.context() as patch:

        def start_at_rest(device: Quanser, sample_time: float, seed: int | None) -> None:
            bench.rest()
            start(device, sample_time, seed)

        patch.setattr(Quanser, "start", start_at_rest)
        yield


def ticks(device: Device, voltages: list[float]) -> list[Sample]:
    """Read and write once for each voltage, and return the samples."""
    samples = []
    for voltage in voltages:
        samples.append(device.read())
        device.write(voltage)
    return samples


def test_it_is_a_device_that_says_what_it_is_before_it_is_connected(make: Make) -> None:
    device = make()

    assert isinstance(device, Device)
    info = device.info
    assert isinstance(info, DeviceInfo)
    assert DEVICES.name_of(device) == info.name
    assert {"voltage", "counts"} <= {channel.name for channel in info.channels}
    assert info.timing in ("virtual", "host", "device")
    assert info.delay >= 0


def test_it_can_be_used_twice(make: Make) -> None:
    device = make()

    for _ in range(2):
        with device as entered:
            assert entered is device
            device.start(SAMPLE_TIME, 0)
            assert ticks(device, [1.0] * 3)[0].index == 0


def test_samples_are_counted_from_0_their_times_increase_and_they_hold_what_the_info_says(make: Make) -> None:
    with make() as device:
        device.start(SAMPLE_TIME, 0)
        samples = ticks(device, [1.0] * 50)

        sensors = [name for name in ("tachometer", "current") if device.info.channel(name)]

    assert [sample.index for sample in samples] == list(range(50))
    assert np.allclose(np.diff([sample.time for sample in samples]), SAMPLE_TIME, rtol=0.1)
    for sample in samples:
        assert isinstance(sample.counts, int)
        has = [name for name in ("tachometer", "current") if getattr(sample, name) is not None]
        assert has == sensors


def test_what_it_puts_out_is_a_finite_voltage_within_its_own_range(make: Make) -> None:
    with make() as device:
        device.start(SAMPLE_TIME, 0)
        voltage = device.info.channel("voltage")
        for given in (0.0, 1.0, -1.0, 1e6, -1e6, 2, np.float32(1.5), np.float64(-1.5)):
            device.read()
            applied = device.write(given)

            assert type(applied) is float
            assert math.isfinite(applied)
            assert voltage.minimum is None or applied >= voltage.minimum
            assert voltage.maximum is None or applied <= voltage.maximum


HUGE = 10**400  # larger than any float


@pytest.mark.promise("S1")
@pytest.mark.parametrize(
    "given", [math.nan, math.inf, -math.inf, None, "1", True, [1.0], 1j, HUGE], ids=lambda v: str(v)[:5]
)
def test_what_is_no_finite_voltage_is_refused_and_the_next_one_taken(make: Make, given: Any) -> None:
    with make() as device:
        device.start(SAMPLE_TIME, 0)
        device.read()
        with pytest.raises(UsageError, match="expected a finite number in V"):
            device.write(given)

        assert math.isfinite(device.write(1.0))


@pytest.mark.promise("S16")
def test_stopping_is_possible_at_any_time_and_any_number_of_times(make: Make) -> None:
    device = make()
    device.stop()
    with device:
        device.stop()
        device.start(SAMPLE_TIME, 0)
        device.stop()
        ticks(device, [1.0] * 3)
        device.stop()
        device.stop()
    device.stop()


@pytest.mark.parametrize("when", ["before it is connected", "after it is closed"])
def test_a_device_that_is_not_connected_does_nothing_and_says_so(make: Make, when: str) -> None:
    device = make()
    if when == "after it is closed":
        with device:
            device.start(SAMPLE_TIME, 0)
            ticks(device, [1.0] * 3)

    with pytest.raises(DeviceError, match="with statement"):
        device.start(SAMPLE_TIME, 0)
    with pytest.raises(DeviceError, match="with statement"):
        device.read()
    with pytest.raises(DeviceError, match="with statement"):
        device.write(0.0)


def test_an_error_inside_the_with_statement_closes_it_and_passes_through(make: Make) -> None:
    device = make()

    def fail() -> None:
        with device:
            device.start(SAMPLE_TIME, 0)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    with pytest.raises(DeviceError):
        device.read()


def test_a_sample_time_that_is_none_is_refused(make: Make) -> None:
    with make() as device:
        for sample_time in (0.0, -0.002, math.nan, math.inf):
            with pytest.raises(UsageError, match="sample time"):
                device.start(sample_time, 0)


def test_reading_before_a_run_has_started_is_refused(make: Make) -> None:
    with make() as device, pytest.raises(UsageError, match=r"start\(\)"):
        device.read()


def test_the_same_seed_gives_the_same_samples(make_repeatable: Make) -> None:
    voltages = np.random.default_rng(1).uniform(-3, 3, 100).tolist()

    def samples() -> list[Sample]:
        device.start(SAMPLE_TIME, 7)
        return ticks(device, voltages)

    with make_repeatable() as device:
        once, again = samples(), samples()
    with make_repeatable() as device:
        elsewhere = samples()

    assert once == again == elsewhere


def test_no_sample_knows_the_voltage_that_is_written_after_it(make_repeatable: Make) -> None:
    def samples(device: Device, last: float) -> list[Sample]:
        device.start(SAMPLE_TIME, 0)
        return ticks(device, [1.0] * 20 + [last])

    with make_repeatable() as device:
        assert samples(device, 1.0) == samples(device, -9.0)


def test_a_run_of_it_ends_well_and_records_what_it_gave(make: Make) -> None:
    experiment = Experiment(duration=0.1, sample_time=SAMPLE_TIME)
    with make() as device:
        # The guard's clock stands still: how long a busy computer takes for a simulated rig says nothing of the device.
        recording = run(experiment, Guarded(device, experiment.limits, now=lambda: 0.0))

    assert recording.stopped.reason == "finished"
    assert len(recording["counts"].values) == 50
    assert recording["counts"].channel == device.info.channel("counts")


def test_nothing_moves_before_the_first_voltage(make_driven: Make) -> None:
    with make_driven() as device:
        device.start(SAMPLE_TIME, 0)
        samples = [device.read() for _ in range(50)]

    assert len({sample.counts for sample in samples}) == 1


def test_a_voltage_acts_from_the_sample_before_it_to_the_next(make_driven: Make) -> None:
    def counts(voltage: float) -> list[int]:
        with make_driven() as device:
            device.start(SAMPLE_TIME, 0)
            return [sample.counts for sample in ticks(device, [0.0] * 5 + [voltage] + [0.0] * 20)]

    forth, back = counts(9.0), counts(-9.0)
    delay = make_driven().info.delay

    # 9 V for 2 ms turn the shaft by a count and a half within the tick: k V / (R J) t² / 2 is 4.3 mrad with the twin.
    first = next(k for k, (a, b) in enumerate(zip(forth, back, strict=True)) if a != b)
    assert first == 6 + math.ceil(delay / SAMPLE_TIME)


def test_a_stop_takes_the_voltage_away(make_driven: Make) -> None:
    with make_driven() as device:
        device.start(SAMPLE_TIME, 0)
        ticks(device, [2.0] * 500)
        device.stop()
        # The shaft has 44 rad/s. A bridge that lets go of the motor leaves the stopping to friction: 38 rad/s², so 1.2 s.
        counts = [device.read().counts for _ in range(1000)]

    assert len(set(counts[-100:])) == 1


def test_the_end_of_what_it_can_give_ends_a_run_in_good_order(tmp_path: Path) -> None:
    with making("replay", tmp_path)() as device:
        device.start(SAMPLE_TIME, 0)
        with pytest.raises(RunEnded, match="ended after 200 samples"):
            ticks(device, [0.0] * 1000)
        recording = run(Experiment(duration=100, sample_time=SAMPLE_TIME), device)

    assert recording.stopped.reason == "finished"
    assert len(recording["counts"].values) == 200
