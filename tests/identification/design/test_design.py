"""Designed experiments: what is predicted holds, and limits hold for every motor within the tolerance."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.stats import chi2

from servobench.core.errors import MissingInformation, NotIdentifiable, UsageError
from servobench.identification.design.assumed_motor import (
    AssumedMotor,
    from_data_sheet,
    from_result,
    from_result_file,
)
from servobench.identification.design.candidates import candidates
from servobench.identification.design.foresight import foresee
from servobench.identification.design.limits import DesignLimits, limit_use
from servobench.identification.design.search import Design, best_design
from servobench.identification.identify import identify
from servobench.rig.experiment import PAPER, read_experiment
from servobench.systems.signals.prbs import PRBS
from servobench.systems.signals.square import Square
from tests.datasets import QUANTUM, dataset
from tests.rig.motor.reference import Truth, march

BENCH = Path(__file__).resolve().parents[3] / "bench"
T = np.arange(5000) * 0.002
PLAIN = AssumedMotor(
    name="plain", gain=23.8, time_constant=0.0998, tolerance=0.0, quantum=QUANTUM, noise=QUANTUM / 12**0.5
)


@pytest.fixture
def bounds(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """Return the bench's bound, which shares no line with the models here."""
    before = set(sys.modules)
    monkeypatch.syspath_prepend(str(BENCH))
    from accuracy_parts import bounds  # type: ignore[import-not-found]

    yield bounds
    for name in set(sys.modules) - before:
        if name.startswith("accuracy_parts"):
            del sys.modules[name]


@pytest.fixture(scope="module")
def confined() -> Design:
    """A design that has to keep to all limits; a short one, as that is quicker."""
    limits = DesignLimits(voltage=10.0, current=1.0, speed=100.0, travel=40.0)
    return best_design(from_data_sheet("qube_servo_2"), limits, duration=4.0)


@pytest.mark.parametrize("sample_time", [0.002, 0.001, 0.0005, 0.003])
def test_a_time_in_an_experiment_is_written_as_a_person_would(sample_time: float) -> None:
    made = [each.shape(3.0) for each in candidates(PLAIN, 20.0, sample_time)]
    times = {each.bit_time for each in made if isinstance(each, PRBS)}

    # 9 · 0.002 is 0.018000000000000002 in binary; whole samples of half a millisecond need four decimals.
    assert len(times) > 3
    assert all(
        time == round(time, 4) and abs(time / sample_time - round(time / sample_time)) < 1e-9
        for time in times
    )


def test_the_prediction_is_the_cramer_rao_bound_where_noise_is_white(bounds: ModuleType) -> None:
    """Noise far above the encoder's step. The scatter over 60 draws is χ², and counts where it is above the bound."""
    motor = replace(PLAIN, quantum=1e-7, noise=1e-3)
    u = PAPER.signal(T)
    bound = bounds.bound(bounds.FirstOrder(gain=motor.gain, tau=motor.time_constant), u, 0.0, motor.noise**2)

    ahead = foresee(motor, T, u, 60)

    most = float(np.sqrt(chi2.isf(1e-6, 60) / 60))
    for name, value in (("gain", motor.gain), ("time_constant", motor.time_constant)):
        # The bench's derivatives are differences, good to a thousandth.
        assert 0.999 * bound[name] <= ahead.sd[name] / value <= most * 1.001 * bound[name]


def test_rounding_that_repeats_with_the_input_is_foreseen() -> None:
    """A motor that goes to and fro over the same counts; decision 0006 tells how it was found."""
    motor = from_data_sheet("qube_servo_2")

    to_and_fro = foresee(motor, T, Square(low=-9.8, high=9.8, frequency=1.25)(T), 30)
    wandering = foresee(motor, T, PRBS(low=1, high=9.8, bit_time=0.214)(T), 30)

    assert to_and_fro.structure == "first_order_coulomb"
    assert to_and_fro.rounding > 1.5
    # The mean square of 30 draws of white noise is χ²/30.
    assert wandering.rounding < np.sqrt(chi2.isf(1e-6, 30) / 30)


def test_every_motor_within_the_tolerance_keeps_to_the_limits(confined: Design) -> None:
    """The finely stepped reference, inductance and all, with gain and time constant at the ends of ±20 %."""
    t = np.arange(2000) * 0.002
    u = confined.experiment.signal(t)
    sheet = Truth(viscous_friction=0.0, coulomb_torque=0.2 * 0.042 / 8.4)
    for gain, tau in product((0.8, 1.2), (0.8, 1.2)):
        constant = sheet.motor_constant / gain
        inertia = tau * sheet.inertia / gain**2
        motor = sheet._replace(motor_constant=constant, inertia=inertia)
        current, speed, angle = march(motor, u, 0.002, step=2e-5).T
        assert np.abs(u).max() <= 10.0
        assert np.abs(current).max() <= 1.0
        assert np.abs(speed).max() <= 100.0
        assert np.abs(angle).max() <= 40.0


def test_the_limits_that_keep_it_from_telling_more_are_named(confined: Design) -> None:
    assert "time" in confined.active
    assert len(confined.active) > 1
    for name in set(confined.active) - {"time"}:
        assert confined.chosen.used[name] > 0.93


