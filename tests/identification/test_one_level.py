"""A motor that one level of the input only moved: what is known of it, and what isn't."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from servobench.core.finding import Verdict
from servobench.identification.identify import identify
from servobench.identification.trust.doubts.single_level import widen_for_gain_friction_split
from servobench.identification.uncertainty.identifiability import State
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.report.mathml import transfer_function_math
from tests.contracts.finding_examples.base import fitted, with_sd, with_values
from tests.datasets import QUANTUM, dataset
from tests.rig.motor.reference import Truth, march
from tests.truth.test_intervals import answers

T = np.arange(2400) * 0.002


def stepped(*levels: float) -> Dataset:
    """The reference motor, which has 0.16 V of friction, under levels of the same length."""
    u = np.repeat(levels, len(T) // len(levels))
    angle = march(Truth(), u, 0.002, angle=0.3 * QUANTUM)[:, 2]
    data = dataset(seed=1, samples=len(T), y=(np.floor(angle / QUANTUM) + 0.5) * QUANTUM)
    return replace(data, u=u, input_before=levels[0])


def test_a_single_step_tells_neither_gain_nor_friction_but_the_time_constant() -> None:
    """K (u - u_c) = 43.6 rad/s is all that the steady speed at 2 V says: 23.7 and 0.16 V make it as well as 21.8 and none."""
    result = identify(stepped(0.0, 2.0))
    assert result.fit is not None
    assert result.verdict is Verdict.TRUSTED
    assert [finding.code for finding in result.findings].count("single-level") == 1
    assert "parameter-unknown" not in {finding.code for finding in result.findings}
    for name in ("gain", "coulomb_voltage"):
        low, high = result.fit[name].interval
        assert low in (-np.inf, 0.0)  # a friction isn't negative
        assert high == np.inf
    tau = result.fit["time_constant"]
    assert tau.value == pytest.approx(answers(Truth())["time_constant"], rel=2e-3)
    assert tau.sd < 0.2 * tau.value  # one event: the allowance for model error is whole, 35 % of the lag


def test_noise_before_the_step_makes_no_gain_known() -> None:
    """Of a motor with 30 % of friction, a gain without any, of 1.4 for 2.0, was stated as known and trusted."""
    rng, step, speed, angle = np.random.default_rng(2), 1e-4, 0.0, 0.0
    u = np.where(np.arange(400) < 50, 0.0, 100.0)
    y = np.zeros(len(u))
    for k, level in enumerate(u):
        y[k] = angle + 0.02 * rng.standard_normal()
        for _ in range(20):
            drive = 2.0 * (level - 30.0) - 20.0 * np.sin(angle) if level else 0.0
            speed += step * (drive - speed) / 0.03
            angle += step * speed
    data = replace(dataset(seed=1, samples=len(u), y=y), u=u, input_before=0.0, quantum=None, input_unit="%")

    result = identify(data)
    told = result.to_dict()

    assert "single-level" in {each.code for each in result.findings}
    assert told["parameters"]["gain"]["state"] == "combination"
    assert told["combinations"]["speed_at_level"]["value"] == pytest.approx(140.0, rel=0.03)


def test_the_poles_are_known_and_the_margins_are_not() -> None:
    derived = identify(stepped(0.0, 2.0)).derived
    assert np.isfinite(derived["pole"].interval).all()
    assert not np.isfinite(derived["gain_crossover"].interval).any()


@pytest.mark.parametrize("levels", [(2.0, 1.0), (0.0, 2.0, 0.0), (2.0, -2.0)])
def test_a_second_level_or_coasting_tells_them_apart(levels: tuple[float, ...]) -> None:
    fit = identify(stepped(*levels)).fit
    assert fit is not None
    assert np.isfinite(fit["gain"].sd)
    assert fit["gain"].value == pytest.approx(answers(Truth())["gain"], rel=0.01)


def test_a_number_that_is_not_known_is_not_printed() -> None:
    result = identify(stepped(0.0, 2.0))
    assert result.fit is not None
    lines = str(result).splitlines()

    assert [" ".join(line.split()) for line in lines if line.startswith(("gain", "Coulomb"))] == [
        "gain known together only",
        "Coulomb voltage known together only",
    ]
    assert result.equation.startswith("G(s) = K / (")
    assert f"{result.fit['gain'].value:.3g}"[:3] not in result.equation
    assert "<mi>K</mi>" in transfer_function_math(result)
    assert f"{result.fit['gain'].value:.4g}" not in transfer_function_math(result)
    assert result.to_dict(derived=False)["transfer_function"]["unknown"] == ["K", "d"]
    assert identify(dataset(seed=1)).to_dict(derived=False)["transfer_function"]["unknown"] == []


def test_a_time_constant_that_is_not_known_is_a_letter_in_the_equation() -> None:
    result = identify(stepped(2.0, 1.0))
    bounded = replace(result.answers["time_constant"], state=State.BOUNDED)
    unknown = replace(result, answers={**result.answers, "time_constant": bounded})

    assert "(τ s + 1), τ isn't known" in unknown.equation
    assert "τ" not in result.equation
    assert transfer_function_math(result).count("<mi>τ</mi>") == 1
    assert transfer_function_math(unknown).count("<mi>τ</mi>") == 2  # in the numbers, too


def test_an_equation_of_which_no_number_is_known_has_none_on_the_page() -> None:
    result = identify(stepped(2.0, 1.0))
    open_ones = {n: replace(each, state=State.UNKNOWN) for n, each in result.answers.items()}

    assert re.findall(r"<mn>([^<]*)</mn>", transfer_function_math(replace(result, answers=open_ones))) == [
        "1"
    ]


def test_a_delay_that_may_be_none_is_not_in_the_equation() -> None:
    result = identify(stepped(2.0, 1.0))
    assert result.fit is not None
    fit = result.fit
    at = fit.model.names.index("delay")
    theta, covariance = fit.model.theta.copy(), fit.covariance.copy()
    theta[at], covariance[at, at] = 1e-5, 1e-8
    tiny = replace(fit, model=replace(fit.model, theta=theta), covariance=covariance)

    assert "e^" not in replace(result, fit=tiny).equation
    covariance[at, at] = 1e-14
    sure = replace(result, fit=replace(tiny, covariance=covariance))
    for state in State:
        answer = replace(result.answers["delay"], state=state)
        shown = "e^" in replace(sure, answers={**result.answers, "delay": answer}).equation
        assert shown == (state in {State.KNOWN, State.COMBINATION})
    open_lag = replace(result.answers["time_constant"], state=State.BOUNDED)
    known = replace(result.answers["delay"], state=State.KNOWN)
    beside = replace(sure, answers={**result.answers, "delay": known, "time_constant": open_lag})
    assert "(τ s + 1) · e^(-1e-05 s), τ isn't known" in beside.equation


def test_a_gain_that_is_known_stands_in_the_equation() -> None:
    result = identify(stepped(2.0, 1.0))
    assert result.fit is not None
    estimate = result.fit["gain"]
    shown = float(result.equation.partition("(s) = (")[2].partition(")")[0])
    assert abs(shown - estimate.value) < 0.05 * estimate.half_width  # rounded to two digits of it


@pytest.mark.parametrize("rest", [False, True], ids=["nothing said", "rest"])
def test_a_motor_under_one_negative_level_is_known_as_well_as_under_a_positive_one(rest: bool) -> None:
    """Friction brakes: what it takes of -3 V is as much as of 3 V, the other way."""
    data = replace(stepped(3.0), input_before=0.0, starts_at_rest=rest)
    back = replace(data, u=-data.u, y=-data.y)

    (there,), (again,) = (
        [each for each in identify(one).combinations if each.name == "speed_at_level"] for one in (data, back)
    )

    assert again.estimate.value == pytest.approx(-there.estimate.value, rel=1e-3)
    assert again.estimate.half_width == pytest.approx(there.estimate.half_width, rel=0.1)


def wheel(level: float, seed: int) -> Dataset:
    """A wheel of 0.187 rad/(s %) and 0.1 s that loses 7.5 % to friction, from rest under a level [%], behind 360 counts a turn.

    Its speed is 0.187 (u - 7.5), and its angle the integral of how that is approached. The file begins with the level.
    """
    t, quantum = 0.007 * np.arange(130), 2 * np.pi / 360
    speed = 0.187 * (level - np.copysign(7.5, level))
    angle = speed * (t + 0.1 * np.expm1(-t / 0.1)) + np.random.default_rng(seed).uniform(0.0, quantum)
    y = (np.floor(angle / quantum) + 0.5) * quantum
    data = dataset(seed=seed, samples=len(t), sample_time=0.007, y=y)
    return replace(data, u=np.full(len(t), level), input_unit="%", input_before=level, quantum=quantum)


@pytest.mark.parametrize(("forward", "backward"), [(60.0, -60.0), (20.0, -60.0), (60.0, -100.0)])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_one_level_in_each_direction_does_not_rule_friction_out(
    forward: float, backward: float, seed: int
) -> None:
    """Any friction with its own gain and offset makes both speeds; a gain without friction, a tenth too small, was trusted."""
    result = identify([wheel(forward, seed), wheel(backward, seed + 10)])

    codes = {finding.code for finding in result.findings}
    assert codes & {"friction-possible", "friction-found"}
    assert "friction-not-found" not in codes
    assert result.answers["gain"].state is State.COMBINATION
    (speed,) = (each for each in result.combinations if each.name == "speed_at_level")
    level = speed.input_level
    assert level is not None
    low, high = speed.estimate.interval
    assert low < 0.187 * (level - np.copysign(7.5, level)) < high
    assert result.verdict is Verdict.TRUSTED


def test_two_levels_in_one_direction_and_one_in_the_other_tell_gain_and_friction() -> None:
    result = identify([wheel(20.0, 1), wheel(60.0, 2), wheel(-60.0, 3)])

    for name, value in (("gain", 0.187), ("coulomb_voltage", 7.5)):
        assert result.answers[name].state is State.KNOWN
        low, high = result.answers[name].estimate.interval
        assert low < value < high


COAST, STAIRS = (0.0, 5.0, 0.0), (0.0, 5.0, 3.0)


@pytest.mark.parametrize(
    ("levels", "known", "sd"), [(COAST, False, 0.1), (COAST, True, 0.01), (STAIRS, False, 0.01)]
)
def test_a_coast_behind_an_unknown_sensor_tells_no_friction(
    levels: tuple[float, ...], known: bool, sd: float
) -> None:
    """A filter's output goes on to zero where friction has stopped the shaft, and looks like a motor without any."""
    data = dataset(seed=1, samples=1500, u=np.repeat(levels, 500), chain="derivative")
    speed = replace(data, applied=Chain(), quantum=None, chain_known=known)
    plain = with_values(fitted(speed, "first_order_one_way"), coulomb_voltage=0.02)

    wider = widen_for_gain_friction_split(with_sd(plain, gain=0.01, coulomb_voltage=2.0))

    assert wider.sd("gain") == pytest.approx(sd * plain.model["gain"])
