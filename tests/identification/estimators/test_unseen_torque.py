"""A random torque that may act unseen: intervals as wide as the mixture of its levels reaches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.estimators import unseen_torque
from servobench.identification.estimators.base import ESTIMATORS
from servobench.identification.estimators.unseen_torque import tail_factor, with_unseen_torque
from servobench.identification.models.base import STRUCTURES
from tests.datasets import QUANTUM, dataset
from tests.rig.motor.reference import Truth, march

DRAWS = 400_000


@pytest.mark.parametrize("weights", [(0.9, 0.1), (0.97, 0.03), (0.5, 0.5)])
def test_one_in_a_hundred_of_a_mixture_lies_beyond(weights: tuple[float, float]) -> None:
    """By drawing from it: 1 % of 400,000, to within four standard deviations of 0.016 %."""
    random = np.random.default_rng(4)
    means, sd = np.array([0.0, 1.5]), np.array([1.0, 6.0])
    which = random.choice(2, DRAWS, p=weights)
    drawn = means[which] + sd[which] * random.standard_normal(DRAWS)
    variance = float(np.array(weights) @ (means**2 + sd**2))

    far = 2.5758 * tail_factor(np.array(weights), means, sd**2, variance) * np.sqrt(variance)

    assert float(np.mean(np.abs(drawn) > far)) == pytest.approx(0.01, abs=6.5e-4)


def test_a_single_normal_distribution_stays_as_it_is() -> None:
    assert tail_factor(np.ones(1), np.zeros(1), np.full(1, 4.0), 4.0) == pytest.approx(1.0, rel=2e-3)


def test_a_parameter_that_every_level_holds_at_its_place_stays_as_it_is() -> None:
    assert tail_factor(np.array([0.5, 0.5]), np.zeros(2), np.zeros(2), 0.0) == 1.0


def test_the_offset_of_a_short_noisy_record_reaches_as_far_as_the_mixture(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Half a second of a sine behind two counts of noise, which leaves open whether a torque acts."""
    t = 0.001 * np.arange(500)
    plain = dataset(
        seed=1, u=6.0 * np.sin(8 * np.pi * t), samples=500, sample_time=0.001, truth=Truth(inductance=1e-9)
    )
    y = plain.y + 2 * QUANTUM * np.random.default_rng(1).standard_normal(500)
    fit = ESTIMATORS["output_error"].fit(
        STRUCTURES["first_order_coulomb"], [replace(plain, y=y, quantum=None)]
    )

    reaching = with_unseen_torque(fit)
    monkeypatch.setattr(unseen_torque, "tail_factor", lambda *_: 1.0)
    of_its_variance = with_unseen_torque(fit)

    assert reaching.sd("offset_voltage") > 1.3 * of_its_variance.sd("offset_voltage")
    assert reaching.sd("gain") >= of_its_variance.sd("gain")


@pytest.mark.parametrize(("volts", "hertz", "friction"), [(0.8, 0.5, 0.002), (1.0, 0.3, 0.003)])
def test_rounding_that_lasts_is_not_taken_for_a_torque(volts: float, hertz: float, friction: float) -> None:
    """A slow swing with rests behind 100 counts a turn: its rounding wanders, but every count is where the model puts it.

    A torque that leaves them there makes the gain a few times as uncertain as rounding alone; the likeliest one of white rounding
    made it 47 and 68 times as uncertain.
    """
    t = 0.001 * np.arange(6000)
    u = volts * (np.sin(2 * np.pi * hertz * t) + 0.6 * np.sin(4.6 * np.pi * hertz * t + 1))
    truth = Truth(inductance=1e-9, viscous_friction=0.0, coulomb_torque=friction)
    quantum = 2 * np.pi / 100
    y = (np.floor((march(truth, u, 0.001)[:, 2] + 0.1) / quantum) + 0.5) * quantum
    data = replace(dataset(seed=1, u=u, samples=len(t), sample_time=0.001, y=y), quantum=quantum)
    fit = ESTIMATORS["interval_likelihood"].fit(STRUCTURES["first_order_coulomb"], [data])

    wider = with_unseen_torque(fit)

    assert fit.sd("gain") < wider.sd("gain") < 10 * fit.sd("gain")
