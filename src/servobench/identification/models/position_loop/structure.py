"""A servo with a goal: a motor with friction in a loop with a proportional position controller.

    u = k_p (g(t - d) - θ),   τ dω/dt = -ω + K (u - u₀ - u_c sgn(ω)),   dθ/dt = ω

Goal and position determine the loop gain κ = K k_p, τ, and friction and offset as positions, δ = u_c/k_p and u₀/k_p:

    θ/g = κ e^(-ds) / (τ s² + s + κ)

That follows from the two lines above, friction and offset left out. δ is the dead band within which the shaft rests off its
goal. K, u_c and u₀ follow if k_p is known. The model has no integral or derivative part, no voltage limit, and no load under
gravity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.identification.models.base import STRUCTURES, Output, Parameter, Prediction
from servobench.identification.models.common_parameters import DELAY, TIME_CONSTANT
from servobench.identification.models.records import (
    START_POSITION,
    START_SPEED,
    filter_parameters,
    through_chain,
)
from servobench.identification.models.turning import Sliding
from servobench.recordings.measurement.base import Chain, Kind
from servobench.recordings.measurement.dataset import Dataset
from servobench.systems.transfer_function import TransferFunction

LOOP_GAIN = Parameter(
    name="loop_gain",
    meaning="speed per unit of distance to the target",
    unit="{position}/(s·{input})",
    lower=0.0,
)
DEAD_BAND = Parameter(
    name="dead_band_position",
    meaning="distance from the target at which friction holds the shaft",
    unit="{input}",
    lower=0.0,
)
GOAL_OFFSET = Parameter(
    name="offset_position",
    meaning="distance from the target at which the motor produces no torque",
    unit="{input}",
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
        """Return the bounds of the parameters; those of delay and time constant are explained in `FirstOrder.bounds`."""
        step = max(record.sample_time for record in data)
        nearest = {"delay": -2 * step, "time_constant": 0.01 * step, "loop_gain": 1e-6 / step}
        lower = [nearest.get(parameter.name, parameter.lower) for parameter in self.parameters]
        return np.array(lower), np.array([parameter.upper for parameter in self.parameters])

    def guesses(self, data: Sequence[Dataset]) -> tuple[Array, ...]:
        """Return guesses from a search over κ, τ and d: see `models.position_loop.search`."""

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
        from servobench.identification.models.position_loop import kernels

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

    def sliding(self, theta: Array, data: Dataset) -> Sliding:
        """Return where the model's shaft stops and turns back, which matters only with friction, for theta (P + Q,)."""
        if not self.friction:
            return Sliding.all_through(data.t_output)
        loop_gain, tau, dead_band = theta[:3]
        change = 2 * loop_gain * dead_band / tau
        return Sliding.of_speed(self.response(theta, data, "speed")[0], data.t_output, change)

    def unmodelled(self, theta: Array, data: Dataset) -> Array:
        """Return the encoder's rounding at each rest of the shaft, as columns (M, E).

        A shaft at rest is rounded in the same way in all samples, so a rest gives its position once, not a hundred times:
        to within step/√12, as its place between two steps is as good as random.
        """
        if not data.quantum or data.kind != "position" or not self.friction:
            return np.empty((len(data.y), 0))
        still = self.sliding(theta, data).left == 0
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


_ROWS = 240  # samples of a record; a guess needs no more


_FREQUENCIES = 18  # natural ones, from two turns of the phase in the record up to half of the sample rate


_DAMPING = np.array([0.15, 0.35, 0.7, 1.2, 2.5, 6.0])


_DELAYS = np.array([0.0, 2.0, 8.0])  # in sample times


_BEST = 3  # points of the grid that are worth a search each


_PARTS = (0.05, 0.5)  # of the distance from the goal at rest: dead bands to begin from


