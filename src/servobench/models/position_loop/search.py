"""A first guess for position loops: a search over loop gain, time constant and delay, the rest by least squares.

Without friction the output is linear in the offset and the start state, so a grid over the natural frequency and the damping of
the loop, with a small least-squares problem at each point, finds the region of the minimum without any step that could diverge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from servobench.channels import Array
from servobench.errors import NotIdentifiable
from servobench.measurement.base import Chain
from servobench.measurement.dataset import Dataset
from servobench.models.first_order import DELAY, TIME_CONSTANT
from servobench.models.position_loop.structure import GOAL_OFFSET, LOOP_GAIN, PositionLoop

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
    few = [_thinned(record) for record in data]
    found = sorted((_trial(plain, few, point) for point in _points(data)), key=lambda trial: trial[0])
    guesses = []
    for _, point, offset, starts in found[:_BEST]:
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
            f"{data.name}: the output stays at {data.y[0]:g} {data.output_unit} throughout: the wheel was blocked, the encoder "
            "isn't connected, or another column was meant; record the servo while it moves"
        )
    if np.ptp(data.u) == 0 and data.input_before == data.u[0]:
        raise NotIdentifiable(
            f"{data.name}: the goal stays at {data.u[0]:g} {data.input_unit} throughout, so nothing tells how the loop follows it"
        )


def _thinned(data: Dataset) -> Dataset:
    """A part of the samples, as those of the shaft itself; a chain is left out of a guess."""
    rows = np.unique(np.linspace(0, len(data.y) - 1, _ROWS).astype(np.int64))
    return replace(
        data, t_output=data.t_output[rows], y=data.y[rows], declared=Chain(), applied=Chain(), current=None
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
    """How far from its goal the shaft rests: the median of the distance in the slowest tenth of the samples."""
    errors = []
    for record in data:
        if record.kind != "position":
            continue
        held = np.maximum(np.searchsorted(record.t_input, record.t_output, side="left") - 1, 0)
        still = np.abs(np.gradient(record.y, record.t_output))
        slow = still <= np.quantile(still, 0.1)
        errors.append(np.abs(record.u[held] - offset - record.y)[slow])
    return float(np.median(np.concatenate(errors))) if errors else 0.01 * float(np.ptp(data[0].u))
