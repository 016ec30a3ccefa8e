"""The four standard tests of WPILib's SysId, held against the algebra of the motor's equation.

u = (R/k) T_c sgn ω + (k + R b/k) ω + (R J/k) dω/dt for a winding without a lag, so kS, kV and kA follow without any fit. The lag
L/R of the reference motor's winding is 0.14 ms; it adds to the delay and, by at most itself over τ, to the time constant.
"""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import servobench as sb
from servobench.core.finding import Severity
from tests.recordings.formats.robots import constants_of, sysid_json
from tests.rig.motor.reference import Truth

DRIVE = Truth(
    resistance=0.5,
    inductance=1e-5,
    motor_constant=0.108,
    inertia=0.003,
    viscous_friction=1e-5,
    coulomb_torque=0.05,
)
TWIN = Truth()


@pytest.mark.parametrize("truth", [DRIVE, TWIN], ids=["drive", "twin"])
@pytest.mark.parametrize("period", [0.005, 0.02])
def test_the_four_tests_are_trusted_with_the_gains_of_the_algebra(
    truth: Truth, period: float, tmp_path: Path
) -> None:
    path = tmp_path / "robot.json"
    path.write_text(sysid_json(truth, period))

    result = sb.identify(path)

    assert result.verdict == "trusted"
    assert [each.code for each in result.findings if each.severity != Severity.INFO] == []
    true, turn = constants_of(truth), 2 * math.pi
    gain, tau, friction = (result[name] for name in ("gain", "time_constant", "coulomb_voltage"))
    lag = truth.inductance / truth.resistance
    # 1e-5: a model of first order in place of the winding; its lag may be in the time constant. Three sd beside that.
    assert turn / gain.value == pytest.approx(
        true.kv, abs=3 * turn * gain.sd / gain.value**2 + 1e-5 * true.kv
    )
    assert tau.value == pytest.approx(true.ka / true.kv, abs=3 * tau.sd + lag)
    assert friction.value == pytest.approx(true.ks, abs=3 * friction.sd + 1e-4 * true.ks)


def test_half_of_the_tests_say_less_and_are_not_wrong(tmp_path: Path) -> None:
    path = tmp_path / "robot.json"
    path.write_text(sysid_json(DRIVE, tests=("slow-forward", "fast-forward")))

    result = sb.identify(path)

    true = constants_of(DRIVE)
    assert result.verdict == "trusted"
    low, high = result["gain"].interval
    assert low * (1 - 1e-5) <= 2 * math.pi / true.kv <= high * (1 + 1e-5)