def loop_guesses(structure: PositionLoop, data: Sequence[Dataset]) -> tuple[Array, ...]:
    """Return vectors of parameters and nuisance parameters of each record, the best first.

    Raises `NotIdentifiable` where the output doesn't move or the goal never changes.
    """
    for record in data:
        _check(record)
    plain = PositionLoop((LOOP_GAIN, TIME_CONSTANT, GOAL_OFFSET, DELAY))
    few = [_decimate(record) for record in data]
    trials = sorted((_trial(plain, few, point) for point in _points(data)), key=lambda trial: trial[0])
    guesses = []
    for _, point, offset, starts in trials[:_BEST]:
        for part in _PARTS if structure.friction else (0.0,):
            known = {
                "loop_gain": point[0],
                "time_constant": point[1],
                "offset_position": offset,
                "dead_band_position": part * _rest_error(data, offset),
                "delay": point[2],
            }
            own = [
                np.append(start, np.zeros(len(structure.nuisance(record)) - 2))
                for record, start in zip(data, starts, strict=True)
            ]
            guesses.append(np.concatenate([[known[p.name] for p in structure.parameters], *own]))
    return tuple(guesses)


def _check(data: Dataset) -> None:
    if len(data.y) < 20:
        raise NotIdentifiable(
            f"{data.name}: {len(data.y)} samples of the output; at least 20 are needed: record for longer"
        )
    if np.ptp(data.y) == 0:
        raise NotIdentifiable(
            f"{data.name}: the output stays at {data.y[0]:g} {data.output_unit} throughout: the shaft was blocked, "
            "the encoder isn't connected, or it's the wrong column; record the servo while it moves"
        )
    if np.ptp(data.u) == 0 and data.input_before == data.u[0]:
        raise NotIdentifiable(
            f"{data.name}: the goal stays at {data.u[0]:g} {data.input_unit} throughout, which doesn't show how the "
            "loop follows it"
        )


def _decimate(data: Dataset) -> Dataset:
    """A part of the samples, as those of the shaft itself; a chain is left out of a guess."""
    rows = np.unique(np.linspace(0, len(data.y) - 1, _ROWS).astype(np.int64))
    return replace(
        data,
        t_output=data.t_output[rows],
        y=data.y[rows],
        declared=Chain(),
        applied=Chain(),
        current=None,
        rows=None,
    )


def _points(data: Sequence[Dataset]) -> Array:
    """κ, τ and d at the points of the grid (T, 3): ω_n² = κ/τ, damping 1/(2 √(κ τ))."""
    step, longest = min(r.sample_time for r in data), max(r.duration for r in data)
    low, high = 2 * np.pi / longest, np.pi / (2 * step)
    frequencies = low * (high / low) ** np.linspace(0.0, 1.0, _FREQUENCIES)
    grid = [
        (w / (2 * z), 1.0 / (2 * z * w), d * step) for w in frequencies for z in _DAMPING for d in _DELAYS
    ]
    return np.array(grid)


def _trial(
    structure: PositionLoop, data: Sequence[Dataset], point: Array
) -> tuple[float, Array, float, list[Array]]:
    """The cost at a point of the grid, the point, and the offset and the start states that are best there."""
    theta = np.array([point[0], point[1], 0.0, point[2] + 0.1 * data[0].sample_time, 0.0, 0.0])
    width = 1 + 2 * len(data)
    blocks, rests = [], []
    for n, record in enumerate(data):
        response, jacobian = structure.response(theta, record, record.kind)
        block = np.zeros((len(record.y), width))
        block[:, 0] = jacobian[:, 2]
        block[:, 1 + 2 * n : 3 + 2 * n] = jacobian[:, 4:6]
        blocks.append(block)
        rests.append(record.y - response)
    a, y = np.vstack(blocks), np.concatenate(rests)
    best = np.linalg.lstsq(a, y, rcond=1e-10)[0]
    left = y - a @ best
    starts = [np.asarray(best[1 + 2 * n : 3 + 2 * n], dtype=np.float64) for n in range(len(data))]
    return float(left @ left), point, float(best[0]), starts


def _rest_error(data: Sequence[Dataset], offset: float) -> float:
    """The distance from the goal at rest: its median over the slowest tenth of the samples."""
    errors = []
    for record in data:
        if record.kind != "position":
            continue
        held = np.maximum(np.searchsorted(record.t_input, record.t_output, side="left") - 1, 0)
        still = np.abs(np.gradient(record.y, record.t_output))
        slow = still <= np.quantile(still, 0.1)
        errors.append(np.abs(record.u[held] - offset - record.y)[slow])
    return float(np.median(np.concatenate(errors))) if errors else 0.01 * float(np.ptp(data[0].u))
