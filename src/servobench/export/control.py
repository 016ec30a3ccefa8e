"""A Python file that defines the motor as a python-control system."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from servobench.export.base import TARGETS, Wishes
from servobench.export.summary import ResultSummary
from servobench.systems.interop import PADE_ORDER

_TEXT = '''{comment}
"""The identified motor as systems of python-control, and its parameters with their intervals.

`motor()` is from {input} [{input_unit}] to speed [{position}/s], `motor(position=True)` to position [{position}]. The delay of
{delay!r} s is a Padé approximation of the given order.
"""

import control

NUMERATOR = {numerator!r}
DENOMINATOR = {denominator!r}
DELAY = {delay!r}  # s

# name: (value, standard deviation, (low, high) of the 95 % interval, unit); None where there is none.
# What the data don't determine is said above: its value here is the model's, and no measurement.
PARAMETERS = {{
{parameters}
}}


def motor(position=False, pade_order={order}):
    """Return the transfer function, to the position or else to the speed."""
    denominator = [*DENOMINATOR, 0.0] if position else DENOMINATOR
    output = "position" if position else "speed"
    rational = control.tf(NUMERATOR, denominator, inputs="input", outputs=output)
    if DELAY == 0:
        return rational
    late = control.tf(*control.pade(DELAY, pade_order), inputs="input", outputs="delayed")
    return control.tf(control.series(late, rational), inputs="input", outputs=output)
'''


@TARGETS.member("control")
class Control:
    """A Python file for python-control: `motor()` with named signals, and the parameters with their intervals."""

    suffix: ClassVar[str] = ".py"
    wishes: ClassVar[frozenset[str]] = frozenset()

    def render(self, answer: ResultSummary, wishes: Wishes, stem: str) -> Mapping[str, bytes]:
        """Return the one file."""
        system = answer.model
        position, driven_by = answer.units
        rows = [
            f"    {name!r}: ({_text(e.value)}, {_text(e.sd)}, ({_text(e.interval[0])}, {_text(e.interval[1])}), {e.unit!r}),"
            for name, e in answer.estimates.items()
        ]
        text = _TEXT.format(
            comment="\n".join(f"# {line}" for line in answer.model_comment),
            input="voltage" if driven_by == "V" else "input",
            input_unit=driven_by,
            position=position,
            numerator=list(system.numerator),
            denominator=list(system.denominator),
            delay=system.delay,
            order=PADE_ORDER,
            parameters="\n".join(rows),
        )
        return {f"{stem}.py": text.encode()}


def _text(value: float) -> str:
    return repr(value) if math.isfinite(value) else "None"
