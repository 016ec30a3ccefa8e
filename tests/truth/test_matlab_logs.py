"""Logs of two motors in MATLAB's own objects: each is read whole, and says the gain that an independent fit finds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from servobench.core.finding import Verdict
from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.recordings.formats.base import load
from servobench.recordings.formats.mapping import assign
from servobench.recordings.measurement.measure import measure
from servobench.recordings.recording import Recording

RealData = Callable[[str], Path]

TIMESERIES = {
    "2026-02-06_19-54-24_Step": 25502,
    "2026-02-06_19-57-16_Ramp": 25502,
    "2026-02-06_20-01-36_Sine_pi_2": 25502,
    "2026-02-06_20-06-51_Sine_pi": 25502,
    "2026-02-06_20-09-36_Sine_2pi": 25502,
    "2026-02-06_20-12-42_Stair": 25502,
    "2026-02-06_20-21-20_Chirp": 25502,
    "2026-02-06_20-22-09_Chirp": 25502,
}
STREAMS = {"Ramp_25Percent_Rec1": "Ramp", "Stair_0.5Hz_Rec1": "Stair2", "Step_40Percent_Rec1": "Step1"}
GAIN = (21.85, 22.2)  # rad/(s·V), of eight recordings one by one, first order with friction, offset and delay
GAIN_OF_COUNTS = 3.89e-3  # rad/(s·counts), of 72 recordings
COULOMB_OF_COUNTS = 0.73 / 12 * 65535  # counts, of the same


def one(path: Path) -> Recording:
    (recording,) = load(path)
    return recording


def identified(recording: Recording, input: str, output: str) -> Result:
    return identify([measure(assign(recording, input=input, output=output))])


@pytest.mark.parametrize(("name", "samples"), TIMESERIES.items())
def test_timeseries_of_the_board_are_read_whole(name: str, samples: int, real_data: RealData) -> None:
    recording = one(real_data(f"fra233/{name}.mat"))

    assert [each.channel.name for each in recording.series] == ["sig_speed", "sig_volt"]
    for series in recording.series:
        assert series.t is not None
        assert len(series.values) == samples
        assert np.allclose(np.diff(series.t), 1e-3, rtol=0, atol=1e-9)
    # The speed is a difference of counts of an encoder with 8192 a turn, at 1 kHz.
    step = 2 * np.pi / 8192 * 1000
    assert np.abs(recording["sig_volt"].values).max() == pytest.approx(12, abs=1e-9)
    assert np.abs(np.mod(recording["sig_speed"].values / step + 0.5, 1) - 0.5).max() < 1e-3


@pytest.mark.parametrize(("name", "input"), STREAMS.items())
def test_streams_of_simulink_are_read_whole(name: str, input: str, real_data: RealData) -> None:
    recording = one(real_data(f"fra233_pwm/{name}.mat"))

    assert [each.channel.name for each in recording.series] == ["data.Angular_Velocity", f"data.{input}"]
    for series in recording.series:
        assert series.t is not None
        assert np.allclose(np.diff(series.t), 2e-4, rtol=0, atol=1e-9)
        assert np.isfinite(series.values).all()
    # Full scale is 65535 counts; the motor turns at no more than 12 V times its gain.
    assert recording["data.Angular_Velocity"].values.max() < 12 * GAIN[1]


@pytest.mark.parametrize(
    "name", ["2026-02-06_20-12-42_Stair", "2026-02-06_20-01-36_Sine_pi_2", "2026-02-06_20-21-20_Chirp"]
)
def test_each_timeseries_says_the_gain_of_the_independent_fit(name: str, real_data: RealData) -> None:
    result = identified(one(real_data(f"fra233/{name}.mat")), "sig_volt:V", "sig_speed:rad/s")

    assert result.fit is not None
    low, high = result.fit["gain"].interval
    assert low < GAIN[1]
    assert high > GAIN[0]
    # The interval must tell something, too. The eight recordings lie within 1.6 % of each other; one alone doesn't show that.
    assert high - low < 0.08 * GAIN[0]
    assert result.verdict != Verdict.REFUSED


def test_a_streamed_stair_says_the_gain_and_the_friction_of_the_independent_fit(real_data: RealData) -> None:
    recording = one(real_data("fra233_pwm/Stair_0.5Hz_Rec1.mat"))

    result = identified(recording, "data.Stair2:counts", "data.Angular_Velocity:rad/s")

    assert result.fit is not None
    assert result.fit["gain"].interval[0] < GAIN_OF_COUNTS < result.fit["gain"].interval[1]
    low, high = result.fit["coulomb_voltage"].interval
    assert low < COULOMB_OF_COUNTS < high
