"""An input that explains the output no better than chance."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.finding import Finding, warning
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.kernels import first_order_recursion

_WELL = 90.0  # percent: nothing explains so much by chance, but for a shaft that turns at one speed
_ALL = (
    0.5  # of what a constant speed leaves: an input that takes no more than half of it away explains little
)
_CHANGE = 0.05  # of the input's range: less, such as a sagging supply or a ramp, is the same level still
_LEVELS = 8  # held one after another: with fewer there are too few orders to put them in
_ORDERS = 19  # other orders of the levels: the recorded one is the best of 20 by chance in 5 % of the cases
_AS_GOOD = 2  # of these orders
# Samples from the beginning of each record: where a fit explains little, so many that slow levels are among them.
_SAMPLES = {True: 2000, False: 20_000}
_LAGS = 9  # time constants that are tried, up to the whole record
_SHORTEST = 0.1  # of the sample time: a speed that follows its input at once


def _about_fit(fit: Fit) -> list[Finding]:
    """Whether the same levels of the input explain the output as well when they come in another order.

    A position drifts, and a drift is explained to 70 % by nearly anything: what counts is that the recorded order of the levels
    does it better than others do. It doesn't where the input changed unseen between samples, or drives another motor. Of levels
    of one sign any order explains most of the way, so a position's speeds are asked as well.
    """
    records = [record.data for record in fit.records]
    well = fit.fit_percent >= _WELL
    inputs = [data.input_at_output[: _SAMPLES[well]] for data in records]
    if "gain" not in fit.model.names or any(len(_switches(u)) < _LEVELS for u in inputs):
        return []
    if well:
        explained = _ALL * min(_misfits_behind_lags(records, [0.0 * u for u in inputs]))
        if any(each < explained for each in _misfits(records, inputs)):
            return []
    as_good = _as_good_orders(records, inputs, min(least_misfit(records, inputs), _remainder(fit)))
    if as_good < _AS_GOOD:
        return []
    speeds_tell = records[0].kind == "position" and (
        _as_good_orders(records, inputs, least_misfit(records, inputs, as_speed=True), as_speed=True)
        < _AS_GOOD
    )
    if speeds_tell:
        return []
    sentence = (
        f"The input explains the output no better than chance does: {as_good} of {_ORDERS} other orders of the same levels "
        "explain as much. Either the input changes between the samples, unseen, or this column doesn't drive this motor: record "
        "faster than the input changes, and check the columns."
    )
    return [warning("fit-by-chance", sentence, parameters=("gain", "time_constant"))]


def _remainder(fit: Fit) -> float:
    """The same as `least_misfit` of what the fit itself leaves, which has friction and a delay besides."""
    shares = []
    for record in fit.records:
        y, left = record.data.y[record.valid], record.residual[record.valid]
        total = float(np.sum((y - y.mean()) ** 2))
        shares.append(float(np.sum(left**2)) / total if total > 0 else 1.0)
    return sum(shares)


def _as_good_orders(
    records: list[Dataset], inputs: list[Array], recorded: float, as_speed: bool = False
) -> int:
    """How many other orders of the levels leave as little as the recorded one does."""
    generator = np.random.default_rng(0)
    others = [
        least_misfit(records, [_reorder(u, generator) for u in inputs], as_speed) for _ in range(_ORDERS)
    ]
    return sum(other <= recorded for other in others)


def _switches(u: Array) -> NDArray[np.intp]:
    """The samples (K,) at which another level begins."""
    return np.flatnonzero(np.abs(np.diff(u)) > _CHANGE * np.ptp(u)) + 1


def _reorder(u: Array, generator: np.random.Generator) -> Array:
    """The same levels, each held for as long as it was, in another order."""
    held = np.split(u, _switches(u))
    return np.concatenate([held[at] for at in generator.permutation(len(held))])


def least_misfit(records: list[Dataset], inputs: list[Array], as_speed: bool = False) -> float:
    """Return the smallest sum of squares that a motor leaves of records, relative to that of each record's own variation.

    `inputs` (N,) are those of the records' first N samples of the output, in place of their own.
    """
    return min(_misfits(records, inputs, as_speed))


def _misfits(records: list[Dataset], inputs: list[Array], as_speed: bool = False) -> Iterator[float]:
    """The sums of squares of an input that acts as recorded, and of one that acts before its row is written."""
    early = [np.append(u[1:], u[-1]) for u in inputs]
    for each in (inputs, early):
        yield from _misfits_behind_lags(records, each, as_speed)


def _misfits_behind_lags(
    records: list[Dataset], inputs: list[Array], as_speed: bool = False
) -> Iterator[float]:
    """The sums of squares that a motor with each of several time constants, from the longest on, leaves of the records.

    Linear least squares in gain, offset and start: the same small search for every order. A position may be compared
    `as_speed`, by what it goes from sample to sample.
    """
    times = [data.t_output[: len(u)] for data, u in zip(records, inputs, strict=True)]
    spans = [max(t[-1] - t[0], data.sample_time) for data, t in zip(records, times, strict=True)]
    shortest = [_SHORTEST * data.sample_time for data in records]
    for lags in np.geomspace(spans, shortest, _LAGS):
        yield sum(
            _misfit_behind_lag(data.y[: len(u)], u, t, float(lag), data.kind, as_speed)
            for data, u, t, lag in zip(records, inputs, times, lags, strict=True)
        )


def _misfit_behind_lag(y: Array, u: Array, t: Array, lag: float, kind: str, as_speed: bool) -> float:
    """The share of the output's variation that a motor with a time constant of `lag` [s] leaves, at times t (N,) [s]."""
    steps = np.diff(t)
    decay = np.exp(-steps / lag)
    speed = np.append(0.0, first_order_recursion(decay, ((1.0 - decay) * u[:-1])[:, None])[:, 0])
    columns = [speed, np.ones_like(speed), np.exp(-(t - t[0]) / lag)]
    if kind == "position":
        # The integral of a speed that starts at zero.
        turned = np.append(0.0, np.cumsum(u[:-1] * steps)) - lag * speed
        columns = [turned, *columns[1:], t - t[0]]
    matrix = np.column_stack(columns)
    if as_speed:
        matrix, y = np.diff(matrix, axis=0) / steps[:, None], np.diff(y) / steps
    rest, total = y - matrix @ np.linalg.lstsq(matrix, y, rcond=None)[0], float(np.sum((y - y.mean()) ** 2))
    return float(np.sum(rest**2)) / total if total > 0 else 1.0


DOUBTS.member("chance")(Doubt(codes=("fit-by-chance",), about_fit=_about_fit))
