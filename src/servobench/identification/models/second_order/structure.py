"""The second-order motor with an integrator: a first-order one whose torque follows the input with the lag of the winding.

    ω/u = K e^(-ds) / ((τ s + 1) (τ₂ s + 1)),   τ₂ = τ τ_e / (τ - τ_e),   dθ/dt = ω

`electrical_time_constant` is τ_e = L/R, with which the current settles while the shaft is held. These laws follow from L di/dt
+ R i = v - k ω and J dω/dt = k i - b ω. Back-emf makes the fast pole's time constant τ₂ a little longer: p(s) = J L s² + (J R +
L b) s + R b + k² has the roots -1/τ and -1/τ₂, so that without viscous friction in the bearings τ_e = τ τ₂/(τ + τ₂) exactly; b
leaves K, τ and τ₂ as they are and makes L/R larger than τ_e, by a part R b/(R b + k²) τ₂/τ of it at most. Coulomb friction
brakes the shaft at once, not through the winding:

    (τ + τ₂) dω/dt = K (e - u_c sgn(ω)),   τ_e de/dt = u(t - d) - u₀ - e - ω/K,   e = R i
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

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
from servobench.identification.models.first_order import FirstOrder
from servobench.identification.models.records import start_parameters, through_chain
from servobench.identification.models.turning import Sliding
from servobench.recordings.measurement.base import Kind
from servobench.recordings.measurement.dataset import Dataset
from servobench.systems.transfer_function import TransferFunction

ELECTRICAL = Parameter(
    name="electrical_time_constant",
    meaning="time in which the current covers 63.2 % of a step while the shaft is held, L/R",
    unit="s",
    lower=0.0,
)

# Of τ: the electrical time constant at which both poles meet is half of it; beyond it they would be complex.
_LARGEST_PART = 0.499
# Parts of what a first-order fit calls delay, the device's own not counted, that a guess takes for the winding's lag.
_PARTS = (0.9, 0.3)


@dataclass(frozen=True)
class SecondOrder:
    """A motor with a winding and an integrator, and those of its parameters that are to be found.

    `first` is the structure without the winding's lag; guesses begin from its own.
    """

    parameters: tuple[Parameter, ...]
    first: FirstOrder

    @cached_property
    def friction(self) -> bool:
        """Whether Coulomb friction acts, with rest and reversals."""
        return COULOMB in self.parameters

    def nuisance(self, data: Dataset) -> tuple[Parameter, ...]:
        """Return the nuisance parameters of a record: where and how fast it starts, and the unknown states of its filters.

        The current at the first sample is what the input before makes of it.
        """
        return start_parameters(data)

    def bounds(self, data: Sequence[Dataset]) -> tuple[Array, Array]:
        """Return the bounds of the parameters; those of the first-order structure, and a thousandth of a sample time for τ_e."""
        lower, upper = self.first.bounds(data)
        at = self._place(ELECTRICAL)
        least = 1e-3 * min(record.sample_time for record in data)
        return np.insert(lower, at, least), np.insert(upper, at, np.inf)

    def guesses(self, data: Sequence[Dataset]) -> tuple[Array, ...]:
        """Return the guesses of the first-order structure, each with its delay shared out between a delay and τ_e.

        A delay near zero gives a τ_e of a tenth of a sample time. Raises `NotIdentifiable` as that structure does.
        """
        step = min(record.sample_time for record in data)
        at, delay = self._place(ELECTRICAL), self.first.parameters.index(DELAY)
        tau = self.first.parameters.index(TIME_CONSTANT)
        guesses = []
        for guess in self.first.guesses(data):
            for part in _PARTS:
                lag = min(max(part * guess[delay], 0.1 * step), 0.2 * guess[tau])
                shared = guess.copy()
                shared[delay] = max(guess[delay] - lag, 0.05 * step)
                guesses.append(np.insert(shared, at, lag))
        return tuple(guesses)

    def predict(self, theta: Array, data: Dataset) -> Prediction:
        """Return the prediction through the data's chain, and its exact Jacobian, for theta (P + Q,).

        It is NaN where τ_e is nearly half of τ or more: such a motor swings, and has no two real poles.
        """
        kind = data.shaft_kind if data.chain else data.kind
        own = 2 if data.kind == "position" else 1
        y, jacobian = self.response(theta, data, kind, own)
        return through_chain(y, jacobian, theta[len(self.parameters) + own :], data)

    def response(self, theta: Array, data: Dataset, kind: Kind, own: int) -> tuple[Array, Array]:
        """Return the position or the speed at the samples (M,), before any chain, and its derivatives (M, P + own).

        `own` is 2 where theta has a start position and a start speed after the parameters, 1 where it has the speed alone.
        """
        value = self._by_name(theta)
        if not self.is_overdamped(theta):
            nothing = np.full(len(data.t_output), np.nan)
            return nothing, np.full((len(nothing), len(self.parameters) + own), np.nan)
        start = theta[len(self.parameters) : len(self.parameters) + own]
        volts, slopes = self._in_volts(value, float(start[-1]), data, kind)
        position = float(start[0]) if own == 2 and kind == "position" else 0.0
        return position + value["gain"] * volts, self._derivatives(value, start, volts, slopes, kind)

    def _in_volts(
        self, value: dict[str, float], speed: float, data: Dataset, kind: Kind
    ) -> tuple[Array, Array]:
        """ψ or y of the kernel at the samples (M,), and its derivatives by all that it knows (M, 6)."""
        from servobench.identification.models.second_order import kernels

        p = np.empty(kernels.COLUMNS)
        p[kernels.TAU], p[kernels.FAST] = value["time_constant"], fast_time_constant(value)
        p[kernels.OFFSET], p[kernels.COULOMB] = value["offset_voltage"], value["coulomb_voltage"]
        p[kernels.DELAY], p[kernels.SPEED] = value["delay"] + data.delay, speed / value["gain"]
        out, slopes = np.empty(len(data.t_output)), np.empty((len(data.t_output), kernels.COLUMNS))
        t, u, before = data.t_input, data.u, data.input_before
        friction, speed_out = float(self.friction), 1.0 if kind == "speed" else 0.0
        columns = np.arange(kernels.COLUMNS)
        kernels.response(t, u, before, data.t_output, p, friction, speed_out, columns, out, slopes)
        return out, slopes

    def _derivatives(
        self, value: dict[str, float], start: Array, volts: Array, slopes: Array, kind: Kind
    ) -> Array:
        """The derivatives by the parameters and the start state (M, P + own), from those of the kernel."""
        from servobench.identification.models.second_order import kernels

        gain, tau, lag = value["gain"], value["time_constant"], value["electrical_time_constant"]
        speed, fast = float(start[-1]), slopes[:, kernels.FAST]
        by_name = {
            "gain": volts - speed / gain * slopes[:, kernels.SPEED],
            "time_constant": gain * (slopes[:, kernels.TAU] - (lag / (tau - lag)) ** 2 * fast),
            "electrical_time_constant": gain * (tau / (tau - lag)) ** 2 * fast,
            "offset_voltage": gain * slopes[:, kernels.OFFSET],
            "coulomb_voltage": gain * slopes[:, kernels.COULOMB],
            "delay": gain * slopes[:, kernels.DELAY],
        }
        columns = [by_name["offset_voltage" if p is ONE_WAY else p.name] for p in self.parameters]
        if len(start) == 2:
            columns.append(np.full(len(volts), 1.0 if kind == "position" else 0.0))
        return np.column_stack([*columns, slopes[:, kernels.SPEED]])

    def sliding(self, theta: Array, data: Dataset) -> Sliding:
        """Return where the model's shaft stops and turns back, which matters only with friction, for theta (P + Q,)."""
        if not self.friction:
            return Sliding.all_through(data.t_output)
        own = 2 if data.kind == "position" else 1
        value, speed = self._by_name(theta), self.response(theta, data, "speed", own)[0]
        change = 2 * value["gain"] * value["coulomb_voltage"] / value["time_constant"]
        return Sliding.of_speed(speed, data.t_output, change)

    def unmodelled(self, theta: Array, data: Dataset) -> Array:
        """Return nothing, (M, 0): what the winding does near a reversal is in the model."""
        return np.empty((len(data.y), 0))

    def transfer_function(self, theta: Array, output: Output, data: Dataset) -> TransferFunction:
        """Return K e^(-ds) / ((τ s + 1) (τ₂ s + 1)), or that over s for the position."""
        value = self._by_name(theta)
        tau, fast = value["time_constant"], fast_time_constant(value)
        lags = (tau * fast, tau + fast, 1.0)
        unit = data.gain_unit
        return TransferFunction(
            numerator=(value["gain"],),
            denominator=lags if output == "speed" else (*lags, 0.0),
            delay=value["delay"],
            output=output,
            unit=unit if output == "speed" else f"{data.position_unit}/{data.input_unit}",
        )

    def is_overdamped(self, theta: Array) -> bool:
        """Return whether the poles are real and lie apart, for theta (P or more,)."""
        value = self._by_name(theta)
        return bool(0 < value["electrical_time_constant"] < _LARGEST_PART * value["time_constant"])

    def _by_name(self, theta: Array) -> dict[str, float]:
        """The values by name; what turning one way calls Coulomb voltage acts as an offset."""
        value = {"offset_voltage": 0.0, "coulomb_voltage": 0.0}
        for parameter, x in zip(self.parameters, theta, strict=False):
            value["offset_voltage" if parameter is ONE_WAY else parameter.name] = float(x)
        return value

    def _place(self, parameter: Parameter) -> int:
        return self.parameters.index(parameter)


def fast_time_constant(value: dict[str, float]) -> float:
    """Return τ₂ [s], that of the fast pole, from the `time_constant` and the `electrical_time_constant`."""
    tau, lag = value["time_constant"], value["electrical_time_constant"]
    return tau * lag / (tau - lag)


def _with_winding(first: FirstOrder) -> SecondOrder:
    gain, tau, *rest = first.parameters
    return SecondOrder((gain, tau, ELECTRICAL, *rest), first)


STRUCTURES.member("second_order")(_with_winding(FirstOrder((GAIN, TIME_CONSTANT, OFFSET, DELAY))))
STRUCTURES.member("second_order_one_way")(_with_winding(FirstOrder((GAIN, TIME_CONSTANT, ONE_WAY, DELAY))))
STRUCTURES.member("second_order_coulomb")(
    _with_winding(FirstOrder((GAIN, TIME_CONSTANT, COULOMB, OFFSET, DELAY)))
)
