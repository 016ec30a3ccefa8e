"""Friction near rest that nobody has seen: a line of the budget, as large as the data leave it."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.estimators.output_error import OutputError
from servobench.identification.identify import identify
from servobench.identification.models import near_rest
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.missing_terms import friction_doubt, with_friction_near_rest
from servobench.identification.uncertainty.shares import expected_share, squared_share
from tests.datasets import dataset
from tests.identification.trust.test_missing_terms import odd

SOURCE = "friction near rest"


def line_of(fit: Fit | None) -> float:
    """What part of the gain's variance is the line's."""
    assert fit is not None
    return 1 - (fit.without(SOURCE).sd("gain") / fit.sd("gain")) ** 2


@pytest.mark.parametrize("seed", range(4))
def test_a_precise_record_of_constant_friction_pays_next_to_nothing(seed: int) -> None:
    """Ten seconds of counts tell that friction near rest is what it is at speed: an eighth of the deviation at the most."""
    assert line_of(identify(dataset(seed=seed, kind="prbs")).fit) < 0.25


def test_where_it_is_there_and_the_model_lacks_it_the_intervals_of_the_gain_hold_the_truth() -> None:
    """Friction that is 40 % larger at rest, fitted as if it were constant: the line is what the gain is off by.

    More than 1 miss in 6 with a coverage of 95 %: 3 cases in 100 (binomial); without the line all miss. The friction falls as a
    Gaussian curve here, which the line knows nothing of.
    """
    alone, held = 0, 0
    for seed in range(6):
        bare = OutputError().fit(STRUCTURES["first_order_coulomb"], [odd(seed, stribeck=0.4)])
        fit = with_friction_near_rest(bare)
        alone += abs(bare.model["gain"] - 23.8) < 1.96 * bare.sd("gain")
        held += abs(fit.model["gain"] - 23.8) < 1.96 * fit.sd("gain")
    assert alone <= 1
    assert held >= 5


def test_a_motor_without_friction_or_with_all_of_it_known_has_no_such_line() -> None:
    data = dataset(seed=1, kind="prbs")
    frictionless = ESTIMATORS["output_error"].fit(STRUCTURES["first_order"], [data])
    stribeck = ESTIMATORS["output_error"].fit(
        STRUCTURES["first_order_coulomb_stribeck"], [odd(1, stribeck=0.4)]
    )

    assert not friction_doubt(frictionless).any()
    assert not friction_doubt(stribeck).any()


def test_what_the_data_do_not_tell_is_as_large_as_it_was_expected() -> None:
    """A part between 0 and 1 has a mean square of 1/3, which a chance of none makes less."""
    assert squared_share(0.3, 1e3) == pytest.approx(1 / 3, rel=0.01)
    assert squared_share(0.3, 1e3, near_rest.CHANCE) == pytest.approx(near_rest.CHANCE / 3, rel=0.01)
    assert expected_share(1e3, 0.5) == pytest.approx(0.5 / 3, rel=0.01)


def test_what_the_data_tell_counts_whatever_the_chance() -> None:
    """0.6 ± 0.02 is what it says; 0 ± 0.02 is less than its own deviation, as there may be none."""
    assert squared_share(0.6, 0.02, 0.5) == pytest.approx(0.36, rel=0.01)
    assert squared_share(0.0, 0.02, 0.5) < 0.1 * squared_share(0.0, 0.02) < 0.1 * 0.02**2 * 1.01
    assert np.isfinite(squared_share(-5.0, 0.02, 0.5))
