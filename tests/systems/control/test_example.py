"""`examples/position.toml`: the twin follows, as was predicted, and is identified from what the controller made of it."""

import math
from pathlib import Path

import numpy as np
import pytest

import servobench as sb
from servobench.core.finding import Verdict
from servobench.identification.identify import identify
from servobench.recordings.measurement.measure import measure
from servobench.recordings.recording import Recording
from servobench.rig.experiment import load_experiment
from servobench.systems.control.pid import Pid

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "position.toml"


@pytest.fixture(scope="module")
def recording() -> Recording:
    with sb.connect("twin") as motor:
        return sb.run(load_experiment(EXAMPLE), motor)


def test_the_shaft_goes_where_it_is_reported_and_the_voltage_stays_within_its_limit(
    recording: Recording,
) -> None:
    angle = recording["counts"].values * 2 * math.pi / 2048
    period = round(2.5 / 0.002)
    ends = angle[period // 2 - 1 :: period // 2]

    # Poles as slow as 15 rad/s, 1.25 s long, in which friction is overcome; it overshoots by 0.01 % of 14 rad, and by friction.
    np.testing.assert_allclose(np.abs(ends), 7.0, rtol=0, atol=0.05)
    assert np.abs(angle).max() < 7.1
    assert np.abs(recording["commanded"].values).max() < 10.0


def test_the_motor_is_identified_in_closed_loop(recording: Recording) -> None:
    result = identify([measure(recording)])

    assert result.verdict is Verdict.TRUSTED
    assert "rests-left-out" in {each.code for each in result.findings}
    assert result.fit is not None
    # K = k/(R b + k²); τ is that of the slow pole, of R = 8.4 Ω, L = 1.16 mH, k = 0.042, J = 2.0952e-5, b = 1e-6.
    r, l, k, j, b = 8.4, 1.16e-3, 0.042, 2.0952e-5, 1e-6
    true = {
        "gain": k / (r * b + k * k),
        "time_constant": -1 / max(np.roots([l * j, l * b + r * j, r * b + k * k]).real),
    }
    for name, value in true.items():
        estimate = result.fit.estimates[name]
        assert abs(estimate.value - value) < 3.3 * estimate.sd, name


def test_its_gains_are_those_that_tune_gives_for_the_motor() -> None:
    law = load_experiment(EXAMPLE).controller
    assert isinstance(law, Pid)

    # By hand: τ s³ + (1 + K kd) s² + K kp s + K ki has the poles -15 and -20 ± 15j; K and τ as identified, to 1e-3.
    gain, tau = 23.697, 0.0991
    wanted = np.real(np.poly([-15, -20 + 15j, -20 - 15j]))
    expected = ((tau * wanted[1] - 1) / gain, tau * wanted[2] / gain, tau * wanted[3] / gain)
    np.testing.assert_allclose((law.kd, law.kp, law.ki), expected, rtol=3e-3)
