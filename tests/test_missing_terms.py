"""Score tests for missing terms: against motors that have the term, and motors that haven't."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.finding import Verdict
from servobench.identification import identify
from servobench.measurement.dataset import Dataset
from servobench.missing_terms import TERMS
from servobench.result import Result
from tests.datasets import QUANTUM, dataset

H, STEPS = 0.002, 200


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _odd_motor(u, stribeck, drag, lopsided, out):  # type: ignore[no-untyped-def]
    """A first-order motor of 23.8 rad/(s·V) and 0.1 s with what the model doesn't know, in steps of 10 µs."""
    gain, tau, coulomb = 23.8, 0.1, 0.16
    dt = H / STEPS
    w = theta = 0.0
    for n in range(len(u)):
        out[n] = theta
        for _ in range(STEPS):
            lost = coulomb * (1.0 + stribeck * np.exp(-((w / 6.0) ** 2)))
            push = u[n] * (1.0 + lopsided * np.sign(w)) - drag * w * abs(w)
            free = w + dt / tau * (gain * push - w)
            stop = dt / tau * gain * lost
            new = free - min(stop, max(-stop, free))
            theta += 0.5 * dt * (w + new)
            w = new


def odd(seed: int, *, stribeck: float = 0.0, drag: float = 0.0, lopsided: float = 0.0) -> Dataset:
    data = dataset(seed=seed, kind="prbs", y=np.zeros(5000))
    angle: NDArray[np.float64] = np.empty(5000)
    _odd_motor(data.u, stribeck, drag, lopsided, angle)
    return replace(data, y=(np.floor((angle + 1e-3) / QUANTUM) + 0.5) * QUANTUM)


def doubts(result: Result) -> set[str]:
    return {finding.code for finding in result.findings} & {term.code for term in TERMS}


@pytest.mark.parametrize("seed", range(5))
def test_a_motor_that_is_as_the_model_says_is_trusted(seed: int) -> None:
    result = identify(odd(seed))
    assert doubts(result) == set()
    assert result.verdict == Verdict.TRUSTED


@pytest.mark.parametrize(
    ("code", "what"),
    [
        ("friction-depends-on-speed", {"stribeck": 0.3}),
        ("drag-not-linear", {"drag": 2e-5}),  # 0.09 V of 3 V at full speed
        ("directions-differ", {"lopsided": 0.02}),
    ],
)
def test_what_the_model_lacks_is_named(code: str, what: dict[str, float]) -> None:
    result = identify(odd(1, **what))
    assert code in doubts(result)
    assert result.verdict == Verdict.DOUBTFUL


@pytest.mark.parametrize("kind", ["square", "prbs"])
@pytest.mark.parametrize("noise", [0.0, 1e-6, 1e-5])
def test_neither_an_encoder_nor_a_random_torque_is_taken_for_a_missing_term(kind: str, noise: float) -> None:
    for seed in range(5):
        result = identify(dataset(seed=seed, kind=kind, torque_noise=noise))  # type: ignore[arg-type]
        assert doubts(result) == set()
        assert "residual-follows-input" not in {finding.code for finding in result.findings}


def test_a_second_pole_of_a_tenth_of_the_time_constant_is_not_trusted() -> None:
    """Prediction error would take it for a disturbance: the time constant 8 % wrong, and no colour left."""
    from tests.motor.reference import Truth

    result = identify(dataset(seed=1, truth=Truth(inductance=84e-3)))
    assert result.verdict == Verdict.DOUBTFUL
    assert "residual-follows-input" in {finding.code for finding in result.findings}
