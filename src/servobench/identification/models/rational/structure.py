"""Rational transfer functions of any order, optionally with a known integrator and a delay.

    y = B(s)/A(s) e^(-ds) u + y₀,   A = s^n + a₁ s^(n-1) + ... + a_n,   B = b₀ s^m + ... + b_m

y is the output in the data: a position or a speed. With the known integrator, B/A is the transfer function to the speed and the
position is its integral, so records of either have the same parameters. Each record has its own start state, and its own output
y₀ at zero input. The start state adds C(s)/A(s), which follows from the differential equation A y = B u.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from servobench.core.channels import Array
from servobench.identification.models.base import STRUCTURES, Output, Parameter, Prediction
from servobench.identification.models.rational.response import Pieces, Response, hold_pieces, response
from servobench.identification.models.turning import Sliding
from servobench.recordings.measurement.dataset import Dataset
from servobench.systems.transfer_function import TransferFunction

DELAY = Parameter(name="delay", meaning="time from a change of the input to its effect", unit="s")


@dataclass(frozen=True, kw_only=True)
class OfTheOutput(Parameter):
    """A parameter in the unit of the data's output, a position or a speed, over s to a power and over `other`."""

    power: int
    other: str = ""

    def unit_in(self, data: Dataset) -> str:
        """Return the unit, spelled out for that data."""
        unit = _over("{position}", self.power + (1 if data.kind == "speed" else 0), self.other)
        return unit.format(position=data.position_unit, input=data.input_unit)


@dataclass(frozen=True)
class Rational:
    """B(s)/A(s) with A of order `order` (n) and B of order `zeros` (m < n); `integrator` and `delayed` say what else there is."""

    order: int
    zeros: int
    integrator: bool = False
    delayed: bool = False

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters a₁ to a_n, b₀ to b_m, and the delay where there is one."""
        return _parameters(self)

    @property
    def friction(self) -> bool:
        """Nothing sticks."""
        return False

    def nuisance(self, data: Dataset) -> tuple[Parameter, ...]:
        """Return the nuisance parameters of a record: its start state, its output at no input, unknown states of its filters.

        The start state is C = c₁ s^(N-1) + ... + c_N; c₁ is the output at the first sample, less that at no input.
        """
        start = tuple(
            OfTheOutput(
                name=f"start_{k}",
                meaning=f"c{k} of the start state",
                unit=_over("{output}", k - 1),
                power=k - 1,
            )
            for k in range(1, self.start_order(data) + 1)
        )
        rest = Parameter(
            name="output_at_no_input",
            meaning="steady speed at zero input" if self.integrator else "steady output at zero input",
            unit="{position}/s" if self.integrator or data.kind == "speed" else "{position}",
        )
        filters = tuple(
            Parameter(
                name=f"start_state_{n}",
                meaning=f"state of '{state.stage}' at the first sample",
                unit="{position}" if state.kind == "position" else "{position}/s",
            )
            for n, state in enumerate(data.start_states, start=1)
        )
        return (*start, rest, *filters)

    def integrates(self, data: Dataset) -> bool:
        """Return whether what enters the chain is the integral of B/A."""
        return data.shaft_kind == "position" and (self.integrator or data.kind == "speed")

    def start_order(self, data: Dataset) -> int:
        """Return the number N of start states; the angle from which a speed was differenced isn't one."""
        return self.order + (1 if self.integrates(data) and data.kind == "position" else 0)

    def bounds(self, data: Sequence[Dataset]) -> tuple[Array, Array]:
        """Return the bounds of the parameters: no a is negative, as none is where all poles are stable.

        The output comes at most two sample times before its cause, for the reason given in `FirstOrder.bounds`.
        """
        lower = np.array([parameter.lower for parameter in self.parameters])
        upper = np.array([parameter.upper for parameter in self.parameters])
        if self.delayed:
            lower[-1] = -2 * max(record.sample_time for record in data)
        return lower, upper

    def guesses(self, data: Sequence[Dataset]) -> tuple[Array, ...]:
        """Return the guess of refined instrumental variables: see `models.rational.refined`."""
        from servobench.identification.models.rational.guesses import best_guesses

        return best_guesses(self, data)

    def predict(self, theta: Array, data: Dataset) -> Prediction:
        """Return the prediction through the data's chain, and its exact Jacobian, for theta (P + Q,)."""
        lines = self.lines(theta, data)
        through = data.chain.linear
        shaft = self._columns(theta, data, lines)
        passed = through(np.column_stack([self._output(theta, data, shaft), shaft]), data.t_output)
        filters = data.start_responses
        own = theta[len(self.parameters) + self.start_order(data) + 1 :]
        return Prediction(
            y=passed[:, 0] + filters @ own, jacobian=np.hstack([passed[:, 1:], filters]), valid=data.valid
        )

    def lines(self, theta: Array, data: Dataset) -> Response:
        """Return what the response of a record, before any chain, consists of; theta (P + Q,) as for `predict`."""
        extra = int(self.integrates(data))
        n, m = self.order, self.zeros
        size = n + extra
        feedback, forcing, start = np.zeros(size), np.zeros(size), np.zeros(size)
        feedback[extra:] = theta[:n][::-1]
        forcing[: m + 1] = theta[n : n + m + 1][::-1]
        count = self.start_order(data)
        start[:count] = theta[len(self.parameters) : len(self.parameters) + count][::-1]
        return response(feedback, forcing, start, self.pieces(theta, data))

    def pieces(self, theta: Array, data: Dataset) -> Pieces:
        """Return a record cut at its samples and at the changes of its input, delayed by the device and by theta (P + Q,)."""
        delay = data.delay + (float(theta[len(self.parameters) - 1]) if self.delayed else 0.0)
        return hold_pieces(data.t_input, data.u, data.input_before, data.t_output, delay)

    def rest_column(self, data: Dataset) -> Array:
        """Return what the output at no input adds to the shaft (M,): one, or the time where it is a speed that is integrated."""
        return data.t_output - data.t_output[0] if self.integrates(data) else np.ones(len(data.t_output))

    def _columns(self, theta: Array, data: Dataset, lines: Response) -> Array:
        """The derivatives of the shaft by the parameters, the start states and the output at no input, (M, P + N + 1).

        By a_i: -s^(n-i)/A of the output without the part at no input. By d: minus the slope of the forced response, of which the
        input that has acted forever is no part.
        """
        extra = int(self.integrates(data))
        n, m = self.order, self.zeros
        by_a = -lines.twice[:, extra : extra + n][:, ::-1]
        by_b = lines.forced[:, : m + 1][:, ::-1]
        by_c = lines.free[:, : self.start_order(data)][:, ::-1]
        columns = [by_a, by_b, by_c, self.rest_column(data)[:, None]]
        if self.delayed:
            rising = np.column_stack([lines.forced, lines.slope])[:, 1 : m + 2]
            before = self.pieces(theta, data).at_start
            by_d = (before * lines.free[:, : m + 1] - rising) @ theta[n : n + m + 1][::-1]
            columns.insert(2, by_d[:, None])
        return np.hstack(columns)

    def _output(self, theta: Array, data: Dataset, columns: Array) -> Array:
        """The shaft's position or speed (M,): it is linear in b, c and the output at no input."""
        linear = np.zeros(columns.shape[1])
        n, m, shared = self.order, self.zeros, len(self.parameters)
        linear[n : n + m + 1] = theta[n : n + m + 1]
        linear[shared:] = theta[shared : columns.shape[1]]
        return np.asarray(columns @ linear, dtype=np.float64)

    def sliding(self, theta: Array, data: Dataset) -> Sliding:
        """Return motion all through, whatever theta (P + Q,): nothing sticks."""
        return Sliding.all_through(data.t_output)

    def unmodelled(self, theta: Array, data: Dataset) -> Array:
        """Return no columns: the structure resolves all that it knows of."""
        return np.empty((len(data.y), 0))

    def transfer_function(self, theta: Array, output: Output, data: Dataset) -> TransferFunction:
        """Return B/A e^(-ds), times or over s where the other of position and speed is requested than B/A belongs to."""
        n, m = self.order, self.zeros
        numerator = tuple(float(b) for b in theta[n : n + m + 1])
        denominator = (1.0, *(float(a) for a in theta[:n]))
        own = "speed" if self.integrator or data.kind == "speed" else "position"
        if own == "speed" and output == "position":
            denominator = (*denominator, 0.0)
        if own == "position" and output == "speed":
            numerator = (*numerator, 0.0)
        return TransferFunction(
            numerator=numerator,
            denominator=denominator,
            delay=float(theta[n + m + 1]) if self.delayed else 0.0,
            output=output,
            unit=data.gain_unit if output == "speed" else f"{data.position_unit}/{data.input_unit}",
        )


