"""A run: what is recorded, and that the motor is stopped and the file closed however it ends."""

import errno
import math
import threading
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servobench.core.channels import DeviceInfo, Sample
from servobench.core.errors import DeviceError, StorageError, UsageError
from servobench.recordings.native import mcap_file
from servobench.recordings.native.reader import read
from servobench.recordings.recording import Recording, Stopped
from servobench.rig.clock import HostClock, VirtualClock
from servobench.rig.devices.base import RunEnded
from servobench.rig.devices.guarded import Guarded
from servobench.rig.devices.twin import Twin
from servobench.rig.experiment import Experiment, Limits
from servobench.rig.experiment.limits import Outputs
from servobench.rig.loop.opening import opening
from servobench.rig.loop.run import Progress, run
from servobench.rig.lost_device import DeviceLost
from tests.rig.loop.shaft import Controller, Shaft, experiment, odd


@pytest.fixture(autouse=True)
def no_thread_is_left() -> Iterator[None]:
    """Hold for every run here that it ends with all it began."""
    yield
    assert [thread.name for thread in threading.enumerate() if "recorder" in thread.name] == []


@pytest.fixture(params=["memory", "file"])
def to(request: pytest.FixtureRequest, tmp_path: Path) -> Path | None:
    """Return where a run is recorded: nowhere but in memory, and in a file."""
    return tmp_path / "run.mcap" if request.param == "file" else None


def raises(error: BaseException, at: int = 30) -> Callable[[Any], None]:
    """Return a function that raises an error when it is called with the number `at`, or with a progress that far."""

    def fail(tick: Any) -> None:
        if getattr(tick, "tick", tick) >= at:
            raise error

    return fail


def test_each_sample_is_latched_before_the_voltage_of_its_tick_acts(to: Path | None) -> None:
    # The shaft turns by 1 count for each volt and tick: sample k is the sum of the voltages of the ticks before.
    asked = odd(controller=Controller(lambda k: float(k % 3)))

    recording = run(asked, Shaft(), to=to)

    applied = recording["applied"].values
    assert recording["counts"].values.tolist() == [applied[:k].sum() for k in range(100)]
    assert applied[:4].tolist() == [0.0, 1.0, 2.0, 0.0]


def test_what_is_recorded_is_named_and_has_its_units_times_and_roles(to: Path | None) -> None:
    asked = experiment(name="two volts")

    recording = run(asked, Shaft(tachometer=True), to=to)

    assert {s.channel.name: s.channel.unit for s in recording.series} == {
        "commanded": "V",
        "applied": "V",
        "counts": "counts",
        "tachometer": "rad/s",
        "scheduled": "s",
        "late": "1",
        "saturated": "1",
    }
    assert (recording.name, recording.input, recording.output, recording.input_before) == (
        "two volts",
        "applied",
        "counts",
        0.0,
    )
    assert all(s.t is not None and s.t.tolist() == [k * 0.01 for k in range(100)] for s in recording.series)
    assert recording["tachometer"].values.tolist() == [0.5 * k for k in range(100)]
    assert recording["late"].values.sum() == 0
    assert recording.stopped == Stopped(reason="finished", sentence="ran for 1 s, as asked")
    assert recording.experiment == asked.to_toml()
    assert recording.info == Shaft(tachometer=True).info
    assert recording.findings == ()


def test_a_run_to_a_file_gives_the_same_recording_as_one_in_memory(tmp_path: Path) -> None:
    with Twin() as motor:
        in_memory = run(experiment(), motor)
        to_file = run(experiment(), motor, to=tmp_path / "a.mcap")

    assert to_file == in_memory
    assert read(tmp_path / "a.mcap") == (in_memory,)


@pytest.mark.promise("S2")
def test_the_voltage_is_limited_by_the_experiment_and_by_the_device_and_both_are_recorded() -> None:
    asked = odd(controller=Controller(lambda k: [8.0, -8.0, 3.0][k % 3]), limits=Limits(voltage=6.0))
    wrote: list[float] = []
    device = Shaft()
    device.write = lambda voltage, write=device.write: (wrote.append(voltage), write(voltage))[1]  # type: ignore[method-assign]

    recording = run(asked, device)

    assert recording["commanded"].values[:3].tolist() == [8.0, -8.0, 3.0]
    assert wrote[:3] == [6.0, -6.0, 3.0]
    assert recording["applied"].values[:3].tolist() == [5.0, -5.0, 3.0]


