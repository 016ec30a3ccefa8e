"""The benchmark of Rao and Garnier: a fourth-order system with two resonances and a zero in the right half-plane.

The bound is worked out here by SciPy's sampled systems, not by the code's own response; `bench/rao_garnier.py` has more runs.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import cont2discrete, dlsim, tf2ss
from scipy.stats import chi2

from servobench.identification.estimators.base import ESTIMATORS
from servobench.identification.models.base import STRUCTURES
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source
from servobench.systems.signals.prbs import PRBS

A, B, DT = [1.0, 5.0, 408.0, 416.0, 1600.0], [-6400.0, 1600.0], 0.01
TRUTH = np.array([*A[1:], *B])


def held_input(samples: int) -> NDArray[np.float64]:
    """±1 from a register of 10 bits, all ones at first, each bit held for 7 samples."""
    sequence = PRBS(low=-1.0, high=1.0, bit_time=7 * DT, order=10, seed=1023)
    return sequence((np.arange(samples) + 0.5) * DT)


def line(numerator: list[float], denominator: list[float], u: NDArray[np.float64]) -> NDArray[np.float64]:
    """The response to a held input, by SciPy's state space of the sampled system."""
    return np.ravel(dlsim(cont2discrete(tf2ss(numerator, denominator), DT, method="zoh"), u)[1])


def jacobian(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """∂y/∂a_i = -s^(4-i) B/A² u and ∂y/∂b_j = s^(1-j)/A u."""
    square = list(np.polymul(A, A))
    by_a = [line([-b for b in B] + [0.0] * (4 - i), square, u) for i in range(1, 5)]
    by_b = [line([1.0, 0.0], A, u), line([1.0], A, u)]
    return np.column_stack([*by_a, *by_b])


def record(u: NDArray[np.float64], y: NDArray[np.float64]) -> Dataset:
    t = np.arange(len(u)) * DT
    return Dataset(
        name="Rao-Garnier", t_input=t, u=u, input_unit="V", input_before=0.0, t_output=t, y=y, output_unit="rad/s",
        kind="speed", source=Source(name="Rao-Garnier"),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("samples", "published"),
    [
        (7161, [0.0604, 1.062, 3.546, 7.735, 40.4, 71.6]),
        (1000, [0.2146, 4.119, 10.98, 23.19, 113.6, 128.4]),
    ],
)
def test_the_bound_is_that_of_an_earlier_calculation(samples: int, published: list[float]) -> None:
    """Standard deviations at 10 dB, start state and level known, from a program that shares no line with this one."""
    u = held_input(samples)
    y, j = line(B, A, u), jacobian(u)
    bound = np.sqrt(np.mean(y**2) / 10 * np.diag(np.linalg.inv(j.T @ j)))
    np.testing.assert_allclose(bound, published, rtol=1e-3)  # half a unit of the last digit printed

    prediction = STRUCTURES["rational_4_1"].predict(np.append(TRUTH, np.zeros(5)), record(u, y))
    # Rounding of two routes: 1e-16 times a state of the order of 1e6 outputs (s³ of poles at 20 1/s, unscaled, twice over).
    np.testing.assert_allclose(prediction.y, y, atol=1e-9 * np.ptp(y))
    for n in range(6):
        np.testing.assert_allclose(prediction.jacobian[:, n], j[:, n], atol=1e-9 * np.ptp(j[:, n]))


def test_srivc_is_at_the_bound_from_no_start_values_and_its_intervals_cover() -> None:
    runs, u = 30, held_input(7161)
    data = record(u, line(B, A, u))
    structure = STRUCTURES["rational_4_1"]
    noise = np.sqrt(np.mean(data.y**2) / 10)
    j = structure.predict(np.append(TRUTH, np.zeros(5)), data).jacobian
    bound = noise * np.sqrt(np.diag(np.linalg.inv(j.T @ j)))[:6]
    errors, covered = [], 0
    for seed in range(runs):
        y = data.y + noise * np.random.default_rng([seed, 7]).standard_normal(len(u))
        fit = ESTIMATORS["srivc"].fit(structure, [replace(data, y=y)])
        assert fit.converged
        errors.append((fit.model.theta - TRUTH) / bound)
        covered += sum(
            e.interval[0] <= v <= e.interval[1] for e, v in zip(fit.estimates.values(), TRUTH, strict=True)
        )
    # At the bound, the squares' sum over the runs is χ². One of six coefficients is beyond this limit in 1 case of 170.
    assert (np.sum(np.square(errors), axis=0) < chi2.ppf(0.999, runs)).all()
    # 180 intervals, not independent of each other: at the worst as good as 60, of which 95 % are 57 ± 1.7.
    assert covered >= 0.87 * 6 * runs
