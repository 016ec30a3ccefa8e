"""The study `loop_margins`: gain, phase and delay margin of a loop, its bandwidth, and what Nyquist's criterion says of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from servobench.core.channels import Array
from servobench.core.rounding import plain
from servobench.lab.expression import Fact
from servobench.lab.loops import OfAMotor, gains_text, on_paper, tunable
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, Table
from servobench.report import stability_figures
from servobench.report.illustrations import Illustration
from servobench.rig.experiment.experiment import AnyController
from servobench.systems.control.pid import Pid
from servobench.systems.margins import margins
from servobench.systems.responses import bandwidth
from servobench.systems.sampled_loop import SampledLoop, sampled_margins
from servobench.systems.stability.nyquist import closed_loop
from servobench.systems.stability.sampled import closed_bandwidth, closed_sampled_loop
from servobench.systems.transfer_function import TransferFunction
from servobench.systems.tuning.base import Tunable
from servobench.systems.tuning.loop import open_loop

_POINTS = 400


@STUDIES.member("loop_margins")
class LoopMargins(OfAMotor):
    """Margins and bandwidth of a controller around the motor: as drawn on paper, and as it runs, tick by tick."""

    controller: AnyController | None = None
    """The controller; without it that of the exercise's experiment."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the margins both ways, Bode diagram and Nyquist curve; raises `UsageError` for a law without feedback."""
        law = tunable(self.controller or stand.experiment.controller)
        gain, tau = self.motor(stand)
        h = stand.experiment.sample_time
        paper, sampled = on_paper(law, gain, tau), open_loop(law, gain, tau, 0.0, h)
        both_margins = (margins(paper), sampled_margins(sampled))
        closed = (closed_loop(paper), closed_sampled_loop(sampled))
        numbers = {
            "crossover": ("gain crossover", "rad/s", [m.gain_crossover for m in both_margins]),
            "phase": ("phase margin", "°", [math.degrees(m.phase_margin) for m in both_margins]),
            "gain": ("gain margin", "", [m.gain_margin for m in both_margins]),
            "delay": ("delay margin", "s", [m.delay_margin for m in both_margins]),
            "bandwidth": ("bandwidth of L/(1 + L)", "rad/s", [_bandwidth(paper), closed_bandwidth(sampled)]),
        }
        columns = (
            Column(name="loop", heading="loop", values=("on paper", "as it runs")),
            *(
                Column(name=name, heading=heading, unit=unit, values=tuple(values))
                for name, (heading, unit, values) in numbers.items()
            ),
            Column(name="verdict", heading="closed loop", values=tuple(c.verdict for c in closed)),
        )
        note = (
            f"‘As it runs’ is the loop computed every {plain(1000 * h, 3)} ms: the voltage holds in between, and "
            "filters, derivatives and integrals are sums and differences of samples."
        ) + _of_the_reference(law, paper, gain)
        return StudyResult(
            tables=(Table(title=f"Margins with {gains_text(law)}", columns=columns, note=note),),
            figures=(
                _bode(paper, sampled, both_margins[1].gain_crossover),
                _nyquist(sampled, both_margins[1].gain_crossover),
            ),
            sentences=(closed[1].sentence,),
            facts={"right": Fact(value=float(closed[1].right or 0))},
        )


def _bandwidth(loop: TransferFunction) -> float:
    """The frequency at which L/(1 + L) has 1/√2 of its gain at zero [rad/s]."""
    return bandwidth(_close_loop(loop, loop.numerator))


def _close_loop(loop: TransferFunction, numerator: Sequence[float]) -> TransferFunction:
    """The closed loop with another numerator over that of 1 + L."""
    below = np.polyadd(loop.denominator, loop.numerator)
    return TransferFunction(numerator=tuple(map(float, numerator)), denominator=tuple(map(float, below)))


def _of_the_reference(law: Tunable, loop: TransferFunction, gain: float) -> str:
    """The bandwidth from reference to output, where a PID weighs the reference by b and c and L/(1 + L) isn't it."""
    if not isinstance(law, Pid) or (law.b == 1 and (law.c == 1 or not law.kd)):
        return ""
    powers = (law.c * law.kd, law.b * law.kp, law.ki) if law.ki else (law.c * law.kd, law.b * law.kp)
    followed = bandwidth(_close_loop(loop, [gain * power for power in powers]))
    return (
        " The derivative doesn't use the whole reference, so L/(1 + L) isn't the response to it: from reference to "
        f"output the bandwidth is {plain(followed)} rad/s on paper."
    )


def _bode(paper: TransferFunction, sampled: SampledLoop, crossover: float) -> Illustration:
    omega = _frequencies(sampled, crossover, 30)
    responses = (
        ("on paper", paper.frequency_response(omega)),
        ("as it runs", sampled.frequency_response(omega)),
    )
    return Illustration(
        name="loop",
        title="Bode diagram of the open loop",
        caption="The dotted line is the gain crossover; the phase margin is the phase there above −180°.",
        description=f"Magnitude falls through 0 dB at {plain(crossover)} rad/s.",
        draw=partial(stability_figures.loop_bode, omega, responses, crossover),
    )


def _nyquist(sampled: SampledLoop, crossover: float) -> Illustration:
    response = sampled.frequency_response(_frequencies(sampled, crossover, 1000))
    return Illustration(
        name="nyquist",
        title="Nyquist curve of the open loop",
        caption="Dark for positive, light for negative frequencies. The cross is −1, the circle has the radius 1.",
        description="Nyquist curve of the loop as it runs, up to half the sample rate.",
        draw=partial(stability_figures.nyquist, np.asarray(response.real), np.asarray(response.imag)),
    )


def _frequencies(sampled: SampledLoop, crossover: float, times: float) -> Array:
    """Frequencies (N,) [rad/s] about a crossover, so many times to either side, and not quite as far as half the sample rate.

    Right there a sampled motor is nearly zero, and its phase jumps.
    """
    last = 0.99 * math.pi / sampled.sample_time
    middle = crossover if math.isfinite(crossover) else min(10.0, 0.1 * last)
    return np.geomspace(middle / times, min(middle * times, last), _POINTS if times < 100 else 5 * _POINTS)
