"""A shaft that starts at more than it stops at is noticed, and only such a shaft."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.core.finding import Verdict
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.identification.uncertainty.static_friction import _ends, breakaway, with_static_friction
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset

GAIN, TAU, SLIDING = 40.0, 0.1, 0.5  # counts/(s·V) in tens, s, V
STEP, SAMPLES = 0.05, 1600  # s, 80 s


def triangle(top: float = 1.0, ramps: int = 4) -> NDArray[np.float64]:
    """Two ramps up and down [V], one each way."""
    return np.interp(
        np.arange(SAMPLES), np.linspace(0, SAMPLES, ramps + 1), [0.0, top, 0.0, -top, 0.0][: ramps + 1]
    )


def ramps(static: float, u: NDArray[np.float64] | None = None, tau: float = TAU, seed: int = 1) -> Dataset:
    """Counts of a motor that starts at `static` [V] and slides under 0.5 V, in steps of 1 ms."""
    u = triangle() if u is None else u
    angle, speed, h, y = 0.37, 0.0, 1e-3, np.empty(len(u))
    for n, volts in enumerate(u):
        y[n] = np.floor(angle)
        for _ in range(round(STEP / h)):
            if speed == 0.0 and abs(volts) <= static:
                continue
            sense = np.sign(speed) or np.sign(volts)
            new = speed + h / tau * (10 * GAIN * (volts - SLIDING * sense) - speed)
            speed = 0.0 if new * sense < 0 else new
            angle += h * speed
    made = dataset(seed=seed, u=u, samples=len(u), sample_time=STEP, y=y)
    return replace(made, quantum=1.0, output_unit="counts")


def fit_of_ramps(static: float) -> Fit:
    return ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [ramps(static)])


def test_a_shaft_that_sticks_gives_both_levels() -> None:
    """Each is on the safe side: the start not above the static friction, the stop not below the sliding one."""
    found = breakaway(ramps(0.75))

    assert found is not None
    assert ((found.start > 0.7) & (found.start <= 0.75)).all()
    assert ((found.stop >= SLIDING) & (found.stop < 0.55)).all()


@pytest.mark.parametrize("tau", [0.03, 0.3, 3.0])
def test_without_static_friction_no_lag_looks_like_it(tau: float) -> None:
    found = breakaway(ramps(SLIDING, tau=tau))

    assert found is None or (found.stop > 0.95 * found.start).all()


def test_inputs_that_go_away_at_once_say_nothing_of_the_stop() -> None:
    levels = np.repeat([0.0, 0.4, 0.9, 0.0, -0.4, -0.9, 0.0, 0.45], SAMPLES // 8)

    assert breakaway(ramps(SLIDING, levels)) is None


def test_a_level_that_was_switched_to_long_ago_is_no_slow_start() -> None:
    """A coarse encoder shows the first step of a slow shaft long after that of the input: such a start is a sudden one."""
    rows = np.arange(400)
    turned = np.maximum(rows - 130, 0.0)
    switched, ramped = np.where(rows < 100, 0.0, 0.4), 0.004 * np.minimum(rows, 100)
    run = slice(130, 399)

    starts = [
        _ends(dataset(seed=1, samples=400, u=u, y=turned), run, 1.5, 1.0, 0.0)[0] for u in (switched, ramped)
    ]

    assert starts[0] == 0.0
    assert starts[1] > 0.3


def test_the_interval_holds_start_and_stop() -> None:
    fit = fit_of_ramps(0.75)
    low, high = with_static_friction(fit)["coulomb_voltage"].interval

    assert low <= 0.52
    assert high >= 0.74
    assert {line.source for line in with_static_friction(fit).budget} >= {"static friction"}


def test_the_result_is_that_of_friction_that_falls_with_the_speed() -> None:
    """A quarter of a volt more holds the shaft than brakes it."""
    result = identify(ramps(0.75))

    assert result.verdict == "trusted"
    for name, true in (("gain", 10 * GAIN), ("coulomb_voltage", SLIDING), ("stribeck_voltage", 0.25)):
        low, high = result[name].interval
        assert low <= true <= high


def test_of_a_model_with_one_friction_the_result_says_so_and_is_doubtful() -> None:
    result = identify(ramps(0.75), structure="first_order_coulomb")
    (found,) = [each for each in result.findings if each.code == "static-friction"]

    assert result.verdict == "doubtful"
    assert "starts at 0.7" in found.sentence
    assert "stops at 0.5" in found.sentence


def test_a_motor_that_slides_is_trusted_as_before() -> None:
    fit = fit_of_ramps(SLIDING)

    assert with_static_friction(fit) is fit


def test_a_sequence_of_steps_has_no_slow_starts() -> None:
    """Sampled so rarely that what moves by less than the noise of a moving shaft seems to rest between the steps."""
    for seed in range(1, 11):
        assert breakaway(dataset(seed=seed, kind="prbs", hold=10, samples=1000, sample_time=0.01)) is None


@pytest.mark.parametrize(("gain", "counts"), [(1.1, 1000), (2.2, 500)])
def test_the_steps_of_a_sensor_under_a_fast_chirp_are_no_static_friction(gain: float, counts: int) -> None:
    """At a few hertz the input is far beyond the friction before the first count comes, in the model's own output as well."""
    n, dt, tau, friction = 4000, 0.002, 0.064, 1.045
    t = dt * np.arange(n)
    rate = np.log(7.48 / 0.25) / (n * dt)
    u = 4.3 * np.sin(2 * np.pi * 0.25 / rate * np.expm1(rate * t))
    speed, angle, h, y = 0.0, 0.0, dt / 10, np.empty(n)
    for k, volts in enumerate(u):
        y[k] = np.floor(angle * counts / (2 * np.pi))
        for _ in range(10):
            if speed == 0.0 and abs(volts) <= friction:
                continue
            sense = np.sign(speed) or np.sign(volts)
            new = speed + h / tau * (gain * (volts - friction * sense) - speed)
            speed = 0.0 if new * sense < 0 else new
            angle += h * speed
    quantum = 2 * np.pi / counts
    data = dataset(seed=1, u=u, samples=n, sample_time=dt, y=(y + 0.5) * quantum)

    result = identify(replace(data, quantum=quantum))

    assert "static-friction" not in {each.code for each in result.findings}
    assert result.verdict is Verdict.TRUSTED
