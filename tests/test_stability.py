"""Stability: against systems whose answer is in every textbook."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.stability.verdict import stability
from servobench.transfer_function import TransferFunction


def system(*denominator: float) -> TransferFunction:
    return TransferFunction(numerator=(1.0,), denominator=denominator)


@pytest.mark.parametrize(
    ("denominator", "verdict", "bibo"),
    [
        ((0.1, 1.0), "stable", True),
        ((0.1, 1.0, 0.0), "marginally stable", False),  # the motor's position: one integrator
        ((1.0, 0.0, 0.0), "unstable", False),  # a double integrator
        ((1.0, 0.0, 4.0), "marginally stable", False),  # an undamped oscillator
        ((1.0, -1.0), "unstable", False),
        (tuple(np.poly([-1.0, -1.0, -1.0])), "stable", True),
        (tuple(np.poly([2j, -2j, 2j, -2j]).real), "unstable", False),  # twice on the axis
    ],
)
def test_the_verdict_is_that_of_the_textbook(
    denominator: tuple[float, ...], verdict: str, bibo: bool
) -> None:
    report = stability(system(*denominator))
    assert (report.verdict, report.bibo) == (verdict, bibo)
    assert len(report.reasons) == sum(pole.imag >= 0 for pole in report.poles)  # one for a pair


def test_a_double_pole_is_counted_twice() -> None:
    report = stability(system(*np.poly([-3.0, -3.0, -1.0])))
    assert sorted(zip(np.real(report.poles).round(3), report.multiplicities, strict=True)) == [
        (-3.0, 2),
        (-1.0, 1),
    ]


def test_the_motors_position_says_which_input_drives_it_off() -> None:
    (reason,) = (r for r in stability(system(0.1, 1.0, 0.0)).reasons if "axis" in r)
    assert "a constant" in reason


def test_a_pole_is_judged_by_the_scale_of_the_system() -> None:
    """A slow motor of 1e6 s isn't an integrator."""
    assert stability(system(1e6, 1.0)).verdict == "stable"
