"""A run in compiled blocks is the run tick by tick, to the last bit: rows, end, findings, and all that goes on afterwards."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import servobench as sb
from servobench.core.channels import Array
from servobench.recordings.recording import Recording
from servobench.rig.devices.faults.base import table_of
from servobench.rig.devices.faulty import with_faults
from servobench.rig.devices.guarded import Guarded
from servobench.rig.devices.handover import COUNTS_PER_REV, Handover
from servobench.rig.devices.twin import Twin
from servobench.rig.experiment import Experiment
from servobench.rig.experiment.limits import Limits, Outputs, Plausibility, StallLimits
from servobench.rig.loop.blocks import block_pass
from servobench.rig.loop.blocks.block_pass import BlockPass, tick_by_tick_reason
from servobench.rig.loop.references import BLOCK, LONG_BLOCK
from servobench.rig.loop.run import Progress
from servobench.rig.lost_device import DeviceLost
from servobench.rig.motor.encoder import Encoder
from servobench.systems.control.lead import Lead
from servobench.systems.control.open_loop import OpenLoop
from servobench.systems.control.pid import Pid
from servobench.systems.control.state_feedback import StateFeedback
from servobench.systems.signals.base import SIGNALS
from servobench.systems.signals.sine import Sine
from servobench.systems.signals.square import Square
from servobench.systems.signals.step import Step
from tests.contracts.test_signals import example

FAST = Square(low=-6.0, high=6.0, frequency=1.3)
LAWS: dict[str, Any] = {
    "open loop": OpenLoop(),
    "PI of the speed": Pid(output="speed", kp=0.05, ki=0.5),
    "PID of the position": Pid(kp=2.0, ki=0.3, kd=0.05, c=0.5),
    "PD that saturates": Pid(kp=40.0, kd=0.4),
    "lead": Lead(gain=3.0),
    "lead of the speed": Lead(output="speed", gain=0.1),
    "state feedback": StateFeedback(position_gain=3.0, speed_gain=0.1, integral_gain=1.0),
}
TWINS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "16 bits, from far away": {"counter_bits": 16, "start_angle": 200.0, "counts_per_rev": 8192},
    "noisy": {"torque_noise": 3e-5, "current_noise": 0.02, "tachometer": True, "tachometer_noise": 0.4},
    "random torque alone": {"torque_noise": 3e-5, "current_sensor": False},
    "no current, a tachometer": {"current_sensor": False, "tachometer": True},
    "delay of 3.7 ms": {"delay": 0.0037},
    "delay of 3.7 ms, noisy": {
        "delay": 0.0037,
        "torque_noise": 3e-5,
        "current_noise": 0.02,
        "tachometer": True,
    },
    "delay of a tenth of a tick, random torque": {
        "delay": 0.0002,
        "torque_noise": 3e-5,
        "current_sensor": False,
    },
    "delay of a tick, dead band": {"delay": 0.002, "dead_band": 0.3, "amplifier_resistance": 0.5},
    "no inductance": {"inductance": 0.0, "coulomb_torque": 0.0},
    "much friction": {"coulomb_torque": 8e-3, "torque_noise": 1e-5},
}
LIMITS: dict[str, Limits] = {
    "none but the usual": Limits(),
    "clipped": Limits(voltage=2.5, slew=40.0, start=Outputs(voltage=1.0)),
    "travel": Limits(travel=9.0),
    "speed": Limits(speed=60.0),
    "current": Limits(current=0.9),
    "a stall that is short": Limits(stall=StallLimits(voltage=0.5, motion=3.0, duration=0.4)),
    "nothing watched": Limits(stall=None, plausibility=None),
    "an impossible speed": Limits(possible_speed=20.0),
}


class Done:
    """A run and what is left after it."""

    def __init__(self, recording: Recording, device: Guarded, twin: Any, ticks_in_blocks: int) -> None:
        self.recording = recording
        self.ticks_in_blocks = ticks_in_blocks
        self.findings = (recording.findings, device.findings(), recording.stopped)
        self.after = (twin.state, twin._plant.course, twin._random.bit_generator.state, device.unwrapped)
        self.time_stalled = device.time_stalled

    @property
    def rows(self) -> Array:
        series = self.recording.series
        return np.column_stack([series[0].t, *(each.values for each in series)])


@pytest.fixture
def both(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[Done, Done]]:
    """Return a function that carries an experiment out tick by tick, and in blocks."""

    def carry_out(
        experiment: Experiment,
        *,
        to: Path | None = None,
        watch: Any = None,
        faults: tuple[str, ...] = (),
        **settings: Any,
    ) -> Any:
        runs = []
        for fewest in (10**9, 1):
            monkeypatch.setattr(block_pass, "FEWEST_TICKS", fewest)
            counted = CountedBlocks(monkeypatch)
            with sb.connect("twin", **settings) as twin:
                device = Guarded(with_faults(twin, [table_of(fault) for fault in faults]), experiment.limits)
                file = None if to is None else to / f"{fewest}.mcap"
                try:
                    recording = sb.run(experiment, device, to=file, watch=watch() if watch else None)
                except DeviceLost as lost:  # its words stand in the recording
                    recording = lost.recording
                runs.append(Done(recording, device, twin, counted.ticks))
        assert runs[0].ticks_in_blocks == 0
        return tuple(runs)

    return carry_out


class CountedBlocks:
    """Counts the ticks that are done in blocks."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.ticks = 0
        advance = ADVANCE

        def count(block: BlockPass, due: int, ticks: int | None) -> int:
            after = advance(block, due, ticks)
            self.ticks += after - due
            return after

        monkeypatch.setattr(BlockPass, "advance", count)


