"""The covariance that rounding has, given the path: against all places that the path can have among the counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.identification.estimators.encoder_rounding import counts_in_place, is_rounded, rounding_sines
from servobench.identification.estimators.output_error import OutputError
from servobench.identification.models.base import STRUCTURES
from servobench.recordings.measurement.base import Chain
from tests.datasets import QUANTUM, dataset

PATHS = {
    "at rest": np.zeros(300),
    "to and fro": 7.3 * np.sin(np.linspace(0, 6, 300)),
    "in step with the samples": np.arange(300.0),
    "slowing down": 4 * np.exp(-np.linspace(0, 9, 300)),
}


def power(path: NDArray[np.float64], jacobian: NDArray[np.float64], noise: float) -> NDArray[np.float64]:
    """The covariance of J'e for a path [counts]."""
    sines, white = rounding_sines(jacobian, path * QUANTUM, QUANTUM, noise)
    return np.asarray(sines.T @ sines + white * (jacobian.T @ jacobian))


@pytest.mark.parametrize("path", list(PATHS.values()), ids=list(PATHS))
def test_the_power_is_the_mean_over_all_places_among_the_counts(path: NDArray[np.float64]) -> None:
    """Averaged over 4,001 starts within a count. Eight sines have 93 % of the power, and what is missing is taken for white."""
    jacobian = np.column_stack([np.ones(300), np.linspace(-1, 1, 300)])
    starts = np.arange(4001) / 4001
    errors = [np.floor(path + start) + 0.5 - (path + start) for start in starts]
    expected = np.mean([np.outer(s, s) for s in (jacobian.T @ e for e in errors)], axis=0)
    found = power(path, jacobian, 0.0)
    # The missing 7 % may be anything between none and all in step, and are given the power of 300 white errors.
    white = 0.072 / 12 * 300
    np.testing.assert_allclose(np.diag(found) / QUANTUM**2, np.diag(expected), rtol=0.072, atol=white)


def test_noise_before_the_rounding_makes_it_white() -> None:
    """Half a count of noise leaves e^-10 of what samples at rest share: J'e has the variance of 300 white errors."""
    found = power(np.full(300, 0.3), np.ones((300, 1)), noise=0.25)
    # What the sines still share: 300² e^(-π²)/(2π²) = 0.24 of a count squared.
    assert found[0, 0] / QUANTUM**2 == pytest.approx(300 * (1 / 12 + 0.25), abs=0.25)


def test_only_an_encoders_position_is_rounded() -> None:
    data = dataset(seed=1, samples=300, y=np.zeros(300))
    assert is_rounded(data)
    assert not is_rounded(replace(data, quantum=None))
    assert not is_rounded(replace(data, kind="speed"))


def test_pieces_of_one_recording_are_rounded_by_the_same_counts() -> None:
    """A shaft that goes the same way in both halves is rounded alike in both: four times the power of one, not twice."""
    path, ones = 7.3 * np.sin(np.linspace(0, 6, 300)), np.ones((300, 1))
    (once, white), (again, _) = (rounding_sines(ones, path * QUANTUM, QUANTUM, 0.0) for _ in range(2))
    both = np.concatenate([path, path])

    shared = (once + again).T @ (once + again) + 600 * white
    np.testing.assert_allclose(shared, power(both, np.ones((600, 1)), 0.0))
    starts = np.arange(4001) / 4001
    exact = np.mean([np.sum(np.floor(both + s) + 0.5 - (both + s)) ** 2 for s in starts])
    # As above: 7 % of the power may be missing, or taken for white.
    np.testing.assert_allclose(shared[0, 0] / QUANTUM**2, exact, rtol=0.072, atol=0.072 / 12 * 600)


def test_a_count_beyond_its_place_is_noticed() -> None:
    data = dataset(seed=1, samples=300, y=np.zeros(300))
    residual = np.full(300, 0.4 * QUANTUM)
    assert counts_in_place([data], [residual], unknowns=7)
    residual[::5] = 0.6 * QUANTUM
    assert not counts_in_place([data], [residual], unknowns=7)


def test_behind_an_average_no_count_has_a_place() -> None:
    data = replace(dataset(seed=1, samples=300, y=np.zeros(300)), declared=Chain.parse("average 20 ms"))

    assert not counts_in_place([data], [np.full(300, 0.4 * QUANTUM)], unknowns=7)


def test_intervals_cover_where_the_shaft_often_rests() -> None:
    """Levels of ±0.6 V, a quarter of them within the friction: taken for white, 60 to 67 % of the intervals cover.

    The truth is the model's own response, which other tests hold against a finely stepped motor: only the encoder matters here.
    120 runs at 95 %: fewer than 105 is 1 case in 900.
    """
    structure = STRUCTURES["first_order_coulomb"]
    truth = {"gain": 23.8, "time_constant": 0.1, "coulomb_voltage": 0.16}
    covered = dict.fromkeys(truth, 0)
    for seed in range(120):
        random = np.random.default_rng(seed)
        u = np.repeat(random.uniform(-0.6, 0.6, 38), 40)[:1500]
        data = replace(dataset(seed=seed, samples=1500, y=np.zeros(1500)), u=u)
        theta = np.array([*truth.values(), 0.0, 0.0, random.random() * QUANTUM, 0.0])
        moved = structure.predict(theta, data).y
        fit = OutputError().fit(structure, [replace(data, y=(np.floor(moved / QUANTUM) + 0.5) * QUANTUM)])
        for name, value in truth.items():
            low, high = fit[name].interval
            covered[name] += low <= value <= high
    assert all(count >= 105 for count in covered.values()), covered


def test_where_rounding_is_all_there_is_no_other_covariance_is_computed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its own replaces those for noise of any colour, which took a third of a fit; with noise they are needed."""
    data, structure = dataset(seed=1), STRUCTURES["first_order_one_way"]
    noisy = replace(data, y=data.y + 2 * QUANTUM * np.random.default_rng(1).standard_normal(len(data.y)))
    asked = []
    monkeypatch.setattr(
        "servobench.identification.estimators.output_error.period",
        lambda record: asked.append(record) or None,
    )

    OutputError().fit(structure, [data])
    assert not asked
    OutputError().fit(structure, [noisy])
    assert asked == [noisy]
