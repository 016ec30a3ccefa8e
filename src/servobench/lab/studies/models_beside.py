"""The study `models_beside`: models of gain and time constant beside the exercise's own recording."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.rounding import plain, with_unit
from servobench.core.settings import PositiveTime, Settings
from servobench.lab.expression import Expression
from servobench.lab.graphs import curve, over_time, panel
from servobench.lab.motion import Motion, motion_of
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.report.figures import Course
from servobench.report.illustrations import Illustration


class Candidate(Settings):
    """A model K/(τs + 1): expressions over facts give K and τ."""

    name: Annotated[str, Field(min_length=1)]
    """Its name."""
    gain: str
    """The expression for K, in rad/(s·V)."""
    time_constant: str
    """The expression for τ, in s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Comparison:
    """A model compared with a motion: its values, its mean speeds (N,) [rad/s], their error [rad/s], and friction's part [V]."""

    name: str
    gain: float
    tau: float
    speed: Array
    error: float
    lost: float


@STUDIES.member("models_beside")
class ModelsBeside(StudySettings):
    """First-order models simulated from the recording's voltage, against the speed that was measured, as means over 20 ms.

    The mean speeds are plain differences of the angle, taken from model and motor alike, so that no filter lags. While the shaft
    turns one way friction takes a constant part of the voltage; for each model the part that suits it best is taken off. What is
    left is the model's error; the fit is 100·(1 - error/standard deviation of the speed) %.
    """

    window: PositiveTime = 0.02
    """Time over which speeds are means [s]."""
    models: Annotated[tuple[Candidate, ...], Field(min_length=1)]
    """The models."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return how far each model is off; raises `UsageError` where the shaft doesn't turn one way all the time."""
        motion = motion_of(stand.recording)
        if (np.diff(motion.angle) < 0).any():
            raise UsageError(
                "the shaft turns back, and friction with it; expected a voltage that always turns it the same way, "
                "such as 1 to 3 V"
            )
        step = max(1, round(self.window / float(motion.t[1] - motion.t[0])))
        t, measured = _mean_speed(motion.t, motion.angle, step)
        held = [self._compare(stand, model, motion, step, measured) for model in self.models]
        spread, quantum = float(np.std(measured)), motion.count / (step * float(t[1] - t[0]))
        table = Table(
            title="Each model under the same voltage, against the speed that was measured",
            columns=(
                Column(name="model", heading="model", values=tuple(h.name for h in held)),
                Column(name="gain", heading="K", unit="rad/(s·V)", values=tuple(h.gain for h in held)),
                Column(name="tau", heading="τ", unit="s", values=tuple(h.tau for h in held)),
                Column(
                    name="lost",
                    heading="Coulomb voltage",
                    unit="V",
                    digits=2,
                    values=tuple(h.lost for h in held),
                ),
                Column(
                    name="error",
                    heading="error (rms)",
                    unit="rad/s",
                    digits=2,
                    values=tuple(h.error for h in held),
                ),
                Column(
                    name="fit",
                    heading="fit",
                    unit="%",
                    digits=3,
                    values=tuple(100 * (1 - h.error / spread) for h in held),
                ),
            ),
            note=f"Rounding to whole counts alone gives an error of {plain(quantum / math.sqrt(6), 2)} rad/s.",
        )
        return StudyResult(tables=(table,), figures=(_figure(motion, t, measured, held),))

    def _compare(
        self, stand: Stand, model: Candidate, motion: Motion, step: int, measured: Array
    ) -> _Comparison:
        gain = Expression(model.gain).evaluate(stand.facts).value
        tau = Expression(model.time_constant).evaluate(stand.facts).value
        _, driven = _mean_speed(motion.t, _angle(motion.t, motion.voltage, gain, tau), step)
        _, held_back = _mean_speed(motion.t, _angle(motion.t, np.ones_like(motion.t), gain, tau), step)
        lost = float(held_back @ (driven - measured) / (held_back @ held_back))
        speed = driven - lost * held_back
        error = float(np.sqrt(np.mean((measured - speed) ** 2)))
        return _Comparison(name=model.name, gain=gain, tau=tau, speed=speed, error=error, lost=lost)


def _angle(t: Array, voltage: Array, gain: float, tau: float) -> Array:
    """The angle (N,) of K/(s(τs + 1)) from rest, each voltage held until the next sample: exact."""
    angle, speed = np.zeros_like(t), 0.0
    for k, dt in enumerate(np.diff(t)):
        end = gain * voltage[k]
        gone = -math.expm1(-dt / tau)
        angle[k + 1] = angle[k] + end * dt + (speed - end) * tau * gone
        speed += (end - speed) * gone
    return angle


def _mean_speed(t: Array, angle: Array, step: int) -> tuple[Array, Array]:
    """Mean speeds over so many samples, and the middles of their times."""
    return 0.5 * (t[step:] + t[:-step]), (angle[step:] - angle[:-step]) / (t[step:] - t[:-step])


def _figure(motion: Motion, t: Array, measured: Array, held: list[_Comparison]) -> Illustration:
    """The last rise of the voltage, a picture for each model."""
    rises = np.flatnonzero(np.diff(motion.voltage) > 0)
    at = float(motion.t[rises[-1] + 1]) if len(rises) else float(motion.t[0])
    longest = max(model.tau for model in held)
    part = (t > at - longest) & (t < at + 5 * longest)
    courses = tuple(
        Course(
            title=f"{model.name}: τ = {with_unit(model.tau, 's', 3)}",
            panels=(
                panel(
                    "Speed",
                    "rad/s",
                    curve(t[part] - at, measured[part], "measured", "measured"),
                    curve(t[part] - at, model.speed[part], "model", "model"),
                ),
            ),
        )
        for model in held
    )
    best = min(held, key=lambda model: model.error)
    return over_time(
        "models",
        "One rise of the speed, and each model's",
        "Wide and grey: measured. Thin and blue: the model, under the same voltage. Time counts from the rise of the voltage.",
        f"Closest to the measured speed is ‘{best.name}’, with an error of {plain(best.error, 2)} rad/s.",
        courses,
    )
