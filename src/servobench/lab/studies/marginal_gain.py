"""The study `marginal_gain`: the gain at which a loop begins to swing by itself, by Routh, as it is sampled, and by trial."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Annotated

import numpy as np
from pydantic import Field

from servobench.core.channels import Array
from servobench.core.rounding import plain
from servobench.core.settings import PositiveTime, Speed
from servobench.lab.expression import Fact
from servobench.lab.loops import OfAMotor
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, Table
from servobench.recordings.measurement.measure import measure
from servobench.report import figures
from servobench.report.figures import Course, Curve, Panel
from servobench.report.illustrations import Illustration
from servobench.rig.experiment import Experiment
from servobench.systems.control.pid import Pid
from servobench.systems.signals.ramp import Ramp
from servobench.systems.stability.gains import stable_gains
from servobench.systems.transfer_function import TransferFunction
from servobench.systems.tuning.loop import open_loop

_SETTLED = 0.5  # s after the ramp; the loop's third pole is gone by then
_SHOWN = 4
_WIDEST = (
    1.2  # ratio of two gains between which growth is a straight line, to less than a per cent of the gain
)
_NARROWEST = 1.01  # ratio of two gains that is near enough where the upper one runs away at once
_FARTHEST = 8.0  # how far beyond the gains to try others are tried, as a factor


@dataclass(frozen=True, kw_only=True, eq=False)
class _Swing:
    """The speed about which a loop swings with the gain k: growth [1/s] and frequency [rad/s], NaN where it ran away at once.

    Times (N,) [s] and speeds (N,) [rad/s], as far as the swings stay within half of the speed.
    """

    k: float
    growth: float
    frequency: float
    t: Array
    speed: Array

    @property
    def dies_out(self) -> bool:
        """Whether it swings less and less."""
        return self.growth <= 0


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

    def __call__(self, stand: Stand) -> StudyResult:
        """Return gains and growth in a table, the swings, and the limits of the gain found in three ways."""
        gain, tau = self.motor(stand)
        a, h = self.pole, stand.experiment.sample_time
        loop = TransferFunction(numerator=(gain,), denominator=(tau, 1 + a * tau, a, 0.0), unit="1")
        paper = stable_gains(loop)[0][1]
        # The loop itself, sampled, for k = 1.
        sampled = stable_gains(open_loop(self._law(1.0), gain, tau, 0.0, h).in_w)[0][1]
        swings = self._search(stand, float(np.sqrt(a / tau)))
        rightmost = [
            float(max(r.real for r in np.roots(np.polyadd(loop.denominator, [each.k * gain])) if r.imag > 0))
            for each in swings
        ]
        tried = _crossing(swings)
        limits = (
            Column(
                name="how",
                heading="limit of the gain",
                values=("Routh", "of the loop as it is sampled", "tried"),
            ),
            Column(name="limit", heading="k", values=(paper, sampled, tried)),
        )
        return StudyResult(
            tables=(
                self._table(rightmost, swings),
                Table(title="Where the oscillation begins", columns=limits),
            ),
            figures=(self._figure(swings),),
            facts={
                "routh": Fact(value=paper),
                "tried": Fact(value=tried),
                "period": Fact(value=2 * np.pi / float(np.sqrt(a / tau))),
            },
        )

    def _search(self, stand: Stand, near: float) -> list[_Swing]:
        """The swings with the gains to try and, where these leave the limit open, with further ones, in rising order.

        Gains are added beyond the last ones, and between two, until one whose swings die out and one whose swings grow are within
        a fifth; `near` is about the frequency of the swings [rad/s].
        """
        tried = {k: self._swing(stand, k, near) for k in self.gains}
        while (k := _next(tried)) is not None and self.gains[0] / _FARTHEST < k < self.gains[-1] * _FARTHEST:
            tried[k] = self._swing(stand, k, near)
        return [tried[k] for k in sorted(tried)]

    def _swing(self, stand: Stand, k: float, near: float) -> _Swing:
        t, speed = self._run(stand, k)
        if len(t) < 2 or t[-1] - t[0] < 2 * np.pi / near:  # run away before a period was over
            return _Swing(k=k, growth=math.nan, frequency=math.nan, t=t, speed=speed)
        growth, omega = _growth(t, speed, near)
        return _Swing(k=k, growth=growth, frequency=omega, t=t, speed=speed)

    def _table(self, theory: list[float], swings: Sequence[_Swing]) -> Table:
        return Table(
            title="Gains tried",
            columns=(
                Column(name="gain", heading="gain k", values=tuple(each.k for each in swings)),
                Column(name="theory", heading="growth by theory", unit="1/s", values=tuple(theory), digits=3),
                Column(
                    name="growth",
                    heading="growth in the run",
                    unit="1/s",
                    values=tuple(each.growth for each in swings),
                    digits=3,
                ),
                Column(
                    name="frequency",
                    heading="frequency in the run",
                    unit="rad/s",
                    values=tuple(each.frequency for each in swings),
                ),
                Column(
                    name="verdict",
                    heading="the swings",
                    values=tuple("die out" if each.dies_out else "grow" for each in swings),
                ),
            ),
        )

    def _law(self, k: float) -> Pid:
        return Pid(output="speed", kp=0.0, ki=k / self.pole, cutoff=self.pole)

    def _run(self, stand: Stand, k: float) -> tuple[Array, Array]:
        """Time and speed from shortly after the ramp on, while the swings stay within half of the speed."""
        own = stand.experiment
        ramp = Ramp(final=self.speed, duration=0.5)
        experiment = Experiment(
            name=f"gain {k:g}",
            signal=ramp,
            controller=self._law(k),
            duration=self.duration,
            sample_time=own.sample_time,
            device=own.device,
            limits=own.limits,
            seed=own.seed,
        )
        data = measure(stand.run(experiment), "derivative | lowpass 50 rad/s")
        after = data.t_output > ramp.duration + _SETTLED
        t, y = data.t_output[after], data.y[after]
        wide = np.flatnonzero(np.abs(y - self.speed) > 0.5 * self.speed)
        end = wide[0] if len(wide) else len(t)
        return t[:end], y[:end]

    def _figure(self, swings: Sequence[_Swing]) -> Illustration:
        candidates = [each for each in swings if each.k in self.gains and len(each.t)]
        courses = tuple(
            Course(
                title=f"k = {plain(each.k)}",
                panels=(
                    Panel(
                        title="Speed",
                        unit="rad/s",
                        curves=(Curve(t=each.t, y=each.speed, look="measured"),),
                        height=110.0,
                    ),
                ),
            )
            for each in candidates[:_SHOWN]
        )
        return Illustration(
            name="swings",
            title="Oscillation about the reference speed",
            caption=(
                "Each run from half a second after the ramp, as long as the oscillation stays within half "
                "of the speed."
            ),
            description="Oscillations that decay with a small gain and grow with a large one.",
            draw=partial(figures.time_courses, courses),
        )


def _growth(t: Array, y: Array, near: float) -> tuple[float, float]:
    """Growth [1/s] and frequency [rad/s] of c + e^(σt) (a cos ωt + b sin ωt), by least squares from a frequency nearby."""
    from scipy.optimize import least_squares

    x = t - t[0]

    def remainder(theta: Array) -> Array:
        growth, omega = theta
        swing = np.exp(growth * x)
        base = np.column_stack([np.ones_like(x), swing * np.cos(omega * x), swing * np.sin(omega * x)])
        weights, *_ = np.linalg.lstsq(base, y, rcond=None)
        return np.asarray(y - base @ weights, dtype=np.float64)

    fit = least_squares(remainder, (0.0, near), x_scale=(0.1, 1.0))
    return float(fit.x[0]), float(fit.x[1])


def _next(tried: Mapping[float, _Swing]) -> float | None:
    """The gain to try next; None where one that dies out and one that grows are near each other."""
    growing = [each.k for each in tried.values() if not each.dies_out]
    dying = [each.k for each in tried.values() if each.dies_out and (not growing or each.k < min(growing))]
    if not dying:
        return min(tried) / _WIDEST
    if not growing:
        return max(tried) * _WIDEST
    low, high = max(dying), min(growing)
    near_enough = _WIDEST if math.isfinite(tried[high].growth) else _NARROWEST
    return None if high / low <= near_enough else math.sqrt(low * high)


def _crossing(swings: Sequence[_Swing]) -> float:
    """The gain at which the growth is zero, between the two tried about it; NaN without such two."""
    for low, high in pairwise(swings):
        if low.dies_out and not high.dies_out:
            across = low.growth / (low.growth - high.growth) if math.isfinite(high.growth) else 0.5
            return low.k + across * (high.k - low.k)
    return math.nan
