"""Motors with a friction ladder and gravity: against a finely stepped motor, differences, and the structures they contain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from servobench.core.errors import NotIdentifiable, UnknownName
from servobench.identification.models.base import STRUCTURES, Structure
from servobench.identification.models.nonlinear import kernels
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset
from tests.rig.motor.odd_motor import OddMotor, marched

VALUES = {
    "gain": 23.8,
    "time_constant": 0.1,
    "coulomb_voltage": 0.16,
    "offset_voltage": 0.03,
    "coulomb_voltage_forward": 0.19,
    "coulomb_voltage_backward": 0.13,
    "drag_asymmetry": 1e-3,
    "stribeck_voltage": 0.1,
    "stribeck_speed": 2.0,
    "gravity_voltage_sine": 0.9,
    "gravity_voltage_cosine": 0.3,
    "load_friction": 0.2,
    "delay": 0.0013,
}
NAMES = (
    "first_order_gravity",
    "first_order_asymmetric",
    "first_order_coulomb_stribeck",
    "first_order_one_way_stribeck",
    "first_order_coulomb_gravity",
    "first_order_asymmetric_stribeck_gravity_load",
    "first_order_coulomb_stribeck_gravity_load",
)


def theta_of(structure: Structure, start: tuple[float, ...] = (0.1, 0.5)) -> NDArray[np.float64]:
    return np.array([*(VALUES[parameter.name] for parameter in structure.parameters), *start])


def truth(structure: Structure) -> OddMotor:
    """The same motor for the reference, by the names of the parameters."""
    value = {p.name: VALUES[p.name] for p in structure.parameters}
    forward = value.get("coulomb_voltage_forward", value.get("coulomb_voltage", 0.0))
    backward = value.get("coulomb_voltage_backward", forward)
    return OddMotor(
        gain=value["gain"],
        time_constant=value["time_constant"],
        coulomb=0.5 * (forward + backward),
        offset=value.get("offset_voltage", 0.5 * (forward - backward)),
        delay=value["delay"],
        stribeck=value.get("stribeck_voltage", 0.0),
        stribeck_speed=value.get("stribeck_speed", 1.0),
        gravity_sine=value.get("gravity_voltage_sine", 0.0),
        gravity_cosine=value.get("gravity_voltage_cosine", 0.0),
        load=value.get("load_friction", 0.0),
        drag_asymmetry=value.get("drag_asymmetry", 0.0),
    )


def swinging(samples: int = 600) -> Dataset:
    """An input of many levels, small and large, with reversals, stops and rests: held for 20 samples of 2 ms each."""
    random = np.random.default_rng(5)
    levels = random.choice([-2.0, -0.8, -0.25, 0.0, 0.1, 0.3, 1.0, 2.2], size=samples // 20)
    return replace(dataset(seed=1, samples=samples, y=np.zeros(samples)), u=np.repeat(levels, 20))


@pytest.mark.parametrize("name", NAMES)
def test_the_response_is_that_of_a_finely_stepped_motor(name: str) -> None:
    structure, data = STRUCTURES[name], swinging()
    found = structure.predict(theta_of(structure, (0.1, 0.0)), data).y
    # The reference is of second order but for its stops, which it meets to within a step: two lengths of the step tell its error.
    rough, fine = (marched(truth(structure), data.u, 0.002, 0.1, step)[:, 0] for step in (4e-6, 1e-6))
    error = np.abs(rough - fine).max()
    assert 0 < error < 1e-2
    # The model's own steps are of 1e-7 each, of what changes; ten of them, as an error decays within some ten steps' time.
    assert np.abs(found - fine).max() < error + 1e-6 * np.abs(fine).max()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("kind", ["position", "speed"])
def test_sensitivities_are_the_derivatives_of_the_response(name: str, kind: str) -> None:
    structure, data = STRUCTURES[name], swinging()
    if kind == "speed":
        data = replace(data, kind="speed", output_unit="rad/s")
    theta = theta_of(structure, (0.1, 0.5) if kind == "position" else (0.5,))
    exact = structure.predict(theta, data).jacobian
    for n in range(len(theta)):
        step = np.zeros(len(theta))
        step[n] = 1e-4 * max(abs(theta[n]), 1e-2)
        difference = structure.predict(theta + step, data).y - structure.predict(theta - step, data).y
        slope = difference / (2 * step[n])
        # A difference over 1e-4 of a parameter is right to some 1e-8 of a third derivative, and knows the integration's error of
        # 1e-9 to 1e-5. Between a stop at theta + step and one at theta - step it is no derivative: hence the median.
        assert np.median(np.abs(slope - exact[:, n])) <= 1e-4 * np.abs(exact[:, n]).max()
        assert np.mean(np.abs(slope - exact[:, n]) > 1e-3 * np.abs(exact[:, n]).max()) < 0.01


def test_without_its_terms_it_is_the_motor_with_coulomb_friction() -> None:
    data = swinging()
    plain, rich = STRUCTURES["first_order_coulomb"], STRUCTURES["first_order_coulomb_stribeck_gravity_load"]
    value = {**VALUES, "stribeck_voltage": 0.0, "gravity_voltage_sine": 0.0, "gravity_voltage_cosine": 0.0}
    theta = np.array([*(value[parameter.name] for parameter in rich.parameters), 0.1, 0.5])
    expected = plain.predict(theta_of(plain), data)
    found = rich.predict(theta, data)
    # A step's error is 1e-7 of what changes, and the motor makes some ten radians.
    assert np.abs(found.y - expected.y).max() < 1e-6
    names = [parameter.name for parameter in rich.parameters]
    shared = [names.index(parameter.name) for parameter in plain.parameters]
    assert np.allclose(found.jacobian[:, shared], expected.jacobian[:, :5], rtol=1e-5, atol=1e-5)


def test_unequal_coulomb_voltages_are_an_offset() -> None:
    data = swinging()
    offset, unequal = (
        STRUCTURES["first_order_coulomb_stribeck"],
        STRUCTURES["first_order_asymmetric_stribeck"],
    )
    names = [parameter.name for parameter in unequal.parameters]
    theta = theta_of(unequal)
    theta[names.index("drag_asymmetry")] = 0.0
    assert np.allclose(unequal.predict(theta, data).y, offset.predict(theta_of(offset), data).y, atol=1e-9)


def test_a_pendulum_let_go_keeps_the_frequency_of_its_gravity() -> None:
    """Near the bottom, τ θ'' + θ' + K u_g θ = 0: with K u_g τ = 25 the swing has ω = √(K u_g/τ - 1/4τ²)."""
    structure = STRUCTURES["first_order_gravity"]
    gain, tau, pull = 10.0, 0.5, 5.0
    t = np.arange(2000) * 0.001
    data = replace(dataset(seed=0, samples=2000, y=np.zeros(2000)), t_input=t, t_output=t, u=np.zeros(2000))
    value = {
        "gain": gain,
        "time_constant": tau,
        "offset_voltage": 0.0,
        "gravity_voltage_sine": pull,
        "gravity_voltage_cosine": 0.0,
        "delay": 0.0,
    }
    theta = np.array([*(value[p.name] for p in structure.parameters), 1e-4, 0.0])
    found = structure.predict(theta, data).y
    decay, pulse = 0.5 / tau, np.sqrt(gain * pull / tau - 0.25 / tau**2)
    expected = 1e-4 * np.exp(-decay * t) * (np.cos(pulse * t) + decay / pulse * np.sin(pulse * t))
    # The sine's cubic term changes the frequency by θ²/16: 1e-9 of it. A step of 1 ms is 1e-2 of 1/ω: 1e-10/120 each.
    assert np.abs(found - expected).max() < 1e-8 * 1e-4 + 1e-11


