"""The state of each parameter: values, combinations, bounds, and sentences for unknown ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.finding import Verdict, info
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.estimators.delay_prior import CODE, prior_of_delay
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.doubts.base import DOUBTS
from servobench.identification.uncertainty.identifiability import State, combinations, parameter_statuses
from servobench.identification.uncertainty.purpose import good_for
from servobench.identification.uncertainty.status_findings import about_answers
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset
from tests.identification.test_one_level import stepped
from tests.rig.motor.reference import Truth


def fitted() -> Fit:
    return ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [dataset(seed=1, samples=2500)])


def fitted_unsettled() -> Fit:
    """The same of an input that changes before the motor gets to any speed."""
    data = dataset(seed=1, kind="prbs", hold=20, samples=2500)
    return ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [data])


def with_spread(fit: Fit, **directions: float) -> Fit:
    """The fit with so much more standard deviation [1] along directions of the parameters, relative to their values."""
    along = np.array([directions.get(name, 0.0) for name in fit.model.names]) * np.abs(fit.model.theta)
    return replace(fit, covariance=fit.covariance + np.outer(along, along))


def test_what_is_known_to_half_of_itself_is_known() -> None:
    fit = fitted()

    assert {each.state for each in parameter_statuses(fit).values()} == {State.KNOWN}
    assert combinations(fit) == ()


def test_a_delay_below_zero_is_no_property_of_a_motor() -> None:
    fit = fitted()
    at, step = fit.model.names.index("delay"), fit.records[0].data.sample_time
    theta = fit.model.theta.copy()
    theta[at] = -0.4 * step
    early = replace(fit, model=replace(fit.model, theta=theta), intervals={})
    known = replace(early, covariance=np.diag(np.full(len(theta), (0.01 * step) ** 2)))

    assert known["delay"].interval[1] < 0.0
    assert parameter_statuses(known)["delay"].state is not State.KNOWN


@pytest.mark.parametrize(("scales", "is_known"), [(0.5, True), (3.0, False)])
def test_a_delay_that_its_prior_let_stand_far_from_what_is_usual_is_not_known(
    scales: float, is_known: bool
) -> None:
    """What fits best is no measurement: the data don't tell the delay, as the finding says."""
    fit = fitted()
    prior = prior_of_delay(fit.model.structure, [record.data for record in fit.records])
    assert prior is not None
    theta = fit.model.theta.copy()
    theta[prior.at] = prior.middle + scales * prior.scale
    said = info(CODE, "The delay is assumed.", parameters=("delay",))
    assumed = replace(fit, model=replace(fit.model, theta=theta), findings=(*fit.findings, said))

    assert (parameter_statuses(assumed)["delay"].state is State.KNOWN) is is_known


def test_time_constant_and_delay_that_stand_for_each_other_are_known_as_their_sum() -> None:
    fit = fitted()
    tau, delay = fit.model["time_constant"], fit.model["delay"]
    fit = with_spread(fit, time_constant=0.6, delay=-0.6 * tau / abs(delay))
    (lag,) = combinations(fit)

    assert lag.name == "lag"
    assert lag.estimate.value == pytest.approx(tau + delay)
    assert lag.estimate.sd < 1e-2 * tau
    told = parameter_statuses(fit)
    assert told["time_constant"].state is told["delay"].state is State.COMBINATION
    assert told["gain"].state is State.KNOWN
    sentences = [finding.sentence for finding in about_answers(told, (lag,), fit)]
    assert len(sentences) == 1
    assert "only together" in sentences[0]


def test_a_sum_that_is_vaguer_than_the_delay_is_not_stated_beside_it() -> None:
    """A delay of 70 ms known to 5 ms, and a time constant of 6 ms that may be five times that."""
    fit = fitted()
    theta = fit.model.theta.copy()
    theta[[fit.model.names.index(name) for name in ("time_constant", "delay")]] = 0.006, 0.070
    moved = replace(fit, model=replace(fit.model, theta=theta))
    vague = with_spread(moved, time_constant=2.3, delay=0.036)

    assert parameter_statuses(vague)["delay"].state is State.KNOWN
    assert all(each.name != "lag" for each in combinations(vague))
    assert parameter_statuses(vague)["time_constant"].state is not State.COMBINATION


def test_a_combination_of_which_rounding_is_all_that_is_left_is_not_stated() -> None:
    """Gain and time constant that run to infinity together leave a quotient with no standard deviation, and not with one of 0."""
    near, lost = (with_spread(fitted_unsettled(), gain=size, time_constant=size) for size in (30.0, 1e12))
    (acceleration,) = combinations(near)

    assert acceleration.name == "acceleration"
    assert acceleration.estimate.sd > 0
    assert combinations(lost) == ()


