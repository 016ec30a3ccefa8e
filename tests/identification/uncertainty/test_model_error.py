"""Model error: nothing on an ideal motor with several events, the whole allowance where one event shows nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.estimators.residual_correlation import TIED, input_correlation
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.identification.uncertainty.experience import FEW_EVENTS, ONE_LEVEL, SEVERAL_EVENTS
from servobench.identification.uncertainty.model_error import (
    SOURCE,
    _of_short_records,
    _start,
    model_error,
    with_model_error,
)
from servobench.identification.uncertainty.weak_priors import with_weak_priors
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import QUANTUM, dataset, square
from tests.rig.motor.reference import Truth, march


def fitted(data: Dataset, structure: str = "first_order_one_way") -> Fit:
    return ESTIMATORS["output_error"].fit(STRUCTURES[structure], [data])


def stepped() -> Dataset:
    """One step from 1 to 2 V, after the motor has settled at 1 V."""
    u = np.repeat([1.0, 2.0], 1000)
    angle = march(Truth(), u, 0.002, angle=0.3 * QUANTUM)[:, 2]
    data = dataset(seed=1, samples=len(u), u=u, y=(np.floor(angle / QUANTUM) + 0.5) * QUANTUM)
    return data.part(1.0, 4.0)  # settled for ten time constants


def with_ripple(size: float) -> Dataset:
    """The square wave, with an error of the angle that comes and goes in 3.7 s, as play in a coupling may make."""
    data = dataset(seed=2)
    return replace(data, y=data.y + size * np.sin(2 * np.pi * data.t_output / 3.7), quantum=None)


@pytest.mark.parametrize("seed", range(6))
def test_an_ideal_motor_with_several_events_gets_nothing(seed: int) -> None:
    found = model_error(fitted(dataset(seed=seed)))

    assert found is not None
    assert min(found.events.values()) > 4  # eight steps in 10 s at 0.4 Hz
    assert found.ratio < 1.2
    assert not any(found.shares.values())


def test_with_nothing_to_add_the_fit_is_the_same() -> None:
    fit = fitted(dataset(seed=1))

    assert with_model_error(fit) is fit


def test_a_slow_error_of_the_encoder_is_seen_and_held_by_the_intervals() -> None:
    """20 mrad over 8 events; the truth is that of the marched motor."""
    data = with_ripple(0.02)
    fit = fitted(data)
    found, wider = model_error(fit), with_model_error(fit)

    assert found is not None
    assert found.shares["gain"] == 1
    gain = answer("gain")
    low, high = wider["gain"].interval
    assert low < gain < high
    assert wider["gain"].sd >= 0.99 * SEVERAL_EVENTS.gain * gain / 1.96
    assert [line.source for line in wider.budget] == [SOURCE]


def test_one_step_has_the_whole_allowance_and_says_why() -> None:
    fit = fitted(stepped())
    found, wider = model_error(fit), with_model_error(fit)

    assert found is not None
    assert found.events["lag"] < 2
    assert found.shares["lag"] == 1
    tau = answer("time_constant")
    assert wider["time_constant"].sd >= 0.99 * FEW_EVENTS.lag * tau / 1.96
    assert "a second step would" in wider.budget[-1].reason


def test_a_supply_that_gives_way_under_a_step_makes_no_further_event_of_it() -> None:
    """2.0 V, 1.87 and 1.74 after 0.2 s each: three "events", and so no allowance for the model's error at all."""
    u = np.concatenate([np.zeros(50), np.repeat([2.0, 1.87, 1.74], 100), np.full(200, 1.76)])
    found = model_error(fitted(dataset(seed=1, u=u, samples=len(u)), "first_order_one_way_rest"))

    assert found is not None
    assert found.events["gain"] < 2
    assert found.shares["gain"] == 1


def test_small_steps_to_and_fro_are_events_each() -> None:
    u = np.repeat([2.0, 1.8] * 5, 200)
    found = model_error(fitted(dataset(seed=1, u=u, samples=len(u)).part(0.4, 4.0)))

    assert found is not None
    assert found.events["gain"] > 4


