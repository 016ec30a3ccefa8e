"""The output of a model in place of the one that was recorded: what it shows by itself is no doubt about the motor."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.identification.estimators.base import ESTIMATORS, Fit, as_predicted
from servobench.identification.models.base import STRUCTURES
from tests.datasets import QUANTUM, dataset


@pytest.fixture(scope="module")
def fit() -> Fit:
    return ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [dataset(seed=1, samples=1000)])


def test_the_model_s_output_is_in_the_middle_of_counts_as_a_recording_is(fit: Fit) -> None:
    (record,) = as_predicted(fit).records
    counts = record.data.y / QUANTUM - 0.5

    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-6)
    assert float(np.abs(record.data.y - fit.records[0].prediction).max()) <= 0.5 * QUANTUM * (1 + 1e-9)
    np.testing.assert_array_equal(record.residual, record.data.y - record.prediction)
