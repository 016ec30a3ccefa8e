"""The device for a QUBE-Servo, on the stand-in: verified on simulated hardware only. With it fault rows 3, 6, 7, 11, 28, 29."""

import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import servobench as sb
from servobench.compat.quanser import install
from servobench.compat.quanser.hil import HIL
from servobench.compat.quanser.session import Bench
from servobench.core.errors import DeviceError, UsageError
from servobench.recordings.measurement.unwrap import Unwrap
from servobench.rig.devices.base import RunEnded, connect
from servobench.rig.devices.quanser import Quanser, QuanserSettings
from servobench.rig.lost_device import DeviceLost
from servobench.rig.motor.physics import Physics

H = 0.002  # s


@pytest.fixture
def bench() -> Iterator[Bench]:
    with install(quiet=True, ignore_threads=True) as bench:
        yield bench


def drive(motor: Quanser, voltage: float, samples: int) -> list[Any]:
    """Read and write so often."""
    found = []
    for _ in range(samples):
        found.append(motor.read())
        motor.write(voltage)
    return found


def coasts(bench: Bench) -> bool:
    """Whether the shaft comes to rest by itself: what is driven would turn on."""
    bench.timebase.wait_until(bench.timebase.now() + 3.0)
    bench.board.advance(bench.timebase.now())
    return bench.board.motion.plant.state.speed == 0.0


@pytest.mark.parametrize("board", ["qube_servo_2", "qube_servo_3", "qube_servo"])
def test_an_identification_finds_the_parameters_of_the_motor_that_turns(board: str, bench: Bench) -> None:
    with connect("quanser", board=board) as motor:
        recording = sb.run(sb.Experiment(signal=sb.Square(low=-3, high=3, frequency=0.4), duration=10), motor)
        truth: Physics = bench.board.motion.plant._physics
    result = sb.identify(sb.measure(recording))

    assert result.verdict == "trusted"
    for name, value in (
        ("gain", truth.gain),
        ("time_constant", truth.time_constant),
        ("coulomb_voltage", truth.coulomb_voltage),
        # What a call takes, and the fast time constant, J L / (R J - τ (R b + k²)...) within 2 % of L/R.
        ("delay", 125e-6 - 1 / truth.eigenvalues[1].real),
    ):
        low, high = result[name].interval
        assert low <= value <= high, name


def test_the_simulators_board_is_found_by_its_address(bench: Bench) -> None:
    with connect("quanser", board="qube_servo_3", simulator=True) as motor:
        motor.start(H, 0)
        drive(motor, 3.0, 200)

    assert bench.board.address.identifier == "0@tcpip://localhost:18922?nagle='off'"


def test_current_and_speed_come_in_si_units_and_the_first_generation_has_neither(bench: Bench) -> None:
    with connect("quanser") as motor:
        motor.start(H, 0)
        last = drive(motor, 5.0, 500)[-1]
    with connect("quanser", board="qube_servo") as old:
        old.start(H, 0)
        bare = drive(old, 5.0, 10)[-1]

    assert abs(last.tachometer - 114.7) < 0.1  # 4.84 V times the gain
    assert abs(last.current - 0.0218) < 6 / 4096
    assert (bare.tachometer, bare.current) == (None, None)
    assert old.info.channel("current") is None


def test_the_amplifier_is_on_from_start_to_stop_and_the_light_says_so(bench: Bench) -> None:
    with connect("quanser") as motor:
        assert not bench.board.motion.enabled
        motor.start(H, 0)
        assert (bench.board.motion.enabled, bench.board.lights) == (True, (0.0, 1.0, 0.0))
        drive(motor, 5.0, 100)
        motor.stop()
        assert (bench.board.motion.enabled, bench.board.lights) == (False, (1.0, 0.0, 0.0))
        assert motor.write(5.0) == 0.0
        assert coasts(bench)

    assert bench.endings[0].is_safe


