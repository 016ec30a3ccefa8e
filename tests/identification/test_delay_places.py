"""A delay that stands for friction is not where a search ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.channels import Array
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


def angle_from_rest(
    u: Array, gain: float, tau: float, friction: float, parts: tuple[tuple[int, float], ...]
) -> Array:
    """The angle (N,) before each input u (N,) of a shaft that friction holds; u of so many samples ago acts in parts of one [s].

    Under one input it is the exact θ = ω_∞ t + τ (ω_∞ - ω) of the speed ω that tends to ω_∞ = K (u - u_c).
    """
    w = theta = 0.0
    y = np.empty(len(u))
    for n in range(len(u)):
        y[n] = theta
        for late, h in parts:
            end = gain * max(u[max(n - late, 0)] - friction, 0.0)
            change = -np.expm1(-h / tau) * (end - w)
            theta += end * h - tau * change
            w += change
    return y


def stairs(seed: int) -> Dataset:
    """Counts under noise of a shaft that friction holds at first, driven by a ramp that climbs in stairs, 2.9 samples late."""
    step, quantum, samples = 4.49e-3, 1.52e-4, 1026
    u: Array = 1.27 * step * np.arange(samples, dtype=np.float64)
    y = angle_from_rest(u, 307.0, 0.198, 1.37, ((3, 0.9 * step), (2, 0.1 * step)))
    noisy = y + 1.2e-4 * np.random.default_rng(seed).standard_normal(samples)
    data = dataset(seed=1, u=u, samples=samples, sample_time=step, y=quantum * np.round(noisy / quantum))
    return replace(data, quantum=quantum)


@pytest.mark.parametrize("seed", range(6))
def test_stairs_that_determine_the_delay_within_a_sample_do_not_hide_that_it_is_short(seed: int) -> None:
    """From one sample to the next places look alike; between them the fit is worse, also beside the usual delay."""
    result = identify(stairs(seed))

    assert result.fit is not None
    assert result.fit.model["delay"] < 0.1
    estimate = result.fit.estimates["coulomb_voltage"]
    assert abs(estimate.value - 1.37) < 3.0 * estimate.sd


@pytest.mark.parametrize(
    ("gain", "tau", "friction"), [(20.0, 0.05, 1.0), (46.4, 0.0336, 0.656), (46.4, 0.0336, 1.0)]
)
@pytest.mark.parametrize("times", [4.0, 6.0])
def test_friction_on_a_short_ramp_from_rest_is_no_delay(
    gain: float, tau: float, friction: float, times: float
) -> None:
    """A delay of the friction over the slope explains 200 fine counts a little better, for the rounding of the rest."""
    step, samples, quantum = times * tau / 200, 200, 2 * np.pi / 8192
    u: Array = 5.0 / samples * np.arange(samples, dtype=np.float64)
    y = angle_from_rest(u, gain, tau, friction, ((0, step),))
    y = quantum * np.floor(y / quantum) + 0.5 * quantum

    result = identify(
        replace(
            dataset(seed=1, u=u, samples=samples, sample_time=step, y=y), quantum=quantum, input_before=0.0
        )
    )

    assert result.fit is not None
    for name, truth in (("delay", 0.0), ("coulomb_voltage", friction), ("gain", gain)):
        estimate = result.fit.estimates[name]
        assert abs(estimate.value - truth) < 3.0 * estimate.sd, name
