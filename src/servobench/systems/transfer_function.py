"""A continuous-time transfer function with a delay."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from servobench.core.arguments import check_type, text_of_value
from servobench.core.channels import Array
from servobench.core.errors import UsageError


@dataclass(frozen=True, kw_only=True)
class TransferFunction:
    """G(s) = e^(-delay s) · numerator(s) / denominator(s) (Åström and Murray 2008, chapter 8).

    Coefficients begin with the highest power of s. `output` is `speed` or `position`, `unit` the unit of the
    gain, output unit per input unit (`rad/(s·V)`). Raises `UsageError` if a coefficient isn't finite or the
    leading coefficient of the denominator is zero.

    >>> motor = TransferFunction(numerator=(23.7,), denominator=(0.099, 1.0), delay=0.0001)
    >>> print(motor)
    (23.7) / (0.099 s + 1) · e^(-0.0001 s)
    >>> motor.poles.round(1)
    array([-10.1+0.j])
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    delay: float = 0.0
    output: str = "speed"
    unit: str = "rad/(s·V)"

    def __post_init__(self) -> None:
        for name in ("numerator", "denominator"):
            coefficients = getattr(self, name)
            # Plain tuples and floats, of which thousands are made, are recognised before the slower abstract classes.
            if not isinstance(coefficients, tuple | Sequence | np.ndarray) or not all(
                isinstance(each, float | Real) for each in coefficients
            ):
                raise UsageError(
                    f"{name} is {text_of_value(coefficients)}; expected numbers, highest power of s first"
                )
        check_type("delay", self.delay, Real, "a number of seconds")
        values = (*self.numerator, *self.denominator, self.delay)
        if (
            not self.numerator
            or not self.denominator
            or not all(map(math.isfinite, values))
            or self.denominator[0] == 0
        ):
            raise UsageError(
                f"no transfer function: numerator {self.numerator}, denominator {self.denominator}, delay {self.delay}; "
                "expected finite coefficients, highest power first, the first of the denominator not zero"
            )

    def __call__(self, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return G(s) at complex frequencies s [1/s] of any shape."""
        ratio = np.polyval(self.numerator, s) / np.polyval(self.denominator, s)
        return np.asarray(ratio * np.exp(-self.delay * s), dtype=np.complex128)

    def frequency_response(self, omega: Array) -> NDArray[np.complex128]:
        """Return G(jω) at angular frequencies ω [rad/s], shape (N,)."""
        return self(1j * np.asarray(omega, dtype=np.complex128))

    @property
    def poles(self) -> NDArray[np.complex128]:
        """The roots of the denominator [1/s], (P,), slowest first."""
        if len(self.denominator) == 2:  # a first-order motor, whose poles are asked for thousands of times
            return np.array([-self.denominator[1] / self.denominator[0]], dtype=np.complex128)
        roots = np.asarray(np.roots(self.denominator), dtype=np.complex128)
        return roots[np.argsort(np.abs(roots))]

    @property
    def zeros(self) -> NDArray[np.complex128]:
        """The roots of the numerator [1/s], (Z,)."""
        return np.asarray(np.roots(self.numerator), dtype=np.complex128)

    def __str__(self) -> str:
        delay = f" · e^({-self.delay:.4g} s)" if self.delay else ""
        return f"({_polynomial(self.numerator)}) / ({_polynomial(self.denominator)}){delay}"


def _polynomial(coefficients: tuple[float, ...]) -> str:
    """A polynomial in s as a person writes it: `0.0998 s + 1`."""
    written = ""
    for power, value in zip(range(len(coefficients) - 1, -1, -1), coefficients, strict=True):
        if value == 0:
            continue
        factor = "" if abs(value) == 1 and power > 0 else f"{abs(value):.6g}"
        symbol = {0: "", 1: "s"}.get(power, f"s^{power}")
        if written:
            written += " - " if value < 0 else " + "
        elif value < 0:
            written = "-"
        written += " ".join(filter(None, (factor, symbol)))
    return written or "0"