def test_what_nothing_tells_has_a_remedy() -> None:
    fit = with_spread(fitted(), time_constant=30.0)
    told = parameter_statuses(fit)

    assert told["time_constant"].state is State.UNKNOWN
    (finding,) = about_answers(told, combinations(fit), fit)
    assert finding.code == "parameter-unknown"
    assert "steps" in finding.sentence


def test_an_upper_end_that_says_something_is_a_bound() -> None:
    fit = with_spread(fitted(), time_constant=0.5)
    told = parameter_statuses(fit)["time_constant"]

    assert told.state is State.BOUNDED


def test_the_level_at_which_the_speed_is_known_is_stated() -> None:
    """Gain and friction that vary together so that K (3 V - u_c) stays leave open the speed at 1 V, where it mostly was."""
    u = np.where(np.arange(2500) % 500 < 460, 1.0, 3.0)
    fit = ESTIMATORS["output_error"].fit(
        STRUCTURES["first_order_one_way"], [dataset(seed=1, samples=2500, u=u)]
    )
    lost = float(fit.model["coulomb_voltage"])
    varied = with_spread(fit, gain=2.0, coulomb_voltage=2.0 * (3.0 - lost) / lost)

    speed = next(each for each in combinations(varied) if each.name == "speed_at_level")

    assert speed.input_level == 3.0
    # Of less than the 5 % that a settled speed would be known to.
    assert speed.estimate.half_width < 0.02 * speed.estimate.value


def test_a_speed_that_settles_ends_what_a_time_constant_may_be() -> None:
    """Levels of 0.4 s, under each of which the motor gets to its speed: a time constant of that time wouldn't let it."""
    data = dataset(seed=1, samples=1000, u=np.repeat([2.0, 4.0, 3.0, 5.0, 1.0], 200))
    fit = with_spread(
        ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [data]), time_constant=4.0
    )
    told = parameter_statuses(fit)["time_constant"]

    assert told.state is State.BOUNDED
    assert fit.estimates["time_constant"].interval[1] > 0.8
    assert told.estimate.interval[1] == pytest.approx(0.4, abs=0.003)


def test_a_result_of_which_nothing_is_known_is_refused() -> None:
    fit = with_spread(with_spread(fitted_unsettled(), gain=40.0), time_constant=30.0)
    (finding,) = about_answers(parameter_statuses(fit), combinations(fit), fit)

    assert finding.code == "nothing-known"
    assert finding.severity == "refusal"


def test_where_the_gain_may_be_zero_nothing_else_is_known() -> None:
    """A time constant is that of the answer to the input: without an answer its interval is chance, however short."""
    fit = with_spread(fitted_unsettled(), gain=2.0)
    told = parameter_statuses(fit)
    (finding,) = about_answers(told, combinations(fit), fit)

    assert {each.state for each in parameter_statuses(with_spread(fitted_unsettled(), gain=0.4)).values()} > {
        State.KNOWN
    }
    assert {each.state for each in told.values()} == {State.UNKNOWN}
    assert finding.code == "nothing-known"
    assert "but what it may be wrong by is as large as its gain (largest contribution" in finding.sentence


def test_speeds_that_the_motor_settled_at_are_known_whatever_the_model_says() -> None:
    """The reference motor turns at 23.7 (u - 0.16) rad/s; 3 V is the highest of its levels."""
    fit = with_spread(with_spread(fitted(), gain=40.0), time_constant=30.0)
    (speed,) = combinations(fit)
    low, high = speed.estimate.interval

    assert low < 23.7 * (3.0 - 0.16) < high
    assert high - low == pytest.approx(0.1 * speed.estimate.value)
    assert speed.input_level == 3.0
    assert parameter_statuses(fit)["gain"].state is State.COMBINATION
    assert {each.code for each in about_answers(parameter_statuses(fit), (speed,), fit)} == {
        "known-together",
        "parameter-unknown",
    }


def of_one_level_each(*points: tuple[float, float]) -> list[Dataset]:
    """Two seconds at each level [V] and speed [rad/s], with noise of 0.5 rad/s; both were so before the record."""
    rng = np.random.default_rng(1)
    return [
        replace(
            dataset(seed=1, samples=200, sample_time=0.01, u=np.full(200, level)),
            input_before=level,
            y=speed + rng.normal(0.0, 0.5, 200),
            kind="speed",
            output_unit="rad/s",
            quantum=None,
        )
        for level, speed in points
    ]