@lru_cache(maxsize=128)
def _parameters(structure: Rational) -> tuple[Parameter, ...]:
    n, m = structure.order, structure.zeros
    a = tuple(
        Parameter(name=f"a{i}", meaning=f"coefficient of s^{n - i} in A", unit=_over("1", i), lower=0.0)
        for i in range(1, n + 1)
    )
    b = tuple(_numerator(j, n - m + j, m - j, structure.integrator) for j in range(m + 1))
    return (*a, *b, *((DELAY,) if structure.delayed else ()))


def _numerator(j: int, power: int, of: int, integrator: bool) -> Parameter:
    """The parameter b_j, which stands with s to the power `of`; its unit is the output's over s to a `power` and the input's."""
    meaning = f"coefficient of s^{of} in B"
    if integrator:
        return Parameter(name=f"b{j}", meaning=meaning, unit=_over("{position}", power + 1, "{input}"))
    unit = _over("{output}", power, "{input}")
    return OfTheOutput(name=f"b{j}", meaning=meaning, unit=unit, power=power, other="{input}")


def _over(unit: str, power: int, other: str = "") -> str:
    """A unit over a power of s, and over another unit: `{output}/(s^2·{input})`."""
    below = [part for part in ({0: "", 1: "s"}.get(power, f"s^{power}"), other) if part]
    if not below:
        return unit
    return f"{unit}/({'·'.join(below)})" if len(below) > 1 else f"{unit}/{below[0]}"


def rational(name: str) -> Rational | None:
    """Return the structure that a name such as `rational_2_1_integrator_delay` stands for, None where it stands for none.

    The two numbers are the orders n of A, without the integrator, and m of B, m < n.
    """
    match = re.fullmatch(r"rational_([1-9]\d?)_(\d\d?)(_integrator)?(_delay)?", name)
    if match is None or int(match[2]) >= int(match[1]):
        return None
    return Rational(int(match[1]), int(match[2]), bool(match[3]), bool(match[4]))


STRUCTURES.family(
    "rational_N_M[_integrator][_delay]",
    rational,
    "N is the order of the denominator (the number of poles, 1 to 99, without the integrator) and M that of the "
    "numerator (the number of zeros, 0 to N - 1)",
)
