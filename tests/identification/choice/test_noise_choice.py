"""Where prediction error shows that output error ended in a wrong place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.choice.noise_choice import allow_for_disturbance
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.estimators.delay_prior import is_in_several_places
from servobench.identification.estimators.disturbance import Profile
from servobench.identification.estimators.least_squares import lowest
from servobench.identification.estimators.output_error import fit_minimum
from servobench.identification.estimators.prediction_error import PredictionError
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.validation import explains_the_colour
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset
from tests.rig.motor.reference import Truth, march

GAIN, TIME_CONSTANT, COULOMB = 2.78, 0.0065, 0.62


def one_sine() -> Dataset:
    """A motor of six samples in a time constant under a sine of four volts, recorded while it ran."""
    constant, step, quantum, before = 1 / GAIN, 0.00108, 2 * np.pi / 19442, 60
    motor = Truth(
        resistance=1.0,
        inductance=1e-6,
        motor_constant=constant,
        inertia=TIME_CONSTANT * constant**2,
        viscous_friction=0.0,
        coulomb_torque=COULOMB * constant,
    )
    random = np.random.default_rng(6)
    rate = 2 * np.pi / random.uniform(25, 70)
    u = 4.16 * np.sin(rate * np.arange(before + 151) + random.uniform(0, 6.28))
    angle = march(motor, np.roll(u, 1), step, angle=random.uniform(0, 0.1))[before:, 2]
    y = (np.floor(angle / quantum) + 0.5) * quantum
    data = dataset(seed=1, samples=151, sample_time=step, u=u[before:], y=y)
    return replace(data, quantum=quantum, input_before=float(u[before - 1]))


BESIDE = np.array([2.975, 7.609e-3, 0.6581, -6.923e-4, 5.873e-4, 5.061e-2, 2.354])
"""Another minimum of that record: gain, time constant, Coulomb and offset voltage, delay, angle and speed at the start."""


def squares(fit: Fit) -> float:
    return float(np.sum(fit.records[0].residual ** 2))


def test_a_search_that_ended_beside_the_minimum_goes_on_from_where_prediction_error_came_to() -> None:
    data = one_sine()
    structure = STRUCTURES["first_order_coulomb"]
    first = fit_minimum(structure, [data], lowest(structure, [data], [BESIDE]))
    found = allow_for_disturbance(first)
    assert squares(found) < 0.95 * squares(first)
    fit = identify(data).fit
    assert fit is not None
    assert fit.estimator == "output_error"  # nothing shakes this motor
    for name, true in (("gain", GAIN), ("time_constant", TIME_CONSTANT), ("coulomb_voltage", COULOMB)):
        low, high = fit[name].interval
        assert low < true < high, name


def test_rests_of_an_unknown_encoder_are_no_evidence_against_a_random_torque() -> None:
    """At rest all samples are rounded alike, which colours the innovations, but not at the frequencies of the parameters."""
    u = np.repeat(np.random.default_rng(1).choice([0.0, 3.0], 20), 250)
    shaken = dataset(seed=1, u=u, torque_noise=1e-6, truth=Truth(coulomb_torque=8e-4))
    data = replace(shaken, quantum=None)

    fit = allow_for_disturbance(
        ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way_rest"], [data])
    )

    assert fit.estimator == "prediction_error"
    assert abs(fit["gain"].value - 23.697) < 3 * fit["gain"].sd  # k/(R b + k²)


def test_a_prediction_error_whose_simulation_is_far_from_the_record_is_not_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A random torque makes a simulation wander from the record, and not ten times as far as the nearest one."""
    data = dataset(seed=3, kind="prbs", torque_noise=2e-3)
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [data])
    assert allow_for_disturbance(fit).estimator == "prediction_error"
    search = PredictionError.fit_after

    def fit_astray(method: PredictionError, before: Fit, test: Profile) -> Fit:
        after = search(method, before, test)
        away = 11.0 * before.records[0].residual
        return replace(after, records=(replace(after.records[0], residual=away),))

    monkeypatch.setattr(PredictionError, "fit_after", fit_astray)
    assert allow_for_disturbance(fit).estimator == "output_error"


@pytest.mark.parametrize("noise", [1e-5, 3e-5])
def test_a_random_torque_that_hides_the_delay_of_a_shaft_that_swings_is_allowed_for(noise: float) -> None:
    """To output error several delays are as good, each with its own friction: it knew the gain to 20 %, not to 0.3."""
    u = 5.0 * np.sin(2 * np.pi * 1.5 * 0.002 * np.arange(4000))
    data = dataset(seed=3, samples=4000, u=u, torque_noise=noise, truth=Truth(coulomb_torque=0.006))
    first = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [data])
    assert is_in_several_places(first)

    fit = allow_for_disturbance(first)

    assert fit.estimator == "prediction_error"
    assert fit.sd("gain") < 0.1 * first.sd("gain")
    motor = Truth()
    gain = motor.motor_constant / (motor.motor_constant**2 + motor.resistance * motor.viscous_friction)
    low, high = fit["gain"].interval
    assert low < gain < high


def faintly_coloured(memory: float) -> Fit:
    """The fit of a motor without friction behind noise of which each value keeps a part of the one before."""
    plain = dataset(seed=1, kind="prbs", samples=5000, truth=Truth(coulomb_torque=0.0, inductance=1e-9))
    white = np.random.default_rng(2).standard_normal(5001)
    y = plain.y + 0.02 * (white[1:] + memory * white[:-1])
    return ESTIMATORS["output_error"].fit(STRUCTURES["first_order"], [replace(plain, y=y, quantum=None)])


def test_a_faint_colour_that_no_torque_makes_widens_nothing() -> None:
    """The other weighing knows a tenth as much where noise is white: what the two differ by is no error of the model."""
    fit = faintly_coloured(0.1)
    assert not explains_the_colour(fit)

    assert allow_for_disturbance(fit) is fit


def test_a_plain_colour_is_weighed_twice() -> None:
    assert "weighed-twice" in {each.code for each in allow_for_disturbance(faintly_coloured(-0.7)).findings}


def test_in_a_loop_whose_input_never_comes_back_rounding_does_not_repeat() -> None:
    data = dataset(seed=1, kind="prbs", samples=2500)
    in_a_loop = replace(data, reference=np.zeros(2500))
    assert in_a_loop.closed_loop

    fit = allow_for_disturbance(
        ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [in_a_loop])
    )

    assert "rounding-repeats" not in {finding.code for finding in fit.findings}
