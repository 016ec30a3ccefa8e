"""What is read off a step response, on responses that are known."""

import math

import numpy as np
import pytest

from servobench.lab.step_response import Response, figures_of

T = np.arange(0.0, 2.0, 0.001)


def response(zeta: float, omega: float) -> Response:
    """The second-order step response 1 - e^(-ζωt) (cos ω_d t + ζω/ω_d sin ω_d t), below ζ = 1."""
    damped = omega * math.sqrt(1 - zeta**2)
    y = 1 - np.exp(-zeta * omega * T) * (np.cos(damped * T) + zeta * omega / damped * np.sin(damped * T))
    return Response(t=T, output=y, voltage=np.zeros_like(T))


def test_peak_and_overshoot_are_those_of_the_formulas() -> None:
    found = figures_of(response(0.5, 20.0), 0.0, 1.0)

    assert found.peak_time == pytest.approx(math.pi / (20 * math.sqrt(0.75)), abs=5e-4)  # half a sample
    # Half a sample beside a peak costs ½ ω² (h/2)² of it at the most.
    assert found.overshoot == pytest.approx(
        math.exp(-math.pi * 0.5 / math.sqrt(0.75)), abs=0.5 * 400 * 5e-4**2
    )


def test_an_overshoot_that_nobody_can_see_is_none() -> None:
    """e^(-πζ/√(1-ζ²)) is 7e-10 for ζ = 0.989: the rounding of a calculation, and no peak."""
    found = figures_of(response(0.989, 20.0), 0.0, 1.0)

    assert found.overshoot == 0.0
    assert math.isnan(found.peak_time)