def with_small_steps(second: float) -> Dataset:
    """The step from 1 to 2 V, and 2 s later one to `second` volt, and back after another 2 s."""
    u = np.repeat([1.0, 2.0, second, 2.0], 1000)
    angle = march(Truth(), u, 0.002, angle=0.3 * QUANTUM)[:, 2]
    data = dataset(seed=1, samples=len(u), u=u, y=(np.floor(angle / QUANTUM) + 0.5) * QUANTUM)
    return data.part(1.0, 8.0)


def test_smaller_steps_that_agree_with_the_large_one_make_the_allowance_less() -> None:
    """Steps of a tenth tell the lag ten times worse: that bounds how far the large one's lag may be off, not to nothing."""
    found = model_error(fitted(with_small_steps(2.1)))

    assert found is not None
    assert found.events["lag"] < 2
    assert 0 < found.shares["lag"] < 0.6


def test_a_smaller_step_that_disagrees_leaves_the_allowance_whole() -> None:
    """From the second step on the shaft answers a tenth of a second late."""
    data = with_small_steps(2.5)
    late = np.where(data.t_output > 3.0, np.interp(data.t_output - 0.1, data.t_output, data.y), data.y)
    agreeing, found = model_error(fitted(data)), model_error(fitted(replace(data, y=late, quantum=None)))

    assert agreeing is not None
    assert found is not None
    assert agreeing.shares["lag"] < 0.5
    assert found.shares["lag"] == 1


def test_a_delay_that_is_expected_is_not_expected_to_vary_more_for_a_residual() -> None:
    """A step that the record begins with: the delay is what loops have, and was doubled as if the data had said it."""
    u = np.full(400, 2.0)
    angle = march(Truth(), u, 0.002, angle=0.3 * QUANTUM)[:, 2]
    fit = fitted(dataset(seed=1, samples=len(u), u=u, y=(np.floor(angle / QUANTUM) + 0.5) * QUANTUM))
    assert "delay-expected" in {finding.code for finding in fit.findings}
    # One level doesn't tell gain from friction, on whatever processor: no product with a huge variance passes for a small one.
    assert fit.sd("gain") > 5 * fit.model["gain"]

    wider = with_model_error(fit, one_level=True)

    split = ONE_LEVEL.split * (fit.model["time_constant"] + fit.model["delay"]) / 1.96
    assert fit.sd("delay") <= wider.sd("delay") <= np.hypot(fit.sd("delay"), split)


def test_a_residual_that_follows_the_input_is_model_error_where_its_size_does_not_tell() -> None:
    """A winding of a twentieth of the time constant, taken for a random torque."""
    data = dataset(seed=2, kind="prbs", samples=1500, truth=Truth(inductance=0.05), torque_noise=1e-6)
    fit = ESTIMATORS["prediction_error"].fit(STRUCTURES["first_order_coulomb"], [data])
    found = model_error(fit)

    assert found is not None
    assert input_correlation(fit) > TIED
    assert set(found.shares.values()) == {1.0}


def test_a_random_torque_is_no_model_error() -> None:
    """Its wander is in prediction error's own intervals; counted twice they would be far wider than the bound."""
    fit = identify(dataset(seed=3, torque_noise=1e-5)).fit
    assert fit is not None
    assert fit.estimator == "prediction_error"

    found = model_error(fit)

    assert found is not None
    assert found.ratio < 1.5  # over 400 bins with 120 lags the long-run variance itself scatters by a quarter


def test_the_size_of_units_does_not_matter() -> None:
    """In degrees instead of radians the same share and the same relative widths come out."""
    data = with_ripple(0.02)
    degrees = replace(data, y=np.rad2deg(data.y), output_unit="deg")
    one, other = model_error(fitted(data)), model_error(fitted(degrees))

    assert one is not None
    assert other is not None
    assert other.ratio == pytest.approx(one.ratio, rel=1e-3)
    at = fitted(data).model.names.index("time_constant")
    assert other.covariance[at, at] == pytest.approx(one.covariance[at, at], rel=1e-2)


