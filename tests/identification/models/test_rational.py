"""Rational structures: the response against a matrix exponential and the first-order motor, the Jacobian, names and units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from servobench.core.errors import NotIdentifiable
from servobench.identification.models.base import STRUCTURES, Model
from servobench.identification.models.rational import Rational, rational
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source
from tests.datasets import dataset

Array = NDArray[np.float64]
N = 400


def record(*, regular: bool = True, kind: str = "speed", chain: str = "") -> Dataset:
    """A record with a binary input, latched beside the output or a little off it, and zeros for the output."""
    random = np.random.default_rng(11)
    t = np.arange(N) * 0.002 if regular else np.cumsum(random.uniform(0.0005, 0.004, N))
    t_in = t if regular else t + random.uniform(-0.0002, 0.0002, N)
    return Dataset(
        name="made up",
        t_input=t_in,
        u=np.repeat(np.where(random.random(N // 8) < 0.5, -3.0, 3.0), 8),
        input_unit="V",
        input_before=1.0,
        t_output=t,
        y=np.zeros(N),
        output_unit="rad" if kind == "position" else "rad/s",
        kind="position" if kind == "position" else "speed",
        source=Source(name="made up"),
        applied=Chain.parse(chain),
    )


def coefficients(structure: Rational) -> list[float]:
    """Poles between 10 and 100 1/s, one pair of them complex from the third order on, and zeros of either sign."""
    poles = {1: [-10], 2: [-10, -60], 3: [-10, -20 + 40j, -20 - 40j], 4: [-10, -100, -20 + 40j, -20 - 40j]}
    a = np.real(np.poly(poles[structure.order]))
    b = np.atleast_1d(np.poly([-30.0, 25.0, -50.0][: structure.zeros]))
    return [*a[1:], *(5.0 * a[-1] / b[-1] * b), *([0.0033] if structure.delayed else [])]


def vector(structure: Rational, data: Dataset) -> Array:
    """Parameters, and start states of the size of the output."""
    own = len(structure.nuisance(data))
    sizes = np.array([*(20.0**k for k in range(structure.start_order(data))), 3.0, 0.7, 0.4])[:own]
    return np.concatenate([coefficients(structure), sizes * np.random.default_rng(3).uniform(0.5, 1.5, own)])


def dense(structure: Rational, theta: Array, data: Dataset) -> Array:
    """The output by another route: the observer form, whose state is the start state, one matrix exponential for each piece."""
    n, m = structure.order, structure.zeros
    a, b = theta[:n], np.concatenate([np.zeros(n - m - 1), theta[n : n + m + 1]])
    if structure.integrates(data):
        a, b = np.append(a, 0.0), np.concatenate([[0.0], b])
    size = len(a)
    field = np.zeros((size + 1, size + 1))
    field[:size, 0] = -a
    field[: size - 1, 1:size] = np.eye(size - 1)
    field[:size, size] = b
    delay = theta[n + m + 1] if structure.delayed else 0.0
    start = len(structure.parameters)
    state = np.concatenate([theta[start : start + size], [0.0]])
    rest = theta[start + size]
    y, now = np.empty(len(data.t_output)), float(data.t_output[0])
    changes = data.t_input + delay
    for k, t in enumerate(data.t_output):
        for edge in [*changes[(changes > now) & (changes < t)], t]:
            held = np.searchsorted(changes, 0.5 * (now + edge)) - 1
            state[size] = data.u[held] if held >= 0 else data.input_before
            state = expm(field * (edge - now)) @ state
            now = edge
        y[k] = state[0] + rest * (t - data.t_output[0] if structure.integrates(data) else 1.0)
    return y


@pytest.mark.parametrize("regular", [True, False])
@pytest.mark.parametrize(
    "name", ["rational_1_0", "rational_2_1_delay", "rational_4_1", "rational_3_2_integrator_delay"]
)
def test_the_response_is_that_of_matrix_exponentials_over_the_pieces(name: str, regular: bool) -> None:
    structure = rational(name)
    assert structure is not None
    data = record(regular=regular, kind="position" if structure.integrator else "speed")
    theta = vector(structure, data)

    expected = dense(structure, theta, data)

    # Rounding: 800 pieces, each with a few eps of the state, whose largest entry is some 1e4 of the output.
    np.testing.assert_allclose(structure.predict(theta, data).y, expected, atol=1e-9 * np.ptp(expected))


@pytest.mark.parametrize("regular", [True, False])
@pytest.mark.parametrize("kind", ["position", "speed"])
def test_one_pole_and_the_integrator_are_the_first_order_motor(kind: str, regular: bool) -> None:
    """K = b₀/a₁, τ = 1/a₁; C is the start position and speed, and u₀ the part at no input: c₁ = θ₀, c₂ = ω₀ + a₁ θ₀ + K u₀."""
    data = record(regular=regular, kind=kind)
    motor, structure = STRUCTURES["first_order"], STRUCTURES["rational_1_0_integrator_delay"]
    gain, tau, offset, delay, angle, speed = 23.8, 0.1, 0.3, 0.0031, 0.7, 20.0
    own = [angle, speed] if kind == "position" else [speed]
    expected = motor.predict(np.array([gain, tau, offset, delay, *own]), data)
    start = speed + gain * offset  # the speed above that at no input, -K u₀
    own = [angle, start + angle / tau] if kind == "position" else [start]
    found = structure.predict(np.array([1 / tau, gain / tau, delay, *own, -gain * offset]), data)

    np.testing.assert_allclose(found.y, expected.y, atol=1e-11 * np.abs(expected.y).max())
    by_delay = [parameter.name for parameter in motor.parameters].index("delay")
    column = expected.jacobian[:, by_delay]
    np.testing.assert_allclose(found.jacobian[:, 2], column, atol=1e-11 * np.abs(column).max())


@pytest.mark.parametrize("regular", [True, False])
@pytest.mark.parametrize(
    ("name", "kind", "chain"),
    [
        ("rational_1_0_integrator_delay", "position", ""),
        ("rational_2_1_delay", "position", ""),
        ("rational_4_1", "speed", ""),
        ("rational_4_3_delay", "speed", ""),
        ("rational_3_1_integrator_delay", "speed", ""),
        ("rational_3_2_integrator", "position", ""),
        ("rational_2_1_delay", "speed", "lowpass 50 rad/s"),
        ("rational_2_1_integrator_delay", "speed", "derivative | lowpass 50 rad/s"),
        ("rational_2_0", "speed", "derivative"),
    ],
)
def test_the_jacobian_is_the_derivative_of_the_prediction(
    name: str, kind: str, chain: str, regular: bool
) -> None:
    structure = rational(name)
    assert structure is not None
    data = record(regular=regular, kind=kind, chain=chain)
    theta = vector(structure, data)
    prediction = structure.predict(theta, data)
    for n in range(len(theta)):
        column = prediction.jacobian[:, n]
        largest = float(np.abs(column).max())
        # A step that moves the output by 1e-6 of itself at the least.
        step = 1e-6 * max(abs(theta[n]), float(np.abs(prediction.y).max()) / largest)
        up, down = theta.copy(), theta.copy()
        up[n] += step
        down[n] -= step
        difference = (structure.predict(up, data).y - structure.predict(down, data).y) / (2 * step)
        # Rounding: 1e-13 of an angle over 2 ms, over 1e-6 of a speed, is 1e-6. A change of the input that passes a sample
        # within the step bends the response there, so that a single sample may be off.
        assert np.median(np.abs(difference - column)) <= 2e-6 * largest, n


def test_a_sample_doesn_t_depend_on_which_others_there_are() -> None:
    """Nothing is resampled: a part of the times gives the same values there."""
    structure = rational("rational_3_1_delay")
    assert structure is not None
    data = record()
    theta = vector(structure, data)
    keep = np.random.default_rng(1).random(N) > 0.4
    keep[0] = True
    part = replace(data, t_output=data.t_output[keep], y=data.y[keep])
    whole = structure.predict(theta, data).y
    np.testing.assert_allclose(structure.predict(theta, part).y, whole[keep], atol=1e-10 * np.ptp(whole))


def test_poles_six_decades_apart_keep_their_accuracy() -> None:
    """1e6/((s + 1)(s + 1e6)): after a step, 1 - e^-t but for the fast pole's part of a millionth."""
    t = np.linspace(0.0, 5.0, 400)
    data = replace(record(), t_input=t[:1], u=np.ones(1), t_output=t, y=0 * t)
    structure = rational("rational_2_0")
    assert structure is not None
    y = structure.predict(np.array([1e6 + 1, 1e6, 1e6, 0.0, 0.0, 0.0]), data).y
    expected = 1 - (1e6 * np.exp(-t) - np.exp(-1e6 * t)) / (1e6 - 1)
    np.testing.assert_allclose(y, expected, atol=1e-9)


