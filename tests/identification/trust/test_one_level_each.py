"""Records of one level each, one of which is in another unit or of another motor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.doubts.base import DOUBTS
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset


def run(level: float, divisor: float = 1.0) -> Dataset:
    """The reference motor from rest at one level [V], whose output was divided by something."""
    made = dataset(seed=1, samples=1000, u=np.full(1000, level), chain="derivative")
    return replace(made, y=made.y / divisor, starts_at_rest=True, input_before=0.0, name=f"{level:g} V")


def fit_of_levels(divisor: float, levels: tuple[float, ...] = (2.0, 4.0)) -> Fit:
    """The joint fit of a run at each level [V], the first of which is divided by something."""
    runs = [run(level, divisor if n == 0 else 1.0) for n, level in enumerate(levels)]
    return ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], runs)


def codes(fit: Fit) -> list[str]:
    return [each.code for each in DOUBTS["one_level_each"].about_fit(fit)]


@pytest.mark.parametrize("divisor", [57.29578, 3.0])
def test_radians_among_degrees_and_a_slower_motor_take_more_friction_than_motors_have(divisor: float) -> None:
    (finding,) = DOUBTS["one_level_each"].about_fit(fit_of_levels(divisor))

    assert "in one unit" in finding.sentence


def test_runs_of_one_motor_are_no_doubt() -> None:
    assert codes(fit_of_levels(1.0)) == []


def test_four_records_show_themselves_which_one_differs() -> None:
    assert codes(fit_of_levels(3.0, (2.0, 3.0, 4.0, 5.0))) == []


def test_a_record_with_two_levels_shows_its_friction() -> None:
    two = dataset(seed=1, samples=1000, u=np.repeat([2.0, 4.0], 500), chain="derivative")
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [two, run(3.0, 10.0)])

    assert codes(fit) == []
