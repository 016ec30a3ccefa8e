"""Transfer functions for and from other packages: python-control and SciPy.

Neither has a delay in its transfer function, and none is ever dropped: it becomes a Padé approximation, whose order can be
chosen, or stands beside the rational part of the system.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from math import factorial
from typing import TYPE_CHECKING, Any

import numpy as np

from servobench.core.arguments import check_type
from servobench.core.errors import UsageError
from servobench.systems.transfer_function import TransferFunction

if TYPE_CHECKING:
    import control
    import scipy.signal


PADE_ORDER = 3
"""The order of a Padé approximation where none is said: its phase is good to 0.015 rad up to a frequency of 3 over the delay."""


def to_control(system: TransferFunction, *, pade_order: int = PADE_ORDER) -> control.TransferFunction:
    """Return a system as a `control.TransferFunction`, its delay as a Padé approximation of that order.

    `to_control_and_delay` is exact. Raises `UsageError` for a negative delay, and if python-control isn't
    installed.

    >>> from servobench import TransferFunction
    >>> motor = TransferFunction(numerator=(20.0,), denominator=(0.1, 1.0))
    >>> to_control(motor).poles().real
    array([-10.])
    """
    check_type("system", system, TransferFunction, "a TransferFunction, such as result.transfer_function")
    rational = without_delay(system, pade_order)
    return _control().TransferFunction(
        list(rational.numerator), list(rational.denominator), inputs="input", outputs=system.output
    )


def to_control_and_delay(system: TransferFunction) -> tuple[control.TransferFunction, float]:
    """Return the rational part of a system as a `control.TransferFunction`, and its delay [s] beside it."""
    return to_control(replace(system, delay=0.0)), system.delay


def from_control(system: Any, *, output: str, unit: str, delay: float = 0.0) -> TransferFunction:
    """Return a python-control system in continuous time with one input and one output.

    Any linear kind is accepted (transfer function, state space). It has no units, so state `output` (`speed`,
    `position`) and the `unit` of the gain (`rad/(s·V)`); `delay` [s] is an additional delay. Raises
    `UsageError` for a system in discrete time, with several inputs or outputs, or that isn't linear.

    >>> import control
    >>> print(from_control(control.tf([20.0], [0.1, 1.0]), output="speed", unit="rad/(s·V)"))
    (20) / (0.1 s + 1)
    """
    package = _control()
    if not isinstance(system, package.TransferFunction | package.StateSpace):
        raise UsageError(
            f"{type(system).__name__} isn't a linear system of python-control: expected its TransferFunction or "
            "StateSpace"
        )
    if not system.issiso():
        raise UsageError(
            f"the python-control system has {system.ninputs} inputs and {system.noutputs} outputs; expected one of each: "
            "index it first, as in system[0, 0]"
        )
    if system.isdtime(strict=True):
        raise UsageError(
            f"the python-control system is in discrete time (dt = {system.dt}); expected continuous time"
        )
    rational = package.tf(system)
    numerator, denominator = _trim(rational.num[0][0]), _trim(rational.den[0][0])
    return TransferFunction(
        numerator=numerator, denominator=denominator, delay=delay, output=output, unit=unit
    )


def as_controller(controller: TransferFunction | Any) -> TransferFunction:
    """Return a controller, from the error to the input, as a `TransferFunction`; without one (None) it is unit feedback.

    A python-control system will do as well, as `from_control` takes it and raises.
    """
    if controller is None:
        return TransferFunction(numerator=(1.0,), denominator=(1.0,), output="input", unit="1")
    if isinstance(controller, TransferFunction):
        return controller
    return from_control(controller, output="input", unit="1")


def to_scipy(system: TransferFunction, *, pade_order: int = PADE_ORDER) -> scipy.signal.lti:
    """Return a system as a `scipy.signal.lti`, its delay as a Padé approximation of that order.

    `to_scipy_and_delay` is exact. Raises `UsageError` for a negative delay.

    >>> from servobench import TransferFunction
    >>> motor = TransferFunction(numerator=(20.0,), denominator=(0.1, 1.0))
    >>> to_scipy(motor).poles
    array([-10.])
    """
    check_type("system", system, TransferFunction, "a TransferFunction, such as result.transfer_function")
    from scipy.signal import lti

    rational = without_delay(system, pade_order)
    return lti(list(rational.numerator), list(rational.denominator))


def to_scipy_and_delay(system: TransferFunction) -> tuple[scipy.signal.lti, float]:
    """Return the rational part of a system as a `scipy.signal.lti`, and its delay [s] beside it."""
    return to_scipy(replace(system, delay=0.0)), system.delay


def from_scipy(system: Any, *, output: str, unit: str, delay: float = 0.0) -> TransferFunction:
    """Return a `scipy.signal.lti` of any kind (transfer function, zeros and poles, state space); arguments as `from_control`.

    `delay` [s] is an additional delay. Raises `UsageError` for a system in discrete time, or with several
    inputs or outputs.

    >>> import scipy.signal
    >>> print(from_scipy(scipy.signal.lti([20.0], [0.1, 1.0]), output="speed", unit="rad/(s·V)"))
    (200) / (s + 10)
    """
    from scipy.signal import BadCoefficients, lti

    if not isinstance(system, lti):
        raise UsageError(
            f"{type(system).__name__} isn't a scipy.signal.lti: expected a system in continuous time"
        )
    if (system.inputs, system.outputs) != (1, 1):
        raise UsageError(
            f"the SciPy system has {system.inputs} inputs and {system.outputs} outputs; expected one of each"
        )
    with warnings.catch_warnings():
        # It warns of the zeros in front of a numerator, which any system has that doesn't answer at once.
        warnings.simplefilter("ignore", BadCoefficients)
        rational = system.to_tf()
    return TransferFunction(
        numerator=_trim(rational.num),
        denominator=_trim(rational.den),
        delay=delay,
        output=output,
        unit=unit,
    )


def without_delay(system: TransferFunction, pade_order: int = PADE_ORDER) -> TransferFunction:
    """Return a system with its delay replaced by a Padé approximation of that order; the system itself where it has none.

    Raises `UsageError` for an order below 1, and for a negative delay, which no causal system has.
    """
    check_type("pade_order", pade_order, int, "a whole number from 1 on")
    if pade_order < 1:
        raise UsageError(f"a Padé approximation of order {pade_order} omits the delay; expected 1 or more")
    if system.delay == 0.0:
        return system
    if system.delay < 0:
        raise UsageError(
            f"the system has a delay of {system.delay:g} s, so the output would come before its cause: keep the "
            "delay separate with to_control_and_delay or to_scipy_and_delay"
        )
    lag = pade(system.delay, pade_order)
    return replace(
        system,
        numerator=tuple(map(float, np.polymul(system.numerator, lag.numerator))),
        denominator=tuple(map(float, np.polymul(system.denominator, lag.denominator))),
        delay=0.0,
    )


def hand_over(system: TransferFunction, interval: tuple[float, float] | None) -> tuple[TransferFunction, str]:
    """Return a model as other programs get it, and a sentence on a delay that was left out; an empty one where none was.

    `interval` is the delay's [s], None where it wasn't estimated. No delay is handed over where the interval holds zero, nor a
    negative one, which no causal system has.
    """
    delay = system.delay
    low, high = (delay, delay) if interval is None else interval
    if not delay:
        return system, ""
    if low <= 0 <= high:
        why = "its 95 % interval includes zero"
    elif delay < 0:
        why = "the output can't come before its cause"
    else:
        return system, ""
    return replace(system, delay=0.0), f"The delay of {_milliseconds(delay)} ms is left out: {why}."


def _milliseconds(seconds: float) -> str:
    return f"{1000 * seconds:.3g}"


def pade(delay: float, order: int) -> TransferFunction:
    """Return the Padé approximation of e^(-delay s), delay in seconds, with numerator and denominator of that order.

    Σ c_j (∓delay s)^j with c_j = (2n - j)! n! / ((2n)! j! (n - j)!) (Golub and Van Loan 2013, section 9.3).
    """
    n = order
    weights = [
        factorial(2 * n - j) * factorial(n) / (factorial(2 * n) * factorial(j) * factorial(n - j))
        for j in range(n, -1, -1)
    ]
    powers = range(n, -1, -1)
    denominator = tuple(c * delay**j for c, j in zip(weights, powers, strict=True))
    numerator = tuple(c * (-1) ** j for c, j in zip(denominator, powers, strict=True))
    return TransferFunction(numerator=numerator, denominator=denominator, unit="1")


def _control() -> Any:
    try:
        import control
    except ImportError as error:
        raise UsageError('python-control isn\'t installed: `pip install "servobench[control]"`') from error
    return control


def _trim(coefficients: Any) -> tuple[float, ...]:
    """The coefficients without zeros in front; a single zero for the zero polynomial."""
    polynomial = np.trim_zeros(np.atleast_1d(np.asarray(coefficients, dtype=np.float64)), "f")
    return tuple(map(float, polynomial)) or (0.0,)