ADVANCE = BlockPass.advance
COUNTS = Encoder.counts


def assert_equal(runs: tuple[Done, Done]) -> None:
    by_ticks, in_blocks = runs
    np.testing.assert_array_equal(by_ticks.rows.view(np.uint64), in_blocks.rows.view(np.uint64))
    assert by_ticks.findings == in_blocks.findings
    assert by_ticks.after == in_blocks.after
    assert by_ticks.time_stalled == in_blocks.time_stalled


@pytest.mark.parametrize("twin", TWINS)
@pytest.mark.parametrize("law", LAWS)
def test_each_law_on_each_twin(both: Callable[..., Any], law: str, twin: str) -> None:
    signal = FAST if law == "open loop" else Square(low=0.0, high=30.0, frequency=0.9)
    runs = both(Experiment(duration=4.0, signal=signal, controller=LAWS[law], seed=3), **TWINS[twin])

    assert_equal(runs)
    assert runs[1].ticks_in_blocks > 1900  # of 2000: a block may end at a tick that is looked at closely


@pytest.mark.parametrize("limits", LIMITS)
@pytest.mark.parametrize("law", ["open loop", "PD that saturates", "PI of the speed"])
def test_each_limit_ends_the_run_at_the_same_tick_with_the_same_words(
    both: Callable[..., Any], law: str, limits: str
) -> None:
    signal = FAST if law == "open loop" else Square(low=-40.0, high=40.0, frequency=0.9)
    experiment = Experiment(duration=4.0, signal=signal, controller=LAWS[law], limits=LIMITS[limits])
    runs = both(experiment, tachometer=True)

    assert_equal(runs)
    assert runs[1].ticks_in_blocks > 0.9 * len(runs[1].rows) - 2  # all but the first and the last


@pytest.mark.parametrize("law", ["open loop", "PID of the position", "PD that saturates", "PI of the speed"])
def test_an_encoder_that_counts_backwards_is_found_at_the_same_tick(
    both: Callable[..., Any], law: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Encoder, "counts", lambda self, angle: COUNTS(self, -angle))
    hand_over = Twin.hand_over

    def hand_over_backwards(twin: Twin, to: Handover) -> None:
        hand_over(twin, to)
        to.p[COUNTS_PER_REV] *= -1.0

    monkeypatch.setattr(Twin, "hand_over", hand_over_backwards)
    signal = Square(low=-3.0, high=3.0, frequency=0.7)
    runs = both(Experiment(duration=4.0, signal=signal, controller=LAWS[law]))

    assert_equal(runs)
    assert ("accelerates against" in runs[1].recording.stopped.sentence) is (law != "open loop")


