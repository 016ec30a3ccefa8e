"""An arm whose speed alone was recorded is doubted, and told from friction that falls and from a ripple."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.estimators.base import Fit
from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset, prbs
from tests.rig.motor.odd_motor import OddMotor, marched

STEP, SAMPLES = 0.005, 1000  # s


def speeds(
    truth: OddMotor, noise: float = 0.02, kind: str = "prbs", angle: float = 0.4, seed: int = 7
) -> Dataset:
    """A tachometer at the shaft of a motor that starts with its arm at that angle from below [rad]."""
    random = np.random.default_rng(seed)
    t = STEP * np.arange(SAMPLES)
    u = prbs(SAMPLES, 25, random) if kind == "prbs" else 3.0 * np.sin(2 * np.pi * 0.9 * t)
    y = marched(truth, u, STEP, angle=angle)[:, 1] + noise * random.standard_normal(SAMPLES)
    made = dataset(seed=1, u=u, samples=SAMPLES, sample_time=STEP, y=y)
    return replace(made, kind="speed", output_unit="rad/s", quantum=None, chain_known=True)


def fit_of_arm(weight: float) -> Fit:
    fit = identify(speeds(OddMotor(gravity_sine=weight)), structure="first_order_coulomb").fit
    assert fit is not None
    return fit


def codes(result: Result) -> set[str]:
    return {finding.code for finding in result.findings}


@pytest.mark.parametrize("kind", ["prbs", "sine"])
def test_a_weight_is_seen_in_what_the_model_misses(kind: str) -> None:
    result = identify(speeds(OddMotor(gravity_sine=0.5), kind=kind))
    (found,) = [each for each in result.findings if each.code == "weight-by-speed"]

    assert result.verdict == "doubtful"
    assert "Record the position" in found.sentence


def test_its_size_is_about_right() -> None:
    (found,) = [
        each
        for each in identify(speeds(OddMotor(gravity_sine=0.3))).findings
        if each.code == "weight-by-speed"
    ]
    volts = float(found.sentence.split("about ")[1].split()[0])

    assert volts == pytest.approx(0.3, rel=0.2)


@pytest.mark.parametrize(
    "truth",
    [OddMotor(), OddMotor(stribeck=0.15, stribeck_speed=2.0), OddMotor(drag_asymmetry=0.004)],
    ids=["plain", "friction that falls", "drag by direction"],
)
@pytest.mark.parametrize("kind", ["prbs", "sine"])
def test_without_a_weight_nothing_follows_the_angle(truth: OddMotor, kind: str) -> None:
    assert "weight-by-speed" not in codes(identify(speeds(truth, kind=kind)))


def test_a_position_is_fitted_with_gravity() -> None:
    u = prbs(SAMPLES, 25, np.random.default_rng(7))
    y = marched(OddMotor(gravity_sine=0.5), u, STEP, angle=0.4)[:, 0]
    result = identify(replace(dataset(seed=1, u=u, samples=SAMPLES, sample_time=STEP, y=y), quantum=None))

    assert "weight-by-speed" not in codes(result)
    assert result.fit is not None
    assert "gravity" in result.fit.structure


def test_arms_that_start_at_different_angles_are_seen_together() -> None:
    records = [speeds(OddMotor(gravity_sine=0.5), angle=1.5 * n, seed=n) for n in range(4)]

    assert "weight-by-speed" in codes(identify(records))


@pytest.mark.parametrize("seed", range(6))
def test_a_few_noisy_samples_follow_nothing(seed: int) -> None:
    """Two columns explain two fifths of twelve residuals by chance every third time."""
    t = 0.02 * np.arange(12)
    noise = np.random.default_rng(seed).standard_normal(len(t))
    y = 23.8 * 3.0 * (1.0 - np.exp(-t / 0.1)) + noise
    made = dataset(seed=1, u=np.full(len(t), 3.0), samples=len(t), sample_time=0.02, y=y)
    data = replace(made, kind="speed", output_unit="rad/s", quantum=None, chain_known=True, input_before=0.0)

    assert "weight-by-speed" not in codes(identify(data))
