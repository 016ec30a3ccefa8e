"""A position that is said to start at rest: where it can't have, and where a fast, slow or delayed motor did."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.finding import Finding
from servobench.identification.trust.doubts.base import about_data
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset

SPEED = 20.0  # rad/s


def position(
    tau: float, *, sample_time: float, speed_before: float = 0.0, counts: int = 2048, delay: float = 0.0
) -> Dataset:
    """A step of a motor that turned at `speed_before` until then, for ten time constants and the delay."""
    t = sample_time * np.arange(int((10.0 * tau + delay) / sample_time) + 30)
    since = np.maximum(t - delay, 0.0)
    way = SPEED * since - (SPEED - speed_before) * tau * -np.expm1(-since / tau)
    quantum = 2 * np.pi / counts
    y = (np.floor(way / quantum) + 0.5) * quantum
    data = dataset(seed=1, samples=len(t), sample_time=sample_time, u=np.full(len(t), 5.0), y=y)
    return replace(data, quantum=quantum, input_before=0.0, starts_at_rest=True)


def codes(data: Dataset) -> set[str]:
    findings: list[Finding] = about_data([data])
    return {each.code for each in findings}


@pytest.mark.parametrize("share", [0.6, 0.9, 1.0])
@pytest.mark.parametrize("tau", [0.02, 0.1, 0.5])
def test_a_shaft_that_turned_before_didn_t_start_at_rest(tau: float, share: float) -> None:
    assert "not-at-rest" in codes(position(tau, sample_time=0.002, speed_before=share * SPEED))


@pytest.mark.parametrize("sample_time", [0.002, 0.02])
@pytest.mark.parametrize("delay", [0.0, 0.03])
@pytest.mark.parametrize("tau", [0.004, 0.01, 0.1, 0.5])
def test_a_motor_that_did_start_at_rest_is_believed(tau: float, delay: float, sample_time: float) -> None:
    assert "not-at-rest" not in codes(position(tau, sample_time=sample_time, delay=delay))


def test_behind_a_coarse_encoder_too() -> None:
    coarse = {"sample_time": 0.005, "counts": 64}

    assert "not-at-rest" in codes(position(0.15, speed_before=SPEED, **coarse))
    assert "not-at-rest" not in codes(position(0.15, **coarse))


def test_two_rows_at_once_in_the_beginning_show_no_speed() -> None:
    """A logger that writes its first two rows 80 µs apart: a window as short as that has no room for a lag."""
    data = position(0.07, sample_time=0.006, delay=0.02, counts=100_000)
    t = np.concatenate([[0.0], data.t_output[:-1] + 8e-5])

    record = replace(data, t_output=t, y=np.interp(t, data.t_output, data.y), quantum=None)

    assert "not-at-rest" not in codes(record)
