"""Voltages that act later than their samples: where the loop noted when, no estimate is moved by it.

Time is virtual: the motor is the closed form of a first-order one, driven from the times of writing, which are drawn from a seed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.channels import Array, Channel, DeviceInfo
from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.measure import measure
from servobench.recordings.recording import Recording, Series, Source
from tests.datasets import prbs

GAIN, TAU, H = 23.8, 0.1, 0.002
T = H * np.arange(5000)
U = prbs(5000, 50, np.random.default_rng(2))
NOISE = 1e-3  # rad: as much as the rounding of 2048 counts


def position(changes: Array, u: Array) -> Array:
    """The position at T of a motor that starts at rest, with u (N,) from the times `changes` (N,) on and nothing before.

    A step of size d at time s adds K d (x - τ (1 - e^(-x/τ))), x = t - s > 0.
    """
    out = np.zeros(len(T))
    steps = np.diff(u, prepend=0.0)
    for n in np.flatnonzero(steps):
        x = np.maximum(T - changes[n], 0.0)
        out += GAIN * steps[n] * (x - TAU * -np.expm1(-x / TAU))
    return out


def recorded(
    waits: Array, seed: int = 3, noted: bool = True, more: dict[str, Array] | None = None
) -> Recording:
    """A run in which each voltage acted so long [s] after its sample; `more` channels are times [s]."""
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(T))
    columns = {"applied": (U, "V"), "angle": (position(T + waits, U) + noise, "rad")}
    if noted:
        columns["written"] = (T + waits, "s")
    columns |= {name: (values, "s") for name, values in (more or {}).items()}
    return Recording(
        name="run",
        series=tuple(
            Series(channel=Channel(name=name, unit=unit), values=values, t=T)
            for name, (values, unit) in columns.items()
        ),
        source=Source(name="test"),
        input="applied",
        output="angle",
        input_before=0.0,
        info=DeviceInfo(name="test", timing="host"),
    )


def identified(data: Dataset) -> Result:
    return identify(data, structure="first_order", estimator="output_error")


def speed() -> Array:
    """The speed at T over its largest, by the exact step of a first-order motor."""
    decay = np.exp(-H / TAU)
    w = np.zeros(len(T))
    for k in range(len(T) - 1):
        w[k + 1] = GAIN * U[k] * (1 - decay) + decay * w[k]
    return np.abs(w) / np.abs(w).max()


def same(size: float) -> Array:
    return np.full(len(T), size)


# All within the 2 ms of a tick.
WAITS = {
    "none": same(0.0),
    "always the same": same(1.9e-3),
    "scatter": np.random.default_rng(8).uniform(0.0, 1.5e-3, len(T)),
    "drift": 1.5e-3 * T / T[-1],
    "later upwards": np.where(U > 0, 1.2e-3, 0.2e-3),
    "later when fast": 1.5e-3 * speed(),  # as where each count of the encoder interrupts the processor
}


@pytest.mark.parametrize("kind", WAITS)
def test_no_estimate_is_moved_by_when_a_voltage_was_written(kind: str) -> None:
    """The motor's own figures, without any delay: it was driven from the times of writing."""
    fit = identified(measure(recorded(WAITS[kind]))).fit

    assert fit is not None
    for name, truth in (("gain", GAIN), ("time_constant", TAU), ("delay", 0.0)):
        assert fit[name].value == pytest.approx(truth, abs=3.3 * fit[name].sd), name


def test_where_nobody_noted_it_a_wait_that_follows_the_speed_moves_the_time_constant() -> None:
    """So that the test above has something to show: 1.5 ms of the wait, by 1.2 ms."""
    fit = identified(measure(recorded(WAITS["later when fast"], noted=False))).fit

    assert fit is not None
    assert fit["time_constant"].value > TAU + 1.0e-3


def test_times_of_writing_that_can_not_be_are_not_taken() -> None:
    """Before the sample, or in another order than the samples: a loop that notes something else."""
    for waits in (same(-1e-3), np.where(np.arange(len(T)) % 2 == 0, 5e-3, 0.0)):
        data = measure(recorded(waits))

        assert np.array_equal(data.t_input, T)
        assert data.hidden_delay == 0.0


def test_a_device_that_keeps_the_hosts_time_says_when_it_latched() -> None:
    """In a count of its own, 100 s behind; the shortest asking is taken to take no time."""
    asking = np.random.default_rng(4).uniform(1e-5, 2e-4, len(T))
    times = {"latched": T + asking + 100.0, "handed": T + 4e-4}

    data = measure(recorded(same(5e-4), more=times))

    assert np.allclose(data.t_output, T + asking - asking.min(), rtol=0.0, atol=1e-12)
    assert data.hidden_delay == pytest.approx(1e-4)


def test_a_count_that_jumps_is_no_time_of_a_latch() -> None:
    """By 3 ms, so that samples would have been latched after the voltages that answer to them."""
    data = measure(recorded(same(5e-4), more={"latched": T + np.where(T > 5.0, 3e-3, 0.0)}))

    assert np.array_equal(data.t_output, T)
    assert data.hidden_delay == pytest.approx(5e-4)