@pytest.mark.parametrize(
    ("duration", "sample_time", "ticks"), [(2.1, 0.3, 7), (1.0, 0.01, 100), (1.0, 0.3, 4)]
)
def test_the_ticks_are_those_scheduled_before_the_duration_is_over(
    duration: float, sample_time: float, ticks: int
) -> None:
    # 2.1 s / 0.3 s is 7.000000000000001.
    recording = run(experiment(duration=duration, sample_time=sample_time), Shaft())

    assert len(recording["counts"].values) == ticks


@pytest.mark.promise("S16")
@pytest.mark.parametrize("where", ["read", "write", "controller", "watch"])
@pytest.mark.parametrize(
    ("error", "raised", "reason"),
    [
        (KeyboardInterrupt(), None, "interrupted"),
        (DeviceError("the cable is out"), DeviceLost, "device_lost"),
        (ZeroDivisionError("oops"), ZeroDivisionError, "error"),
        (SystemExit(1), SystemExit, "error"),
    ],
    ids=["Ctrl-C", "lost", "bug", "exit"],
)
def test_however_a_run_is_cut_short_the_motor_is_stopped_and_the_recording_kept(
    tmp_path: Path, where: str, error: BaseException, raised: type[BaseException] | None, reason: str
) -> None:
    fail = raises(error)
    device = Shaft(
        on_read=fail if where == "read" else lambda k: None,
        on_write=fail if where == "write" else lambda k: None,
    )
    command = fail if where == "controller" else lambda k: None
    asked = odd(controller=Controller(lambda k: command(k) or 2.0))
    watch = fail if where == "watch" else None
    path = tmp_path / "a.mcap"

    if raised is None:
        run(asked, device, to=path, watch=watch)
    else:
        with pytest.raises(raised) as caught:
            run(asked, device, to=path, watch=watch)
        if isinstance(caught.value, DeviceLost):
            assert (caught.value.recording,) == read(path)
            assert str(caught.value) == "the cable is out"
        else:
            assert caught.value is error

    assert device.voltage == 0.0
    assert device.events[-1] == "stop"
    (recording,) = read(path)
    assert recording.stopped.reason == reason
    assert recording.findings == ()
    # The tick in which it happened is recorded where all of it was done: read, asked and written.
    assert len(recording["counts"].values) == (31 if where == "watch" else 30)
    assert [file.name for file in tmp_path.iterdir()] == ["a.mcap"]


def test_a_device_that_is_lost_in_a_run_in_memory_leaves_its_recording_in_the_error() -> None:
    device = Shaft(on_read=raises(DeviceError("gone")))

    with pytest.raises(DeviceLost) as lost:
        run(experiment(), device)

    assert len(lost.value.recording["counts"].values) == 30
    assert "gone" in lost.value.recording.stopped.sentence


@pytest.mark.promise("S16")
def test_a_device_that_does_not_start_is_stopped_and_leaves_no_file(tmp_path: Path) -> None:
    device = Shaft()

    def start(sample_time: float, seed: int | None) -> None:
        raise DeviceError("no answer")

    device.start = start  # type: ignore[method-assign]
    with pytest.raises(DeviceError, match="no answer") as caught:
        run(experiment(), device, to=tmp_path / "a.mcap")

    assert not isinstance(caught.value, DeviceLost)
    assert device.events == ["stop"]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.promise("S52")
def test_the_device_is_started_once_all_else_is_ready(tmp_path: Path) -> None:
    # What keeps the time itself sends samples from its start on, which nobody reads while the rest is made ready.
    before: list[str] = []

    class Prepared(Controller):
        def start(self, sample_time: float, info: DeviceInfo) -> int:
            before.append("controller")
            return super().start(sample_time, info)

    class Board(Shaft):
        def start(self, sample_time: float, seed: int | None) -> None:
            before.extend(path.suffix for path in tmp_path.iterdir())
            super().start(sample_time, seed)

    recording = run(odd(controller=Prepared(lambda k: 2.0)), Board(timing="device"), to=tmp_path / "a.mcap")

    assert recording.stopped.reason == "finished"
    assert before == ["controller", ".part"]


@pytest.mark.promise("S16")
def test_ctrl_c_a_second_time_while_the_motor_is_stopped_does_not_keep_it_from_stopping() -> None:
    device = Shaft(on_read=raises(KeyboardInterrupt()))
    stop = device.stop
    interrupted = []

    def stop_interrupted() -> None:
        if not interrupted:
            interrupted.append(True)
            raise KeyboardInterrupt
        stop()

    device.stop = stop_interrupted  # type: ignore[method-assign]

    recording = run(experiment(), device)

    assert device.voltage == 0.0
    assert recording.stopped.reason == "interrupted"


