"""The one voltage that is lost by a motor that turned one way: found whichever way that was, and never a help."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.finding import Severity
from servobench.identification.estimators.base import ESTIMATORS
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.doubts.base import DOUBTS
from servobench.identification.trust.doubts.one_way import hardly_turns_back
from tests.datasets import dataset
from tests.rig.motor.reference import Truth

T = 0.002 * np.arange(4000)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_friction_that_holds_the_shaft_brakes_it_whichever_way_it_turns(way: float) -> None:
    data = dataset(seed=1, samples=len(T), u=way * np.where(T % 2.0 < 1.0, 3.0, 0.0))
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way_rest"], [data])

    assert [each.code for each in DOUBTS["one_way"].about_fit(fit)] == [
        "friction-and-offset-together",
        "offset-found",
    ]


@pytest.mark.parametrize("wired", [1.0, -1.0])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_constant_below_zero_that_brakes_is_explained_and_stated_by_its_size(
    way: float, wired: float
) -> None:
    """It acts on the input, and so has its sign: the sentences say what is lost, and why it is below zero."""
    data = dataset(seed=1, samples=len(T), u=way * np.where(T % 2.0 < 1.0, 3.0, 2.0))
    data = replace(data, y=wired * data.y)
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [data])

    _, lost = (each.sentence for each in DOUBTS["one_way"].about_fit(fit))

    assert np.sign(fit["coulomb_voltage"].value) == way
    assert ("below zero because the input was" in lost) == (way < 0.0)
    assert lost.startswith("0.16")  # 8.4 Ω times 0.8 mN·m over 0.042 V·s


def test_an_interval_below_zero_is_read_out_before_it_is_evidence() -> None:
    """A motor that saturates a little: its friction comes out below zero, and by 2.5 standard deviations."""
    data = dataset(seed=1, samples=len(T), u=np.where(T % 2.0 < 1.0, 3.0, 2.0))
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [data])
    at = fit.model.names.index("coulomb_voltage")
    theta, covariance = fit.model.theta.copy(), fit.covariance.copy()
    theta[at], covariance[at, at] = -0.5, 0.2**2
    below = replace(fit, model=replace(fit.model, theta=theta), covariance=covariance, intervals={})

    (about,) = [each for each in DOUBTS["one_way"].about_fit(below) if each.code == "offset-negative"]

    assert about.severity is Severity.INFO
    assert "Chance does that once in forty times" in about.sentence


def test_a_constant_that_may_be_nothing_is_not_explained() -> None:
    data = dataset(
        seed=1, samples=len(T), u=-np.where(T % 2.0 < 1.0, 3.0, 2.0), truth=Truth(coulomb_torque=0.0)
    )
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [data])

    assert not any("below zero" in each.sentence for each in DOUBTS["one_way"].about_fit(fit))


def test_a_start_speed_that_is_gone_at_once_is_no_turning() -> None:
    """With a time constant of a thousandth of a sample time, any start speed leaves the position as it is."""
    data = dataset(seed=1, kind="prbs", samples=1000)
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [data])
    names = list(fit.model.names)
    theta = fit.model.theta.copy()
    theta[names.index("time_constant")] = 2e-6
    (record,) = fit.records
    nuisance = record.nuisance.copy()
    nuisance[-1] = 1e5
    short = replace(
        fit,
        model=replace(fit.model, theta=theta),
        records=(replace(record, nuisance=nuisance),),
    )

    assert not hardly_turns_back(fit)
    assert not hardly_turns_back(short)


def test_the_finding_on_a_motor_that_turns_back_does_not_suppose_who_chose_the_structure() -> None:
    data = dataset(seed=1, kind="prbs", samples=2000)
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [data])
    (finding,) = DOUBTS["one_way"].about_fit(fit)

    assert finding.code == "structure-reverses"
    assert "`structure=first_order_coulomb`" in finding.sentence
    assert "program" not in finding.sentence
