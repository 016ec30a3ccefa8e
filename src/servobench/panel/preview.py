"""A preview of a signal as the loop would output it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.finding import Severity
from servobench.panel.commands import settings_error_text
from servobench.rig.experiment import Experiment
from servobench.systems.signals.base import AnySignal, Signal
from servobench.systems.signals.multisine import Multisine
from servobench.systems.signals.sequence import Sequence
from servobench.systems.signals.sum import Sum

COLUMNS = 560
"""The most points of a drawn signal: two for each unit of the page's drawing."""
LEAST_SAMPLES = 20
"""So many are drawn, however short the time that was requested: two of them would look like any signal."""
MOST_WORK = 8e6
"""Values of a plain signal that are reckoned at most for one drawing, and as many for what comes after it."""
_BLOCK = 2**16  # samples at a time
_HARMONIC = 1.5  # the work of one harmonic, measured: its cosine, and its part of the sum
_SEGMENT = 0.25  # the work of looking which samples are a segment's


def preview_signal(settings: Mapping[str, Any], experiment: Experiment) -> dict[str, Any]:
    """Return what a signal does over a duration [s] in an experiment, and what can't be put out as it is drawn.

    The signal is sampled as the loop does it. `low` and `high` (N,), N up to `COLUMNS`, are its least and largest value from
    `t[k]` to before `t[k + 1]` [s], None where none is finite, so that nothing is left out, however fast it is. They are those of
    the first `duration` [s] of `length` [s]; where that is less, `later` is the least and the largest value of the rest, or None
    where it is too long. Raises `UsageError` for a duration or a signal that can't be.
    """
    asked = settings.get("duration", 10.0)
    if not isinstance(asked, int | float) or not 0 < asked < math.inf:
        raise UsageError(f"a preview can't last {asked!r} s; expected a number above 0")
    try:
        signal = TypeAdapter(AnySignal).validate_python(settings.get("signal"))
    except ValidationError as error:
        raise UsageError(settings_error_text(error)) from None
    step, most = experiment.sample_time, MOST_WORK / work_of(signal)
    length = max(float(asked), LEAST_SAMPLES * step)
    wanted = length / step
    count = math.ceil(
        min(wanted, max(most, LEAST_SAMPLES)) - 1e-9
    )  # a duration is a multiple but for rounding
    edges = np.linspace(0, count, min(count, COLUMNS) + 1).astype(np.int64)
    low, high = extremes(signal, step, edges)
    run = experiment.model_copy(update={"signal": signal, "duration": None})
    return {
        "t": (edges * step).tolist(),
        "low": [v if np.isfinite(v) else None for v in low.tolist()],
        "high": [v if np.isfinite(v) else None for v in high.tolist()],
        "duration": length if count >= wanted - 1e-9 else count * step,
        "length": length,
        "later": _later(signal, step, count, wanted) if count < wanted - 1e-9 <= count + most else None,
        "unit": experiment.controller.reference_unit,
        "warnings": [each.sentence for each in run.findings() if each.severity is Severity.WARNING],
    }


def work_of(signal: Signal) -> float:
    """Return how much work a value of a signal is, in values of a plain one such as a sine wave."""
    if isinstance(signal, Sum):
        return sum(map(work_of, signal.parts))
    if isinstance(signal, Sequence):
        return max(work_of(each.signal) for each in signal.segments) + _SEGMENT * len(signal.segments)
    if isinstance(signal, Multisine):
        return 1 + _HARMONIC * signal.highest / signal.frequency
    return 1.0


def extremes(signal: Signal, step: float, edges: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return the least and the largest of a signal's samples from `edges[n]` to before `edges[n + 1]`, each (N,).

    Sample k is that at k `step` [s]; edges (N + 1,) are whole numbers that ascend. NaN where nothing is finite; what isn't is
    left out.
    """
    low, high = np.empty(len(edges) - 1), np.empty(len(edges) - 1)
    for first, last in _blocks(edges):
        with np.errstate(
            over="ignore", invalid="ignore"
        ):  # a sum may be beyond all numbers: that isn't finite
            values = signal(np.arange(edges[first], edges[last]) * step)
        values = np.where(np.isfinite(values), values, np.nan)
        begins = edges[first:last] - edges[first]
        low[first:last] = np.fmin.reduceat(values, begins)
        high[first:last] = np.fmax.reduceat(values, begins)
    return low, high


def _blocks(edges: NDArray[np.int64]) -> Iterator[tuple[int, int]]:
    """Stretches of columns that have few samples together, or are one column."""
    first, last = 0, len(edges) - 1
    while first < last:
        until = max(first + 1, int(np.searchsorted(edges, edges[first] + _BLOCK, side="right")) - 1)
        yield first, min(until, last)
        first = until


def _later(signal: Signal, step: float, first: int, samples: float) -> list[float] | None:
    """The least and the largest value from sample `first` on, None where none is finite."""
    last = math.ceil(samples - 1e-9)
    edges = np.append(np.arange(first, last, _BLOCK), last)
    low, high = (values[np.isfinite(values)] for values in extremes(signal, step, edges))
    return [float(low.min()), float(high.max())] if len(low) else None