@pytest.mark.parametrize("name", ["first_order_coulomb_stribeck", "first_order_coulomb_gravity"])
def test_it_predicts_through_a_chain_with_its_exact_jacobian(name: str) -> None:
    structure = STRUCTURES[name]
    data = replace(swinging(), declared=Chain.parse("lowpass 50 rad/s"), quantum=None)
    theta = theta_of(structure, (0.1, 0.5, 0.2))
    found = structure.predict(theta, data)
    for n in (0, 1, len(theta) - 1):
        step = np.zeros(len(theta))
        step[n] = 1e-6 * abs(theta[n])
        slope = (structure.predict(theta + step, data).y - structure.predict(theta - step, data).y) / (
            2 * step[n]
        )
        assert np.median(np.abs(slope - found.jacobian[:, n])) < 1e-5 * np.abs(found.jacobian[:, n]).max()


@pytest.mark.parametrize(
    "name",
    [
        "first_order_stribeck",
        "first_order_coulomb_load",
        "first_order_gravity_load",
        "first_order_gravity_coulomb",
    ],
)
def test_a_name_that_stands_for_no_motor_is_told_how_names_are_made(name: str) -> None:
    with pytest.raises(UnknownName, match="stribeck and load need a friction, load needs gravity"):
        STRUCTURES[name]


