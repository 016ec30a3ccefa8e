"""Transfer functions to python-control and SciPy, and back."""

import math
from dataclasses import replace

import control
import numpy as np
import pytest
import scipy.signal

from servobench.core.errors import NotIdentifiable, UsageError
from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.systems.interop import (
    from_control,
    from_scipy,
    pade,
    to_control,
    to_control_and_delay,
    to_scipy,
    to_scipy_and_delay,
)
from servobench.systems.transfer_function import TransferFunction
from tests.datasets import dataset

MOTOR = TransferFunction(numerator=(23.8,), denominator=(0.1, 1.0))
OTHERS = [
    MOTOR,
    TransferFunction(
        numerator=(23.8,), denominator=(0.1, 1.0, 0.0), delay=0.002, output="position", unit="rad/V"
    ),
    TransferFunction(numerator=(1.0, 0.0, 3.0), denominator=(2.0, 1.0, 5.0, 7.0), delay=-1e-4),
]
OMEGA = np.geomspace(0.1, 300, 30)


@pytest.mark.parametrize("system", OTHERS)
def test_what_goes_to_python_control_comes_back_equal(system: TransferFunction) -> None:
    there, delay = to_control_and_delay(system)

    assert from_control(there, delay=delay, output=system.output, unit=system.unit) == system


@pytest.mark.parametrize("system", OTHERS)
def test_what_goes_to_scipy_comes_back_with_the_same_response(system: TransferFunction) -> None:
    there, delay = to_scipy_and_delay(system)

    back = from_scipy(there, delay=delay, output=system.output, unit=system.unit)

    # SciPy divides by the leading coefficient.
    np.testing.assert_allclose(
        back.frequency_response(OMEGA), system.frequency_response(OMEGA), rtol=1e-12, atol=0
    )
    assert (back.delay, back.output, back.unit) == (system.delay, system.output, system.unit)


def test_both_have_the_frequency_response_of_the_rational_part() -> None:
    expected = MOTOR.frequency_response(OMEGA)

    np.testing.assert_allclose(to_control(MOTOR)(1j * OMEGA), expected, rtol=1e-12)
    np.testing.assert_allclose(to_scipy(MOTOR).freqresp(OMEGA)[1], expected, rtol=1e-12)


@pytest.mark.parametrize("convert", [to_control, to_scipy])
def test_a_delay_is_never_dropped_without_a_word(convert) -> None:  # type: ignore[no-untyped-def]
    late = convert(replace(MOTOR, delay=0.002))
    found = late(1j * OMEGA) if convert is to_control else late.freqresp(OMEGA)[1]
    # Of order 3 the first term left out is (ωd)^7 (3!)²/(6! 7!): 3e-7 at 300 rad/s.
    np.testing.assert_allclose(found, replace(MOTOR, delay=0.002).frequency_response(OMEGA), rtol=1e-6)
    with pytest.raises(UsageError, match="before its cause"):
        convert(replace(MOTOR, delay=-0.002))
    with pytest.raises(UsageError, match="order 0 omits the delay"):
        convert(MOTOR, pade_order=0)


def of_delay(delay: float, interval: tuple[float, float]) -> Result:
    """A result whose delay and its interval are these."""
    made = identify(dataset(seed=1, samples=2000))
    assert made.fit is not None
    model = made.fit.model
    theta = np.where([name == "delay" for name in model.names], delay, model.theta)
    fit = replace(made.fit, model=replace(model, theta=theta), intervals={"delay": interval})
    return replace(made, fit=fit)


@pytest.mark.parametrize(
    ("delay", "interval", "kept"),
    [
        (0.002, (0.0019, 0.0021), True),
        (0.002, (-0.001, 0.005), False),
        (-0.0001, (-0.0003, 0.0001), False),
        (-0.0002, (-0.0003, -0.0001), False),
    ],
)
def test_a_result_goes_over_whatever_its_delay_and_with_none_where_there_may_be_none(
    delay: float, interval: tuple[float, float], kept: bool
) -> None:
    result = of_delay(delay, interval)
    rational = result.to_control_and_delay()[0](1j * OMEGA)

    assert result.to_control_and_delay()[1] == result.to_scipy_and_delay()[1] == (delay if kept else 0.0)
    expected = rational * np.exp(-1j * OMEGA * (delay if kept else 0.0))
    # As above for a delay of 2 ms.
    np.testing.assert_allclose(result.to_control()(1j * OMEGA), expected, rtol=1e-6)
    np.testing.assert_allclose(result.to_control(pade_order=5)(1j * OMEGA), expected, rtol=1e-6)
    np.testing.assert_allclose(result.to_scipy().freqresp(OMEGA)[1], expected, rtol=1e-6)
    assert len(result.to_control().poles()) == (4 if kept else 1)


