"""The motor's own parameters: found where current, stall or a stated value tell them, and said to be open where not."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

import servobench as sb
from servobench.core.errors import UnknownName, UsageError
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.output_error import OutputError
from servobench.identification.models.base import STRUCTURES
from servobench.identification.motor_parameters import MotorEstimates, motor_parameters
from servobench.recordings.measurement.dataset import Dataset
from servobench.rig.devices.twin import Twin, TwinSettings
from tests.datasets import QUANTUM, dataset
from tests.rig.motor.reference import Truth, march

STEP = 2 * 3.0 / 4096  # A: 12 bits over ±3 A
TRUTH = {
    "resistance": 8.4,
    "motor_constant": 0.042,
    "inertia": 2.0951778e-5,
    "viscous_friction": 1e-6,
    "coulomb_torque": 8e-4,
}


def shown(current: NDArray[np.float64], noise: float, random: np.random.Generator) -> NDArray[np.float64]:
    """The reading of a converter with 12 bits of a current with white noise [A]."""
    return np.round((current + noise * random.standard_normal(len(current))) / STEP) * STEP


def with_current(
    seed: int, kind: str = "prbs", noise: float = 0.005, truth: Truth | None = None, **options: float
) -> Dataset:
    """The reference motor behind an ideal encoder and a current sensor; its current is latched with the angle."""
    random = np.random.default_rng(1000 + seed)
    data = dataset(seed=seed, kind=kind, truth=truth, **options)  # type: ignore[arg-type]
    motion = march(truth or Truth(), data.u, data.sample_time, angle=random.random() * QUANTUM)
    angle = (np.floor(motion[:, 2] / QUANTUM) + 0.5) * QUANTUM
    return replace(data, y=angle, current=shown(motion[:, 0], noise, random))


def fitted(data: Dataset, structure: str = "first_order_coulomb") -> Fit:
    return OutputError().fit(STRUCTURES[structure], [data])


def codes(found: MotorEstimates) -> set[str]:
    return {finding.code for finding in found.findings}


def stalled(
    voltages: tuple[float, ...], resistance: float = 8.4, brushes: float = 0.0, noise: float = 0.003
) -> Dataset:
    """A shaft that is held, for half a second at each voltage."""
    u = np.repeat(voltages, 250)
    t = 0.002 * np.arange(len(u))
    current = (u - brushes * np.sign(u)) / resistance
    return Dataset(
        name="stall", t_input=t, u=u, input_unit="V", input_before=0.0, t_output=t, y=np.full(len(u), 0.3), output_unit="rad",
        kind="position", source=dataset(seed=0, samples=10).source, quantum=QUANTUM,
        current=shown(current, noise, np.random.default_rng(3)),
    )  # fmt: skip


@cache
def intervals(seed: int, kind: str, structure: str) -> dict[str, tuple[float, float]]:
    """What is found with that seed, kept as the few runs are the first ones of the many."""
    found = motor_parameters(fitted(with_current(seed, kind), structure))
    return {name: found[name].interval for name in TRUTH}


@pytest.mark.parametrize(("runs", "fewest"), [(20, 16), pytest.param(60, 51, marks=pytest.mark.long)])
@pytest.mark.parametrize(
    ("kind", "structure"), [("prbs", "first_order_coulomb"), ("square", "first_order_one_way")]
)
def test_intervals_from_a_measured_current_cover(kind: str, structure: str, runs: int, fewest: int) -> None:
    """If each covers with 95 %, fewer than 16 of 20 happen once in 390 sets, fewer than 51 of 60 once in 1300 (binomial)."""
    hits = dict.fromkeys(TRUTH, 0)
    for seed in range(runs):
        for name, (low, high) in intervals(seed, kind, structure).items():
            hits[name] += low <= TRUTH[name] <= high
    assert min(hits.values()) >= fewest, hits


def test_a_measured_current_tells_resistance_and_motor_constant_to_a_thousandth() -> None:
    found = motor_parameters(fitted(with_current(7)))

    for name in ("resistance", "motor_constant", "inertia"):
        assert found[name].sd < 1e-3 * TRUTH[name]
    assert "motor-parameters-told" in codes(found)


def test_a_second_order_fit_tells_the_inductance_as_well() -> None:
    truth = Truth(inductance=1.16e-2, viscous_friction=2e-5)
    found = motor_parameters(fitted(with_current(3, truth=truth, sample_time=0.001), "second_order_coulomb"))

    expected = {**TRUTH, "inductance": 1.16e-2, "viscous_friction": 2e-5}
    for name, value in expected.items():
        # 4.5 standard deviations: one seed in 100,000 that is none of the code's fault.
        assert abs(found[name].value - value) < 4.5 * found[name].sd, name


def test_without_current_nothing_is_invented() -> None:
    found = motor_parameters(fitted(dataset(seed=3, kind="prbs")))

    assert not found.estimates
    sentence = next(f.sentence for f in found.findings if f.code == "motor-parameters-not-told")
    assert "twice the resistance and half the inertia" in sentence
    assert "0.0422" in sentence  # 1/K, K = 0.042/(8.4e-6 + 0.042²)


def test_a_stated_resistance_tells_nothing_but_itself_without_the_motor_constant() -> None:
    """K, τ and u_c leave two numbers open, and a resistance is one: k lies between nothing and 1/K."""
    found = motor_parameters(fitted(dataset(seed=3, kind="prbs")), known={"resistance": 8.4})

    assert set(found.estimates) == {"resistance"}
    assert "motor-parameters-not-told" in codes(found)


def test_resistance_and_motor_constant_tell_the_rest_by_the_laws() -> None:
    fit = fitted(dataset(seed=3, kind="prbs"))
    found = motor_parameters(fit, known={"resistance": (8.4, 0.2), "motor_constant": 0.042})

    for name, value in TRUTH.items():
        assert abs(found[name].value - value) < 4.5 * found[name].sd, name
    # T_c = u_c k/R: what isn't known of R isn't known of T_c.
    assert found["coulomb_torque"].sd == pytest.approx(8e-4 * 0.2 / 8.4, rel=0.02)


def test_a_stall_tells_the_resistance_without_what_the_brushes_take() -> None:
    fit = fitted(dataset(seed=3, kind="prbs"))
    found = motor_parameters(fit, stalled=[stalled((1.0, -1.0, 3.0, -3.0), brushes=0.4)])

    assert abs(found["resistance"].value - 8.4) < 4.5 * found["resistance"].sd
    # Of four times 240 samples with 3 mA of noise, 1 V about their mean: 8.4² · 0.003/√960 = 0.0068 Ω.
    assert found["resistance"].sd == pytest.approx(0.0068, rel=0.3)


def test_a_stall_at_one_voltage_says_that_the_brushes_are_in_it() -> None:
    found = motor_parameters(fitted(dataset(seed=3, kind="prbs")), stalled=[stalled((2.0,), brushes=0.4)])

    assert found["resistance"].value == pytest.approx(2.0 / (1.6 / 8.4), rel=0.01)
    assert "stall-of-one-voltage" in codes(found)


def test_a_moving_shaft_is_no_stall() -> None:
    fit = fitted(dataset(seed=3, kind="prbs"))
    found = motor_parameters(fit, stalled=[with_current(4)])

    assert not found.estimates
    assert "stall-unused" in codes(found)


def test_a_stated_value_that_the_current_contradicts_is_reported() -> None:
    fit = fitted(with_current(5))

    assert "motor-parameters-disagree" in codes(motor_parameters(fit, known={"resistance": (4.2, 0.1)}))
    assert "motor-parameters-disagree" not in codes(motor_parameters(fit, known={"resistance": (8.4, 0.1)}))


@pytest.mark.parametrize("change", [lambda i, u: -i, lambda i, u: np.abs(i * u / 12.0)])
def test_a_current_that_is_not_the_armatures_is_not_used(change: object) -> None:
    """One with the wrong sign, and the supply's: power over the supply's voltage."""
    data = with_current(5)
    assert data.current is not None
    odd = replace(data, current=change(data.current, data.u))  # type: ignore[operator]
    found = motor_parameters(fitted(odd))

    assert not found.estimates
    assert "current-not-the-armatures" in codes(found)


def test_an_input_that_never_holds_long_enough_is_reported() -> None:
    """A winding of 14 ms at a sample time of 10 ms: it never settles before the input changes again."""
    random = np.random.default_rng(5)
    data = with_current(5, samples=1000)
    delayed = replace(data, u=random.choice([-3.0, 3.0], 1000) + 1e-3 * random.random(1000))
    motion = march(Truth(inductance=0.012), delayed.u, 0.002)
    slow = replace(delayed, y=(np.floor(motion[:, 2] / QUANTUM) + 0.5) * QUANTUM, current=motion[:, 0])
    found = motor_parameters(fitted(slow))

    assert not found.estimates
    assert "current-unused" in codes(found)


@pytest.mark.parametrize(
    ("known", "error", "why"),
    [
        ({"resistence": 8.4}, UnknownName, "resistance"),
        ({"resistance": -8.4}, UsageError, "expected a value above 0"),
        ({"resistance": (8.4, -1.0)}, UsageError, "standard deviation of 0 or more"),
    ],
)
def test_what_no_motor_has_is_refused(known: dict[str, float], error: type[Exception], why: str) -> None:
    fit = fitted(dataset(seed=3, kind="prbs", samples=1000))

    with pytest.raises(error, match=why):
        motor_parameters(fit, known=known)


def test_a_run_of_the_twin_brings_its_motors_parameters_along() -> None:
    twin = Twin(TwinSettings(current_noise=0.004, resistance=6.0))
    with twin as motor:
        recording = sb.run(sb.Experiment(duration=10, seed=3), motor)
    result = sb.identify(sb.measure(recording))

    found = result.motor_parameters
    assert abs(found["resistance"].value - 6.0) < 4.5 * found["resistance"].sd
    assert abs(found["motor_constant"].value - 0.042) < 4.5 * found["motor_constant"].sd
    plain = json.loads(json.dumps(result.to_dict()))["motor_parameters"]
    assert plain["resistance"]["unit"] == "Ω"


def test_a_fit_that_knows_nothing_tells_nothing_of_the_motor() -> None:
    """A constant input: gain and friction are one and the same, so that the covariance is singular."""
    data = with_current(5, "square", samples=1000)
    constant = replace(data, u=np.full(1000, 2.0))
    motion = march(Truth(), constant.u, 0.002)
    steady = replace(constant, y=(np.floor(motion[:, 2] / QUANTUM) + 0.5) * QUANTUM, current=motion[:, 0])
    found = motor_parameters(fitted(steady, "first_order_one_way"))

    assert not {"inertia", "viscous_friction", "coulomb_torque"} & set(found.estimates)


def test_a_torque_constant_that_friction_would_have_to_drive_is_doubted() -> None:
    """With k > 1/K the motor turns faster than its own back-emf lets it; with k < 1/K friction takes the rest."""
    fit = fitted(dataset(seed=1, kind="prbs"))

    def codes(constant: float) -> list[str]:
        return [f.code for f in motor_parameters(fit, known={"motor_constant": constant}).findings]

    assert "motor-parameters-disagree" in codes(1.2 / fit.model["gain"])
    assert "motor-parameters-disagree" not in codes(0.9 / fit.model["gain"])
