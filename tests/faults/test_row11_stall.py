"""Row 11: a shaft that is held under a large voltage. A warning within 100 ms, cut off after 3 s; Quanser's semantics."""

import pytest

from servobench.rig.devices.guarded import Guarded
from servobench.rig.devices.twin import Twin
from servobench.rig.experiment import PAPER, Limits
from servobench.rig.experiment.limits import StallLimits
from servobench.rig.loop.run import run
from tests.faults.doubles import Bench, Jammed, drive

HELD = {"coulomb_torque": 1.0}  # N·m; 24 times what the motor makes at 10 V


@pytest.mark.promise("S7")
@pytest.mark.parametrize("voltage", [5.1, -6.0, 10.0])
@pytest.mark.parametrize("sample_time", [0.0005, 0.002, 0.01])
def test_a_shaft_that_never_moves_is_warned_of_within_100_ms_and_cut_off_after_3_s(
    voltage: float, sample_time: float
) -> None:
    with Bench(**HELD) as motor:
        early = drive(motor, lambda t: voltage, sample_time=sample_time, duration=0.1)
        assert [finding.code for finding in early.findings()] == ["stalled"]
        assert early.time_stalled == pytest.approx(0.1, abs=2 * sample_time)
        early.stop()

        late = drive(motor, lambda t: voltage, sample_time=sample_time, duration=4.0)
        assert late.fault is not None
        assert late.fault.code == "stalled"
        assert late.fault.time == pytest.approx(3.0, abs=0.1)
        assert motor.reached[-1] == 0.0


@pytest.mark.promise("S7")
@pytest.mark.parametrize("current_sensor", [True, False])
def test_a_shaft_that_is_jammed_at_speed_is_warned_of_within_100_ms(current_sensor: bool) -> None:
    with Jammed(1.0, current_sensor=True) as motor:
        guarded = Guarded(motor)
        guarded.start(0.002, 0)
        warned = None
        for _ in range(560):
            sample = guarded.read()
            guarded.write(10.0)
            if warned is None and guarded.findings():
                warned = sample.time
        assert warned is not None
        assert 1.0 < warned <= 1.1


@pytest.mark.promise("S7")
def test_a_shaft_that_is_jammed_at_speed_is_cut_off_after_3_s_where_the_current_shows_that_it_stands() -> (
    None
):
    with Jammed(1.0) as motor:
        guarded = drive(motor, lambda t: 10.0, duration=5.0)
        assert guarded.fault is not None
        assert guarded.fault.code == "stalled"
        assert guarded.fault.time == pytest.approx(4.0, abs=0.1)


@pytest.mark.promise("S7")
def test_without_a_current_sensor_a_shaft_that_stops_dead_is_taken_for_an_encoder_that_is_stuck() -> None:
    with Jammed(1.0, current_sensor=False) as motor:
        guarded = drive(motor, lambda t: 10.0, duration=5.0)
        assert guarded.fault is not None
        assert guarded.fault.code == "encoder-stands-still"
        assert 1.0 < guarded.fault.time <= 1.1


@pytest.mark.promise("S7")
def test_it_is_no_stall_at_5_v_or_where_a_break_comes_before_3_s() -> None:
    with Bench(**HELD) as motor:
        assert drive(motor, lambda t: 5.0, duration=5.0).fault is None
    with Bench(**HELD) as motor:
        assert drive(motor, lambda t: 0.0 if 2.8 <= t < 2.9 else 8.0, duration=5.6).fault is None


@pytest.mark.promise("S7")
def test_the_papers_square_wave_neither_warns_nor_stops() -> None:
    with Twin() as motor:
        recording = run(PAPER, motor)

    assert recording.stopped.reason == "finished"
    assert recording.findings == ()


def test_it_can_be_stricter_or_off() -> None:
    strict = Limits(stall=StallLimits(voltage=1.0, duration=0.5))
    with Bench(**HELD) as motor:
        guarded = drive(motor, lambda t: 2.0, duration=1.0, limits=strict)
        assert guarded.fault is not None
        assert guarded.fault.time == pytest.approx(0.5, abs=0.01)
    with Bench(**HELD) as motor:
        assert drive(motor, lambda t: 8.0, duration=5.0, limits=Limits(stall=None)).fault is None
