"""The first-order motor with friction that depends on speed, direction and load, and with gravity.

    τ dω/dt = -ω + K (u(t - d) - u₀ - g(θ) - u_a |ω|) - |K| sgn(ω) (u_c + u_s e^(-|ω|/ω_s) + μ |g(θ)|),   dθ/dt = ω
    g(θ) = u_gs sin θ + u_gc cos θ

All losses are in units of the input, so a fit needs no motor constant. K and τ already include viscous friction, and a constant
load (a hoist) is the offset u₀. Falling friction is Stribeck's in the exponential form of Tustin (1947); a Gaussian is flat at
rest and wouldn't describe a shaft that creeps. Gravity by sine and cosine, not by amplitude and angle, is linear in its
parameters and has no singularity where there is none.

Friction that differs by direction: with the Coulomb voltages u₊ and u₋, and forward the way that a positive input drives,

    sgn(ω) u_c + u₀  =  u₊ forward, -u₋ backward   where   u_c = (u₊ + u₋)/2, u₀ = (u₊ - u₋)/2

so unequal Coulomb voltages and an offset are the same thing, at rest too, and a model can't have both. An offset can't replace
viscous friction that depends on the direction: u_a |ω|.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.identification.models.base import Output, Parameter, Prediction
from servobench.identification.models.common_parameters import COULOMB, DELAY, GAIN, OFFSET, TIME_CONSTANT
from servobench.identification.models.first_order import FirstOrder
from servobench.identification.models.motion import smooth_speed
from servobench.identification.models.records import is_plain, start_parameters, through_chain
from servobench.identification.models.turning import Sliding
from servobench.recordings.measurement.base import Kind
from servobench.recordings.measurement.dataset import Dataset
from servobench.systems.transfer_function import TransferFunction

FORWARD = Parameter(
    name="coulomb_voltage_forward",
    meaning="input needed to overcome friction while turning in the direction of a positive input",
    unit="{input}",
)
BACKWARD = Parameter(
    name="coulomb_voltage_backward",
    meaning="input needed to overcome friction while turning in the other direction",
    unit="{input}",
)
ASYMMETRY = Parameter(
    name="drag_asymmetry",
    meaning="input per unit of speed lost going forward and gained going backward",
    unit="{input}·s/{position}",
)
STRIBECK = Parameter(
    name="stribeck_voltage",
    meaning="input needed to overcome friction at rest, beyond that at speed",
    unit="{input}",
    lower=0.0,
)
STRIBECK_SPEED = Parameter(
    name="stribeck_speed",
    meaning="speed at which 37 % of the stribeck_voltage is left",
    unit="{position}/s",
    lower=0.0,
)
SINE = Parameter(
    name="gravity_voltage_sine",
    meaning="input needed against gravity, times the sine of the angle",
    unit="{input}",
)
COSINE = Parameter(
    name="gravity_voltage_cosine",
    meaning="input needed against gravity, times the cosine of the angle",
    unit="{input}",
)
LOAD = Parameter(name="load_friction", meaning="friction per unit of gravity's load", unit="1", lower=0.0)

# The place and weight of each parameter in the kernel's vector (K, τ, u₀, u_c, d, u_s, ω_s, u_gs, u_gc, μ, u_a, θ₀, ω₀).
_PLACES: dict[Parameter, dict[int, float]] = {
    GAIN: {0: 1.0},
    TIME_CONSTANT: {1: 1.0},
    OFFSET: {2: 1.0},
    COULOMB: {3: 1.0},
    FORWARD: {3: 0.5, 2: 0.5},
    BACKWARD: {3: 0.5, 2: -0.5},
    DELAY: {4: 1.0},
    STRIBECK: {5: 1.0},
    STRIBECK_SPEED: {6: 1.0},
    SINE: {7: 1.0},
    COSINE: {8: 1.0},
    LOAD: {9: 1.0},
    ASYMMETRY: {10: 1.0},
}
_SLOWEST, _FASTEST = (
    1e-3,
    0.7,
)  # of the largest speed: a stribeck_speed beyond that is a Coulomb voltage, or viscous friction


@dataclass(frozen=True)
class NonlinearMotor:
    """A first-order motor with an integrator and those terms of friction and gravity whose parameters it has."""

    parameters: tuple[Parameter, ...]

    @cached_property
    def friction(self) -> bool:
        """Whether the shaft can stick."""
        return COULOMB in self.parameters or FORWARD in self.parameters

    @cached_property
    def stribeck(self) -> bool:
        """Whether friction falls with the speed."""
        return STRIBECK in self.parameters

    @cached_property
    def gravity(self) -> bool:
        """Whether the load depends on the angle."""
        return SINE in self.parameters

    @cached_property
    def mixing(self) -> Array:
        """The kernel's vector without its start state, (11, P), as a linear function of the parameters."""
        out = np.zeros((11, len(self.parameters)))
        for n, parameter in enumerate(self.parameters):
            for place, weight in _PLACES[parameter].items():
                out[place, n] = weight
        return out

    def nuisance(self, data: Dataset) -> tuple[Parameter, ...]:
        """Return the nuisance parameters of a record: where and how fast it starts, and the unknown states of its filters."""
        return start_parameters(data)

    def bounds(self, data: Sequence[Dataset]) -> tuple[Array, Array]:
        """Return the bounds of the parameters: those of `FirstOrder`, and for what friction and gravity may be.

        A stribeck_speed is one that the data can know of, and no motor moves against ten times what drives it. A time constant
        below a fifth of a sample time shows in no sample, and would take many steps of the integration.
        """
        largest = 10 * max(float(np.abs(record.u).max()) for record in data)
        base = FirstOrder((GAIN, TIME_CONSTANT, DELAY))
        (_, _, earliest), (_, _, latest) = base.bounds(data)
        shortest = 0.2 * max(record.sample_time for record in data)
        top = max(float(np.abs(smooth_speed(record)).max()) for record in data) or 1.0
        nearest = {TIME_CONSTANT: shortest, DELAY: float(earliest), STRIBECK_SPEED: _SLOWEST * top}
        nearest |= {SINE: -largest, COSINE: -largest}
        farthest = {
            DELAY: float(latest),
            STRIBECK_SPEED: _FASTEST * top,
            **dict.fromkeys((SINE, COSINE, STRIBECK), largest),
        }
        return (
            np.array([nearest.get(p, p.lower) for p in self.parameters]),
            np.array([farthest.get(p, p.upper) for p in self.parameters]),
        )

    def guesses(self, data: Sequence[Dataset]) -> tuple[Array, ...]:
        """Return guesses from least squares with friction and gravity taken from the measured motion: see `nonlinear.guesses`.

        Raises `NotIdentifiable` where the data have no angle and the structure has gravity.
        """
        from servobench.identification.models.nonlinear.guesses import guesses_from_motion

        return guesses_from_motion(self, data)

    @property
    def held_at_first(self) -> NDArray[np.bool_]:
        """The parameters that multiply others, whose guesses are poor until those are right, (P,)."""
        return np.array([parameter in (STRIBECK_SPEED, LOAD) for parameter in self.parameters])

    def move(self, theta: Array, change: Array) -> Array:
        """Return where a change leads from theta, both (P + ΣQ,): theta + change, but for the stribeck_voltage.

        A fast reversal determines u_s ω_s, the area below the Stribeck curve, and hardly the two factors.
        So it is the area that a change moves to first order: u_s becomes (u_s ω_s + ω_s δu_s + u_s δω_s)/(ω_s + δω_s). A u_s that
        doesn't change is held.
        """
        reached = theta + change
        if not self.stribeck:
            return reached
        u, speed = self.parameters.index(STRIBECK), self.parameters.index(STRIBECK_SPEED)
        if change[u] != 0.0:
            area = theta[u] * theta[speed] + theta[speed] * change[u] + theta[u] * change[speed]
            reached[u] = area / reached[speed]
        return reached

    def predict(self, theta: Array, data: Dataset) -> Prediction:
        """Return the prediction through the data's chain, and its exact Jacobian, for theta (P + Q,)."""
        kind = data.kind if is_plain(data) else data.shaft_kind
        (angle, speed), jacobian = self.response(theta, data, kind, data.t_output)
        start = len(self.parameters) + (2 if data.kind == "position" else 1)
        prediction = through_chain(speed if kind == "speed" else angle, jacobian, theta[start:], data)
        # An integration of its own for the same speed would take as long as this one.
        return replace(prediction, sliding=partial(self._where_it_slides, speed, theta, data))

    def simulate(self, theta: Array, data: Dataset, u: Array) -> Array:
        """Return the prediction (M,) alone, through the data's chain, for theta (P + Q,) and an input u (N,) at its times."""
        driven = data if u is data.u else replace(data, u=u, reference=None)
        kind = data.kind if is_plain(data) else data.shaft_kind
        (angle, speed), none = self.response(theta, driven, kind, data.t_output, derivatives=False)
        start = len(self.parameters) + (2 if data.kind == "position" else 1)
        return through_chain(speed if kind == "speed" else angle, none, theta[start:], data).y

    def vector(self, theta: Array, data: Dataset) -> Array:
        """Return the kernel's vector for theta (P + Q,), the device's own delay included."""
        from servobench.identification.models.nonlinear import kernels

        p = np.zeros(kernels.COLUMNS)
        count = len(self.parameters)
        p[: len(self.mixing)] = self.mixing @ theta[:count]
        p[kernels.DELAY] += data.delay
        p[kernels.STRIBECK_SPEED] = p[kernels.STRIBECK_SPEED] or 1.0
        start = theta[count : count + (2 if data.kind == "position" else 1)]
        p[kernels.COLUMNS - len(start) :] = start
        return p

    def response(
        self, theta: Array, data: Dataset, kind: Kind, times: Array, derivatives: bool = True
    ) -> tuple[Array, Array]:
        """Return position and speed (2, M) at times, before any chain, and the derivatives (M, P + start state) of a kind."""
        from servobench.identification.models.nonlinear import kernels

        own = [kernels.POSITION, kernels.SPEED] if data.kind == "position" else [kernels.SPEED]
        used = np.flatnonzero(self.mixing.any(axis=1))
        columns: NDArray[np.int64] = np.append(used, own) if derivatives else np.empty(0, dtype=np.int64)
        both, raw = np.empty((2, len(times))), np.empty((len(times), len(columns)))
        kernels.response(
            data.t_input,
            data.u,
            data.input_before,
            times,
            self.vector(theta, data),
            self.friction,
            self.stribeck,
            self.gravity,
            kind == "speed",
            columns,
            both,
            raw,
        )
        if not derivatives:
            return both, raw
        with np.errstate(
            invalid="ignore"
        ):  # a trial that runs away has sensitivities without end; its cost refuses it
            mixed = raw[:, : len(used)] @ self.mixing[used]
        return both, np.hstack([mixed, raw[:, len(used) :]])

    def sliding(self, theta: Array, data: Dataset) -> Sliding:
        """Return where the model's shaft stops and turns back, which matters only with friction, for theta (P + Q,)."""
        return self._where_it_slides(self.speed(theta, data), theta, data)

    def _where_it_slides(self, speed: Array, theta: Array, data: Dataset) -> Sliding:
        """The same for a speed (M,) that is known already."""
        if not self.friction:
            return Sliding.all_through(data.t_output)
        gain, tau, _, coulomb, _, stribeck = self.vector(theta, data)[:6]
        return Sliding.of_speed(speed, data.t_output, 2 * gain * (coulomb + stribeck) / tau)

    def speed(self, theta: Array, data: Dataset) -> Array:
        """Return the shaft's speed (M,) at the samples, for theta (P + Q,)."""
        (_, speed), _ = self.response(theta, data, "speed", data.t_output, derivatives=False)
        return np.asarray(speed, dtype=np.float64)

    def unmodelled(self, theta: Array, data: Dataset) -> Array:
        """Return nothing, (M, 0): what a lag in place of the delay does is a line of the budget (`uncertainty.one_lag`)."""
        return np.empty((len(data.y), 0))

    def transfer_function(self, theta: Array, output: Output, data: Dataset) -> TransferFunction:
        """Return K e^(-ds) / (τ s + 1), or that over s: of the motor alone, without gravity and friction."""
        value = dict(zip(self.parameters, theta, strict=True))
        linear = FirstOrder((GAIN, TIME_CONSTANT, DELAY))
        return linear.transfer_function(np.array([value[p] for p in linear.parameters]), output, data)