def test_the_voltage_is_limited_and_board_options_are_passed_on(bench: Bench) -> None:
    with connect(
        "quanser", board="qube_servo_3", voltage_limit=6.0, options="deadband_compensation=0.3"
    ) as motor:
        motor.start(H, 0)
        motor.read()

        assert motor.write(50.0) == 6.0
        assert bench.board.motion.voltage == 6.0
        assert bench.board.motion.compensation == 0.3
    with pytest.raises(UsageError, match="15 V at most"):
        connect("quanser", voltage_limit=20.0)


def test_an_option_that_the_board_refuses_is_an_error_that_leaves_it_closed(bench: Bench) -> None:
    motor = connect("quanser", board="qube_servo_3", options="colour=1")
    with pytest.raises(DeviceError, match=r"couldn't set its options.*'colour'"):
        motor.__enter__()

    assert bench.board.ending is not None


def test_without_quansers_software_one_sentence_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "quanser", None)
    monkeypatch.setitem(sys.modules, "quanser.hardware", None)
    with pytest.raises(DeviceError, match=r"quanser_sdk_win64.*quanser_sdk_linux"), connect("quanser"):
        pass


# --- watchdog ---


def test_the_watchdog_is_tried_and_what_came_of_it_is_reported(bench: Bench) -> None:
    with connect("quanser") as motor:
        states = [dict(motor.info.settings)["watchdog_state"]]
        motor.start(H, 0)
        drive(motor, 1.0, 3)
        states.append(dict(motor.info.settings)["watchdog_state"])

    assert states == ["unknown", "running"]


def test_a_board_without_a_watchdog_runs_all_the_same() -> None:
    with install(quiet=True, has_watchdog=False), connect("quanser") as motor:
        motor.start(H, 0)
        drive(motor, 1.0, 3)

        assert dict(motor.info.settings)["watchdog_state"] == "unsupported"


def test_a_loop_that_hangs_is_let_go_by_the_watchdog_and_told_about_it(bench: Bench) -> None:
    with connect("quanser", buffer="10 s") as motor:
        motor.start(H, 0)
        drive(motor, 5.0, 200)
        assert coasts(bench)
        assert bench.board.lights == (0.0, 0.0, 1.0)
        with pytest.raises(DeviceError, match="watchdog"):
            drive(motor, 5.0, 1)


# --- lost samples ---


def test_samples_that_nobody_fetched_in_time_end_the_run(bench: Bench) -> None:
    with connect("quanser", watchdog=0.0) as motor:
        motor.start(H, 0)
        drive(motor, 1.0, 10)
        bench.timebase.wait_until(bench.timebase.now() + 1.0)
        with pytest.raises(DeviceError, match="overflowed"):
            motor.read()


def test_samples_that_are_lost_can_be_counted_instead_and_leave_their_numbers_out(bench: Bench) -> None:
    with connect("quanser", watchdog=0.0, overflow="count") as motor:
        motor.start(H, 0)
        before = drive(motor, 1.0, 10)[-1]
        bench.timebase.wait_until(bench.timebase.now() + 1.0)
        after = motor.read()

    # A second is 500 samples, of which the buffer of 0.5 s keeps the last 250.
    assert abs(after.index - before.index - 251) <= 1
    assert after.time == after.index * H


# --- the fault rows ---


def test_row_3_a_board_that_is_unplugged_ends_the_run_with_what_was_recorded(
    bench: Bench, tmp_path: Path
) -> None:
    bench.unplug_at = 1.0
    experiment = sb.Experiment(signal=sb.Square(low=1, high=3, frequency=0.4), duration=3, sample_time=H)
    with connect("quanser") as motor, pytest.raises(DeviceLost, match="no longer answers") as caught:
        sb.run(experiment, motor, to=tmp_path / "run.mcap")
    recording = caught.value.recording
    counts = recording["counts"].values

    assert 480 <= len(counts) <= 500  # a second, less the calls before the start
    assert (np.diff(counts[50:]) > 0).all()  # no sample was repeated
    assert len(sb.load(tmp_path / "run.mcap")[0]["counts"].values) == len(counts)
    assert bench.endings[0].unplugged


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, "5", None])
def test_row_6_what_is_no_voltage_never_reaches_the_board(bench: Bench, value: Any) -> None:
    with connect("quanser") as motor:
        motor.start(H, 0)
        drive(motor, 1.0, 3)
        with pytest.raises(UsageError, match="expected a finite number in V"):
            motor.write(value)

        assert bench.board.motion.voltage == 1.0


