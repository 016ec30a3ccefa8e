"""Pole placement for a sampled loop: gains for specified poles, and the resulting poles.

A pole s [1/s] of the sampled loop is z = e^(sh). The voltage is linear in the gains g of a law, so that the poles wished for are
roots of 1 + L(z) if  Σ g_i L_i(e^(sh)) = -1  at each of them, L_i the loop with the gain i = 1 alone: as many linear equations as
gains, with hold, filter and delay in them. The poles that these add aren't placed but checked afterwards: the slowest poles of
the loop have to be the specified ones (docs/decisions/0033-placed-in-z.md).
"""

from __future__ import annotations

import cmath
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np

from servobench.systems.control.sampled_law import sampled_law
from servobench.systems.first_order import FirstOrderMotor
from servobench.systems.tuning.base import Tunable, Unreachable, as_printed
from servobench.systems.tuning.loop import open_loop

_APART = 1e-3  # of a pole's size; of poles nearer to each other their equations are one
_CANCELLED = 0.03  # of a pole's size; how near a pole is to the zero that cancels it
_DIGITS, _MORE_DIGITS = (
    5,
    9,
)  # of a gain; a double root moves by the square root of what is rounded, a triple one by the cube root
_CLOSE = 0.1  # of a pole's size; nearer to each other poles count as a multiple one there


@dataclass(frozen=True, kw_only=True)
class Pole:
    """A pole of the closed loop [1/s]: `wished` is specified, `obtained` the root e^(sh) of 1 + L(z)."""

    wished: complex
    obtained: complex

    @property
    def off(self) -> float:
        """The distance of one from the other, as a part of its distance from zero."""
        return abs(self.obtained - self.wished) / abs(self.wished)


def place_poles(
    law: type[Tunable],
    settings: Mapping[str, Any],
    gains: Sequence[str],
    motor: FirstOrderMotor,
    sample_time: float,
    poles: Sequence[complex],
    cancelled: Sequence[complex] = (),
) -> Tunable:
    """Return the law with those of its `gains` that give the loop the `poles` [1/s], in conjugate pairs, `settings` otherwise.

    Where there are fewer poles than gains, the law's zeros cancel the motor's poles named as `cancelled` [1/s]. Raises
    `Unreachable` where no gains do.
    """
    alone: list[dict[str, Any]] = [{each: float(each == name) for each in gains} for name in gains]
    units = [law(**settings, **each) for each in alone]
    nominal = motor.gain.value, motor.time_constant.value, motor.delay
    loops = [open_loop(unit, *nominal, sample_time) for unit in units]
    rows = [([loop.at(s) for loop in loops], -1.0) for s in separate(poles, cancelled)]
    laws = [sampled_law(unit, sample_time) for unit in units]
    rows += [([each.at(cmath.tanh(0.5 * sample_time * s)) for each in laws], 0.0) for s in cancelled]
    left = np.array(
        [[value.real for value in row] for row, _ in rows]
        + [[value.imag for value in row] for row, _ in rows]
    )
    right = np.array([value for _, value in rows] + [0.0] * len(rows))
    solution, _, rank, _ = np.linalg.lstsq(left, right, rcond=None)
    if rank < len(gains) or not np.isfinite(solution).all():
        raise Unreachable("no gains put poles there")
    digits = digits_for(poles)
    values: dict[str, Any] = {
        name: as_printed(float(g), digits) for name, g in zip(gains, solution, strict=True)
    }
    return law(**settings, **values)


def digits_for(poles: Sequence[complex]) -> int:
    """Return to how many digits gains have to be printed: five, and nine where poles are nearly the same."""
    close = any(abs(one - other) < _CLOSE * abs(one) for n, one in enumerate(poles) for other in poles[:n])
    return _MORE_DIGITS if close else _DIGITS


def match_poles(
    controller: Tunable,
    motor: FirstOrderMotor,
    sample_time: float,
    wished: Sequence[complex],
    cancelled: Iterable[complex] = (),
) -> tuple[Pole, ...]:
    """Return each specified pole with the one obtained: the nearest of the loop's slowest poles, as many as specified.

    Poles are the slower the nearer their real part is to zero. One that a zero of the law cancels isn't seen in how the output
    follows the reference, and is left out. All in 1/s, `sample_time` in s.
    """
    nominal = motor.gain.value, motor.time_constant.value, motor.delay
    with np.errstate(divide="ignore"):
        loop_poles = (
            np.log(open_loop(controller, *nominal, sample_time).closed_poles().astype(complex)) / sample_time
        )
    for pole in cancelled:
        nearest = int(np.argmin(np.abs(loop_poles - pole)))
        if abs(loop_poles[nearest] - pole) <= _CANCELLED * abs(pole):
            loop_poles = np.delete(loop_poles, nearest)
    slowest = sorted(loop_poles.tolist(), key=lambda s: -s.real)[: len(wished)]
    orders = [
        [Pole(wished=w, obtained=s) for w, s in zip(wished, order, strict=True)]
        for order in permutations(slowest)
    ]
    return tuple(min(orders, key=lambda poles: sum(pole.off for pole in poles)))


def separate(poles: Sequence[complex], taken: Sequence[complex] = ()) -> list[complex]:
    """Return one of each conjugate pair [1/s]; one that nearly is another or a taken one is moved left by a thousandth."""
    upper: list[complex] = []
    for pole in sorted((s for s in poles if s.imag >= 0), key=lambda s: -s.real):
        at = pole
        while any(abs(at - other) < 0.5 * _APART * abs(pole) for other in (*upper, *taken)):
            at += _APART * pole.real
        upper.append(at)
    return upper
