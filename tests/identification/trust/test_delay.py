"""An output that comes before its cause, and one that only seems to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.finding import Finding
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.doubts.base import DOUBTS
from servobench.identification.trust.doubts.delay import _sets_off_in_time
from servobench.recordings.measurement.base import Kind
from tests.datasets import dataset
from tests.identification.trust.test_explanations import two_masses


def test_a_lag_that_makes_up_for_a_negative_delay_leaves_the_columns_aligned() -> None:
    """The motor's half of two masses on a spring has zeros that lead: fitted with a winding, lag and delay cancel."""
    fit = identify(two_masses(200.0, 0), structure="second_order").fit
    assert fit is not None
    known = replace(fit, covariance=1e-12 * np.eye(len(fit.model.theta)))  # no interval hides the sign
    lag = fit.model["electrical_time_constant"]

    assert fit.model["delay"] < -0.5 * lag
    assert _doubts(known) == []
    (found,) = _doubts(_with_lag(known, lag - 0.002))  # the sample time is 2 ms
    assert found.code == "delay-negative"
    assert f"comes {with_unit(0.002 - lag - fit.model['delay'], 's', 3)} before" in found.sentence


def test_a_sum_without_an_interval_of_its_own_is_judged_by_its_value() -> None:
    """Lag and delay that are known as a sum only: by rounding, its variance is a little below zero."""
    fit = identify(two_masses(200.0, 0), structure="second_order").fit
    assert fit is not None
    apart = np.array(
        [float(name == "delay") - float(name == "electrical_time_constant") for name in fit.model.names]
    )
    known = replace(fit, covariance=1e-8 * np.outer(apart, apart) - 1e-22)
    lag = fit.model["electrical_time_constant"]

    assert _doubts(known) == []
    assert [found.code for found in _doubts(_with_lag(known, lag - 0.002))] == ["delay-negative"]


def test_a_delay_at_its_shortest_beside_no_time_constant_is_no_motors_whatever_its_interval() -> None:
    """So ended a motor of 60 ms whose input was logged five rows late: its interval reached to zero, and all was trusted."""
    data = dataset(seed=1)
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [data])
    shortest = float(fit.model.structure.bounds([data])[0][fit.model.names.index("delay")])
    wide = replace(fit, covariance=np.diag((0.1 * np.ones(len(fit.model.names))) ** 2))

    def at_the_bound(time_constant: float) -> Fit:
        changed = {"delay": shortest, "time_constant": time_constant}
        theta = np.array([changed.get(name, fit.model[name]) for name in fit.model.names])
        return replace(wide, model=replace(fit.model, theta=theta))

    (doubt,) = _doubts(at_the_bound(0.1 * data.sample_time))
    assert doubt.code == "delay-negative"
    assert (
        f"comes at least {with_unit(-shortest, 's', 3)} before" in doubt.sentence
    )  # what is farther out of step looks the same
    assert _doubts(at_the_bound(5.0 * data.sample_time)) == []


@pytest.mark.parametrize(("upper", "early"), [(-0.7, True), (-0.5, False)])
def test_a_delay_is_judged_by_the_upper_end_of_its_interval(upper: float, early: bool) -> None:
    """In sample times: a standard deviation says too much where an interval lies unevenly about its value."""
    data = dataset(seed=1)
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [data])
    at, step = fit.model.names.index("delay"), data.sample_time
    theta = np.where(np.arange(len(fit.model.theta)) == at, -1.2 * step, fit.model.theta)
    wide = replace(
        fit,
        model=replace(fit.model, theta=theta),
        covariance=np.diag(np.full(len(theta), (0.5 * step) ** 2)),
        intervals={"delay": (-1.9 * step, upper * step)},
    )

    assert [each.code for each in _doubts(wide)] == ["delay-negative"] * early


@pytest.mark.parametrize(("kind", "lag", "early"), [
    ("position", -0.2, True), ("position", 0.2, False), ("speed", -0.4, False), ("speed", -0.6, True),
])  # fmt: skip
def test_all_lags_together_are_no_less_than_nothing(kind: Kind, lag: float, early: bool) -> None:
    """Time constant and delay, known as a sum only, in sample times; a speed may have been differenced half of one ahead."""
    data = dataset(seed=1)
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [data])
    names, step = fit.model.names, data.sample_time
    values = {"time_constant": 0.1 * step, "delay": (lag - 0.1) * step}
    apart = np.array([float(name == "time_constant") - float(name == "delay") for name in names])
    record = replace(fit.records[0], data=replace(data, kind=kind, quantum=None))
    known = replace(
        fit,
        model=replace(fit.model, theta=np.array([values.get(name, fit.model[name]) for name in names])),
        covariance=step**2 * np.outer(apart, apart) + 1e-6 * step**2 * np.eye(len(names)),
        intervals={"delay": (-2.0 * step, step)},
        records=(record,),
    )

    assert [each.code for each in _doubts(known)] == ["delay-negative"] * early


@pytest.mark.parametrize(("lag", "reason"), [(-0.3, "changed evenly"), (-0.7, "misaligned")])
def test_what_an_input_does_between_its_rows_takes_half_a_row_from_the_lag(lag: float, reason: str) -> None:
    """Of a sine, held from row to row; lags in sample times."""
    data = dataset(seed=1, u=3.0 * np.sin(2.0 * np.pi * 0.8 * 0.002 * np.arange(5000)))
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [data])
    names, step = fit.model.names, data.sample_time
    values = {"time_constant": 0.1 * step, "delay": (lag - 0.1) * step}
    known = replace(
        fit,
        model=replace(fit.model, theta=np.array([values.get(name, fit.model[name]) for name in names])),
        covariance=1e-6 * step**2 * np.eye(len(names)),
        intervals={"delay": (-2.0 * step, step)},
    )

    (doubt,) = _doubts(known)

    assert doubt.code == "delay-negative"
    assert reason in doubt.sentence


def _with_lag(fit: Fit, lag: float) -> Fit:
    names = fit.model.names
    theta = np.where([name == "electrical_time_constant" for name in names], lag, fit.model.theta)
    return replace(fit, model=replace(fit.model, theta=theta))


def _doubts(fit: Fit) -> list[Finding]:
    about_fit = DOUBTS["delay"].about_fit
    assert about_fit is not None
    return list(about_fit(fit))


@pytest.mark.parametrize(("late", "in_time"), [(0, True), (20, False)])
def test_a_start_from_rest_shows_whether_the_input_is_in_its_row(late: int, in_time: bool) -> None:
    """Levels that move nothing come first: a start long after one of them shows nothing, one before its own that it is late."""
    u = np.repeat([0.0, 0.1, 3.0, 0.0], 500)
    data = dataset(seed=1, samples=2000, u=u)
    shown = replace(data, u=np.concatenate([np.zeros(late), u[: len(u) - late]]))
    by_rows = np.concatenate([np.full(late, data.y[0]), data.y[: len(u) - late]])

    assert _sets_off_in_time(shown, by_rows, 0.04) == in_time


def test_the_noise_of_a_measured_voltage_is_no_change_that_a_shaft_answers_to() -> None:
    levels = np.repeat([0.0, 3.0, 1.0, 2.0, 1.0, 3.0, 1.0], [100, *[200] * 6])
    data = dataset(seed=1, samples=len(levels), u=levels, chain="derivative")
    noise = 2e-3 * np.random.default_rng(1).standard_normal(len(levels))
    late = replace(data, u=np.concatenate([np.zeros(5), levels[:-5]]) + noise)

    assert "delay-negative" in {each.code for each in identify(late).findings}
