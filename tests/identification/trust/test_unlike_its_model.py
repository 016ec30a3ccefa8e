"""What a model's own output shows as well is no doubt about it."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.core.finding import Finding, warning
from servobench.identification.estimators.base import ESTIMATORS, Fit, as_predicted
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.doubts.base import unlike_its_model
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


def test_only_what_the_model_does_not_show_is_said(fit: Fit) -> None:
    measured = fit.records[0].data.y

    def about(of: Fit) -> list[Finding]:
        always = [warning("speed-levels-off", "Both show it.")]
        own = np.array_equal(of.records[0].data.y, measured)
        return [*always, warning("speed-by-direction", "The record alone shows it.")] if own else always

    assert [each.code for each in unlike_its_model(about)(fit)] == ["speed-by-direction"]