def test_a_model_that_runs_away_predicts_no_numbers_and_no_warnings() -> None:
    structure = rational("rational_2_0")
    assert structure is not None
    y = structure.predict(np.array([-1e4, -1e8, 1.0, 1.0, 0.0, 0.0]), record()).y
    assert np.isnan(y).all()


@pytest.mark.parametrize(
    "name", ["rational_1_0", "rational_2_1", "rational_4_1", "rational_2_1_integrator_delay"]
)
def test_a_structure_is_a_member_under_the_name_of_its_orders(name: str) -> None:
    assert STRUCTURES[name] == rational(name)
    assert STRUCTURES.name_of(STRUCTURES[name]) == name


def test_a_name_may_ask_for_any_order_but_for_no_more_zeros_than_a_response_has() -> None:
    assert rational("rational_7_3_delay") == Rational(7, 3, delayed=True)
    for name in (
        "rational_2_2",
        "rational_0_0",
        "rational_2",
        "rational_2_1_delay_integrator",
        "first_order",
    ):
        assert rational(name) is None


def test_units_are_those_of_the_coefficients() -> None:
    speed, position = record(), record(kind="position")
    units = Model(structure=Rational(2, 1), theta=np.zeros(4), data=speed).units
    assert units == ("1/s", "1/s^2", "rad/(s^2·V)", "rad/(s^3·V)")
    units = Model(structure=Rational(2, 1), theta=np.zeros(4), data=position).units
    assert units == ("1/s", "1/s^2", "rad/(s·V)", "rad/(s^2·V)")
    # With the integrator B/A is the speed's whatever is recorded: b₀ = K a₁.
    structure = Rational(1, 0, integrator=True, delayed=True)
    for data in (speed, position):
        assert Model(structure=structure, theta=np.zeros(3), data=data).units == ("1/s", "rad/(s^2·V)", "s")


