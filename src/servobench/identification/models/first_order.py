"""The first-order motor with an integrator: gain, time constant, delay and the lost voltage.

    τ dω/dt = -ω + K (u(t - d) - u₀ - u_c sgn(ω)),   dθ/dt = ω

They follow from J dω/dt = k i - b ω - T_c sgn(ω) and R i = u(t - d) - u₀ - k ω: K = k/(R b + k²),
τ = R J/(R b + k²), u_c = R T_c/k. Four members share these equations. They differ in the lost voltages that they have: the
offset u₀, which doesn't depend on the direction, and the Coulomb voltage u_c, which always brakes. If the motor only turns one
way, the two can't be separated: one voltage stands for their sum, and holds the shaft during rests.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.identification.models.base import STRUCTURES, Output, Parameter, Prediction
from servobench.identification.models.common_parameters import (
    COULOMB,
    DELAY,
    GAIN,
    OFFSET,
    ONE_WAY,
    TIME_CONSTANT,
)
from servobench.identification.models.first_motion import latest_delay
from servobench.identification.models.records import (
    START_SPEED,
    beside_rest,
    is_plain,
    start_parameters,
    through_chain,
)
from servobench.identification.models.steady import longest_time_constant
from servobench.identification.models.turning import Sliding
from servobench.recordings.measurement.base import Kind
from servobench.recordings.measurement.dataset import Dataset
from servobench.systems.transfer_function import TransferFunction

_SOME_FRICTION = 0.1  # of the largest input
_NEARLY_ALL = 0.9  # of the largest input
_SLOWEST = 0.2  # of 1/τ: to where one step may lower it
# The place of each parameter in the kernel's vector (K, τ, u₀, u_c, d).
_COLUMN = {"gain": 0, "time_constant": 1, "offset_voltage": 2, "coulomb_voltage": 3, "delay": 4}


@dataclass(frozen=True)
class FirstOrder:
    """A first-order motor with an integrator, and those of its parameters that are to be found."""

    parameters: tuple[Parameter, ...]

    @cached_property
    def friction(self) -> bool:
        """Whether Coulomb friction acts, with rest and reversals."""
        return COULOMB in self.parameters

    @cached_property
    def columns(self) -> NDArray[np.int64]:
        """The indices of the parameters in the kernel's vector (K, τ, u₀, u_c, d)."""
        return np.array([2 if p is ONE_WAY else _COLUMN[p.name] for p in self.parameters])

    @cached_property
    def columns_with_start(self) -> dict[Kind, NDArray[np.int64]]:
        """The same with the start state (θ₀, ω₀) of a record of that kind."""
        return {"position": np.append(self.columns, [5, 6]), "speed": np.append(self.columns, 6)}

    @cached_property
    def linear_columns(self) -> NDArray[np.int64]:
        """The indices of those parameters in which the output is linear for a known direction of motion: (S,), ascending."""
        from servobench.identification.models import kernels

        linear = (kernels.GAIN, kernels.OFFSET, kernels.COULOMB)
        return np.array(sorted(c for c in self.columns.tolist() if c in linear))

    def nuisance(self, data: Dataset) -> tuple[Parameter, ...]:
        """Return the nuisance parameters of a record: where and how fast it starts, and the unknown states of its filters."""
        return start_parameters(data)

    def bounds(self, data: Sequence[Dataset]) -> tuple[Array, Array]:
        """Return the bounds of the parameters: the output comes at most two sample times before its cause.

        Nor can it come later than it does: the first motion bounds the delay from above (`models.first_motion`).
        Two channels that are latched one after the other may be out of step by that much, of the one that is sampled more
        often; anything more would be a wrong model, because slow data can't separate a negative delay from a longer time
        constant. In a closed loop it is half of one: earlier, the input that answers to a sample would be what causes it. A
        time constant below a hundredth of a sample time can't be distinguished from zero, and a speed that settles bounds it from
        above (`models.steady`).
        """
        step = max(record.sample_time for record in data)
        latch = max(min(record.sample_time, record.input_step) for record in data)
        early = 0.5 if any(record.closed_loop for record in data) else 2.0
        nearest = {"delay": -early * latch, "time_constant": 0.01 * step}
        lower = [nearest.get(parameter.name, parameter.lower) for parameter in self.parameters]
        farthest = {
            "delay": max(latest_delay(data), 0.1 * step),
            "time_constant": max(longest_time_constant(data), step),
        }
        upper = [farthest.get(parameter.name, parameter.upper) for parameter in self.parameters]
        return np.array(lower), np.array(upper)

    def guesses(self, data: Sequence[Dataset]) -> tuple[Array, ...]:
        """Return guesses from a search over τ and d; with friction, also one that starts at rest and one the other way.

        Where friction holds the shaft for long, one is that of an input that lacks what friction takes; where least squares makes
        all frictions negative, from which a search wouldn't come back, one has a friction that is none of theirs.
        """
        from servobench.identification.models.search import guess_with_delay, is_held, separable_guesses

        guesses = separable_guesses(self, data)
        vectors, late = [guess for _, guess in guesses], guess_with_delay(self, data, guesses[0][0])
        if not self.friction:
            return (*vectors, *late)
        if is_held(data):
            vectors += self._guess_dead_zone(data, guesses[0][0])
        # Under one level friction may be anything, and a search from nearly all of the level stays there.
        vectors, late = (
            [guess for guess in each if self._friction_share(guess, data) < _NEARLY_ALL]
            for each in (vectors, late)
        )
        if all(self._friction_share(guess, data) <= 0.0 for guess in vectors):
            vectors.append(self._guess_some_friction(data))
        return tuple(
            guess
            for moving in (*vectors, *late)
            for guess in beside_rest(moving, self._still(moving, data), self._friction_speed(moving))
        )

    def _friction_share(self, guess: Array, data: Sequence[Dataset]) -> float:
        """The friction of a guess, of the largest input; infinite where there is no input."""
        largest = max(float(np.abs(record.u).max()) for record in data)
        return float(guess[self.parameters.index(COULOMB)]) / largest if largest else np.inf

    def _guess_dead_zone(self, data: Sequence[Dataset], lowest: float) -> list[Array]:
        """Guess as if of a shaft behind a dead zone; with an offset voltage only where that costs less than `lowest`."""
        from servobench.identification.models.search import guess_behind_dead_zone

        frictionless = FirstOrder(tuple(p for p in self.parameters if p not in (COULOMB, OFFSET)))
        cost, held = guess_behind_dead_zone(frictionless, self.parameters.index(COULOMB), data)
        if OFFSET not in self.parameters:
            return [held]
        return [np.insert(held, self.parameters.index(OFFSET), 0.0)] if cost < lowest else []

    def _guess_some_friction(self, data: Sequence[Dataset]) -> Array:
        """Guess as if without friction, of which the gain is that of a motor that loses a tenth of the largest input to it."""
        from servobench.identification.models.search import separable_guesses

        frictionless = FirstOrder(tuple(p for p in self.parameters if p != COULOMB))
        guess = separable_guesses(frictionless, data)[0][1]
        lost = _SOME_FRICTION * max(float(np.abs(record.u).max()) for record in data)
        guess[0] /= 1.0 - _SOME_FRICTION
        return np.insert(guess, self.parameters.index(COULOMB), lost)

    def starts(self, theta: Array, data: Dataset) -> tuple[Array, ...]:
        """Return start vectors (P + Q,) for a search of the nuisance parameters alone, with the parameters theta (P,) held.

        Without friction the output is linear in those, so that one step leads to the minimum from anywhere. With friction one
        starts at rest and one the other way, as among the guesses.
        """
        from servobench.identification.models.motion import check_moves
        from servobench.identification.models.search import start_guess

        if self.friction:
            moving = np.concatenate([theta, start_guess(self, theta, data)])
            return tuple(beside_rest(moving, self._still(moving, [data]), self._friction_speed(moving)))
        check_moves(data, len(self.parameters))
        own = np.zeros(len(self.nuisance(data)))
        own[0] = data.y[0]
        return (np.concatenate([theta, own]),)

    def _still(self, theta: Array, data: Sequence[Dataset]) -> NDArray[np.int64]:
        """The places of the start speeds of the records in which a shaft at rest would stay at rest at first."""
        places, at = [], len(self.parameters)
        for record in data:
            own = self.nuisance(record)
            if self._sticks(theta[: len(self.parameters)], record.input_before):
                places.append(at + [parameter.name for parameter in own].index(START_SPEED.name))
            at += len(own)
        return np.array(places, dtype=np.int64)

    def _friction_speed(self, theta: Array) -> float:
        """The speed that friction takes, K u_c."""
        value = dict(zip((parameter.name for parameter in self.parameters), theta, strict=False))
        return abs(float(value["gain"] * value["coulomb_voltage"]))

    def _sticks(self, theta: Array, voltage: float) -> bool:
        """Whether a shaft at rest stays at rest with that input."""
        value = dict(zip((parameter.name for parameter in self.parameters), theta, strict=True))
        return bool(abs(voltage - value.get("offset_voltage", 0.0)) <= max(value["coulomb_voltage"], 0.0))

    def move_if_slow(self, theta: Array, change: Array, mean_input: float) -> Array:
        """Return where a change leads from theta, both (P + ΣQ,), if the input changes faster than the motor follows.

        Then the output is nearly linear in K/τ, 1/τ and the speed K (ū - u₀) under the mean input ū [input unit], so a change
        moves those to first order. u₀ is the offset, or the friction of a motor that turns one way. A change that would lower 1/τ
        to less than a fifth is shortened to a fifth. Entries that the change leaves alone, as they are held or at a bound, stay.
        """
        gain, tau = (self.parameters.index(each) for each in (GAIN, TIME_CONSTANT))
        k, rate = theta[gain], 1.0 / theta[tau]
        if change[tau] * rate > 1.0 - _SLOWEST:
            change = change * (1.0 - _SLOWEST) / (change[tau] * rate)
        slower = rate - change[tau] * rate**2
        reached = theta + change
        if k == 0.0:
            return reached
        reached[tau] = 1.0 / slower
        if change[gain] != 0.0:
            reached[gain] = (k * rate + change[gain] * rate - k * change[tau] * rate**2) / slower
        lost, sense = self._lost, math.copysign(1.0, mean_input) if self._brakes else 1.0
        if lost is not None and change[lost] != 0.0 and reached[gain] != 0.0:
            left = mean_input - sense * theta[lost]
            speed = k * left + change[gain] * left - k * sense * change[lost]
            reached[lost] = sense * (mean_input - speed / reached[gain])
        return reached

    @cached_property
    def _lost(self) -> int | None:
        """The place of the parameter that takes a constant from the input; None for a structure without one."""
        constant = [each for each in (ONE_WAY, OFFSET, COULOMB) if each in self.parameters]
        return self.parameters.index(constant[0]) if constant else None

    @cached_property
    def _brakes(self) -> bool:
        """Whether that is friction, which acts against the motion."""
        return self._lost is not None and self.parameters[self._lost] is COULOMB

    def predict(self, theta: Array, data: Dataset) -> Prediction:
        """Return the prediction through the data's chain, and its exact Jacobian, for theta (P + Q,)."""
        columns = self.columns_with_start[data.kind]
        y, jacobian = self.response(theta, data, data.kind if is_plain(data) else data.shaft_kind, columns)
        return through_chain(y, jacobian, theta[len(columns) :], data)

    def normal(self, theta: Array, data: Dataset) -> tuple[Array, Array, float] | None:
        """Return J'J, J'r and r'r for theta (P + Q,), r = y - prediction, ten times as fast as `predict`; None behind a chain."""
        from servobench.identification.models import kernels

        if not is_plain(data):
            return None
        p, columns = self.vector(theta, data), self.columns_with_start[data.kind]
        t, u, before = data.t_input, data.u, data.input_before
        friction, speed = float(self.friction), float(data.kind == "speed")
        both = kernels.normal(t, u, before, data.t_output, data.y, p, friction, speed, columns)
        return both[:-1, :-1], both[:-1, -1], float(both[-1, -1])

    def vector(self, theta: Array, data: Dataset) -> Array:
        """Return the kernel's vector (K, τ, u₀, u_c, d, θ₀, ω₀) for theta (P + Q,), the device's own delay included in d."""
        from servobench.identification.models import kernels

        p = np.zeros(kernels.COLUMNS)
        count = len(self.parameters)
        p[self.columns] = theta[:count]
        p[kernels.DELAY] += data.delay
        start = theta[count : count + (2 if data.kind == "position" else 1)]
        p[kernels.COLUMNS - len(start) :] = start
        return p

    def response(
        self, theta: Array, data: Dataset, kind: Kind, columns: NDArray[np.int64]
    ) -> tuple[Array, Array]:
        """Return the position or the speed at the samples (M,), before any chain, and its derivatives (M, C).

        `columns` (C,) are those wanted of the derivatives by (K, τ, u₀, u_c, d, θ₀, ω₀).
        """
        from servobench.identification.models import kernels

        p = self.vector(theta, data)
        y, jacobian = np.empty(len(data.t_output)), np.empty((len(data.t_output), len(columns)))
        t, u, before = data.t_input, data.u, data.input_before
        speed = 1.0 if kind == "speed" else 0.0
        kernels.response(t, u, before, data.t_output, p, float(self.friction), speed, columns, y, jacobian)
        return y, jacobian

    def simulate(self, theta: Array, data: Dataset, u: Array) -> Array:
        """Return the prediction (M,) alone, through the data's chain, for theta (P + Q,) and an input u (N,) at its times."""
        plain = is_plain(data)
        y = self._motion(theta, data, data.kind if plain else data.shaft_kind, data.t_output, u)
        if plain:
            return y
        filters = theta[len(self.columns_with_start[data.kind]) :]
        return through_chain(y, np.empty((len(y), 0)), filters, data).y

    def _motion(self, theta: Array, data: Dataset, kind: Kind, times: Array, u: Array) -> Array:
        """The position or the speed at times (M,), before any chain, for an input u (N,)."""
        from servobench.identification.models import kernels

        y, p, speed = np.empty(len(times)), self.vector(theta, data), float(kind == "speed")
        kernels.motion(data.t_input, u, data.input_before, times, p, float(self.friction), speed, y)
        return y

    def sliding(self, theta: Array, data: Dataset) -> Sliding:
        """Return where the model's shaft stops and turns back, which matters only with friction, for theta (P + Q,)."""
        if not self.friction:
            return Sliding.all_through(data.t_output)
        speed = self._motion(theta, data, "speed", data.t_output, data.u)
        change = 2 * self._friction_speed(theta) / theta[self.parameters.index(TIME_CONSTANT)]
        return Sliding.of_speed(speed, data.t_output, change)

    def unmodelled(self, theta: Array, data: Dataset) -> Array:
        """Return nothing, (M, 0): what a lag in place of the delay does is a line of the budget (`uncertainty.one_lag`)."""
        return np.empty((len(data.y), 0))

    def by_excess_friction(self, theta: Array, data: Dataset, width: float) -> Array:
        """Return the derivative of the prediction (M,) by Coulomb friction that has a volt more at rest, for theta (P + Q,).

        The excess falls to nothing at the speed `width`, in position units a second; see `models.near_rest`.
        """
        from servobench.identification.models.near_rest import by_excess_friction

        p, derivative = self.vector(theta, data), np.empty(len(data.t_output))
        kind = data.kind if is_plain(data) else data.shaft_kind
        t, u, before = data.t_input, data.u, data.input_before
        by_excess_friction(t, u, before, data.t_output, p, width, float(kind == "speed"), derivative)
        return derivative if is_plain(data) else data.chain.linear(derivative[:, None], data.t_output)[:, 0]

    def speed(self, theta: Array, data: Dataset) -> Array:
        """Return the shaft's speed (M,) at the samples, before any chain, for theta (P + Q,)."""
        return self._motion(theta, data, "speed", data.t_output, data.u)

    def transfer_function(self, theta: Array, output: Output, data: Dataset) -> TransferFunction:
        """Return K e^(-ds) / (τ s + 1), or that over s for the position."""
        value = dict(zip((parameter.name for parameter in self.parameters), theta, strict=True))
        lag = (float(value["time_constant"]), 1.0)
        speed = output == "speed"
        return TransferFunction(
            numerator=(float(value["gain"]),),
            denominator=lag if speed else (*lag, 0.0),
            delay=float(value["delay"]),
            output=output,
            unit=data.gain_unit if speed else f"{data.position_unit}/{data.input_unit}",
        )


STRUCTURES.member("first_order")(FirstOrder((GAIN, TIME_CONSTANT, OFFSET, DELAY)))
STRUCTURES.member("first_order_one_way")(FirstOrder((GAIN, TIME_CONSTANT, ONE_WAY, DELAY)))
STRUCTURES.member("first_order_one_way_rest")(FirstOrder((GAIN, TIME_CONSTANT, COULOMB, DELAY)))
STRUCTURES.member("first_order_coulomb")(FirstOrder((GAIN, TIME_CONSTANT, COULOMB, OFFSET, DELAY)))
