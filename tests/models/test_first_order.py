"""First-order structures: the response against closed forms and the reference motor, sensitivities against differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from servobench.errors import NotIdentifiable
from servobench.models import kernels
from servobench.models.base import STRUCTURES
from tests.datasets import dataset
from tests.motor.reference import Truth, march

N = 800


def inputs(regular: bool) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Times of input and output, and an input with reversals, rest, and values below friction."""
    random = np.random.default_rng(7)
    t = np.arange(N) * 0.002 if regular else np.cumsum(random.uniform(0.0005, 0.004, N))
    t_in = t if regular else t + random.uniform(-0.0004, 0.0004, N)
    u = np.repeat(np.where(random.random(N // 40) < 0.5, -3.0, 3.0), 40)
    u[200:300] = 0.05
    u[500:600] = np.linspace(-1.0, 1.0, 100)
    return t_in, t, u


def response(
    p: NDArray[np.float64], *, regular: bool, friction: bool, speed: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    t_in, t, u = inputs(regular)
    y, jacobian = np.empty(N), np.empty((N, kernels.COLUMNS))
    kernels.response(t_in, u, 0.0, t, p, float(friction), float(speed), y, jacobian)
    return y, jacobian


P = np.array([23.8, 0.0998, 0.02, 0.16, 0.0007, 0.3, 5.0])


@pytest.mark.parametrize("speed", [False, True])
@pytest.mark.parametrize("friction", [False, True])
@pytest.mark.parametrize("regular", [True, False])
@pytest.mark.parametrize("column", range(kernels.COLUMNS))
def test_sensitivities_are_the_derivatives_of_the_response(
    column: int, regular: bool, friction: bool, speed: bool
) -> None:
    step = 1e-6 * max(abs(P[column]), 1e-2)
    up, down = P.copy(), P.copy()
    up[column] += step
    down[column] -= step
    of = {"regular": regular, "friction": friction, "speed": speed}
    difference = (response(up, **of)[0] - response(down, **of)[0]) / (2 * step)
    jacobian = response(P, **of)[1][:, column]
    # Central differences: a truncation error of the order of (1e-6)², and rounding of 1e-16/1e-8 of the response.
    scale = max(float(np.abs(jacobian).max()), 1e-9)
    assert np.abs(difference - jacobian).max() <= 1e-6 * scale + 1e-6


def test_a_step_from_rest_follows_the_closed_form() -> None:
    t = np.arange(200) * 0.002
    p = np.array([20.0, 0.1, 0.0, 0.0, 0.0005, 0.2, 0.0])
    y, jacobian = np.empty(200), np.empty((200, kernels.COLUMNS))
    kernels.response(t[:1], np.array([2.0]), 0.0, t, p, 0.0, 0.0, y, jacobian)
    s = np.maximum(t - 0.0005, 0.0)
    np.testing.assert_allclose(y, 0.2 + 40.0 * (s - 0.1 * (1 - np.exp(-s / 0.1))), atol=1e-12)


def test_the_sum_rule_ties_speed_and_position_to_the_integral_of_the_input() -> None:
    """τ (ω - ω₀) + θ - θ₀ = K ∫ (u - u₀) dt, whatever the input, where there is no friction."""
    _t_in, t, u = inputs(regular=True)
    p = P.copy()
    p[kernels.DELAY] = 0.0
    position, _ = response(p, regular=True, friction=False, speed=False)
    speed, _ = response(p, regular=True, friction=False, speed=True)
    area = np.concatenate([[0.0], np.cumsum((u - p[kernels.OFFSET])[:-1] * np.diff(t))])
    left = p[kernels.TAU] * (speed - speed[0]) + position - position[0]
    np.testing.assert_allclose(left, p[kernels.GAIN] * area, atol=1e-10)


def test_the_friction_model_is_the_motor_without_inductance() -> None:
    """Against the reference motor with so little inductance that its current follows at once."""
    _, _t, u = inputs(regular=True)
    truth = Truth(inductance=1e-9)
    stiffness = truth.resistance * truth.viscous_friction + truth.motor_constant**2
    p = np.zeros(kernels.COLUMNS)
    p[kernels.GAIN] = truth.motor_constant / stiffness
    p[kernels.TAU] = truth.inertia * truth.resistance / stiffness
    p[kernels.COULOMB] = truth.coulomb_torque * truth.resistance / truth.motor_constant
    expected = march(truth, u, 0.002, step=2e-7)[:, 2]
    found, _ = response(p, regular=True, friction=True, speed=False)
    # The reference's current lags by half a step of 0.2 µs: 1e-7 s x 24 rad/(s·V) x 6 V = 1.4e-5 rad, 0.005 of a count.
    assert np.abs(found - expected).max() < 0.02 * 2 * np.pi / 2048


@given(st.floats(-0.004, 0.004), st.floats(0.0, 0.3), st.floats(-0.1, 0.1))
def test_a_sample_never_depends_on_an_input_that_acts_later(
    delay: float, coulomb: float, offset: float
) -> None:
    t = np.arange(40) * 0.002
    random = np.random.default_rng(3)
    u = random.normal(0.0, 2.0, 40)
    changed = u.copy()
    changed[20:] += 1.0
    p = np.array([20.0, 0.05, offset, coulomb, delay, 0.0, 1.0])
    outputs = []
    for values in (u, changed):
        y, jacobian = np.empty(40), np.empty((40, kernels.COLUMNS))
        kernels.response(t, values, 0.0, t, p, 1.0, 0.0, y, jacobian)
        outputs.append(y)
    same = t <= t[20] + delay
    np.testing.assert_array_equal(outputs[0][same], outputs[1][same])


@pytest.mark.parametrize("name", STRUCTURES.names())
def test_a_structure_predicts_through_a_chain_with_its_exact_jacobian(name: str) -> None:
    data = dataset(seed=2, kind="prbs", samples=600, chain="derivative | lowpass 50 rad/s")
    structure = STRUCTURES[name]
    theta = structure.guesses([data])[0]
    prediction = structure.predict(theta, data)
    for n in range(len(theta)):
        step = 1e-6 * max(abs(theta[n]), 1e-3)
        up, down = theta.copy(), theta.copy()
        up[n] += step
        down[n] -= step
        difference = (structure.predict(up, data).y - structure.predict(down, data).y) / (2 * step)
        scale = max(float(np.abs(prediction.jacobian[:, n]).max()), 1e-6)
        # A reversal or a delayed change that passes a sample within the step bends the response there: a kink of the speed.
        assert np.median(np.abs(difference - prediction.jacobian[:, n])) <= 1e-6 * scale


def test_an_output_that_never_moves_is_refused_with_what_to_look_at() -> None:
    data = dataset(seed=1, samples=200)
    still = dataset(seed=1, samples=200, y=np.full(200, 1.0))
    assert STRUCTURES["first_order"].guesses([data])
    with pytest.raises(NotIdentifiable, match="blocked"):
        STRUCTURES["first_order"].guesses([still])