@pytest.mark.parametrize("name", SIGNALS.names())
def test_each_signal(both: Callable[..., Any], name: str) -> None:
    runs = both(Experiment(duration=4.0, sample_time=0.003, signal=example(name)))

    assert_equal(runs)
    assert runs[1].ticks_in_blocks == 1333  # all but the first


@pytest.mark.parametrize("sample_time", [1e-4, 1 / 3000, 0.007, 0.02])
def test_each_sample_time(both: Callable[..., Any], sample_time: float) -> None:
    experiment = Experiment(
        duration=1500 * sample_time,
        sample_time=sample_time,
        signal=FAST,
        controller=LAWS["PID of the position"],
    )

    assert_equal(both(experiment))


def test_a_shaft_that_is_blocked_by_friction_stalls_at_the_same_tick(both: Callable[..., Any]) -> None:
    runs = both(Experiment(duration=6.0, signal=Step(final=6.0)), coulomb_torque=0.06)

    assert_equal(runs)
    assert "stood" in runs[1].recording.stopped.sentence or "slower" in runs[1].recording.stopped.sentence


def test_a_dead_encoder_is_found_at_the_same_tick(both: Callable[..., Any]) -> None:
    """Four counts in a revolution: from one count to the next it seems to stand, as far as another motor is expected."""
    expected = Limits(plausibility=Plausibility(gain=400.0, time_constant=0.01, resistance=8.4))
    runs = both(
        Experiment(duration=4.0, signal=Sine(amplitude=9.0, frequency=0.3), limits=expected),
        counts_per_rev=24,
    )

    assert_equal(runs)


@dataclass(frozen=True)
class Plain:
    """An experiment of a user's own making, with a signal that no file could hold."""

    signal: Any
    duration: float = 4.0
    sample_time: float = 0.002
    asked: Experiment = field(default_factory=Experiment)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.asked, name)

    @property
    def samples(self) -> int:
        return round(self.duration / self.sample_time)


def ends_in_nan(t: Array) -> Array:
    return np.where(t < 1.2345, 2.0, np.nan)


def test_a_signal_that_is_no_number_any_more_ends_the_run(both: Callable[..., Any]) -> None:
    runs = both(Plain(ends_in_nan))

    assert_equal(runs)
    assert (
        len(runs[1].rows) == 619
    )  # 1.2345 s is the first time that is out of the signal's range, at 1.236 s
    assert runs[1].recording.stopped.reason == "fault"


def test_a_watch_sees_the_same_ticks_and_ends_the_run_at_the_same_one(both: Callable[..., Any]) -> None:
    seen: list[list[Progress]] = []

    def watch() -> Callable[[Progress], str | None]:
        seen.append([])

        def look(progress: Progress) -> str | None:
            seen[-1].append(progress)
            return "enough" if progress.time > 2.0 else None

        return look

    runs = both(Experiment(duration=4.0, signal=FAST), watch=watch)

    assert_equal(runs)
    assert seen[0] == seen[1]
    assert [each.tick for each in seen[1]] == list(range(0, 1051, 50))
    assert runs[1].recording.stopped.sentence == "enough"


def test_ctrl_c_between_two_blocks_ends_the_run_with_what_was_done() -> None:
    asked = 0

    def interrupt(t: Array) -> Array:
        nonlocal asked
        asked += 1
        if asked == 4:
            raise KeyboardInterrupt
        return np.full_like(t, 2.0)

    experiment = Experiment(duration=120.0)
    with sb.connect("twin") as twin:
        recording = sb.run(Plain(interrupt, duration=120.0, asked=experiment), twin)
        before, after = twin.state, twin.coast(5.0)

    assert recording.stopped.reason == "interrupted"
    # The first ones before anything moves.
    assert len(recording["counts"].values) == BLOCK + 2 * LONG_BLOCK
    assert before.speed > 40.0
    assert after.speed == 0.0  # the motor was stopped