def test_records_of_one_level_and_one_speed_each_tell_the_gain() -> None:
    """10 V leads to about twice the speed of 5 V: 55 rad/s more. That both motors are still on their way is no explanation."""
    result = identify(of_one_level_each((5.0, 50.0), (10.0, 105.0)))

    low, high = result["gain"].interval
    assert low < 11.0 < high
    assert result.answers["gain"].state is State.KNOWN
    assert result.answers["time_constant"].state is State.UNKNOWN
    assert "fit-poor" not in {finding.code for finding in result.findings}


def test_a_reversal_between_two_samples_tells_the_speed_at_full_voltage_and_how_long_the_lag_is_at_most() -> (
    None
):
    """From full forward to full backward, with a time constant below a sample time: friction may be anything up to the input."""
    u = np.repeat([3.0, -3.0], 40)
    truth = Truth()
    power = truth.resistance * truth.viscous_friction + truth.motor_constant**2
    gain, tau = truth.motor_constant / power, truth.resistance * truth.inertia / power
    friction = truth.resistance * truth.coulomb_torque / truth.motor_constant
    data = dataset(seed=1, samples=80, sample_time=3.1 * tau, u=u)
    result = identify(data.part(10 * data.sample_time, 70 * data.sample_time))

    assert result.verdict is Verdict.TRUSTED
    (speed,) = [each for each in result.combinations if each.name == "speed_at_level"]
    low, high = speed.estimate.interval
    assert low < np.sign(speed.input_level or 0.0) * gain * (3.0 - friction) < high
    assert set(speed.parameters) == {"gain", "coulomb_voltage", "offset_voltage"}
    assert result.answers["gain"].state is State.COMBINATION
    assert result.answers["time_constant"].state is State.BOUNDED
    assert result["time_constant"].interval[1] > tau


def test_records_of_one_speed_each_that_no_gain_explains_are_told_what_is_missing() -> None:
    result = identify(of_one_level_each((5.0, 50.0), (-5.0, 50.0)))

    (refused,) = (finding for finding in result.findings if finding.code == "nothing-known")
    assert "within each record input and speed stay as they are" in refused.sentence
    assert "The motor settled at 50 rad/s at −5 V and 50 rad/s at 5 V." in refused.sentence.replace(
        "\u00a0", " "
    )


def test_records_that_settle_at_two_speeds_under_one_level_are_told_apart() -> None:
    """Both set off from rest, under an input that is on from the first row."""
    base = dataset(seed=1, samples=200, sample_time=0.01, u=np.full(200, 5.0))
    base = replace(base, input_before=5.0, kind="speed", output_unit="rad/s", quantum=None)
    noise = 0.3 * np.random.default_rng(1).standard_normal(200)
    result = identify(
        [
            replace(base, name=f"motor {speed:g}", y=speed * -np.expm1(-np.arange(200.0) / 8.0) + noise)
            for speed in (50.0, 20.0)
        ]
    )

    (refused,) = (finding for finding in result.findings if finding.code == "nothing-known")
    apart = "At 5 V the motor settled at 20 rad/s in motor 20, and at 50 rad/s in motor 50"
    assert apart in refused.sentence.replace("\u00a0", " ")