def test_the_motor_is_known_as_well_as_foretold(confined: Design) -> None:
    """A motor near the sheet's, by the reference. Errors beyond 5 standard deviations aren't chance."""
    t = np.arange(2000) * 0.002
    u = confined.experiment.signal(t)
    truth = Truth(inertia=2.2e-5, viscous_friction=0.0)
    angle = march(truth, u, 0.002)[:, 2]
    y = (np.floor(angle / QUANTUM) + 0.5) * QUANTUM
    fit = identify(replace(dataset(seed=0, samples=2000, y=y), u=u, input_before=0.0)).fit

    assert fit is not None
    gain = 1 / truth.motor_constant
    assert abs(fit["gain"].value / gain - 1) < 5 * confined.chosen.relative["gain"]
    lag = truth.resistance * truth.inertia / truth.motor_constant**2
    # The slow root of R J s (1 + L/R s) + k² is that time constant less L/R, to first order in L.
    slow = lag - truth.inductance / truth.resistance
    assert abs(fit["time_constant"].value / slow - 1) < 5 * confined.chosen.relative["time_constant"] + 5e-6


def test_the_experiment_reads_back_as_it_was(confined: Design) -> None:
    assert read_experiment(confined.experiment.to_toml()) == confined.experiment


def test_what_was_identified_is_what_is_assumed() -> None:
    result = identify(dataset(seed=1))
    motor = from_result(result, "a.csv")

    assert result.fit is not None
    assert motor.gain == result.fit["gain"].value
    assert motor.quantum == QUANTUM
    assert motor.disturbance is None


def test_a_random_torque_is_foreseen_from_a_recording() -> None:
    """Under the torque of a recording, a repetition is predicted to tell what such recordings tell, in the root mean square.

    How much one of them leaves open of a friction that is larger near rest depends on its noise.
    """
    results = [identify(dataset(seed=seed, kind="prbs", torque_noise=1e-5)) for seed in range(1, 9)]
    data, motor = results[0].data[0], from_result(results[0], "a.csv")
    fits = [result.fit for result in results if result.fit is not None]
    assert [fit.estimator for fit in fits] == 8 * ["prediction_error"]

    ahead = foresee(replace(motor, tolerance=0.0), data.t_input, data.u, 2)

    # The fit's own covariance is a mixture over levels of noise that the data allow, which widens it by some percent.
    for name in ("gain", "time_constant"):
        stated = float(np.sqrt(np.mean([fit[name].sd ** 2 for fit in fits])))
        assert ahead.sd[name] == pytest.approx(stated, rel=0.15)


def test_a_limit_of_the_current_needs_a_resistance() -> None:
    with pytest.raises(MissingInformation, match="data sheet"):
        best_design(PLAIN, DesignLimits(voltage=10.0, current=1.0))


def test_limits_that_leave_nothing_are_reported() -> None:
    with pytest.raises(NotIdentifiable, match="travel"):
        best_design(PLAIN, DesignLimits(voltage=10.0, travel=1e-3), duration=2.0)
    with pytest.raises(UsageError, match="speed"):
        DesignLimits(voltage=10.0, speed=0.0)
    with pytest.raises(UsageError, match="ten samples"):
        best_design(PLAIN, DesignLimits(voltage=10.0), duration=0.01)


def test_a_voltage_that_friction_takes_is_reported() -> None:
    with pytest.raises(NotIdentifiable, match="allow at least"):
        best_design(from_data_sheet("qube_servo_2"), DesignLimits(voltage=0.01), duration=1.0)


def test_more_samples_than_can_be_compared_are_refused_at_once() -> None:
    with pytest.raises(UsageError, match=r"a duration of 200 s, or a longer sample time"):
        best_design(PLAIN, DesignLimits(voltage=10.0), duration=201.0)


def test_a_refused_recording_is_no_motor_to_design_for() -> None:
    """Its values are what a search ended with; a design for them failed, and blamed the limits."""
    data = dataset(seed=1, samples=500)
    result = identify(replace(data, y=np.zeros(500)))
    assert result.verdict == "refused"

    with pytest.raises(NotIdentifiable, match=r"a.csv is refused, so there is no motor to design for\. \w"):
        from_result(result, "a.csv")
    with pytest.raises(NotIdentifiable, match=r"a.json is refused, so there is no motor to design for"):
        from_result_file(result.to_dict(), "a.json", 2048.0)


@pytest.mark.parametrize("volts", [2.0, -2.0])
def test_travel_is_counted_from_where_the_shaft_starts(volts: float) -> None:
    """A constant voltage turns a first-order motor by K u (t - τ (1 - e^(-t/τ)))."""
    since = T[-1] - PLAIN.time_constant * (1 - np.exp(-T[-1] / PLAIN.time_constant))

    use = limit_use(PLAIN, DesignLimits(voltage=10.0, travel=1000.0), T, np.full(len(T), volts))

    assert use["travel"] == pytest.approx(PLAIN.gain * 2.0 * since / 1000.0, rel=1e-9)
