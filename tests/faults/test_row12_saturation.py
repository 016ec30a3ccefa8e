"""Row 12: an amplifier or a limit in the way. Each such sample is flagged, and what was put out is what is identified."""

import math

import numpy as np
import pytest

import servobench as sb
from servobench.rig.devices.twin import Twin
from servobench.rig.experiment import Experiment, Limits
from servobench.rig.loop.run import run
from servobench.rig.motor.physics import Physics
from servobench.systems.signals.sine import Sine
from servobench.systems.signals.square import Square
from servobench.systems.signals.step import Step
from tests.faults.doubles import drive


@pytest.mark.promise("S4")
@pytest.mark.parametrize(
    ("limit", "amplifier"), [(6.0, 10.0), (10.0, 6.0), (6.0, 6.0)], ids=["experiment", "amplifier", "both"]
)
def test_the_flag_is_exact_for_each_sample(limit: float, amplifier: float) -> None:
    asked = Experiment(signal=Sine(amplitude=9, frequency=1.3), duration=2.0, limits=Limits(voltage=limit))
    with Twin(Twin.Settings(amplifier_limit=amplifier)) as motor:
        recording = run(asked, motor)

    u = 9 * np.sin(2 * math.pi * 1.3 * 0.002 * np.arange(1000))
    assert recording["saturated"].values.tolist() == (np.abs(u) > 6.0).tolist()
    assert recording["applied"].values == pytest.approx(np.clip(u, -6.0, 6.0), abs=1e-12)
    (finding,) = recording.findings
    assert finding.code == "saturated"
    assert f"At {np.count_nonzero(np.abs(u) > 6.0)} samples" in finding.sentence


@pytest.mark.promise("S3")
def test_the_slew_limit_lets_the_voltage_go_no_faster_and_is_flagged() -> None:
    # 4 V at 100 V/s are reached after 40 ms, in steps of 0.2 V a sample of 2 ms.
    asked = Experiment(signal=Step(final=4.0, start=0.01), duration=0.1, limits=Limits(slew=100.0))
    with Twin() as motor:
        recording = run(asked, motor)

    expected = np.clip(0.2 * (np.arange(50) - 4), 0.0, 4.0)
    assert recording["applied"].values == pytest.approx(expected, abs=1e-9)
    assert recording["saturated"].values.tolist() == ((expected < 4.0) & (np.arange(50) >= 5)).tolist()


@pytest.mark.promise("S3")
def test_a_fault_is_zero_volts_at_once_whatever_the_slew_limit() -> None:
    with Twin() as motor:
        guarded = drive(motor, lambda t: 4.0, duration=2.0, limits=Limits(slew=20.0, speed=30.0))
        assert guarded.fault is not None
        assert motor.write(0.0) == 0.0
        wound_down = motor.coast(0.02).current
        assert wound_down <= 0.0  # nothing drives; what is left is the motor as a generator


@pytest.mark.promise("S4")
def test_what_was_put_out_is_identified_so_that_gain_and_time_constant_stay_right() -> None:
    settings = Twin.Settings()
    true = Physics.of(settings.parameters)
    for limit, amplifier in ((5.0, 10.0), (10.0, 5.0)):
        asked = Experiment(
            signal=Square(low=-8, high=8, frequency=0.8), duration=10, limits=Limits(voltage=limit)
        )
        with Twin(Twin.Settings(amplifier_limit=amplifier)) as motor:
            recording = run(asked, motor)
        assert recording["saturated"].values.all()

        fit = sb.identify(sb.measure(recording)).fit
        assert fit is not None
        for name, value in (("gain", true.gain), ("time_constant", true.time_constant)):
            assert abs(fit[name].value - value) < 3.3 * fit[name].sd