def test_a_rational_name_that_stands_for_nothing_is_told_what_n_and_m_are() -> None:
    with pytest.raises(UnknownName, match="N is the order of the denominator"):
        STRUCTURES["rational_2_2"]


def test_gravity_without_an_angle_is_refused_with_what_to_record() -> None:
    structure, data = STRUCTURES["first_order_gravity"], swinging()
    moving = replace(data, y=np.linspace(0.0, 9.0, len(data.y)))
    with pytest.raises(NotIdentifiable, match="the output is a speed: record the position"):
        structure.guesses([replace(moving, kind="speed", output_unit="rad/s")])
    with pytest.raises(NotIdentifiable, match="the position is in counts"):
        structure.guesses([replace(moving, output_unit="counts")])


@pytest.mark.parametrize("speed", [250.0, 40.0])
def test_a_fast_shaft_under_gravity_is_stepped_rarely_and_still_where_it_should_be(speed: float) -> None:
    """Against SciPy's DOP853, which shares nothing with the kernel; 1e-6 rad is a 3000th of a count of the QUBE's encoder."""
    gain, tau, sine, cosine = 257.0, 1.675, 0.04, 0.02
    t = 0.016 * np.arange(300)
    volts = speed / gain
    record = replace(
        dataset(seed=1), t_input=t, t_output=t, u=np.full(300, volts), input_before=volts, y=np.zeros(300)
    )

    found = STRUCTURES["first_order_gravity"].predict(
        np.array([gain, tau, 0.0, sine, cosine, 0.0, 0.3, speed]), record
    )

    def slopes(_: float, x: NDArray[np.float64]) -> list[float]:
        pull = sine * np.sin(x[0]) + cosine * np.cos(x[0])
        return [x[1], (gain * (volts - pull) - x[1]) / tau]

    expected = solve_ivp(slopes, (0, t[-1]), [0.3, speed], "DOP853", t, rtol=1e-13, atol=1e-12).y[0]
    assert np.abs(found.y - expected).max() < 1e-6
    p = np.zeros(kernels.COLUMNS)
    p[[kernels.GAIN, kernels.TAU, kernels.SINE, kernels.COSINE]] = gain, tau, sine, cosine
    # A tenth of the time in which it turns by a radian would be the step beside a gravity that moves it.
    assert kernels.longest_step(kernels.motor_of(p), speed, 0.0, speed, 1.0, False, True) > 2 * 0.1 / speed


def test_a_time_constant_of_a_quarter_of_a_sample_takes_few_steps_and_is_right() -> None:
    """Against SciPy's DOP853, up a ramp, to a millionth of the speed: ten times what one step may leave out."""
    gain, tau, coulomb, stribeck, slow = 209.0, 3.3e-4, 0.1, 0.3, 93.0
    t = 1.3e-3 * np.arange(200)
    volts = np.linspace(1.0, 5.0, 200)
    record = replace(
        dataset(seed=1), t_input=t, t_output=t, u=volts, input_before=1.0, y=np.zeros(200), kind="speed"
    )
    structure = STRUCTURES["first_order_coulomb_stribeck"]
    values = {"gain": gain, "time_constant": tau, "coulomb_voltage": coulomb}
    values |= {"stribeck_voltage": stribeck, "stribeck_speed": slow}
    theta = np.array([*(values.get(p.name, 0.0) for p in structure.parameters), 50.0])

    found = structure.predict(theta, record)

    speed, expected = 50.0, [50.0]
    for v, start, end in zip(volts, t[:-1], t[1:], strict=False):

        def slope(_: float, w: NDArray[np.float64], v: float = float(v)) -> NDArray[np.float64]:
            return (gain * (v - coulomb - stribeck * np.exp(-w / slow)) - w) / tau

        speed = solve_ivp(slope, (start, end), [speed], "DOP853", rtol=1e-13, atol=1e-11).y[0, -1]
        expected.append(speed)
    assert np.abs(found.y - expected).max() < 1e-6 * max(expected)
    p = np.ones(kernels.COLUMNS)
    p[[kernels.GAIN, kernels.TAU]] = gain, tau
    p[[kernels.ASYMMETRY, kernels.STRIBECK, kernels.SINE, kernels.COSINE]] = 0.0
    settled = kernels.longest_step(kernels.motor_of(p), 1000.0, 1e-4 * 1000 / tau, 1000.0, 1.0, False, False)
    assert settled == pytest.approx(0.1 * tau * (1e4) ** 0.2)
