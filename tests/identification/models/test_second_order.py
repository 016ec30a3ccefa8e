"""The second-order motor: its response against the reference motor with friction, its sensitivities, and what fits find."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.core.finding import Verdict
from servobench.identification.estimators.output_error import OutputError
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.identification.models.second_order import kernels
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import QUANTUM, dataset
from tests.rig.motor.reference import Truth, march

N = 800
ALL = np.arange(kernels.COLUMNS)


def poles(truth: Truth) -> dict[str, float]:
    """The true values of a fit, from the roots of J L s² + (J R + L b) s + R b + k², by NumPy's own solver."""
    r, l, k, j, b, friction = truth
    slow, fast = np.sort(-1.0 / np.roots([j * l, j * r + l * b, r * b + k * k]))[::-1]
    return {
        "gain": k / (r * b + k * k),
        "time_constant": float(slow),
        "electrical_time_constant": float(slow * fast / (slow + fast)),
        "coulomb_voltage": friction * r / k,
        "offset_voltage": 0.0,
        "delay": 0.0,
    }


def inputs() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """An input with reversals, rest, and values below friction."""
    random = np.random.default_rng(7)
    u = np.repeat(np.where(random.random(N // 40) < 0.5, -3.0, 3.0), 40)
    u[200:300] = 0.05
    u[500:600] = np.linspace(-1.0, 1.0, 100)
    return np.arange(N) * 0.002, u


def response(p: NDArray[np.float64], speed: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    t, u = inputs()
    y, jacobian = np.empty(N), np.empty((N, kernels.COLUMNS))
    kernels.response(t, u, 0.0, t, p, 1.0, float(speed), ALL, y, jacobian)
    return y, jacobian


@pytest.mark.parametrize("inductance", [1.16e-3, 1.16e-2, 0.1])
def test_friction_acts_on_the_shaft_as_in_the_reference_motor(inductance: float) -> None:
    truth = Truth(inductance=inductance, viscous_friction=0.0)
    value = poles(truth)
    slow, lag = value["time_constant"], value["electrical_time_constant"]
    p = np.array([slow, slow * lag / (slow - lag), 0.0, value["coulomb_voltage"], 0.0, 0.0])
    _, u = inputs()
    expected = march(truth, u, 0.002, step=2.5e-6)[:, 2]
    found, _ = response(p, speed=False)
    # Each reversal falls anywhere within a step of the reference: half a step of 2 u_c K at the most, 1.25 µs x 0.32 V x 23.7
    # rad/(s·V) = 1e-5 rad, for some ten reversals; measured 0.006 of a count, and less with shorter steps.
    assert np.abs(value["gain"] * found - expected).max() < 0.02 * QUANTUM


def test_viscous_friction_moves_only_what_the_docstring_says() -> None:
    """With b = 20 times the QUBE's, L/R is longer than τ_e by less than R b/(R b + k²) τ₂/τ of it."""
    truth = Truth(inductance=1.16e-2, viscous_friction=2e-5)
    value = poles(truth)
    exact = truth.inductance / truth.resistance
    fast = value["time_constant"] * value["electrical_time_constant"]
    fast /= value["time_constant"] - value["electrical_time_constant"]
    drag = truth.resistance * truth.viscous_friction
    most = drag / (drag + truth.motor_constant**2) * fast / value["time_constant"]
    assert 0 < exact / value["electrical_time_constant"] - 1 <= most


@pytest.mark.parametrize("speed", [False, True])
@pytest.mark.parametrize("column", range(kernels.COLUMNS))
def test_sensitivities_are_the_derivatives_of_the_response(column: int, speed: bool) -> None:
    p = np.array([0.0979, 1.4e-3, 0.02, 0.16, 0.0007, 0.2])
    step = 1e-6 * max(abs(p[column]), 1e-3)
    up, down = p.copy(), p.copy()
    up[column] += step
    down[column] -= step
    difference = (response(up, speed)[0] - response(down, speed)[0]) / (2 * step)
    jacobian = response(p, speed)[1][:, column]
    # Rounding of 1e-15 of the response over a step of 1e-9 is 1e-6 in units of the Jacobian's own size.
    assert np.abs(difference - jacobian).max() <= 2e-6 * np.abs(jacobian).max() + 1e-6


def test_the_current_at_the_start_follows_from_the_inputs_before() -> None:
    """The same motor, its record cut off a quarter of a time constant of the winding after a change of the input."""
    structure = STRUCTURES["second_order"]
    theta = np.array([23.7, 0.0979, 1.38e-3, 0.0, 1e-4])
    t = 0.0005 * np.arange(400)
    u = np.where(t < 0.1, 0.0, 3.0)
    whole = Dataset(
        name="whole", t_input=t, u=u, input_unit="V", input_before=0.0, t_output=t, y=np.zeros(400), output_unit="rad/s",
        kind="speed", source=dataset(seed=0, samples=10).source,
    )  # fmt: skip
    y = structure.predict(np.append(theta, 0.0), whole).y
    late = replace(whole, t_output=t[201:], y=np.zeros(199))
    # The speed hardly moves in the 0.4 ms that it is taken for constant: 3 V / 0.1 s x 0.4 ms of 71 rad/s, 0.4 %, of which
    # the current sees 0.4 %.
    found = structure.predict(np.append(theta, y[201]), late).y
    assert np.abs(found - y[201:]).max() < 1e-4 * np.abs(y).max()


@pytest.mark.parametrize(("sample_time", "hold"), [(0.0002, 100), (0.001, 50)])
def test_a_slow_winding_is_found_with_intervals_that_hold_the_truth(sample_time: float, hold: int) -> None:
    truth = Truth(inductance=1.16e-2)
    data = dataset(seed=5, kind="prbs", sample_time=sample_time, truth=truth, hold=hold)
    fit = OutputError().fit(STRUCTURES["second_order_coulomb"], [data])
    for name, expected in poles(truth).items():
        # 4.5 standard deviations: one seed in 100,000 that is none of the code's fault.
        assert abs(fit[name].value - expected) < 4.5 * fit[name].sd, name
    assert fit["electrical_time_constant"].sd < 0.02 * fit["electrical_time_constant"].value


def test_turning_one_way_friction_goes_into_one_voltage() -> None:
    truth = Truth(inductance=1.16e-2)
    data = dataset(seed=5, sample_time=0.001, truth=truth)
    fit = OutputError().fit(STRUCTURES["second_order_one_way"], [data])
    for name in ("gain", "time_constant", "electrical_time_constant", "coulomb_voltage", "delay"):
        assert abs(fit[name].value - poles(truth)[name]) < 4.5 * fit[name].sd, name


def test_a_fine_encoder_tells_the_winding_of_the_qube() -> None:
    """0.14 ms at a sample time of 0.2 ms, with 2^17 counts in a turn."""
    quantum = 2 * math.pi / 2**17
    u = dataset(seed=3, kind="prbs", sample_time=0.0002, hold=50, samples=5000)
    angle = march(Truth(), u.u, 0.0002)[:, 2]
    data = replace(u, y=(np.floor(angle / quantum) + 0.5) * quantum, quantum=quantum)
    fit = OutputError().fit(STRUCTURES["second_order_coulomb"], [data])
    expected = poles(Truth())["electrical_time_constant"]
    lag = fit["electrical_time_constant"]
    assert abs(lag.value - expected) < 4.5 * lag.sd
    assert lag.sd < lag.value / 8


def test_a_winding_that_cannot_be_reported_from_a_delay_is_refused() -> None:
    data = dataset(seed=3, kind="prbs", sample_time=0.002, samples=2500)
    result = identify(data, structure="second_order_coulomb")

    assert result.verdict is Verdict.REFUSED
    sentence = next(f.sentence for f in result.findings if f.code == "electrical-pole-not-told")
    assert "first-order structure" in sentence


def test_poles_that_would_be_complex_are_no_prediction() -> None:
    data = dataset(seed=1, samples=100)
    structure = STRUCTURES["second_order"]

    assert np.isnan(structure.predict(np.array([20.0, 0.1, 0.06, 0.0, 0.0, 0.0, 0.0]), data).y).all()
    assert np.isfinite(structure.predict(np.array([20.0, 0.1, 0.04, 0.0, 0.0, 0.0, 0.0]), data).y).all()


@pytest.mark.parametrize("text", ["tachometer 10 ms", "lowpass 60 rad/s"])
def test_behind_a_chain_the_prediction_is_what_the_chain_makes_of_the_position(text: str) -> None:
    """The motor starts at rest with the chain; a filter whose state at the start is unknown is at that of no motion."""
    structure, theta = STRUCTURES["second_order"], np.array([23.7, 0.0979, 1.38e-3, 0.0, 1e-4])
    plain = dataset(seed=1, kind="prbs", samples=400)
    chain = Chain.parse(text)
    data = replace(plain, kind=chain.yields("position"), applied=chain, quantum=None)
    start = np.zeros(len(structure.nuisance(data)))

    found = structure.predict(np.append(theta, start), data).y

    shaft = structure.predict(np.append(theta, np.zeros(2)), plain).y
    np.testing.assert_allclose(found, chain(shaft, plain.t_output), rtol=1e-9, atol=1e-12)
