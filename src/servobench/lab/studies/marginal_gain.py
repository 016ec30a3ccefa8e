"""The study `marginal_gain`: the gain at which a loop begins to swing by itself, by Routh, as it is sampled, and by trial."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import numpy as np
from pydantic import Field

from servobench.channels import Array
from servobench.control.pid import Pid
from servobench.experiment import Experiment
from servobench.lab.expression import Fact
from servobench.lab.loops import OfAMotor
from servobench.lab.studies.base import STUDIES, Column, Shown, Stand, Table
from servobench.measurement.measure import measure
from servobench.report import figures
from servobench.report.figures import Course, Curve, Panel
from servobench.report.illustrations import Illustration
from servobench.rounding import plain
from servobench.settings import PositiveTime, Speed
from servobench.signals.ramp import Ramp
from servobench.stability_analysis.gains import stable_gains
from servobench.transfer_function import TransferFunction
from servobench.tuning.loop import open_loop

_SETTLED = 0.5  # s after the ramp; the loop's third pole is gone by then
_SHOWN = 4


@STUDIES.member("marginal_gain")
class MarginalGain(OfAMotor):
    """Tries gains k of the loop k/(s + a) · K/(s (τs + 1)), and reads off how fast its swings grow or die out.

    The loop is closed around the speed: an integral k/a of what the filter a/(s + a) lets through, which makes the same open
    loop, the integrator in the controller and the lag in the filter. So the motor keeps turning one way, and
    friction is a constant.
    """

    gains: Annotated[tuple[float, ...], Field(min_length=2)]
    """The gains k to try, in rising order."""
    pole: Annotated[Speed, Field(gt=0)] = 10.0
    """The pole a of the controller [rad/s]."""
    speed: Annotated[Speed, Field(gt=0)] = 60.0
    """The speed about which it swings [rad/s]."""
    duration: PositiveTime = 6.0
    """Length of each run [s]."""

    def __call__(self, stand: Stand) -> Shown:
        """Return gains and growth in a table, the swings, and the limits of the gain found in three ways."""
        gain, tau = self.motor(stand)
        a, h = self.pole, stand.experiment.sample_time
        loop = TransferFunction(numerator=(gain,), denominator=(tau, 1 + a * tau, a, 0.0), unit="1")
        paper = stable_gains(loop)[0][1]
        # The loop itself, sampled, for k = 1.
        sampled = stable_gains(open_loop(self._law(1.0), gain, tau, 0.0, h).in_w)[0][1]
        courses, growths, frequencies = [], [], []
        for k in self.gains:
            t, speed = self._run(stand, k)
            growth, omega = _swing(t, speed, np.sqrt(a / tau))
            courses.append((k, t, speed))
            growths.append(growth)
            frequencies.append(omega)
        rightmost = [
            float(max(r.real for r in np.roots(np.polyadd(loop.denominator, [k * gain])) if r.imag > 0))
            for k in self.gains
        ]
        tried = _crossing(np.array(self.gains), np.array(growths))
        limits = (
            Column(
                name="how",
                heading="limit of the gain",
                values=("Routh", "of the loop as it is sampled", "tried"),
            ),
            Column(name="limit", heading="k", values=(paper, sampled, tried)),
        )
        return Shown(
            tables=(
                self._table(rightmost, growths, frequencies),
                Table(title="Where it begins to swing", columns=limits),
            ),
            figures=(self._figure(courses),),
            facts={
                "routh": Fact(value=paper),
                "tried": Fact(value=tried),
                "period": Fact(value=2 * np.pi / float(np.sqrt(a / tau))),
            },
        )

    def _table(self, theory: list[float], growths: list[float], frequencies: list[float]) -> Table:
        said = tuple("grow" if g > 0 else "die out" for g in growths)
        return Table(
            title="Gains tried",
            columns=(
                Column(name="gain", heading="gain k", values=self.gains),
                Column(name="theory", heading="growth by theory", unit="1/s", values=tuple(theory), digits=3),
                Column(
                    name="growth", heading="growth in the run", unit="1/s", values=tuple(growths), digits=3
                ),
                Column(
                    name="frequency", heading="frequency in the run", unit="rad/s", values=tuple(frequencies)
                ),
                Column(name="verdict", heading="the swings", values=said),
            ),
        )

    def _law(self, k: float) -> Pid:
        return Pid(output="speed", kp=0.0, ki=k / self.pole, cutoff=self.pole)

    def _run(self, stand: Stand, k: float) -> tuple[Array, Array]:
        """Time and speed from shortly after the ramp on, while the swings stay within half of the speed."""
        own = stand.experiment
        ramp = Ramp(final=self.speed, duration=0.5)
        asked = Experiment(
            name=f"gain {k:g}",
            signal=ramp,
            controller=self._law(k),
            duration=self.duration,
            sample_time=own.sample_time,
            device=own.device,
            limits=own.limits,
            seed=own.seed,
        )
        data = measure(stand.run(asked), "derivative | lowpass 50 rad/s")
        after = data.t_output > ramp.duration + _SETTLED
        t, y = data.t_output[after], data.y[after]
        wide = np.flatnonzero(np.abs(y - self.speed) > 0.5 * self.speed)
        end = wide[0] if len(wide) else len(t)
        return t[:end], y[:end]

    def _figure(self, courses: list[tuple[float, Array, Array]]) -> Illustration:
        drawn = tuple(
            Course(
                title=f"k = {plain(k)}",
                panels=(Panel(title="Speed", unit="rad/s", curves=(Curve(t=t, y=y, look="measured"),), height=110.0),),
            )
            for k, t, y in courses[:_SHOWN]
        )  # fmt: skip
        return Illustration(
            name="swings",
            title="Swings about the speed that was asked for",
            caption="Each run from half a second after the ramp, as far as the swings stay within half of the speed.",
            description="Swings that die out with a small gain and grow with a large one.",
            draw=partial(figures.time_courses, drawn),
        )


def _swing(t: Array, y: Array, near: float) -> tuple[float, float]:
    """Growth [1/s] and frequency [rad/s] of c + e^(σt) (a cos ωt + b sin ωt), by least squares from a frequency nearby."""
    from scipy.optimize import least_squares

    x = t - t[0]

    def left(theta: Array) -> Array:
        growth, omega = theta
        swing = np.exp(growth * x)
        base = np.column_stack([np.ones_like(x), swing * np.cos(omega * x), swing * np.sin(omega * x)])
        weights, *_ = np.linalg.lstsq(base, y, rcond=None)
        return np.asarray(y - base @ weights, dtype=np.float64)

    found = least_squares(left, (0.0, near), x_scale=(0.1, 1.0))
    return float(found.x[0]), float(found.x[1])


def _crossing(gains: Array, growths: Array) -> float:
    """The gain at which the growth is zero, on a straight line between the two tried about it; NaN without such two."""
    up = np.flatnonzero((growths[:-1] <= 0) & (growths[1:] > 0))
    if not len(up):
        return float("nan")
    n = int(up[0])
    return float(np.interp(0.0, growths[n : n + 2], gains[n : n + 2]))