def test_the_structure_has_to_have_a_gain_and_a_time_constant() -> None:
    data = dataset(seed=1, u=square(np.arange(5000) * 0.002))
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["rational_1_0_integrator_delay"], [data])

    assert model_error(fit) is None


def answer(name: str) -> float:
    from tests.truth.test_intervals import answers

    return answers(Truth())[name]


def many_sines(rest: float) -> Dataset:
    """Seven sines of 0.1/τ to 3/τ for 10 s, after a rest: they begin with a jump from zero."""
    t = np.arange(5000) * 0.002
    omega, phases = np.geomspace(1.0, 30.0, 7), np.random.default_rng(4).uniform(0.0, 2 * np.pi, 7)
    u = np.where(t < rest, 0.0, np.sin(omega * t[:, None] + phases).sum(axis=1))
    return dataset(seed=5, u=u)


@pytest.mark.parametrize("rest", [0.0, 0.5])
def test_an_input_that_turns_round_all_the_time_has_many_events_however_it_begins(rest: float) -> None:
    """The jump at the end of the rest was taken for the only event there is, and the whole allowance was made."""
    found = model_error(fitted(many_sines(rest), "first_order_coulomb"))

    assert found is not None
    assert min(found.events.values()) > 4
    assert not any(found.shares.values())


def test_rounding_that_beats_with_the_samples_is_no_model_error() -> None:
    """At its top speed the shaft goes three counts a sample, exactly: the rounding stays the same for seconds."""
    u = np.repeat([3.0, -3.0, 3.0, -3.0, 3.0, -3.0], 2000)
    angle = march(Truth(), u, 0.002, angle=0.3)[:, 2]
    quantum = float(np.median(np.abs(np.diff(angle)))) / 3
    data = dataset(seed=1, samples=len(u), u=u, y=(np.floor(angle / quantum) + 0.5) * quantum)
    found = model_error(fitted(replace(data, quantum=quantum), "first_order_coulomb"))

    assert found is not None
    assert not any(found.shares.values())


@pytest.mark.parametrize("seed", range(4))
def test_parameters_that_exact_readings_tell_together_only_are_no_error(seed: int) -> None:
    """Under one level gain and friction are known together only, and a reading without noise leaves no room for a prior."""
    angle = march(Truth(), np.full(600, 2.0 + seed), 0.002, angle=0.1 * seed)[:, 2]
    data = dataset(seed=seed, samples=600, u=np.full(600, 2.0 + seed), y=angle)
    found = with_weak_priors(fitted(replace(data, quantum=None)))

    sd = np.sqrt(np.diag(found.covariance))
    assert np.linalg.eigvalsh(found.covariance / np.outer(sd, sd)).min() >= -1e-12
    # The speed that the level leads to is known to the last digits all the same, by algebra: K (u - u_c).
    names = list(found.model.names)
    left = 2.0 + seed - found.model["coulomb_voltage"]
    slope = np.zeros(len(names))
    slope[names.index("gain")], slope[names.index("coulomb_voltage")] = left, -found.model["gain"]
    assert slope @ found.covariance @ slope < (1e-6 * found.model["gain"] * left) ** 2


