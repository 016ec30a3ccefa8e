"""A position declared as a speed, or the other way round."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.core.errors import NotIdentifiable
from servobench.core.finding import Finding, refusal
from servobench.core.runs import runs
from servobench.core.units import is_unit, unit
from servobench.identification.estimators.base import Fit, percent_explained
from servobench.identification.estimators.gain_sign import with_usual_sign
from servobench.identification.estimators.least_squares import Layout, at, lowest
from servobench.identification.models.base import STRUCTURES
from servobench.identification.models.position_loop.goal import goal_finding
from servobench.identification.models.steady import quarters, stretches_of_input
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.trust.doubts.echo import alike
from servobench.identification.trust.doubts.rest_claimed import isnt_at_rest
from servobench.identification.trust.doubts.short_period import repeats_soon
from servobench.recordings.measurement.dataset import Dataset

_NEARLY_ALL = 90.0  # percent: what explains so much, with a gain that is known, is the right kind
_LEFT = 0.5  # of the misfit may be left of an output taken as what it is
_NEAR = 4.0  # times the misfit that is wanted: a guess that leaves more isn't refined
_LONG = 20  # samples under one input
_HARDLY = 0.1  # of the way in a stretch: a position would go a quarter of it at a steady speed
_STAYS = 0.05  # of the farthest way in such a time
_SLOWER = 0.5  # of what it went in an earlier quarter: a load takes less of a position's speed
_FALL = 0.5  # of the largest input so far: a speed shows it
_STOOD = 3  # samples that show a rest
_SHORT = 12  # samples under one input that show whether it goes on
_LEVELS = 3
_GOES = 0.7  # of the pace in the second quarter: what settles has lost more of it, unless it takes 1.4 times as long
_FEW_LOW = 3  # samples of such an input
_CLEAR = 3.0  # times the noise, by which a position goes on meanwhile
_AT_LIMIT = 0.01  # of the input's range: what is nearer to an end of it is at that end
_ENOUGH = 5000  # samples to tell the two kinds apart
_BEHAVES = {
    "position": "it goes on growing while the input stands still",
    "speed": "it settles while the input stands still",
}


def _about_fit(fit: Fit) -> list[Finding]:
    """Whether a record that its model explains badly is explained well by the same motor, its output taken for the other kind."""
    data = fit.records[0].data
    if len(fit.records) > 1 or data.chain.linear or "gain" not in fit.model.names:
        return []
    if fit.fit_percent >= _NEARLY_ALL and fit.sd("gain") < abs(fit.model["gain"]):
        return []
    if _is_in_rpm(data) or (data.kind == "speed" and _stays_while_driven(data)):
        return []  # nobody writes down a position in rpm, and none stays where it is under a large input
    if repeats_soon(data):
        return []  # in the few rows of a period the one looks like the other
    if isnt_at_rest(data):
        return []  # held to a start that it doesn't have, no kind explains it
    if goal_finding(data) is not None:
        return []  # a position that follows its goal settles with it
    if _is_proportional(data):
        return []  # a proportional controller's law, which explains the output as well as a speed would be
    if data.kind == "speed" and (_comes_to_rest(data) or _slows_down(data)):
        return []  # a position would go on, and as fast as before
    if data.kind == "position" and (_goes_on(data) or _goes_on_at_every_level(data)):
        return []  # a speed would fall with its input, and settle
    same, other = _enough_of(data), _with_other_kind(data)
    wanted = max(_NEARLY_ALL, 100 - _LEFT * (100 - fit.fit_percent))
    explained = _percent_explained(other, wanted)
    if not explained >= wanted:
        return []
    # Compared is what the same search finds: a fit that explains the output by a random torque may simulate it badly.
    as_said = max(fit.fit_percent, _percent_explained(same, explained))
    if not 100 - explained < _LEFT * (100 - as_said):
        return []
    sentence = (
        f"{data.name}: the output is declared as a {data.kind}, but behaves like a {other.kind}: {_BEHAVES[other.kind]}. A "
        f"motor explains {explained:.0f} % of it as a {other.kind}, {as_said:.0f} % as a {data.kind}. Give it the "
        f"unit of a {other.kind}: `output=COL:{other.output_unit}`, or whichever unit it has{_way_out(data)}."
    )
    return [refusal("kind-mistaken", sentence, parameters=("gain", "time_constant"))]


def _is_proportional(data: Dataset) -> bool:
    """Whether the input is a line in the output, in all rows or in those in which it isn't at a limit."""
    u = np.interp(data.t_output, data.t_input, data.u)
    within = (u > u.min() + _AT_LIMIT * np.ptp(u)) & (u < u.max() - _AT_LIMIT * np.ptp(u))
    return alike(u, data.y) or bool(np.count_nonzero(within) >= _LONG and alike(u[within], data.y[within]))


