"""Does an input look like the goal of a position loop, rather than a voltage?"""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, warning
from servobench.recordings.measurement.dataset import Dataset

_FOLLOWS = (
    0.8,
    1.2,
)  # position for each unit of the input: one, but for gravity, friction and what is still on its way
_EXPLAINED = 0.8  # of the position's variance
_QUARTER = 0.25  # of a period: what drives a motor is at least so far ahead of its position
_BESIDE = 0.1  # of its range: nearer to its mean an input is on neither side
_LAGS = np.append(0.0, 2.0 ** np.arange(0, 10))  # in sample times, up to a tenth of the record


def goal_finding(data: Dataset) -> Finding | None:
    """Return a finding where the input is in the unit of the position and the position follows it; None otherwise.

    A motor's position is the integral of what drives it, so only a loop can make it follow by less than a quarter of a period.
    """
    if data.kind != "position" or data.input_unit != data.position_unit or len(data.y) < 20:
        return None
    latest = max(min(0.1 * data.duration, _QUARTER * _period(data)), data.sample_time)
    lags = _LAGS[_LAGS * data.sample_time <= latest] * data.sample_time
    lines = [_line(_input_at(data, data.t_output - lag), data.y) for lag in lags]
    slope, explained = max(lines, key=lambda line: line[1])
    if explained < _EXPLAINED or slope <= 0:
        return None
    follows = (
        f"The position follows the input, with {slope:.2f} {data.output_unit} for each {data.input_unit}: the input "
        "looks like the target of a position loop, not like the voltage that drives the motor."
    )
    if _FOLLOWS[0] <= slope <= _FOLLOWS[1]:
        return warning(
            "input-is-a-goal",
            f"{follows} Use `structure=position_loop` or `structure=position_loop_coulomb`.",
        )
    return warning(
        "input-is-a-goal",
        f"{follows} A load, such as gravity, or a limit keeps the position off its target, which the position_loop structures "
        "can't describe; remove the load, or record the motor's voltage.",
    )


def _period(data: Dataset) -> float:
    """The mean time [s] in which the input goes to and fro about its mean; twice as long as the record where it doesn't."""
    off = data.u - data.u.mean()
    sides = np.sign(off[np.abs(off) > _BESIDE * np.ptp(off)])
    halves = 1 + int(np.count_nonzero(np.diff(sides)))
    return 2.0 * data.duration / halves


def _input_at(data: Dataset, t: Array) -> Array:
    """The input that held at times t (N,)."""
    at = np.searchsorted(data.t_input, t, side="left") - 1
    return np.asarray(np.where(at >= 0, data.u[np.maximum(at, 0)], data.input_before), dtype=np.float64)


def _line(u: Array, y: Array) -> tuple[float, float]:
    """The slope of y over u, and the part of the variance of y that a line explains."""
    u, y = u - u.mean(), y - y.mean()
    power = float(u @ u)
    if power == 0 or not float(y @ y) > 0:
        return 0.0, 0.0
    slope = float(u @ y) / power
    return slope, 1.0 - float(np.sum((y - slope * u) ** 2)) / float(y @ y)