class FullDisk:
    """A file on a disk that is full after some chunks; it notes on the device when that is felt."""

    def __init__(self, path: Path, mode: str, device: Shaft, chunks: int) -> None:
        self._file = open(path, mode)  # noqa: SIM115 - whoever writes closes it
        self._device = device
        self._chunks = chunks

    def write(self, data: bytes) -> int:
        self._chunks -= data[0] == 6  # the opcode of a chunk
        if self._chunks < 0:
            self._device.events.append("disk full")
            raise OSError(errno.ENOSPC, "No space left on device")
        return self._file.write(data)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


@pytest.mark.promise("S24")
def test_a_full_disk_stops_the_motor_and_keeps_what_was_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = Shaft()
    monkeypatch.setattr(
        mcap_file, "open", lambda path, mode: FullDisk(path, mode, device, chunks=3), raising=False
    )

    with pytest.raises(StorageError, match=r"No space left on device; .* kept in .*run\.mcap\.part"):
        run(experiment(duration=1000.0), device, to=tmp_path / "run.mcap")

    assert device.voltage == 0.0
    assert device.events[-1] == "stop"
    assert device.writes < 100_000  # it didn't run to its end
    assert len(read(tmp_path / "run.mcap.part")[0]["counts"].values) == 150  # blocks are half a second


@pytest.mark.promise("S1")
def test_a_voltage_that_is_none_stops_the_motor_and_is_a_result(to: Path | None) -> None:
    for value in (np.nan, np.inf, -np.inf):
        device = Shaft()
        path = to and to.with_name(f"{value}.mcap")

        recording = run(
            odd(controller=Controller(lambda k, bad=value: bad if k == 7 else 2.0)), device, to=path
        )

        assert recording.stopped.reason == "fault"
        assert f"stopped at 0.07 s: the controller returned {value}" in recording.stopped.sentence
        assert recording["applied"].values.tolist() == [2.0] * 7 + [0.0]
        assert np.array_equal(recording["commanded"].values[-1:], [value], equal_nan=True)
        assert device.voltage == 0.0


@pytest.mark.promise("S1")
def test_a_reference_that_is_no_number_stops_the_motor_before_the_controller_sees_it() -> None:
    asked = odd(signal=lambda t: np.where(t < 0.5, 2.0, np.nan), controller=Controller(lambda k: 2.0))

    recording = run(asked, Shaft())

    assert recording.stopped.reason == "fault"
    assert "stopped at 0.5 s: the signal gave nan" in recording.stopped.sentence
    assert len(recording["counts"].values) == 51


def test_a_signal_of_the_wrong_shape_is_refused_before_anything_moves() -> None:
    device = Shaft()

    with pytest.raises(UsageError, match=r"gave shape \(1,\) for times of shape"):
        run(odd(signal=lambda t: np.ones(1)), device)
    assert device.events == []


def test_an_endless_experiment_needs_a_file_and_ends_by_a_word(tmp_path: Path) -> None:
    device = Shaft()
    with pytest.raises(UsageError, match="give `to`"):
        run(experiment(duration=None), device)
    assert device.events == []

    recording = run(
        experiment(duration=None),
        device,
        to=tmp_path / "a.mcap",
        watch=lambda progress: "enough" if progress.time >= 30 else None,
    )

    assert recording.stopped == Stopped(reason="interrupted", sentence="enough")
    assert recording["counts"].values.tolist() == [2.0 * k for k in range(3001)]


def test_a_device_may_end_the_run_itself_which_is_a_result() -> None:
    ended = Stopped(reason="fault", sentence="the stall guard stopped the motor")

    recording = run(experiment(), Shaft(on_read=raises(RunEnded(ended))))

    assert recording.stopped == ended
    assert len(recording["counts"].values) == 30


def test_the_progress_is_shown_ten_times_a_second() -> None:
    shown: list[Progress] = []

    run(experiment(), Shaft(), watch=lambda progress: shown.append(progress))

    assert [progress.tick for progress in shown] == [0, 10, 20, 30, 40, 50, 60, 70, 80, 90]
    assert shown[1] == Progress(tick=10, ticks=100, time=0.1, commanded=2.0, applied=2.0, counts=20)


def test_a_watch_that_says_neither_go_on_nor_why_to_stop_is_a_mistake_that_stops_the_motor() -> None:
    device = Shaft()

    with pytest.raises(UsageError, match="watch returned False; expected None"):
        run(experiment(), device, watch=lambda progress: False)  # type: ignore[arg-type, return-value]
    assert device.events[-1] == "stop"


def test_a_file_that_is_in_the_way_is_refused_and_the_motor_stopped(tmp_path: Path) -> None:
    device = Shaft()
    (tmp_path / "a.mcap.part").write_bytes(b"")

    with pytest.raises(UsageError, match="recover"):
        run(experiment(), device, to=tmp_path / "a.mcap")
    assert device.writes == 0
    assert device.events[-1] == "stop"