@pytest.mark.parametrize("order", [1, 2, 5])
def test_the_pade_approximation_is_python_control_s(order: int) -> None:
    numerator, denominator = control.pade(0.002, order)

    found = pade(0.002, order)

    np.testing.assert_allclose(
        found.frequency_response(OMEGA), control.tf(numerator, denominator)(1j * OMEGA)
    )


def test_a_delay_comes_through_an_approximation_to_its_order() -> None:
    lagging = replace(MOTOR, delay=0.002)

    found = to_control(lagging, pade_order=3)

    # The first term left out is (ωd)^7 (3!)²/(6! 7!): 3e-7 at 300 rad/s.
    np.testing.assert_allclose(found(1j * OMEGA), lagging.frequency_response(OMEGA), rtol=1e-6)


def test_a_state_space_comes_as_its_transfer_function() -> None:
    system = from_control(
        control.ss(control.tf([1.0, 3.0], [1.0, 5.0, 6.0])), output="speed", unit="rad/(s·V)"
    )

    s = 1j * OMEGA
    np.testing.assert_allclose(system(s), (s + 3) / (s**2 + 5 * s + 6), rtol=1e-9)


@pytest.mark.parametrize(
    ("system", "sentence"),
    [
        (control.tf([1.0], [1.0, 0.5], 0.01), "discrete time"),
        (control.ss(-np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2))), "2 inputs and 2 outputs"),
        (scipy.signal.lti([1.0], [1.0, 1.0]), "isn't a linear system of python-control"),
    ],
)
def test_what_is_no_such_system_is_refused_by_name(system: object, sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        from_control(system, output="speed", unit="rad/(s·V)")


def test_scipy_systems_in_discrete_time_or_with_two_outputs_are_refused() -> None:
    with pytest.raises(UsageError, match="continuous time"):
        from_scipy(scipy.signal.dlti([1.0], [1.0, 0.5], dt=0.01), output="speed", unit="rad/(s·V)")
    two = scipy.signal.lti(-np.eye(1), np.eye(1), np.ones((2, 1)), np.zeros((2, 1)))
    with pytest.raises(UsageError, match="2 outputs"):
        from_scipy(two, output="speed", unit="rad/(s·V)")


@pytest.mark.parametrize("kind", ["to_ss", "to_zpk"])
def test_scipy_s_other_kinds_of_system_come_as_their_transfer_function(kind: str) -> None:
    there = getattr(scipy.signal.lti([1.0, 3.0], [1.0, 5.0, 6.0]), kind)()

    back = from_scipy(there, output="speed", unit="rad/(s·V)")

    s = 1j * OMEGA
    np.testing.assert_allclose(back(s), (s + 3) / (s**2 + 5 * s + 6), rtol=1e-9)


def test_a_result_gives_the_transfer_function_that_it_prints() -> None:
    result = identify(dataset(seed=1, samples=2000))
    assert result.transfer_function is not None

    for found in (
        result.to_control(pade_order=4)(1j * OMEGA),
        result.to_scipy(pade_order=4).freqresp(OMEGA)[1],
    ):
        np.testing.assert_allclose(found, result.transfer_function.frequency_response(OMEGA), rtol=1e-9)
    position = result.to_control("position", pade_order=4)
    assert abs(position.poles()).min() == 0
    assert position.output_labels == ["position"]


def test_a_refused_result_has_nothing_to_give() -> None:
    still = dataset(seed=1, samples=200)
    result = identify(replace(still, u=np.zeros(200), y=np.full(200, math.pi)))

    with pytest.raises(NotIdentifiable, match="has no model"):
        result.to_control()
