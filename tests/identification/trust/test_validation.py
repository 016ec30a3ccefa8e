"""The residual is compared with the input, but not where each count is where the model puts it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.identification.estimators.base import ESTIMATORS
from servobench.identification.estimators.residual_correlation import TIED, input_correlation
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.validation import validate
from tests.datasets import dataset


def test_rounding_that_repeats_with_the_input_is_no_missing_response() -> None:
    """Reversals each half second, over the same counts: what the model leaves over goes with the input, and is rounding."""
    t = 0.002 * np.arange(2000)
    data = dataset(seed=5, samples=2000, u=np.where(t % 1.0 < 0.5, 2.0, -2.0))
    fit = ESTIMATORS["interval_likelihood"].fit(STRUCTURES["first_order_coulomb"], [data])
    taken_for_noise = replace(fit, estimator="output_error")

    assert input_correlation(fit.records[0]) > TIED
    assert "residual-follows-input" not in [each.code for each in validate(fit)]
    assert "residual-follows-input" in [each.code for each in validate(taken_for_noise)]
