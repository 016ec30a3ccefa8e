"""The study `linear_model`: the data sheet's transfer functions to speed and position, with and without inductance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.core.rounding import plain, with_unit
from servobench.lab.expression import Fact
from servobench.lab.graphs import curve, over_time, panel
from servobench.lab.required_facts import required_fact
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.report.figures import Course
from servobench.report.illustrations import Illustration
from servobench.systems.transfer_function import TransferFunction

_POINTS = 400  # of a curve
_POWERS = ("", " s", " s²", " s³")


@dataclass(frozen=True, kw_only=True)
class _Sheet:
    """R [Ω], L [H], k [V·s/rad] and J [kg·m²] of a data sheet."""

    resistance: float
    inductance: float
    motor_constant: float
    inertia: float

    @classmethod
    def of(cls, stand: Stand) -> _Sheet:
        names = ("resistance", "inductance", "motor_constant", "inertia")
        return cls(**{name: required_fact(stand, f"sheet_{name}") for name in names})

    def speed(self, inductance: float) -> TransferFunction:
        """k/(L J s² + R J s + k²), all divided by k² so that the denominator ends in 1."""
        k2 = self.motor_constant**2
        powers = [inductance * self.inertia / k2] if inductance else []
        return TransferFunction(
            numerator=(1 / self.motor_constant,),
            denominator=(*powers, self.resistance * self.inertia / k2, 1.0),
        )


@STUDIES.member("linear_model")
class LinearModel(StudySettings):
    """The motor of the experiment's data sheet, without friction, as a transfer function: form, gain and poles.

    From V = R I + L s I + k Ω and J s Ω = k I follows by algebra Ω/V = k/(L J s² + R J s + k²); with L = 0 it is K/(τ s + 1)
    with K = 1/k and τ = R J/k². The position is an integral of the speed: one pole more, at zero.
    """

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the four transfer functions; raises `UsageError` where the experiment names no data sheet (`nominal`)."""
        sheet = _Sheet.of(stand)
        plain_speed, full_speed = sheet.speed(0.0), sheet.speed(sheet.inductance)
        systems = (plain_speed, _position(plain_speed), full_speed, _position(full_speed))
        slow, fast = sorted(-1 / pole for pole in full_speed.poles.real)[::-1]
        facts = {
            "gain": Fact(value=1 / sheet.motor_constant),
            "slow": Fact(value=float(slow)),
            "fast": Fact(value=float(fast)),
            "neglected": Fact(value=-1 / float(plain_speed.poles[0].real)),
            "electrical": Fact(value=sheet.inductance / sheet.resistance),
        }
        return StudyResult(
            tables=(_table(systems),),
            figures=(_figure(plain_speed, full_speed),),
            sentences=(
                f"With the inductance the slow time constant is {with_unit(float(slow), 's', 5)} in place of "
                f"{with_unit(facts['neglected'].value, 's', 5)}, and a second one of "
                f"{with_unit(float(fast), 's', 3)} appears, close to L/R = "
                f"{with_unit(facts['electrical'].value, 's', 3)}: the speed is delayed by that much, which is all "
                "an encoder shows of it.",
            ),
            facts=facts,
        )


def _table(systems: tuple[TransferFunction, ...]) -> Table:
    """Form and poles of each; those of a data sheet's motor are real, as R is large."""
    poles = [np.real_if_close(system.poles) for system in systems]
    columns = tuple(
        Column(
            name=f"pole{n + 1}",
            heading=f"pole {n + 1}",
            unit="1/s",
            values=tuple(float(p[n].real) if n < len(p) else math.nan for p in poles),
        )
        for n in range(3)
    )
    return Table(
        title="The data sheet's motor, without friction",
        columns=(
            Column(
                name="output",
                heading="from voltage to",
                values=("speed, L = 0", "position, L = 0", "speed", "position"),
            ),
            Column(name="form", heading="G(s)", values=tuple(map(_fraction_text, systems))),
            *columns,
        ),
        note="The first pole is the slow one, or that of the integrator at 0.",
    )


def _fraction_text(system: TransferFunction) -> str:
    """G(s) in one line, as a person would write it."""
    highest = len(system.denominator) - 1
    terms = [
        _POWERS[n].strip() if n and value == 1 else f"{plain(value)}{_POWERS[n]}"
        for n, value in zip(range(highest, -1, -1), system.denominator, strict=True)
        if value
    ]
    return f"{plain(system.numerator[-1])} / ({' + '.join(terms)})"


def _position(speed: TransferFunction) -> TransferFunction:
    return TransferFunction(
        numerator=speed.numerator, denominator=(*speed.denominator, 0.0), output="position", unit="rad/V"
    )


def _step(system: TransferFunction, t: Array) -> Array:
    """The answer to a step of 1 V, by partial fractions over the poles, which are simple."""
    poles = system.poles
    slopes = np.polyval(np.polyder(np.array(system.denominator)), poles)
    parts = system.numerator[-1] / (poles * slopes)
    settled = system.numerator[-1] / system.denominator[-1]
    return np.asarray((settled + parts @ np.exp(np.outer(poles, t))).real, dtype=np.float64)


def _figure(without: TransferFunction, with_it: TransferFunction) -> Illustration:
    slow, fast = (float(-1 / pole.real) for pole in with_it.poles)
    courses = tuple(
        Course(
            panels=(
                panel(
                    "Speed",
                    "rad/s",
                    curve(t, _step(without, t), "measured", "L = 0"),
                    curve(t, _step(with_it, t), "model", "with L"),
                ),
            ),
            title=title,
        )
        for title, t in (
            ("The whole step", np.linspace(0.0, 5 * slow, _POINTS)),
            ("Its first moments", np.linspace(0.0, 8 * fast, _POINTS)),
        )
    )
    return over_time(
        "step",
        "A step of 1 V with and without inductance",
        "The two coincide; only the first moments differ.",
        "The speed rises to its end without overshoot; with inductance it begins with a horizontal tangent, "
        f"{with_unit(fast, 's', 2)} late.",
        courses,
    )
