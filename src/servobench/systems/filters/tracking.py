"""Tracking filters: a model predicts position and speed, and each new position corrects them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.numbers import check_positive, number_text


@dataclass(frozen=True, kw_only=True)
class AlphaBeta:
    """The α-β filter: the shaft is taken to keep its speed, and each new position corrects both by a part of the surprise.

    x⁻ = x + v Δt,   x = x⁻ + α (z - x⁻),   v = v + β (z - x⁻)/Δt, from the first position z on, at rest.
    From z to v that is (β/T)(1 - z⁻¹)/(1 - (2 - α - β) z⁻¹ + (1 - α) z⁻²), at steps T: a difference behind a low-pass filter of
    second order. Stable for 0 < `alpha` α, 0 < `beta` β, 2 α + β < 4 (Kalata 1984); raises `UsageError` otherwise.
    """

    alpha: float
    beta: float

    def __post_init__(self) -> None:
        if not (self.alpha > 0 and self.beta > 0 and 2 * self.alpha + self.beta < 4):
            raise UsageError(
                f"an α-β filter with α = {self.alpha:g} and β = {self.beta:g} isn't stable; expected both above 0, and 2 α + β "
                "below 4"
            )

    @classmethod
    def critically_damped(cls, time_constant: float, sample_time: float) -> Self:
        """Return the filter with a double pole at θ = e^{-T/time constant}, both in s: α = 1 - θ², β = (1 - θ)²."""
        check_positive("the time constant of an α-β filter", time_constant, "s")
        check_positive("the sample time", sample_time, "s")
        pole = math.exp(-sample_time / time_constant)
        return cls(alpha=1 - pole**2, beta=(1 - pole) ** 2)

    @classmethod
    def kalman(cls, acceleration: float, quantum: float, sample_time: float) -> Self:
        """Return the steady Kalman filter of a shaft that keeps its speed but for a random acceleration.

        `acceleration` is the standard deviation [rad/s²] of one that is constant through a sample, `quantum` the encoder's step Δ
        [rad], whose error counts as white with Δ/√12. With the tracking index λ = a T²/(Δ/√12) (Kalata 1984),
        r = (4 + λ - √(8λ + λ²))/4, α = 1 - r², β = 2 (2 - α) - 4 √(1 - α).
        """
        check_positive("the random acceleration", acceleration, "rad/s²")
        check_positive("the encoder's step", quantum, "rad")
        check_positive("the sample time", sample_time, "s")
        index = acceleration * sample_time**2 / (quantum / math.sqrt(12))
        root = (4 + index - math.sqrt(8 * index + index**2)) / 4
        return cls(alpha=1 - root**2, beta=2 * (1 - root) ** 2)  # 2 (2 - α) - 4 √(1 - α), with √(1 - α) = r

    def __call__(self, x: Array, t: Array) -> Array:
        """Return the speeds for positions x (N,) or (N, P) [rad] at times t (N,) [s]; the first is zero."""
        speeds = np.zeros(x.shape)
        if len(x) == 0:
            return speeds
        position, speed = np.array(x[0], dtype=np.float64), np.zeros(x.shape[1:])
        for k, dt in enumerate(np.diff(t), start=1):
            ahead = position + speed * dt
            surprise = x[k] - ahead
            position, speed = ahead + self.alpha * surprise, speed + self.beta / dt * surprise
            speeds[k] = speed
        return speeds

    def __str__(self) -> str:
        return f"α-β filter {number_text(round(self.alpha, 6))} {number_text(round(self.beta, 6))}"


@dataclass(frozen=True, kw_only=True)
class MotorKalman:
    """The steady Kalman filter of a first-order motor that knows its voltage: τ dω/dt = K u - ω + τ a.

    `gain` K [rad/(s·V)] and `time_constant` τ [s] are what the filter is told of the motor; `voltage` gives u [V] at times
    (N,) [s], each held to the next; `acceleration` is the standard deviation a [rad/s²] of what the model doesn't know, constant
    through a sample; `quantum` the encoder's step [rad]. The gains solve the discrete Riccati equation at `sample_time` [s].
    It lags behind nothing that its model foresees. Where the model is wrong it shows something between motor and model.
    """

    gain: float
    time_constant: float
    acceleration: float
    quantum: float
    sample_time: float
    voltage: Callable[[Array], Array]

    def __post_init__(self) -> None:
        for what, value, unit in (
            ("the time constant", self.time_constant, "s"),
            ("the random acceleration", self.acceleration, "rad/s²"),
            ("the encoder's step", self.quantum, "rad"),
            ("the sample time", self.sample_time, "s"),
        ):
            check_positive(f"{what} of a Kalman filter", value, unit)

    @property
    def corrections(self) -> tuple[float, float]:
        """The corrections of position [1] and speed [1/s] by a surprise of 1 rad."""
        from scipy.linalg import solve_discrete_are

        advance, _ = self._model
        driven = self.acceleration * np.array([[0.5 * self.sample_time**2], [self.sample_time]])
        output_vector, scatter = np.array([[1.0], [0.0]]), self.quantum**2 / 12
        ahead = solve_discrete_are(advance.T, output_vector, driven @ driven.T, np.array([[scatter]]))
        return float(ahead[0, 0] / (ahead[0, 0] + scatter)), float(ahead[1, 0] / (ahead[0, 0] + scatter))

    def __call__(self, x: Array, t: Array) -> Array:
        """Return the speeds for positions x (N,) or (N, P) [rad] at times t (N,) [s], `sample_time` apart; the first is zero."""
        speeds = np.zeros(x.shape)
        if len(x) == 0:
            return speeds
        (_, of_speed), (_, decay) = self._model[0]
        of_voltage = self._model[1]
        correct_position, correct_speed = self.corrections
        u = self.voltage(t)
        position, speed = np.array(x[0], dtype=np.float64), np.zeros(x.shape[1:])
        for k in range(1, len(t)):
            ahead = position + of_speed * speed + of_voltage[0] * u[k - 1]
            faster = decay * speed + of_voltage[1] * u[k - 1]
            surprise = x[k] - ahead
            position, speed = ahead + correct_position * surprise, faster + correct_speed * surprise
            speeds[k] = speed
        return speeds

    def __str__(self) -> str:
        return f"Kalman filter for {number_text(self.time_constant)} s"

    @property
    def _model(self) -> tuple[Array, Array]:
        """The transition of position and speed over a sample, and the effect of a volt on them."""
        decay = math.exp(-self.sample_time / self.time_constant)
        moved = self.time_constant * (1 - decay)
        advance = np.array([[1.0, moved], [0.0, decay]])
        return advance, self.gain * np.array([self.sample_time - moved, 1 - decay])