@pytest.mark.parametrize("voltage", [10.0, -10.0])
def test_row_7_the_counter_wraps_at_24_bits_either_way_and_unwrapped_it_is_exact(
    bench: Bench, voltage: float
) -> None:
    with connect("quanser", watchdog=0.0) as motor:
        motor.start(0.05, 0)
        shown = np.array([sample.counts for sample in drive(motor, voltage, 2600)])
        angle = bench.board.motion.plant.state.angle

    assert (
        shown.min() < 0 < shown.max()
    )  # it wrapped: 130 s at 233 rad/s are 9.9 million counts, 2^23 are 8.4
    unwrapped = Unwrap(modulus=2.0**24, unit="counts")(shown.astype(float), 0.05 * np.arange(len(shown)))
    # The last sample was latched a call's time before the state that is compared; 233 rad/s x 125 µs are 10 counts.
    assert abs(unwrapped[-1] - angle * 2048 / (2 * math.pi)) < 12


def test_row_11_a_stalled_motor_is_cut_off_by_the_board_and_the_run_ends_with_a_sentence(
    bench: Bench,
) -> None:
    with connect("quanser") as motor:
        motor.start(H, 0)
        motor.read()
        bench.board.motion.plant.blocked = True
        with pytest.raises(RunEnded, match="after a stall of three seconds") as caught:
            drive(motor, 6.0, 2000)

        assert caught.value.stopped.reason == "fault"
        assert caught.value.sample is not None
        assert caught.value.sample.time == pytest.approx(3.0, abs=0.1)
        assert not bench.board.motion.drives


@pytest.mark.parametrize("broken", ["write_analog", "write_digital", "write_other"])
def test_row_29_a_stop_of_which_a_part_fails_still_lets_the_motor_go(
    bench: Bench, broken: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with connect("quanser", watchdog=0.0) as motor:
        motor.start(H, 0)
        drive(motor, 5.0, 200)

        def fail(*_: Any) -> None:
            raise OSError("swallowed")

        monkeypatch.setattr(HIL, broken, fail)
        motor.stop()

        assert coasts(bench)


def test_row_29_where_all_of_a_stop_fails_the_watchdog_lets_the_motor_go(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any) -> None:
        raise OSError("swallowed")

    with connect("quanser") as motor:
        motor.start(H, 0)
        drive(motor, 5.0, 200)
        for call in ("write_analog", "write_digital", "write_other", "watchdog_stop"):
            monkeypatch.setattr(HIL, call, fail)
        motor.stop()

        assert coasts(bench)


def test_row_28_an_exception_in_the_run_leaves_the_motor_at_rest(bench: Bench) -> None:
    def run() -> None:
        with connect("quanser") as motor:
            motor.start(H, 0)
            drive(motor, 5.0, 200)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run()

    assert bench.endings[0].is_safe
    assert coasts_after_closing(bench)


def coasts_after_closing(bench: Bench) -> bool:
    """Whether the shaft stands some time after the board was closed."""
    bench.board.motion.advance_to(bench.timebase.now() + 3.0)
    return bench.board.motion.plant.state.speed == 0.0


def test_settings_that_no_board_has_are_refused() -> None:
    with pytest.raises(UsageError, match="no simulator of a qube_servo"):
        Quanser(QuanserSettings(board="qube_servo", simulator=True))
    with pytest.raises(UsageError, match="0 or more"):
        Quanser(QuanserSettings(watchdog=-1.0))