@pytest.mark.parametrize("timing", ["host", "device"])
def test_a_device_in_real_time_is_not_run_by_a_virtual_clock(timing: Any) -> None:
    device = Shaft(timing=timing)

    with pytest.raises(UsageError, match=f"runs by {timing} time"):
        run(experiment(), device, clock=VirtualClock())
    assert device.events == []


def test_a_fault_has_the_time_of_the_recording_whatever_the_device_s_clock_says() -> None:
    class Late(Shaft):
        """Its own clock has run for an hour, and starts again on the way, as after a restart."""

        def read(self) -> Sample:
            sample = super().read()
            return replace(sample, time=sample.time + 3600 if sample.index < 40 else 0.0)

    seconds = [0.0]

    def sleep(duration: float) -> None:
        seconds[0] += duration

    def now() -> float:
        seconds[0] += 1e-6
        return seconds[0]

    device = Guarded(Late(timing="host"), now=lambda: seconds[0])
    clock = HostClock(now=now, sleep=sleep)
    asked = odd(controller=Controller(lambda k: math.nan if k == 50 else 1.0))
    recording = run(asked, device, clock=clock)

    (fault,) = device.faults
    t = recording["counts"].t
    assert t is not None
    assert recording.stopped.reason == "fault"
    assert fault.time == pytest.approx(t[-1], abs=1e-4)  # some looks at a clock that goes on by 1 µs at each
    assert f"stopped at {fault.time:.4g} s" in recording.stopped.sentence


def test_the_voltage_before_the_first_sample_is_the_start_value_only_where_it_held_for_a_tick() -> None:
    asked = Experiment(limits=Limits(start=Outputs(voltage=2.0), slew=500.0))  # 1 V in a sample of 2 ms
    before = {
        kind: opening(asked, Twin().info, timing=kind).input_before for kind in ("virtual", "host", "device")
    }
    assert before == {"virtual": 0.0, "host": 0.0, "device": 1.0}


@pytest.mark.promise("S31")
def test_lateness_is_recorded_and_reported() -> None:
    seconds = [0.0]

    def stall(index: int) -> None:
        seconds[0] += {20: 0.012, 40: 0.035}.get(index, 0.0)

    def sleep(duration: float) -> None:
        seconds[0] += duration

    def now() -> float:
        seconds[0] += 1e-6
        return seconds[0]

    # The watchdog goes by that time, too: by the wall's a busy machine would stop the motor.
    device = Guarded(Shaft("host", on_write=stall), now=lambda: seconds[0])
    recording = run(experiment(), device, clock=HostClock(now=now, sleep=sleep))

    # 12 ms in tick 20 make tick 21 late by 2 ms; 35 ms in tick 40 make it miss 41 and 42, and come 5 ms late to 43.
    # The shaft's own time counts its samples, so that the missed ones make it 20 ms shorter.
    assert [finding.code for finding in recording.findings] == [
        "samples-late",
        "samples-missed",
        "clocks-disagree",
    ]
    assert "2 of 98 samples were late, by up to 5" in recording.findings[0].sentence
    assert "2 of 100 samples were missed" in recording.findings[1].sentence
    late = recording["late"].values
    assert recording["scheduled"].values[late == 1.0] == pytest.approx([0.21, 0.43])
    t = recording["counts"].t
    assert t is not None
    assert t[late == 1.0] == pytest.approx([0.212, 0.435], abs=1e-4)


def test_the_same_seed_gives_the_same_recording_to_the_bit() -> None:
    def once(seed: int) -> Recording:
        with Twin(Twin.Settings(torque_noise="1 uN·m/√Hz", current_noise="1 mA")) as motor:
            return run(experiment(seed=seed), motor)

    assert once(1) == once(1)
    assert once(1)["current"] != once(2)["current"]


@pytest.mark.promise("S35")
def test_the_memory_of_a_run_to_a_file_does_not_grow_with_it(tmp_path: Path) -> None:
    def peak(duration: float) -> int:
        tracemalloc.start()
        try:
            run(experiment(duration=duration), Shaft(), to=tmp_path / f"{duration}.mcap")
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(20.0)  # what is loaded the first time doesn't count

    # 35,000 more rows of 6 numbers are 1.7 MB. What waits for the disk is at most 64 blocks of 50 rows, 0.15 MB; of each of
    # the 700 more chunks an index record of 90 bytes is kept, 0.06 MB, which is copied four times to end the file.
    assert peak(400.0) - peak(50.0) < 400_000
