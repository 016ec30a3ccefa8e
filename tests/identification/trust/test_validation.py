"""The residual is compared with the input, but not where each count is where the model puts it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.identification.estimators.base import ESTIMATORS, FittedRecord
from servobench.identification.estimators.residual_correlation import TIED, input_correlation
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.validation import validate
from tests.datasets import dataset
from tests.rig.motor.reference import Truth


def as_if_measured(record: FittedRecord) -> FittedRecord:
    """The record without its encoder, as if the residual were a measurement's noise."""
    return replace(record, data=replace(record.data, quantum=None))


def test_rounding_that_repeats_with_the_input_is_no_missing_response() -> None:
    """Reversals each half second, over the same counts: what the model leaves over goes with the input, and is rounding."""
    t = 0.002 * np.arange(2000)
    data = dataset(seed=5, samples=2000, u=np.where(t % 1.0 < 0.5, 2.0, -2.0))
    fit = ESTIMATORS["interval_likelihood"].fit(STRUCTURES["first_order_coulomb"], [data])
    taken_for_noise = replace(fit, estimator="output_error")

    of_noise = replace(taken_for_noise, records=tuple(map(as_if_measured, fit.records)))
    assert input_correlation(of_noise) > TIED
    assert input_correlation(taken_for_noise) < TIED
    for each in (fit, taken_for_noise):
        assert "residual-follows-input" not in [finding.code for finding in validate(each)]


def test_a_second_pole_shows_beside_the_rounding_that_repeats() -> None:
    """L/R of 5 ms beside a time constant of 0.1 s, reversed each half second."""
    t = 0.002 * np.arange(2000)
    truth = Truth(inductance=5e-3 * Truth().resistance)
    data = dataset(seed=5, samples=2000, u=np.where(t % 1.0 < 0.5, 2.0, -2.0), truth=truth)
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [data])

    assert input_correlation(fit) > TIED
