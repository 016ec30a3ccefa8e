"""A speed that grows by less than the input does: friction makes the opposite of that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from servobench.core.finding import Finding, list_text, warning
from servobench.core.rounding import TWO_SIDED, with_unit
from servobench.identification.estimators.base import Fit, as_predicted, fit_percent
from servobench.identification.models.motion import is_ramp, smooth_speed
from servobench.identification.models.steady import speeds_by_level
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_APART = 1.3  # times a level has to be the lowest one, to say how the speed grows
_MUCH = 0.25  # of the highest level: a straight line through the speeds that drives without any input by more isn't friction
_FALLEN = 0.85  # of what is proportional to the input: a motor that warms up or a supply that sags takes less
_POOR = 50.0  # percent of the output: a model that explains less knows no offset
_MOVES = 0.05  # of the largest speed: below it friction holds the shaft, or a loop brings it to rest
_BENT = 0.1  # of the rise of the speed: what a middle level is above the straight line, twice what a settled speed may change by
_FALLS = (
    0.5  # of the slope below: a quadratic drag that takes as much as all else at the highest level leaves 0.6
)
_LEVELS = 20  # that a ramp is divided into
_EXPLAINED = 90.0  # percent of the output: a model that explains so much has what bends the characteristic, or it is small


def _about(fit: Fit) -> list[Finding]:
    """The finding, unless a model with the friction of a motor shows the same: its speeds haven't settled, either."""
    findings = _bends(fit)
    return [] if findings and not _friction_drives(fit) and _bends(as_predicted(fit)) else findings


def _friction_drives(fit: Fit) -> bool:
    """Whether a fit's friction is below zero for certain: such a model has the bend of a driver."""
    if "coulomb_voltage" not in fit.model.names:
        return False
    friction = fit["coulomb_voltage"]
    return friction.value + TWO_SIDED * friction.sd < 0.0


def _bends(fit: Fit) -> list[Finding]:
    if "gain" not in fit.model.names:
        return []
    speeds = speeds_by_level([record.data for record in fit.records])
    has_offset = "offset_voltage" in fit.model.names and fit.fit_percent >= _POOR
    offset = float(fit.model["offset_voltage"]) if has_offset else 0.0
    top = max(float(np.percentile(np.abs(smooth_speed(record.data)), 99)) for record in fit.records)
    for sense in (1.0, -1.0):
        levels = _in_one_sense(speeds, sense, top)
        if len(levels) > 1 and _drives_without_input(levels, sense * offset):
            return [_finding(fit, (levels[0], levels[-1]), sense)]
        is_ramp_alone = not levels and len(fit.records) == 1
        if is_ramp_alone:
            levels = _in_one_sense(_speeds_on_a_ramp(fit.records[0].data), sense, top)
        bend = _bend(levels)
        # A coarse encoder's speed on a ramp is bent by its steps: there its position is what has to be explained.
        if bend is not None and (fit.fit_percent if is_ramp_alone else _percent_of_speed(fit)) < _EXPLAINED:
            return [_finding(fit, (levels[0], bend, levels[-1]), sense)]
    return []


def _percent_of_speed(fit: Fit) -> float:
    """The percentage of the speeds that the model explains: a position grows as well under a gain that is a mean."""
    if any(record.data.kind == "speed" for record in fit.records):
        return fit.fit_percent
    speeds = []
    for record in fit.records:
        speed = smooth_speed(record.data)
        off = speed - smooth_speed(replace(record.data, y=record.prediction))
        speeds.append(replace(record, data=replace(record.data, y=speed), residual=off))
    return fit_percent(speeds)


def _speeds_on_a_ramp(data: Dataset) -> dict[float, float]:
    """The speeds in parts of a ramp, by the mean of the input there; empty where the input doesn't go one way gradually.

    A motor that follows late has all of them a little later, which bends nothing.
    """
    if not is_ramp(data):
        return {}
    u, speed = data.input_at_output, smooth_speed(data)
    parts = np.array_split(np.argsort(u, kind="stable"), _LEVELS)
    return {float(u[part].mean()): float(np.median(speed[part])) for part in parts if len(part)}


def _in_one_sense(speeds: dict[float, float], sense: float, top: float) -> list[tuple[float, float]]:
    """The levels of an input of that sign at which the shaft turns, ascending, and the speeds there; both without the sign.

    Where the shaft turns against what most levels make of it, it hasn't settled, and there are no levels. Nor has it where it
    creeps, as when a loop lets it come to rest: `top` is the largest speed of all.
    """
    way = float(np.sign(sum(level * speed for level, speed in speeds.items())))
    each = sorted(
        (sense * level, sense * way * speed) for level, speed in speeds.items() if sense * level > 0.0
    )
    turning = [point for point in each if abs(point[1]) > _MOVES * top]
    return turning if all(speed > 0.0 for _, speed in turning) else []


def _drives_without_input(levels: Sequence[tuple[float, float]], offset: float) -> bool:
    """Whether the line through the speeds at the lowest and the highest level lies far above zero where the input is zero.

    `offset` is what of the input is lost in this sense and regained in the other, in the unit of the input.
    """
    (low, slow), (high, fast) = levels[0], levels[-1]
    if high < _APART * low:
        return False
    if fast <= slow:
        return True
    lost = low - slow / (fast - slow) * (high - low)
    return lost - offset < -_MUCH * high and fast * (low - offset) < _FALLEN * slow * (high - offset)


def _bend(levels: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """The level between the lowest and the highest beyond which the speed grows by far less than below; None where none is so."""
    if len(levels) < 3 or levels[-1][0] < _APART * levels[0][0]:
        return None
    (low, slow), (high, fast) = levels[0], levels[-1]
    slope = (fast - slow) / (high - low)
    level, speed = max(levels[1:-1], key=lambda each: each[1] - slope * each[0])
    above = speed - slow - slope * (level - low)
    if not (fast > slow and above > _BENT * (fast - slow)):
        return None
    falls = (fast - speed) / (high - level) < _FALLS * (speed - slow) / (level - low)
    return (level, speed) if falls else None


def _finding(fit: Fit, points: Sequence[tuple[float, float]], sense: float) -> Finding:
    data = fit.records[0].data
    unit = f"{data.position_unit}/s"
    texts = [
        f"at {with_unit(speed, unit, 3)} at {with_unit(sense * level, data.input_unit, 3)}"
        for level, speed in points
    ]
    sentence = (
        f"The speed grows by less than the input: the motor settles {list_text(texts)}. Friction would do the opposite. "
        "The driver or the load bends the characteristic, and a single gain is a mean over these levels: record the voltage at "
        "the motor, or identify each range of the input by itself."
    )
    return warning("speed-levels-off", sentence, parameters=("gain",))


DOUBTS.member("levels_off")(Doubt(codes=("speed-levels-off",), about_fit=_about))