def test_the_file_holds_what_the_memory_does(both: Callable[..., Any], tmp_path: Path) -> None:
    experiment = Experiment(duration=24.0, signal=FAST, controller=OpenLoop())
    in_memory = both(experiment)[1]
    runs = both(experiment, to=tmp_path)

    assert_equal(runs)
    np.testing.assert_array_equal(runs[1].rows, in_memory.rows)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["1.mcap", "1000000000.mcap"]


def test_the_noise_of_two_runs_of_one_device_goes_on_in_the_same_way(monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = Experiment(duration=2.0, signal=FAST, seed=None)
    rows = []
    for fewest in (10**9, 1):
        monkeypatch.setattr(block_pass, "FEWEST_TICKS", fewest)
        with sb.connect("twin", current_noise=0.05) as twin:
            recording = sb.run(experiment.model_copy(update={"seed": 5}), twin)
            twin.write(3.0)
            rows.append((recording["current"].values.tolist(), [twin.read() for _ in range(20)]))

    assert rows[0] == rows[1]


class Around:
    """A device around a device that hands on whatever it hasn't itself."""

    def __init__(self, device: Any) -> None:
        self.device = device

    def __getattr__(self, name: str) -> Any:
        return getattr(self.device, name)


@pytest.mark.parametrize(
    "fault",
    [
        "blocked_shaft from=1s for=200ms",
        "clock_step from=1s for=50ms by=40ms",
        "clock_stuck from=3s for=1ms",
        "device_unplugged from=2.5s",
        "jitter from=0.5s for=1s probability=0.3",
        "lost from=1s for=1s every=3",
        "lost every=50",
        "nan from=1.2s channel=counts",
        "repeated from=2s",
        "slow_read from=0.7s for=20ms takes=5ms",
        "stale from=1s for=100ms",
        "stuck_channel from=1s for=100ms",
        "counter_wrap bits=16 start=32000",
    ],
)
@pytest.mark.parametrize("law", ["open loop", "PID of the position"])
def test_each_fault(both: Callable[..., Any], law: str, fault: str) -> None:
    """Those that needn't see the samples before their time leave them to the blocks, and what comes after it, too."""
    experiment = Experiment(duration=4.0, signal=FAST, controller=LAWS[law], seed=7)
    runs = both(experiment, faults=(fault,), torque_noise=1e-5, current_noise=0.01)

    assert_equal(runs)
    every = fault.startswith(("stale", "stuck_channel", "counter_wrap", "lost every"))
    assert (runs[1].ticks_in_blocks > 200) is not every


def test_two_faults_end_the_blocks_at_the_earlier_one(both: Callable[..., Any]) -> None:
    faults = ("jitter from=2s for=0.1s", "blocked_shaft from=1s for=0.2s")
    runs = both(Experiment(duration=4.0, signal=FAST), faults=faults)

    assert_equal(runs)
    assert 900 < runs[1].ticks_in_blocks < 1850  # of 2000, 150 with a fault


def test_what_is_of_a_users_own_goes_tick_by_tick_and_is_reported() -> None:
    class Own(Pid):
        pass

    twin = sb.connect("twin")
    assert tick_by_tick_reason(twin, OpenLoop()) == ""
    assert tick_by_tick_reason(twin, Pid()) == ""
    assert tick_by_tick_reason(twin, Own()) == "the controller Own isn't compiled"
    assert tick_by_tick_reason(sb.connect("twin", solver="rk4"), Pid()).startswith("the device 'twin'")
    assert tick_by_tick_reason(Around(twin), Pid()).startswith("the device 'twin'")
    assert (
        tick_by_tick_reason(with_faults(twin, [{"name": "stale"}]), Pid())
        == "a fault has to see every sample"
    )


def test_a_short_run_is_not_worth_loading_the_compiled_block(monkeypatch: pytest.MonkeyPatch) -> None:
    counted = CountedBlocks(monkeypatch)
    with sb.connect("twin") as twin:
        sb.run(Experiment(duration=1.0), twin)

    assert counted.ticks == 0
