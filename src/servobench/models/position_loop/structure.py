"""A servo that is driven by a goal: a motor with friction in a loop with a proportional controller of its position.

    u = k_p (g(t - d) - θ),   τ dω/dt = -ω + K (u - u₀ - u_c sgn(ω)),   dθ/dt = ω

Goal and position tell the loop gain κ = K k_p, τ, and friction and offset as positions, δ = u_c/k_p and u₀/k_p:

    θ/g = κ e^(-ds) / (τ s² + s + κ)

That follows from the two lines above, friction and offset left out. δ is the dead band within which the shaft rests off its
goal. K, u_c and u₀ follow where k_p is known. A controller with more than a proportional part, a limit of its voltage and a
load that gravity pulls at aren't in the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from servobench.channels import Array
from servobench.measurement.base import Kind
from servobench.measurement.dataset import Dataset
from servobench.models.base import STRUCTURES, Output, Parameter, Prediction
from servobench.models.first_order import DELAY, TIME_CONSTANT
from servobench.models.records import START_POSITION, START_SPEED, filter_parameters, through_chain
from servobench.transfer_function import TransferFunction

LOOP_GAIN = Parameter(
    name="loop_gain",
    meaning="speed for each unit that the goal lies ahead",
    unit="{position}/(s·{input})",
    lower=0.0,
)
DEAD_BAND = Parameter(
    name="dead_band_position",
    meaning="distance from the goal at which friction holds the shaft",
    unit="{input}",
    lower=0.0,
)
GOAL_OFFSET = Parameter(
    name="offset_position", meaning="distance from the goal at which the motor gets no torque", unit="{input}"
)

_MOST_RESTS = 400  # more than these come as a sample of them, scaled

_COLUMN = {"loop_gain": 0, "time_constant": 1, "offset_position": 2, "dead_band_position": 3, "delay": 4}


@dataclass(frozen=True)
class PositionLoop:
    """A motor in its own position loop, and those of its parameters that are to be found."""

    parameters: tuple[Parameter, ...]

    @cached_property
    def friction(self) -> bool:
        """Whether Coulomb friction acts, with rest and reversals."""
        return DEAD_BAND in self.parameters

    def nuisance(self, data: Dataset) -> tuple[Parameter, ...]:
        """Return the nuisance parameters of a record: where and how fast it starts, and the unknown states of its filters.

        The loop acts on the position, so a record of the speed has an unknown start position as well.
        """
        return (START_POSITION, START_SPEED, *filter_parameters(data))

    def bounds(self, data: Sequence[Dataset]) -> tuple[Array, Array]:
        """Return the bounds of the parameters; those of delay and time constant are told in `FirstOrder.bounds`."""
        step = max(record.sample_time for record in data)
        nearest = {"delay": -2 * step, "time_constant": 0.01 * step, "loop_gain": 1e-6 / step}
        lower = [nearest.get(parameter.name, parameter.lower) for parameter in self.parameters]
        return np.array(lower), np.array([parameter.upper for parameter in self.parameters])

    def guesses(self, data: Sequence[Dataset]) -> tuple[Array, ...]:
        """Return guesses from a search over κ, τ and d: see `models.position_loop.search`."""
        from servobench.models.position_loop.search import loop_guesses

        return loop_guesses(self, data)

    def predict(self, theta: Array, data: Dataset) -> Prediction:
        """Return the prediction through the data's chain, and its exact Jacobian, for theta (P + Q,).

        It is NaN for a loop that rings faster than half of the sample rate: such data don't show it, and it would stop and turn
        round more often than there are samples.
        """
        kind = data.shaft_kind if data.chain else data.kind
        if self._rings(theta) > np.pi / data.sample_time:
            y = np.full(len(data.t_output), np.nan)
            jacobian = np.full((len(y), len(self.parameters) + 2), np.nan)
        else:
            y, jacobian = self.response(theta, data, kind)
        return through_chain(y, jacobian, theta[len(self.parameters) + 2 :], data)

    def response(self, theta: Array, data: Dataset, kind: Kind) -> tuple[Array, Array]:
        """Return the position or the speed at the samples (M,), before any chain, and its derivatives (M, P + 2)."""
        from servobench.models.position_loop import kernels

        count = len(self.parameters)
        columns = np.array([*(_COLUMN[parameter.name] for parameter in self.parameters), 5, 6])
        p = np.zeros(kernels.COLUMNS)
        p[columns] = theta[: count + 2]
        p[kernels.DELAY] += data.delay
        y, jacobian = np.empty(len(data.t_output)), np.empty((len(data.t_output), count + 2))
        t, u, before = data.t_input, data.u, data.input_before
        friction, speed_out = float(self.friction), 1.0 if kind == "speed" else 0.0
        kernels.response(t, u, before, data.t_output, p, friction, speed_out, columns, y, jacobian)
        return y, jacobian

    def _rings(self, theta: Array) -> float:
        """The frequency at which the loop rings [rad/s], 0 where it doesn't."""
        loop, tau = float(theta[0]), float(theta[1])
        return float(np.sqrt(max(loop / tau - 0.25 / tau**2, 0.0)))

    def sliding(self, theta: Array, data: Dataset) -> Array:
        """Return 1 where the model's shaft slides and 0 where it sticks, which it does only with friction."""
        if not self.friction:
            return np.ones(len(data.y))
        return np.asarray(self.response(theta, data, "speed")[0] != 0, dtype=np.float64)

    def unmodelled(self, theta: Array, data: Dataset) -> Array:
        """Return the encoder's rounding at each rest of the shaft, as columns (M, E).

        A shaft at rest is rounded the same way in all its samples, so that a rest tells its position once, not a hundred times:
        to within step/√12, as its place between two steps is as good as random.
        """
        if not data.quantum or data.kind != "position" or not self.friction:
            return np.empty((len(data.y), 0))
        still = self.sliding(theta, data) == 0
        number = np.cumsum(np.diff(still, prepend=False) & still)
        rests = np.arange(1, int(number.max(initial=0)) + 1)
        chosen = rests[:: max(1, -(-len(rests) // _MOST_RESTS))]
        one = (still[:, None] & (number[:, None] == chosen)) * (data.quantum / np.sqrt(12.0))
        return np.asarray(one * np.sqrt(len(rests) / max(len(chosen), 1)), dtype=np.float64)

    def transfer_function(self, theta: Array, output: Output, data: Dataset) -> TransferFunction:
        """Return κ e^(-ds) / (τ s² + s + κ) from the goal to the position, or that times s for the speed."""
        value = dict(zip((parameter.name for parameter in self.parameters), theta, strict=True))
        loop, tau = float(value["loop_gain"]), float(value["time_constant"])
        speed = output == "speed"
        unit = data.gain_unit
        return TransferFunction(
            numerator=(loop, 0.0) if speed else (loop,),
            denominator=(tau, 1.0, loop),
            delay=float(value["delay"]),
            output=output,
            unit=unit if speed else f"{data.position_unit}/{data.input_unit}",
        )


STRUCTURES.member("position_loop")(PositionLoop((LOOP_GAIN, TIME_CONSTANT, GOAL_OFFSET, DELAY)))
STRUCTURES.member("position_loop_coulomb")(
    PositionLoop((LOOP_GAIN, TIME_CONSTANT, DEAD_BAND, GOAL_OFFSET, DELAY))
)
