"""A proportional speed loop with one reference: its own law, y = r - u/k, explains each row better than any motor does."""

from __future__ import annotations

import numpy as np
import pytest

import servobench as sb
from servobench.core.channels import Array
from servobench.core.finding import Verdict
from servobench.identification.result import Result

STEP, LAW = 0.005, 0.02


def loop(references: Array, noise: float, structure: str = "auto") -> Result:
    """What is said of a motor of 50 rad/(s·V) with a time constant of 30 ms and a delay of 15 ms, under u = 0.02 (r - y)."""
    random = np.random.default_rng(3)
    t = STEP * np.arange(len(references))
    u, y = np.zeros(len(t)), np.zeros(len(t))
    speed = 0.0
    for n in range(1, len(t)):
        told = u[n - 4] if n > 3 else 0.0
        speed += (50.0 * told - speed) * (1 - np.exp(-STEP / 0.03))
        y[n] = speed + noise * random.standard_normal()
        u[n] = LAW * (references[n] - y[n])
    arrays = {"voltage": u, "speed": y, "reference": references}
    return sb.identify(
        arrays,
        input="voltage:V",
        output="speed:rad/s",
        reference="reference:rad/s",
        sample_time=STEP,
        structure=structure,
    )


@pytest.mark.parametrize("noise", [0.03, 0.1])
def test_the_law_of_a_controller_is_not_taken_for_a_motor(noise: float) -> None:
    result = loop(np.full(300, 6.28), noise)

    assert result.verdict is Verdict.REFUSED
    [told] = [each for each in result.findings if each.code == "loop-tells-little"]
    assert "law read backward" in told.sentence


def test_a_reference_of_several_levels_tells_the_motor() -> None:
    levels = np.repeat(np.random.default_rng(1).uniform(-40.0, 40.0, 20), 60)

    result = loop(levels, 0.1)

    assert result.verdict is not Verdict.REFUSED
    assert result.fit is not None
    assert result.fit["gain"].interval[0] < 50.0 < result.fit["gain"].interval[1]


def test_a_structure_without_a_gain_has_no_law_to_be_taken_for() -> None:
    result = loop(np.full(300, 6.28), 0.1, "rational_2_0_integrator_delay")

    assert not any("law read backward" in each.sentence for each in result.findings)


def test_a_fast_motor_that_follows_a_ramp_at_once_is_its_own() -> None:
    """Rows twice as far apart as its time constant, and a PI controller: each speed is 50 times the voltage before it."""
    step, speed, integral = 0.01, 0.0, 0.0
    references = 20.0 * step * np.arange(400)
    u, y = np.zeros(400), np.zeros(400)
    for n in range(1, 400):
        speed += (50.0 * u[n - 1] - speed) * (1 - np.exp(-step / 0.005))
        y[n] = speed
        integral += step * (references[n] - y[n])
        u[n] = 0.004 * (references[n] - y[n]) + 0.5 * integral
    result = sb.identify(
        {"voltage": u, "speed": y, "reference": references},
        input="voltage:V",
        output="speed:rad/s",
        reference="reference:rad/s",
        sample_time=step,
    )

    assert not any("law read backward" in each.sentence for each in result.findings)
