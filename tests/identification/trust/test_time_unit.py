"""Seconds that are milliseconds: said so by convention, or by somebody who gave the unit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.finding import Finding
from servobench.identification.identify import identify
from servobench.identification.trust.doubts.base import about_data
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset


def a_thousand_times_slower(sample_time: float) -> Dataset:
    """A record of the reference motor whose times in ms are read as seconds."""
    whole = dataset(seed=1, kind="prbs", samples=1000, sample_time=sample_time)
    return replace(whole, t_input=1000.0 * whole.t_input, t_output=1000.0 * whole.t_output)


def told(findings: list[Finding]) -> list[str]:
    return [each.sentence for each in findings if each.code in ("time-unit-doubtful", "size-absurd")]


@pytest.mark.parametrize(("sample_time", "doubted"), [(0.0005, False), (0.002, False), (0.02, True)])
def test_samples_seconds_apart_are_doubted_whoever_gave_the_unit(sample_time: float, doubted: bool) -> None:
    said = told(about_data([a_thousand_times_slower(sample_time)]))

    assert [("milliseconds" in sentence) for sentence in said] == [True] * doubted


def test_a_time_constant_of_minutes_is_doubted_also_where_the_record_ends_before_it() -> None:
    """A motor of 0.28 s, recorded for half a second every ms: it was trusted with 280 s."""
    t = np.arange(500.0)
    speed = 100.0 * -np.expm1(-t / 280.0) + 0.5 * np.random.default_rng(1).standard_normal(len(t))
    base = dataset(seed=1, samples=len(t), sample_time=1.0, u=np.full(len(t), 5.0))
    record = replace(base, y=speed, kind="speed", output_unit="rad/s", quantum=None, starts_at_rest=True)

    assert any("too long for a servo motor" in sentence for sentence in told(list(identify(record).findings)))


def test_seconds_that_are_read_as_milliseconds_make_a_time_constant_that_no_motor_has() -> None:
    whole = dataset(seed=1, kind="prbs", samples=1000)
    record = replace(whole, t_input=1e-3 * whole.t_input, t_output=1e-3 * whole.t_output)

    assert any("too short for any motor" in sentence for sentence in told(list(identify(record).findings)))
    assert not told(list(identify(whole).findings))
