"""The choice between two fits: against SciPy's normal distribution, and against Schwarz's criterion by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from servobench.identification.choice.structure_ladder.comparison import better, deviance, shifts_parameters
from servobench.identification.estimators.base import Fit, FittedRecord
from tests.report.makers import dataset, fit_of

THETA = (20.0, 0.1, 0.3, 0.002)


def fit(residual_sd: float, theta: tuple[float, ...] = THETA, sd: float = 0.01) -> Fit:
    """A fit with 200 residuals, of which the first 20 carry no weight."""
    data = dataset(samples=200)
    residual = residual_sd * np.random.default_rng(4).standard_normal(200)
    record = FittedRecord(
        data=data,
        nuisance=np.empty(0),
        prediction=data.y - residual,
        residual=residual,
        innovations=residual / residual_sd,
        valid=np.arange(200) >= 20,
    )
    return replace(fit_of(theta, sd**2 * np.eye(4), data), residual_sd=residual_sd, records=(record,))


@pytest.mark.parametrize("residual_sd", [0.02, 3.0])
def test_the_deviance_is_that_of_a_normal_distribution_but_for_a_constant(residual_sd: float) -> None:
    found = fit(residual_sd)
    residual = found.records[0].residual[20:]

    # -2 ln of the density has n ln 2π more.
    expected = -2 * norm.logpdf(residual, scale=residual_sd).sum() - 180 * np.log(2 * np.pi)
    assert deviance(found) == pytest.approx(expected, rel=1e-12)


def test_a_parameter_is_worth_it_from_schwarzs_limit_on() -> None:
    """n ln(s₀²/s₁²) > ln n, with the n = 180 that carry weight: s₀/s₁ = e^(ln 180/360)."""
    limit = float(np.exp(np.log(180) / 360))

    assert better(fit(1.0), fit(1.0 * limit * 1.0001))
    assert not better(fit(1.0), fit(1.0 * limit * 0.9999))


@pytest.mark.parametrize("which", [0, 1])
def test_a_fit_is_moved_by_more_than_its_own_standard_deviation(which: int) -> None:
    def shifted(by: float) -> tuple[float, ...]:
        return tuple(value + by * (n == which) for n, value in enumerate(THETA))

    # What counts is what the simpler one, the second, says of itself.
    assert shifts_parameters(fit(1.0, shifted(-0.0101), sd=5.0), fit(1.0, sd=0.01))
    assert not shifts_parameters(fit(1.0, shifted(-0.0099), sd=1e-6), fit(1.0, sd=0.01))