def test_what_a_call_hides_is_in_the_interval_of_the_delay_and_of_nothing_else() -> None:
    """A voltage that acted when it was handed over is noted only when it was taken: the delay comes out too short by as much."""
    wait, call = 1e-3, 4e-4
    run = recorded(same(wait), more={"latched": T, "handed": T + wait - call})
    known = identified(measure(recorded(same(wait)))).fit
    hidden = identified(measure(run)).fit

    assert hidden is not None
    assert known is not None
    assert hidden["time_constant"].sd == pytest.approx(known["time_constant"].sd, rel=0.02)
    # Evenly spread over the call, and added to what the noise leaves.
    assert hidden["delay"].sd ** 2 == pytest.approx(
        known["delay"].sd ** 2 - wait**2 / 3 + call**2 / 3, rel=0.02
    )


def test_the_sentence_says_how_long() -> None:
    result = identified(measure(recorded(same(1e-3))))
    (finding,) = [finding for finding in result.findings if finding.code == "delay-within-a-call"]

    assert finding.parameters == ("delay",)
    assert "1e+03 µs" not in finding.sentence
    assert "1000 µs" in finding.sentence


def test_a_gap_is_seen_where_voltages_come_after_their_samples() -> None:
    """Rows 2000 to 2200 are lost, and the input changes within them."""
    keep = (np.arange(len(T)) < 2000) | (np.arange(len(T)) > 2200)
    whole = recorded(same(1e-4))
    torn = replace(whole, series=tuple(replace(s, values=s.values[keep], t=T[keep]) for s in whole.series))

    result = identified(measure(torn))

    assert "gap-input-unknown" in {finding.code for finding in result.findings}


def test_voltages_that_came_late_and_all_at_once_are_no_gap() -> None:
    """A computer that stood still for 31 ms, of 2 ms a tick, and then answered every sample that waited."""
    came = np.maximum(T, np.where((T >= 4.0) & (T < 4.031), 4.0311 + 1e-6 * np.arange(len(T)) / len(T), 0.0))

    result = identified(measure(recorded(came - T)))

    assert "gap-input-unknown" not in {finding.code for finding in result.findings}


def kept_by_device(waits: Array, more: dict[str, Array], delay: float = 0.0) -> Recording:
    """The same run by a device that keeps the time, whose clock is 100 s behind and 50 ppm slow."""
    host = {name: 100.0 + (1 + 50e-6) * values for name, values in more.items() if name != "held_since"}
    run = recorded(waits, noted=False, more={**more, **host})
    return replace(run, info=DeviceInfo(name="test", timing="device", delay=delay))


READ = T + 2e-4 + np.random.default_rng(6).exponential(1e-4, len(T))  # samples take 0.2 ms at least
LATE = WAITS["later when fast"] + READ - T + 1e-4


def test_by_a_device_s_clock_no_estimate_is_moved_by_when_a_voltage_was_written() -> None:
    """The computer's times are carried over into the device's count: what is left is the samples' shortest way, as a delay."""
    times = {"received": READ, "handed": T + LATE - 5e-5, "written": T + LATE}

    data = measure(kept_by_device(LATE, times))
    fit = identified(data).fit

    # Within a write of 50 µs nobody knows when; the shortest of 5,000 ways is known to 0.1 ms / 500.
    assert data.hidden_delay == pytest.approx(5e-5, rel=1e-3)
    assert data.t_input + 2e-4 == pytest.approx(T + LATE, abs=2e-6)
    assert fit is not None
    for name, truth in (("gain", GAIN), ("time_constant", TAU), ("delay", 2e-4)):
        assert fit[name].value == pytest.approx(truth, abs=3.3 * fit[name].sd), name


def test_where_a_board_s_recording_has_no_such_times_a_voltage_holds_from_its_tick_as_before() -> None:
    """As in recordings of earlier versions."""
    data = measure(kept_by_device(LATE, {}))

    assert np.array_equal(data.t_input, T)
    assert data.hidden_delay == 0.0


def test_a_device_that_says_since_when_a_voltage_holds_is_believed_before_the_computer() -> None:
    """On their way from the computer voltages take up to 1 ms more, which only the device knows."""
    put = LATE + np.random.default_rng(7).uniform(0.0, 1e-3, len(T))
    change = np.flatnonzero(np.diff(U, prepend=0.0))
    seen = np.searchsorted((T + put)[change], T, side="right")
    held_since = np.where(seen > 0, (T + put)[change][seen - 1], 0.0)
    times = {"received": READ, "handed": T + LATE - 5e-5, "written": T + LATE, "held_since": held_since}

    data = measure(kept_by_device(put, times))
    fit = identified(data).fit

    assert data.hidden_delay == 0.0
    assert data.t_input[change[:-1]] == pytest.approx((T + put)[change[:-1]], abs=1e-12)
    assert fit is not None
    for name, truth in (("gain", GAIN), ("time_constant", TAU), ("delay", 0.0)):
        assert fit[name].value == pytest.approx(truth, abs=3.3 * fit[name].sd), name


def test_a_device_that_states_a_delay_puts_voltages_out_by_its_own_clock() -> None:
    """As one that exchanges both at its tick: how late the computer wrote is nothing to it."""
    times = {"received": READ, "handed": T + LATE, "written": T + LATE}

    assert np.array_equal(measure(kept_by_device(LATE, times, delay=H)).t_input, T)
