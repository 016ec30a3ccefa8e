"""Voltages that act later than their samples: told where that moves the time constant, and not where it doesn't.

Time is virtual: the motor is the closed form of a first-order one, driven from the times of writing, which are drawn from a seed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.channels import Array, Channel, DeviceInfo
from servobench.doubts.write_jitter import moved_by_jitter
from servobench.errors import UsageError
from servobench.finding import Severity
from servobench.identification import identify
from servobench.measurement.dataset import Dataset
from servobench.measurement.measure import measure
from servobench.recording.recording import Recording, Series, Source
from servobench.result import Result
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


def recorded(waits: Array, seed: int = 3, noted: bool = True) -> Recording:
    """A run in which each voltage acted so long [s] after its sample."""
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(T))
    columns = {"applied": (U, "V"), "angle": (position(T + waits, U) + noise, "rad")}
    if noted:
        columns["written"] = (T + waits, "s")
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


def told(result: Result) -> list[Severity]:
    return [finding.severity for finding in result.findings if finding.code == "write-jitter"]


def speed() -> Array:
    """The speed at T over its largest, by the exact step of a first-order motor."""
    decay = np.exp(-H / TAU)
    w = np.zeros(len(T))
    for k in range(len(T) - 1):
        w[k + 1] = GAIN * U[k] * (1 - decay) + decay * w[k]
    return np.abs(w) / np.abs(w).max()


def same(size: float) -> Array:
    return np.full(len(T), size)


# All within the 2 ms of a tick: whether they are told was not chosen, but follows from what they do (the first test below).
WAITS = {
    "scatter": np.random.default_rng(8).uniform(0.0, 1.5e-3, len(T)),
    "little scatter": np.random.default_rng(8).uniform(0.0, 2e-5, len(T)),
    "drift": 1.5e-3 * T / T[-1],
    "later upwards": np.where(U > 0, 1.2e-3, 0.2e-3),
    "later when fast": 1.5e-3 * speed(),  # as where each count of the encoder interrupts the processor
    "a little later when fast": 0.2e-3 * speed(),
}


@pytest.fixture(scope="module")
def punctual() -> Result:
    return identified(measure(recorded(same(0.0))))


@pytest.mark.parametrize("kind", WAITS)
def test_what_the_jitter_did_to_the_time_constant_is_known_and_told_from_half_a_deviation_on(
    kind: str, punctual: Result
) -> None:
    """Against a fit to the same data without jitter, with the same noise: the difference is the jitter's doing."""
    waits = WAITS[kind]
    result = identified(measure(recorded(waits)))
    assert result.fit is not None
    assert punctual.fit is not None
    estimate = result.fit["time_constant"]
    moved = estimate.value - punctual.fit["time_constant"].value

    # First order in w leaves w²/(2 τ) of a step's response out, and the map from there to τ is that at the τ found, which is
    # off by moved/τ of itself.
    second_order = float(np.max((waits - waits.mean()) ** 2)) / (2 * TAU) + moved**2 / TAU
    assert moved_by_jitter(result.fit) == pytest.approx(moved, abs=second_order)
    size = abs(moved) / estimate.sd
    assert told(result) == ([Severity.WARNING] if size > 1 else [Severity.INFO] if size > 0.5 else [])


def test_there_are_cases_of_both_kinds() -> None:
    fits = {
        kind: identified(measure(recorded(WAITS[kind]))) for kind in ("scatter", "a little later when fast")
    }

    assert {kind: told(result) for kind, result in fits.items()} == {
        "scatter": [],
        "a little later when fast": [Severity.WARNING],
    }


@pytest.mark.parametrize("wait", [0.0, 2e-4, 1.9e-3])
def test_a_wait_that_is_always_the_same_goes_into_the_delay_and_is_no_news(wait: float) -> None:
    result = identified(measure(recorded(same(wait))))

    assert result.fit is not None
    assert result.fit["delay"].value == pytest.approx(wait, abs=3.3 * result.fit["delay"].sd)
    assert told(result) == []


def test_where_nobody_noted_the_times_of_writing_nothing_is_said() -> None:
    data = measure(recorded(WAITS["later when fast"], noted=False))

    assert data.written is None
    assert told(identified(data)) == []


def test_the_sentence_says_how_long_how_much_and_what_to_do() -> None:
    result = identified(measure(recorded(WAITS["later when fast"])))
    (finding,) = [finding for finding in result.findings if finding.code == "write-jitter"]

    assert finding.parameters == ("time_constant",)
    assert "written 0 to 1500 µs after their samples" in finding.sentence
    assert "moved the time constant by about +1.2 ms, 3.7 of its standard deviations" in finding.sentence
    assert "real-time priority" in finding.sentence


def test_times_of_writing_that_can_not_be_are_not_taken() -> None:
    """Before the sample, or in another order than the samples: a loop that notes something else."""
    for waits in (same(-1e-3), np.where(np.arange(len(T)) % 2 == 0, 5e-3, 0.0)):
        assert measure(recorded(waits)).written is None


def test_the_times_of_writing_belong_to_the_values_of_the_input() -> None:
    data = measure(recorded(same(1e-3)))
    assert data.written is not None

    part = data.part(1.0, 2.0)

    assert np.array_equal(np.asarray(part.written), part.t_input + 1e-3)
    with pytest.raises(UsageError, match="times of writing have shape"):
        replace(data, written=data.written[1:])