@pytest.mark.parametrize("rest", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("ends", [0.15, 0.2])
def test_a_speed_that_a_step_hasn_t_reached_yet_is_as_uncertain_as_its_time_constant(
    ends: float, rest: float
) -> None:
    """A fifth of the way takes four times as long as the rest, as beside a belt that warms up; the settled speed is 60 rad/s."""
    t = 0.002 * np.arange(-round(rest / 0.002), round(ends / 0.002))
    on = np.maximum(t, 0.0)
    way = 60.0 * (on - 0.8 * 0.1 * -np.expm1(-on / 0.1) - 0.2 * 0.4 * -np.expm1(-on / 0.4))
    counts = {"u": np.where(t >= 0.0, 3.0, 0.0), "angle": np.floor(way / QUANTUM)}
    result = identify(
        counts,
        input="u:V",
        output="angle:counts",
        counts_per_rev=2048,
        sample_time=0.002,
        starts_at_rest=True,
    )

    low, high = result.to_dict()["combinations"]["speed_at_level"]["interval"]
    assert low < 60.0 < high


def test_a_rest_before_a_start_tells_nothing_of_where_it_leads() -> None:
    """An allowance for the bend of a short start is as large with two seconds of rest before as without."""
    whole = dataset(seed=1, samples=1040, u=np.repeat([0.0, 3.0], [1000, 40]))
    starts = [whole, whole.part(0.002 * 998, 9.0)]
    short = [_of_short_records(fitted(each, "first_order_one_way"), 0.1) for each in starts]

    assert [_start(each) for each in starts] == pytest.approx([0.076 / 1.3] * 2)
    # (1.3 τ/T)⁴ of the variance of a whole step.
    assert [each[1, 1] for each in short] == pytest.approx([(0.13 / 0.076) ** 4 - 1.0] * 2)


@pytest.mark.parametrize("other", [-3.0, -2.88])
def test_the_speed_either_way_is_known_where_friction_is_not(other: float) -> None:
    """A square of 3 V and as much or 4 % less to the other side, of a motor with 1.5 V of friction and a ripple of its angle."""
    truth = Truth(coulomb_torque=1.5 * Truth().motor_constant / Truth().resistance)
    u = np.where(np.arange(2500) // 250 % 2 == 0, 3.0, other)
    angle = march(truth, u, 0.002)[:, 2]
    angle += 0.01 * np.sin(2 * np.pi * np.arange(len(u)) * 0.002 / 0.37)
    data = dataset(seed=1, samples=len(u), u=u, y=(np.floor(angle / QUANTUM) + 0.5) * QUANTUM)
    found = model_error(fitted(data, "first_order_coulomb"))

    assert found is not None
    assert min(found.shares.values()) == 1.0
    names = fitted(data, "first_order_coulomb").model.names
    gain, lost = (fitted(data, "first_order_coulomb").model[name] for name in ("gain", "coulomb_voltage"))
    slope = np.zeros(len(names))
    slope[names.index("gain")], slope[names.index("coulomb_voltage")] = 3.0 - lost, -gain
    speed, sd = gain * (3.0 - lost), float(np.sqrt(slope @ found.covariance @ slope))
    # Friction alone may be wrong by a tenth of itself, which would be as much of the speed.
    assert (
        found.covariance[names.index("coulomb_voltage"), names.index("coulomb_voltage")] > (0.05 * lost) ** 2
    )
    assert sd < 0.03 * speed


@pytest.mark.parametrize("levels", [(3.0, -0.6, -3.0), (1.2, -3.0)])
def test_a_few_levels_to_and_fro_hide_what_differs_by_direction(levels: tuple[float, ...]) -> None:
    """A gain 7 % smaller backward, and friction of 3.5 % of the input: the mean gain is in the interval, whatever the levels."""
    plain = Truth()
    truth = Truth(coulomb_torque=0.105 * plain.motor_constant / plain.resistance)
    records = []
    for n, level in enumerate(levels):
        u = np.where(np.arange(700) < 10, 0.0, level)
        angle = march(truth, u * (1.0 + 0.035 * np.sign(level)), 0.002)[:, 2]
        angle += 0.03 * np.sin(
            0.5 * angle
        )  # an eccentric disk behind a gear, so that the residual shows an error
        y = (np.floor(angle / QUANTUM) + 0.5) * QUANTUM
        records.append(
            replace(dataset(seed=1, samples=len(u), u=u, y=y), name=f"run {n}", starts_at_rest=True)
        )
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], records)
    found = model_error(fit)

    assert found is not None
    assert found.shares["gain"] == 1.0
    at = fit.model.names.index("gain")
    # K of the reference motor is 23.7 rad/(s·V), the mean of both directions.
    assert abs(fit.model["gain"] - 23.7) < 2.0 * np.sqrt(found.covariance[at, at])
