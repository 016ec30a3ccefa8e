"""Exponential smoothing, as small boards compute it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.errors import UsageError
from servobench.core.finding import Verdict
from servobench.identification.identify import identify
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.lag import lag_of
from tests.datasets import QUANTUM, dataset
from tests.rig.motor.reference import Truth, march
from tests.truth.test_intervals import answers


def test_it_is_the_line_of_a_sketch() -> None:
    x = np.random.default_rng(1).standard_normal(50)
    y, expected = 0.0, [0.0]
    for each in x[1:].tolist():
        y += 0.2 * (each - y)
        expected.append(y)
    jitter = 1e-3 * np.random.default_rng(2).uniform(-1.0, 1.0, 50)  # of the clock; each row is one pass

    made = Chain.parse("ema 0.2 every 10 ms")(x, 0.01 * np.arange(50) + jitter)

    np.testing.assert_allclose(made, expected, rtol=1e-12)


def test_rows_of_several_passes_remember_as_long() -> None:
    """A loop that takes 1 ms and prints each tenth pass, of something that changes slowly."""
    every, tenth = 0.001 * np.arange(2000), 0.01 * np.arange(200)
    smoothing = Chain.parse("ema 0.05 every 1 ms")

    whole, thinned = smoothing(np.sin(every), every), smoothing(np.sin(tenth), tenth)

    np.testing.assert_allclose(thinned, whole[::10], atol=0.01)
    assert lag_of(smoothing, 0.1) == pytest.approx(0.019, rel=0.05)  # (1 - α)/α passes


@pytest.mark.parametrize(
    "text",
    [
        "ema",
        "ema 0.2",
        "ema 0 every 1 s",
        "ema 1 every 1 s",
        "ema nan every 1 s",
        "ema 0.2 every 0 s",
        "ema 0.2 every 10",
    ],
)
def test_anything_but_a_weight_and_a_time_is_refused(text: str) -> None:
    with pytest.raises(UsageError):
        Chain.parse(text)


def recorded(chain: str) -> Dataset:
    """Differences of counts that a sketch smooths by 0.2, under a chain that its owner names."""
    plain = dataset(seed=1, kind="prbs", samples=3000, sample_time=0.01, hold=20)
    counts = (np.floor(march(Truth(), plain.u, 0.01)[:, 2] / QUANTUM) + 0.5) * QUANTUM
    speed = np.diff(counts, prepend=counts[0]) / 0.01
    for n in range(1, len(speed)):
        speed[n] = speed[n - 1] + 0.2 * (speed[n] - speed[n - 1])
    declared = Chain.parse(chain)
    return replace(
        plain, y=speed, kind="speed", output_unit="rad/s", quantum=None, declared=declared, applied=Chain()
    )


def test_a_motor_behind_it_is_identified_where_a_lowpass_would_be_a_sample_late() -> None:
    result = identify(recorded("derivative | ema 0.2 every 10 ms"))

    assert result.verdict is Verdict.TRUSTED
    assert any("after `ema 0.2 every 0.01 s` was undone" in each.sentence for each in result.findings)
    for name in ("gain", "time_constant"):
        low, high = result[name].interval
        assert low < answers(Truth())[name] < high
    late = identify(recorded("derivative | lowpass 22.31 rad/s zoh"))
    assert late.fit is not None
    assert late.fit["delay"].value == pytest.approx(-0.01, abs=0.002)