def _comes_to_rest(data: Dataset) -> bool:
    """Whether the input stands still for long, somewhere off zero, and the output hardly changes in the last quarter of that."""
    stretches = [
        data.y[first:end]
        for first, end in zip(*stretches_of_input(data), strict=True)
        if end - first >= _LONG and data.input_at_output[first] != 0
    ]
    return bool(stretches) and all(np.ptp(y[-len(y) // 4 :]) < _HARDLY * np.ptp(y) for y in stretches)


def _is_in_rpm(data: Dataset) -> bool:
    """Whether the output was recorded in turns a minute, by whatever name."""
    recorded = data.recorded_unit
    return is_unit(recorded) and unit(recorded).si == "rad/s" and unit(recorded).factor == unit("rpm").factor


def _stays_while_driven(data: Dataset) -> bool:
    """Whether the output, far from zero, stays for a fifth of the record in which the input is half of its largest at least."""
    u, count = data.input_at_output, max(_LONG, len(data.y) // 5)
    if len(data.y) <= count:
        return False
    every = slice(None, None, max(count // 4, 1))
    windows = np.lib.stride_tricks.sliding_window_view(data.y, count)[every]
    went, where = np.ptp(windows, axis=1), np.abs(windows.mean(axis=1))
    stays = (went < _STAYS * went.max()) & (where > _FALL * np.ptp(data.y))
    driven = np.lib.stride_tricks.sliding_window_view(u, count)[every]
    strong = _FALL * np.abs(u).max(initial=0.0)
    return bool(np.any(stays & ((driven.min(axis=1) >= strong) | (driven.max(axis=1) <= -strong))))


def _slows_down(data: Dataset) -> bool:
    """Whether the output changes less and less while the input stays or grows in one direction, as a speed that settles does.

    From rest, or while the input grows to twice as much and more: a position that turned faster before slows down as well.
    """
    u = data.input_at_output
    for sense in (1.0, -1.0):
        grows = np.diff(sense * u, prepend=sense * u[0]) >= 0.0
        for first, last in runs(grows & (sense * u > 0.0)):
            if last - first < _LONG or not (
                _rests_before(data, first, last) or 2 * abs(u[first]) <= abs(u[last - 1])
            ):
                continue
            way = data.y * np.sign(data.y[last - 1] - data.y[first])
            went = np.array([way[part][-1] - way[part][0] for part in quarters(data, first, last)])
            earlier = np.maximum.accumulate(went[:-1])
            if len(went) and bool(np.any((earlier > _CLEAR * data.noise) & (went[1:] < _SLOWER * earlier))):
                return True
    return False


def _rests_before(data: Dataset, first: int, last: int) -> bool:
    """Whether the output stands before the rows `first` to `last`, as long as they last or since the record began."""
    before = data.y[max(2 * first - last, 0) : first]
    return data.starts_at_rest if len(before) < _STOOD else float(np.ptp(before)) <= data.noise


def _goes_on(data: Dataset) -> bool:
    """Whether the output never comes back, beside noise, and goes on while the input is at most half as large as it was.

    A speed whose input falls falls as well; one that turns round grows all the time, as its input does.
    """
    way = (data.y - data.y[0]) * (1.0 if data.y[-1] >= data.y[0] else -1.0)
    if float(np.max(np.maximum.accumulate(way) - way, initial=0.0)) > data.noise:
        return False
    u = data.input_at_output
    drive = u if abs(u.max(initial=0.0)) >= abs(u.min(initial=0.0)) else -u
    low = drive < (1.0 - _FALL) * np.maximum.accumulate(drive)
    went = np.diff(way, prepend=way[:1])[low]
    return bool(np.count_nonzero(low) >= _FEW_LOW and float(went.sum()) > _CLEAR * data.noise)


def _goes_on_at_every_level(data: Dataset) -> bool:
    """Whether the output goes on in the last quarter of the time under each of several inputs, hardly more slowly than before."""
    u, goes_on = data.input_at_output, []
    for first, end in zip(*stretches_of_input(data), strict=True):
        parts = quarters(data, first, end) if end - first >= _SHORT and u[first] != 0 else []
        if parts:
            _, second, _, last = (float(np.mean(np.diff(data.y[part]))) for part in parts)
            goes_on.append(second != 0 and last / second > _GOES)
    return len(goes_on) >= _LEVELS and all(goes_on)


def _way_out(data: Dataset) -> str:
    """How steps of an encoder become a position; the empty text of anything else."""
    return "; counts since the row before become a position with `chain=accumulate`" if data.quantum else ""


def _enough_of(data: Dataset) -> Dataset:
    """The record, or of a long one the beginning: no more than it takes to tell the two kinds apart."""
    if len(data.y) <= _ENOUGH:
        return data
    return data.part(float(data.t_output[0]), float(data.t_output[_ENOUGH]))


def _with_other_kind(data: Dataset) -> Dataset:
    """The same values as a speed in place of a position, or the other way round."""
    part = _enough_of(data)
    if data.kind == "position":
        return replace(part, kind="speed", output_unit=f"{data.output_unit}/s", quantum=None)
    return replace(part, kind="position", output_unit=data.position_unit, quantum=None)


def _percent_explained(data: Dataset, wanted: float) -> float:
    """The part of a record that a motor explains, in percent: of the least squares alone, as no figure of the motor is wanted.

    Where no guess comes near the `wanted` part, none is refined: a search that ends far below would take long.
    """
    percentages, total = [0.0], float(np.sum((data.y - data.y.mean()) ** 2))
    for name in ("first_order_coulomb", "first_order_one_way"):
        structure = STRUCTURES[name]
        layout = Layout(structure, (data,))
        try:
            guesses = structure.guesses([data])
        except NotIdentifiable:
            continue
        explained = percent_explained(min(at(layout, guess).cost for guess in guesses), total)
        if explained >= 100 - _NEAR * (100 - wanted):
            best = with_usual_sign(structure, [data], lowest(structure, [data], guesses))
            explained = percent_explained(best.cost, total)
        percentages.append(explained)
    return max(percentages)


DOUBTS.member("kind")(Doubt(codes=("kind-mistaken",), about_fit=_about_fit))
