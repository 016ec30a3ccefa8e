"""The study `loop_margins`: gain, phase and delay margin of a loop, its bandwidth, and what Nyquist's criterion says of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from servobench.control.pid import Pid
from servobench.experiment.experiment import AnyController
from servobench.lab.expression import Fact
from servobench.lab.loops import OfAMotor, named, on_paper, tunable
from servobench.lab.studies.base import STUDIES, Column, Shown, Stand, Table
from servobench.margins import margins
from servobench.report import stability_figures
from servobench.report.illustrations import Illustration
from servobench.responses import bandwidth
from servobench.rounding import plain
from servobench.stability_analysis.nyquist import closed_loop, nyquist_curve
from servobench.transfer_function import TransferFunction
from servobench.tuning.base import Tunable
from servobench.tuning.loop import open_loop

_POINTS = 400
_COARSE = 0.5  # rad in a sample, from which on a delay stands for the hold only roughly


@STUDIES.member("loop_margins")
class LoopMargins(OfAMotor):
    """Margins and bandwidth of a controller around the motor: as drawn on paper, and as it runs, with hold and filter."""

    controller: AnyController | None = None
    """The controller; without it that of the exercise's experiment."""

    def __call__(self, stand: Stand) -> Shown:
        """Return the margins both ways, Bode diagram and Nyquist curve; raises `UsageError` for a law without feedback."""
        law = tunable(self.controller or stand.experiment.controller)
        gain, tau = self.motor(stand)
        h = stand.experiment.sample_time
        loops = {
            "on paper": on_paper(law, gain, tau),
            "as it runs": open_loop(law, gain, tau, 0.0, h),
        }
        found = {name: margins(loop) for name, loop in loops.items()}
        closed = {name: closed_loop(loop) for name, loop in loops.items()}
        numbers = {
            "crossover": ("gain crossover", "rad/s", [m.gain_crossover for m in found.values()]),
            "phase": ("phase margin", "°", [math.degrees(m.phase_margin) for m in found.values()]),
            "gain": ("gain margin", "", [m.gain_margin for m in found.values()]),
            "delay": ("delay margin", "s", [m.delay_margin for m in found.values()]),
            "bandwidth": ("bandwidth of L/(1 + L)", "rad/s", [_bandwidth(loop) for loop in loops.values()]),
        }
        columns = (
            Column(name="loop", heading="loop", values=tuple(loops)),
            *(
                Column(name=name, heading=heading, unit=unit, values=tuple(values))
                for name, (heading, unit, values) in numbers.items()
            ),
            Column(name="verdict", heading="closed loop", values=tuple(c.verdict for c in closed.values())),
        )
        note = (
            f"‘As it runs’ has half a sample time of delay for the hold, {plain(500 * h, 3)} ms, and the filter of a speed or a "
            "derivative."
        )
        note += _of_the_reference(law, loops["on paper"], gain) + _rough(
            found["as it runs"].phase_crossover, h
        )
        return Shown(
            tables=(Table(title=f"Margins with {named(law)}", columns=columns, note=note),),
            figures=(_bode(loops, found["as it runs"].gain_crossover), _nyquist(loops["as it runs"])),
            sentences=(closed["as it runs"].sentence,),
            facts={"right": Fact(value=float(closed["as it runs"].right or 0))},
        )


def _bandwidth(loop: TransferFunction) -> float:
    """Where L/(1 + L) has 1/√2 of its gain at zero [rad/s]; a delay as a Padé approximation of the third order."""
    from servobench.interop import without_delay

    rational = without_delay(loop, 3 if loop.delay else None)
    return bandwidth(_closed(rational, rational.numerator))


def _closed(loop: TransferFunction, numerator: Sequence[float]) -> TransferFunction:
    """The closed loop with another numerator over that of 1 + L."""
    below = np.polyadd(loop.denominator, loop.numerator)
    return TransferFunction(numerator=tuple(map(float, numerator)), denominator=tuple(map(float, below)))


def _of_the_reference(law: Tunable, loop: TransferFunction, gain: float) -> str:
    """The bandwidth from reference to output, where a PID weighs the reference by b and c and L/(1 + L) isn't it."""
    if not isinstance(law, Pid) or (law.b == 1 and (law.c == 1 or not law.kd)):
        return ""
    powers = (law.c * law.kd, law.b * law.kp, law.ki) if law.ki else (law.c * law.kd, law.b * law.kp)
    followed = bandwidth(_closed(loop, [gain * power for power in powers]))
    return (
        " The derivative doesn't see all of the reference, so that L/(1 + L) isn't how the output follows it: from reference to "
        f"output the bandwidth is {plain(followed)} rad/s on paper."
    )


def _rough(crossover: float, sample_time: float) -> str:
    """That a gain margin is rough where a swing has few samples: at ωh = 0.5 the hold's sin(ωh/2)/(ωh/2) is 1 % below 1."""
    if not crossover * sample_time > _COARSE:
        return ""
    samples = 2 * math.pi / (crossover * sample_time)
    return (
        f" The gain margin as it runs is rough: where the phase crosses −180°, at {plain(crossover, 3)} rad/s, a swing has only "
        f"{plain(samples, 2)} samples, and hold and filter are taken for a delay and a lag."
    )


def _bode(loops: dict[str, TransferFunction], crossover: float) -> Illustration:
    middle = crossover if math.isfinite(crossover) else 10.0
    omega = np.geomspace(middle / 30, middle * 30, _POINTS)
    responses = tuple((name, loop.frequency_response(omega)) for name, loop in loops.items())
    return Illustration(
        name="loop",
        title="Bode diagram of the open loop",
        caption="The dotted line is the gain crossover; the phase margin is what the phase has there above −180°.",
        description=f"Magnitude falls through 0 dB at {plain(crossover)} rad/s.",
        draw=partial(stability_figures.loop_bode, omega, responses, crossover),
    )


def _nyquist(loop: TransferFunction) -> Illustration:
    roots = np.abs(loop.poles)
    scale = float(np.median(roots[roots > 0])) if (roots > 0).any() else 1.0
    omega = np.geomspace(scale / 100, scale * 1000, 2000)
    real, imaginary = nyquist_curve(loop, omega)
    return Illustration(
        name="nyquist",
        title="Nyquist curve of the open loop",
        caption="Dark for positive, light for negative frequencies. The cross is −1, the circle has the radius 1.",
        description=f"Nyquist curve of {loop}.",
        draw=partial(stability_figures.nyquist, real, imaginary),
    )
