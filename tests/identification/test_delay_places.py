"""A delay that stands for friction is not where a search ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.identify import identify
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset

GAIN, TAU, FRICTION, RATE = 355.6, 0.0606, 0.3754, 3.93  # rad/(s·V), s, V, V/s
STEP, SAMPLES, QUANTUM = 2.52e-4, 3229, 0.03696  # s, samples, rad


def ramp(lead: float, phase: float) -> Dataset:
    """Counts of a shaft that rests at a part of a count, and is driven by a ramp after a lead.

    θ = K r (t²/2 - τ t + τ² (1 - e^(-t/τ))) from where the ramp r t has overcome friction.
    """
    t = STEP * np.arange(SAMPLES)
    u = RATE * np.maximum(t - lead, 0.0)
    gone = np.maximum(t - lead - FRICTION / RATE, 0.0)
    angle = GAIN * RATE * (0.5 * gone**2 - TAU * gone + TAU**2 * -np.expm1(-gone / TAU))
    y = QUANTUM * np.round(angle / QUANTUM + phase)
    return replace(dataset(seed=1, u=u, samples=SAMPLES, sample_time=STEP, y=y), quantum=QUANTUM)


@pytest.mark.parametrize("phase", [-0.4, -0.2, 0.05, 0.2, 0.4])
@pytest.mark.parametrize("lead", [0.0, 0.1])
def test_a_ramp_from_rest_that_friction_holds_has_no_long_delay(lead: float, phase: float) -> None:
    """A delay of 95 ms and no friction would explain it as well, but for half a count."""
    result = identify(ramp(lead, phase))

    assert result.fit is not None
    assert result.fit.model["delay"] < 0.01
    assert result.fit.model["coulomb_voltage"] == pytest.approx(FRICTION, rel=0.02)
