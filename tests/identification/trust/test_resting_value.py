"""The value at rest of a duty with one sign."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.core.finding import Finding
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.doubts.base import DOUBTS
from tests.datasets import dataset


def fit_of_duty() -> Fit:
    """A PRBS of a motor that stands still at an input of 50 %, from 20 to 80 %."""
    data = dataset(seed=1, kind="prbs", hold=200)
    shifted = replace(data, u=50.0 + 10.0 * data.u, input_unit="%")
    return ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [shifted])


def doubts(fit: Fit) -> list[Finding]:
    return list(DOUBTS["resting_value"].about_fit(fit))


def test_a_shaft_that_rests_in_the_middle_of_the_range_is_driven_backwards_at_its_lower_end() -> None:
    (doubt,) = doubts(fit_of_duty())

    assert doubt.code == "input-rests-off-zero"
    assert "(value - 127.5)/127.5" in doubt.sentence


def test_one_that_stands_under_the_lowest_input_is_not() -> None:
    """The model may say that it rests in the middle: the record says where it does."""
    fit = fit_of_duty()
    (record,) = fit.records
    low = record.data.input_at_output < 30.0
    steps = np.where(low, 0.0, np.diff(record.data.y, prepend=record.data.y[0]))
    turns_back = np.where(np.arange(len(low)) < len(low) // 2, 1.0, -1.0)
    stands = replace(record, data=replace(record.data, y=np.cumsum(np.abs(steps) * turns_back)))

    assert not doubts(replace(fit, records=(stands,)))