def test_the_transfer_function_knows_position_from_speed() -> None:
    theta, s = np.array([3.0, 2.0, 5.0, 4.0]), np.array([0.7j, 2.0 + 1.0j])
    own = (5 * s + 4) / (s**2 + 3 * s + 2)
    for data, integrator, of_speed in (
        (record(), False, own),
        (record(kind="position"), False, own * s),
        (record(kind="position"), True, own),
    ):
        structure = Rational(2, 1, integrator)
        np.testing.assert_allclose(structure.transfer_function(theta, "speed", data)(s), of_speed)
        np.testing.assert_allclose(structure.transfer_function(theta, "position", data)(s), of_speed / s)
        assert structure.transfer_function(theta, "speed", data).unit == "rad/(s·V)"
        assert structure.transfer_function(theta, "position", data).unit == "rad/V"


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("rational_1_0", "speed"),
        ("rational_2_1", "position"),
        ("rational_3_1", "speed"),
        ("rational_4_1", "speed"),
        ("rational_1_0_integrator", "position"),
        ("rational_2_0_integrator", "position"),
    ],
)
def test_the_guess_from_exact_data_is_the_truth(name: str, kind: str) -> None:
    structure = rational(name)
    assert structure is not None
    data = record(kind=kind)
    theta = vector(structure, data)
    data = replace(data, y=structure.predict(theta, data).y)
    count = len(structure.parameters)
    # The iteration ends at a tenth of a standard deviation, which exact data make as small as the last pass left it.
    np.testing.assert_allclose(structure.guesses([data])[0][:count], theta[:count], rtol=1e-2)


def test_an_output_that_never_moves_or_is_too_short_is_refused() -> None:
    structure = STRUCTURES["rational_2_1"]
    with pytest.raises(NotIdentifiable, match="stays at 1 rad"):
        structure.guesses([dataset(seed=1, samples=200, y=np.full(200, 1.0))])
    with pytest.raises(NotIdentifiable, match=r"10 samples .* at least 14"):
        structure.guesses([dataset(seed=1, samples=10)])
