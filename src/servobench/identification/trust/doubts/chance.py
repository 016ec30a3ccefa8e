"""An input that explains the output no better than chance."""

from __future__ import annotations

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
_LAGS = 8  # time constants that are tried, from one sample to the whole record


def _about_fit(fit: Fit) -> list[Finding]:
    """Whether the same levels of the input explain the output as well when they come in another order.

    A position drifts, and a drift is explained to 70 % by nearly anything: what counts is that the recorded order of the levels
    does it better than others do. It doesn't where the input changed unseen between samples, or drives another motor.
    """
    records = [record.data for record in fit.records]
    well = fit.fit_percent >= _WELL
    inputs = [data.input_at_output[: _SAMPLES[well]] for data in records]
    if "gain" not in fit.model.names or any(len(_switches(u)) < _LEVELS for u in inputs):
        return []
    generator = np.random.default_rng(0)
    recorded = _misfit(records, inputs)
    if well and recorded < _ALL * _misfit(records, [0.0 * u for u in inputs]):
        return []
    others = [_misfit(records, [_reorder(u, generator) for u in inputs]) for _ in range(_ORDERS)]
    as_good = sum(other <= recorded for other in others)
    if as_good < _AS_GOOD:
        return []
    sentence = (
        f"The input explains the output no better than chance does: {as_good} of {_ORDERS} other orders of the same levels "
        "explain as much. Either the input changes between the samples, unseen, or this column doesn't drive this motor: record "
        "faster than the input changes, and check the columns."
    )
    return [warning("fit-by-chance", sentence, parameters=("gain", "time_constant"))]


def _switches(u: Array) -> NDArray[np.intp]:
    """The samples (K,) at which another level begins."""
    return np.flatnonzero(np.abs(np.diff(u)) > _CHANGE * np.ptp(u)) + 1


def _reorder(u: Array, generator: np.random.Generator) -> Array:
    """The same levels, each held for as long as it was, in another order."""
    held = np.split(u, _switches(u))
    return np.concatenate([held[at] for at in generator.permutation(len(held))])


def _misfit(records: list[Dataset], inputs: list[Array]) -> float:
    """The smallest sum of squares that a motor leaves of the records, relative to that of each record's own variation.

    Linear least squares in gain, offset and start for each of several time constants: the same small search for every order.
    """
    shares = []
    for data, u in zip(records, inputs, strict=True):
        y = data.y[: len(u)]
        lags = np.geomspace(1.0, len(y), _LAGS)
        shares.append([_misfit_behind_lag(y, u, lag, data.kind) for lag in lags])
    return float(np.min(np.sum(shares, axis=0)))


def _misfit_behind_lag(y: Array, u: Array, lag: float, kind: str) -> float:
    """The share of the output's variation that a motor with a time constant of `lag` samples leaves."""
    decay = np.exp(-1.0 / lag)
    steps = np.arange(len(y))
    follows = first_order_recursion(np.full(len(u), decay), ((1.0 - decay) * u)[:, None])[:, 0]
    speed = np.append(0.0, follows[:-1])
    columns = [speed, np.ones_like(speed), decay**steps]
    if kind == "position":
        columns = [np.cumsum(speed), *columns[1:], steps]
    matrix = np.column_stack(columns)
    rest = y - matrix @ np.linalg.lstsq(matrix, y, rcond=None)[0]
    return float(np.sum(rest**2) / np.sum((y - y.mean()) ** 2))


DOUBTS.member("chance")(Doubt(codes=("fit-by-chance",), about_fit=_about_fit))