def test_a_motor_that_sets_off_under_a_steady_input_is_told_that_a_model_explains_little(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The input was on before the first row, as far as the file says; the speed rises all the same, and isn't explained."""
    about_fit = DOUBTS["fit_poor"].about_fit
    base = dataset(seed=1, samples=200, sample_time=0.01, u=np.full(200, 5.0))
    base = replace(base, input_before=5.0, kind="speed", output_unit="rad/s", quantum=None)
    rising = replace(base, y=50.0 * -np.expm1(-np.arange(200.0) / 40.0))
    steady = replace(base, y=50.0 + 0.5 * np.random.default_rng(1).standard_normal(200))
    fit = fitted()
    monkeypatch.setattr(Fit, "fit_percent", 10.0)

    def codes(*records: Dataset) -> list[str]:
        of_each = tuple(replace(fit.records[0], data=record) for record in records)
        return [finding.code for finding in about_fit(replace(fit, records=of_each))]

    assert codes(rising) == codes(rising, steady) == ["fit-poor"]
    assert codes(steady) == []


def test_an_output_that_the_model_explains_isnt_called_unrelated_to_the_input(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A gain that may be zero beside a fit of nearly 100 % has a wide interval, and beside one of 10 % no influence."""
    fit = with_spread(fitted_unsettled(), gain=2.0)
    (follows,) = about_answers(parameter_statuses(fit), combinations(fit), fit)
    monkeypatch.setattr(Fit, "fit_percent", 10.0)
    (none,) = about_answers(parameter_statuses(fit), combinations(fit), fit)

    assert "these two columns" not in follows.sentence
    assert "these two columns" in none.sentence


def test_one_level_tells_its_speed_and_the_time_constant() -> None:
    """K (u - u_c) = 23.7 (2 - 0.16) rad/s, which is all that the steady speed at 2 V says."""
    result = identify(stepped(0.0, 2.0))
    (speed,) = result.combinations

    assert result.verdict is Verdict.TRUSTED
    assert speed.name == "speed_at_level"
    truth = 0.042 / (8.4 * 1e-6 + 0.042**2) * (2.0 - 0.16)
    assert speed.estimate.interval[0] < truth < speed.estimate.interval[1]
    assert speed.estimate.sd < 0.02 * truth
    states = {name: each.state for name, each in result.answers.items()}
    assert states["gain"] is states["coulomb_voltage"] is State.COMBINATION
    assert states["time_constant"] is State.KNOWN


def test_one_level_tells_its_speed_wherever_the_search_for_friction_began() -> None:
    """Least squares took 8.97 of 9 V for friction, with the gain to suit: on such a footing no speed is known."""
    random = np.random.default_rng(7)
    t = 0.0503 * np.arange(60) + 0.0003 * random.standard_normal(60).cumsum()
    t = (t - t[0])[:-3]
    speed = 100 * np.round(48 * (1 - np.exp(-np.maximum(t - 0.055, 0) / 0.1)))
    columns = {"t": t, "u": np.full(len(t), 9.0), "y": speed}
    result = identify(columns, time="t:s", input="u:V", output="y:rad/s", starts_at_rest=True)
    (found,) = result.combinations

    assert found.name == "speed_at_level"
    assert found.estimate.value == pytest.approx(4800, abs=3 * found.estimate.sd)
    assert found.estimate.sd < 0.02 * 4800


def test_what_a_result_is_good_for_follows_from_its_intervals() -> None:
    """The phase of a lag T turns by ω ΔT: 5° are reached at 0.0873/ΔT. Two gains differ by √2 half-widths."""
    fit = with_spread(fitted(), gain=0.01 / 1.959964, time_constant=0.05 / 1.959964)
    sentence = good_for(parameter_statuses(fit), (), 97.3, 1e-4)
    tau = fit.model["time_constant"]

    assert "97 %" in sentence
    assert f"of at most {np.deg2rad(5) / (0.05 * tau):.2g} rad/s" in sentence
    assert "more than 1.4 %" in sentence


def test_figures_that_are_good_for_nothing_have_no_sentence() -> None:
    fit = with_spread(with_spread(fitted(), gain=40.0), time_constant=30.0)

    assert good_for(parameter_statuses(fit), (), float("nan"), 0.002) == ""


def with_covariance(**values: float) -> Fit:
    """A fit whose friction of 0.15 V has a half-width of 0.12 V, a small part of the input, and whose time constant is open."""
    fit = fitted()
    sd = dict(zip(fit.model.names, np.abs(fit.model.theta) * 0.01, strict=True))
    sd |= {"coulomb_voltage": 0.06, "time_constant": float(fit.model["time_constant"])}
    covariance = np.diag([sd[name] ** 2 for name in fit.model.names])
    friction, lag = (fit.model.names.index(name) for name in ("coulomb_voltage", "time_constant"))
    covariance[friction, lag] = covariance[lag, friction] = (
        values["correlation"] * sd["coulomb_voltage"] * sd["time_constant"]
    )
    covariance[lag, lag] *= values.get("times", 1.0)
    return replace(fit, covariance=covariance, intervals={})


def test_a_friction_that_hangs_together_with_an_open_time_constant_is_not_known() -> None:
    """As behind a ramp, where u_c + a τ is all that is known."""
    states = [
        parameter_statuses(with_covariance(correlation=each))["coulomb_voltage"].state for each in (-0.9, 0.0)
    ]

    assert states[0] is not State.KNOWN
    assert states[1] is State.KNOWN


def test_a_time_constant_of_which_nothing_is_known_says_nothing_of_the_friction() -> None:
    parameter_statuses(with_covariance(correlation=0.0, times=np.inf))
