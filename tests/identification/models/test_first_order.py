"""First-order structures: the response against closed forms and the reference motor, sensitivities against differences."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from servobench.core.errors import NotIdentifiable
from servobench.identification.estimators.base import ESTIMATORS
from servobench.identification.estimators.least_squares import lowest
from servobench.identification.models import kernels
from servobench.identification.models.base import STRUCTURES
from servobench.identification.models.first_order import FirstOrder
from servobench.identification.models.position_loop import PositionLoop
from servobench.recordings.measurement.base import Chain, Kind
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset
from tests.rig.motor.reference import Truth, march

N = 800
ALL = np.arange(kernels.COLUMNS)


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
    kernels.response(t_in, u, 0.0, t, p, float(friction), float(speed), ALL, y, jacobian)
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
    kernels.response(t[:1], np.array([2.0]), 0.0, t, p, 0.0, 0.0, ALL, y, jacobian)
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
        kernels.response(t, values, 0.0, t, p, 1.0, 0.0, ALL, y, jacobian)
        outputs.append(y)
    same = t <= t[20] + delay
    np.testing.assert_array_equal(outputs[0][same], outputs[1][same])


# A position loop's input is a goal: test_position_loop.py has data for it.
DRIVEN = [name for name in STRUCTURES.names() if not isinstance(STRUCTURES[name], PositionLoop)]


@pytest.mark.parametrize("name", DRIVEN)
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


FIRST_ORDER = [name for name in STRUCTURES.names() if isinstance(STRUCTURES[name], FirstOrder)]


def record(kind: Kind, *, steady: bool, regular: bool, delay: float) -> Dataset:
    """A record with reversals, rest and coasting; `steady` inputs hold for many samples, others change at each of them."""
    t_in, t, u = inputs(regular)
    random = np.random.default_rng(11)
    return replace(
        dataset(seed=1, samples=N),
        t_input=np.sort(t_in),
        u=u if steady else u + random.normal(0.0, 0.3, N),
        t_output=t,
        y=np.cumsum(random.normal(0.0, 0.1, N)),
        kind=kind,
        output_unit="rad" if kind == "position" else "rad/s",
        quantum=None,
        delay=delay,
    )


@pytest.mark.parametrize("delay", [-0.0031, 0.0, 0.00052, 0.0047])
@pytest.mark.parametrize("steady", [True, False])
@pytest.mark.parametrize("regular", [True, False])
@pytest.mark.parametrize("kind", ["position", "speed"])
@pytest.mark.parametrize("name", FIRST_ORDER)
def test_normal_equations_without_a_jacobian_are_those_with_one(
    name: str, kind: Kind, regular: bool, steady: bool, delay: float
) -> None:
    structure = STRUCTURES[name]
    data = record(kind, steady=steady, regular=regular, delay=delay)
    value = {"gain": 23.8, "time_constant": 0.0998, "coulomb_voltage": 0.16, "offset_voltage": 0.02}
    start = [0.3, 5.0] if kind == "position" else [5.0]
    theta = np.array([*(value.get(parameter.name, 0.0007) for parameter in structure.parameters), *start])
    prediction = structure.predict(theta, data)
    both = np.column_stack([prediction.jacobian, data.y - prediction.y])
    expected = both.T @ both

    h, g, cost = structure.normal(theta, data)  # type: ignore[attr-defined]

    found = np.block([[h, g[:, None]], [g[None, :], np.array([[cost]])]])
    # e^(-h/τ) is a product of up to 800 factors, each rounded to 2e-16: 2e-13 of the largest term. Terms that cancel in a sum
    # over a piece (a ramp less what the shaft lags behind) are up to 100 times the sum.
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.all(np.abs(found - expected) <= 2e-11 * scale)


@pytest.mark.parametrize("kind", ["square", "prbs"])
@pytest.mark.parametrize("name", FIRST_ORDER)
def test_a_chain_that_does_nothing_changes_no_guess(name: str, kind: Literal["square", "prbs"]) -> None:
    """Plain data have a compiled way to a guess; through a chain each column is predicted by itself."""
    data = dataset(seed=1, kind=kind)
    plain = STRUCTURES[name].guesses([data, dataset(seed=2, kind=kind, samples=900)])
    chained = STRUCTURES[name].guesses(
        [
            replace(record, applied=Chain.parse("scale 1"))
            for record in (data, dataset(seed=2, kind=kind, samples=900))
        ]
    )
    assert len(plain) == len(chained)
    for one, other in zip(plain, chained, strict=True):
        if name == "first_order_coulomb" and kind == "square":
            # Turning one way, friction and offset are one; how they are shared out is rounding's choice.
            one, other = (np.array([x[0], x[1], x[2] + x[3], x[4]]) for x in (one, other))
        # The normal equations double the digits that near-collinear columns (ramp and response) cost: 1e-16 x 10⁴ x 10⁴.
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", ["first_order_coulomb", "first_order_one_way_rest"])
def test_a_motor_with_its_wires_the_other_way_has_the_same_guesses_but_for_signs(name: str) -> None:
    """Friction brakes it all the same. Where it starts and how fast has the other sign, as the gain has."""
    data = dataset(seed=1, kind="prbs", samples=3000)
    structure = STRUCTURES[name]
    signs = np.ones(len(structure.parameters) + 2)
    signs[[0, -2, -1]] = -1.0

    own, turned = (structure.guesses([each]) for each in (data, replace(data, y=-data.y)))

    assert len(own) == len(turned)
    np.testing.assert_allclose(np.array(turned), signs * np.array(own), rtol=1e-9, atol=1e-12)


def test_the_samples_for_a_guess_fall_in_with_no_period_of_the_input() -> None:
    """A sine with as many periods as there are samples in use: evenly spaced ones would all see the same phase."""
    t = np.arange(24_000) * 0.0005
    u = 3 * np.sin(2 * np.pi * 20.0 * t)
    y, jacobian = np.empty(len(t)), np.empty((len(t), 0))
    p = np.array([24.0, 0.1, 0.0, 0.0, 0.0003, 0.0, 0.0])
    kernels.response(t, u, 0.0, t, p, 0.0, 0.0, ALL[:0], y, jacobian)
    data = replace(dataset(seed=1, samples=10), t_input=t, u=u, t_output=t, y=y, quantum=None)

    guess = STRUCTURES["first_order"].guesses([data])[0]

    # The grid of τ is refined to 1.2 %, that of the delay is coarse: a third of a time constant is near enough for a search.
    assert guess[:2] == pytest.approx([24.0, 0.1], rel=0.3)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("start", "end"), [(0.0, 3.0), (3.0, 6.0), (6.3, 10.0)])
def test_a_start_state_alone_is_found_as_well_as_from_all_guesses(
    seed: int, start: float, end: float
) -> None:
    """With the parameters held, least squares at one time constant and delay leads where a search over both of them does."""
    whole, structure = dataset(seed=seed, kind="prbs"), STRUCTURES["first_order_coulomb"]
    theta = lowest(structure, [whole], structure.guesses([whole])).theta[:5]
    part = whole.part(start, end)
    free = np.arange(7) >= 5
    guessed = [np.concatenate([theta, guess[5:]]) for guess in structure.guesses([part])]

    found = lowest(structure, [part], structure.starts(theta, part), free)

    # Each search ends within a thousandth of a standard deviation of a minimum: 1e-6 of a residual's variance, cost/M.
    assert found.cost <= lowest(structure, [part], guessed, free).cost * (1 + 2e-6 / len(part.y))


@pytest.mark.parametrize(
    ("t", "first"), [(0.0, (0, 9.0)), (0.02, (0, 9.0)), (0.025, (1, 1.0)), (0.035, (2, 2.0)), (0.1, (3, 3.0))]
)
def test_before_the_first_sample_all_inputs_have_acted_that_came_a_delay_earlier(
    t: float, first: tuple[int, float]
) -> None:
    """Inputs at 0, 10 and 20 ms with a delay of 20 ms."""
    inputs = 0.01 * np.arange(3), np.array([1.0, 2.0, 3.0])

    assert kernels.first_input(*inputs, 9.0, 0.02, t) == first


@pytest.mark.parametrize("late", [0, 1])
@pytest.mark.parametrize(("inertia", "pulse"), [(5e-6, 20), (1e-5, 8), (1e-5, 10)])
def test_rows_as_far_apart_as_a_time_constant_that_have_answered_to_their_own_input_are_explained(
    inertia: float, pulse: int, late: int
) -> None:
    """Pulses whose speed over each 50 ms is written at their end, beside the input of that time or of the one before.

    The motor's time constant is a half or all of that time. The encoder's rounding leaves less than 1 % of the speed.
    """
    acted = np.resize(np.repeat([0.0, 3.0], pulse), 160)
    turned = dataset(
        seed=2, samples=4001, u=np.append(np.repeat(acted, 25), 0.0), truth=Truth(inertia=inertia)
    )
    t, speed = 0.05 * np.arange(1, 161), np.diff(turned.y[::25]) / 0.05
    log = dataset(seed=1, samples=160, sample_time=0.05, u=np.roll(acted, late), y=speed)
    log = replace(log, t_input=t, t_output=t, kind="speed", output_unit="rad/s", quantum=None)

    assert ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way_rest"], [log]).fit_percent > 99
