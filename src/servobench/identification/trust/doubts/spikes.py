"""Single values that lie far off their neighbours, and how far they move the parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.finding import Finding, info, warning
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.uncertainty.score_test import in_innovations, innovations_and_jacobian
from servobench.recordings.formats.times import in_words
from servobench.recordings.measurement.dataset import Dataset, keep_with_data

_LARGE = 6.0  # times what is usual among the largest second differences
_MOST_MOVED = 2.0  # standard deviations: what moves a parameter farther is outside its interval
_MOST_OF_RESIDUAL = 0.5  # of its square: beyond it the spikes are what limits the accuracy
_SHORTEST = 20  # samples of a record in which one that lies off can be recognised
_AROUND = 3  # departures that a single spike makes: its own and its neighbours'
_AROUND_PAIR = 5  # departures that two in a row make, of two in a row: their own, and those up to two samples before and after
_LATE = 2  # samples of delay of a motor behind its input, as it often has them
_PLAIN = (
    0.05  # of the input's range: a change by less, as of a measured voltage or a slow sine, makes no jump
)
_CALM = 0.5  # of the samples: of fewer without a change of the input nearby, nothing is usual
_MOST = 0.02  # of the samples: more than that isn't a few spikes but noise


def with_spikes(fit: Fit) -> Fit:
    """Return the fit with its covariance larger by the square of what the spikes of its records move the parameters by."""
    which = [spikes_of(record.data) for record in fit.records]
    if not any(map(len, which)):
        return fit
    jacobian, residual = innovations_and_jacobian(fit)
    heights = _heights(fit, which)
    if heights @ heights > _MOST_OF_RESIDUAL * (residual @ residual):
        return fit  # without them all would be known much better: the doubt says so
    moved = _shift(jacobian, heights)[: len(fit.model.names)]
    if not _share_of_sd(fit, moved) < _MOST_MOVED:
        return fit  # too much for a small change of the output: the doubt says so
    reason = "the output has spikes of a sample or two, which no shaft makes"
    return fit.widen(Contribution(source="spikes", covariance=np.outer(moved, moved), reason=reason))


def _about_fit(fit: Fit) -> list[Finding]:
    """Spikes in any record of a fit: a doubt, or where the intervals allow for them a remark."""
    which = [spikes_of(record.data) for record in fit.records]
    if not any(map(len, which)):
        return []
    allowed = any(line.source == "spikes" for line in fit.budget)
    return [_finding(r.data, each, allowed) for r, each in zip(fit.records, which, strict=True) if len(each)]


@keep_with_data
def spikes_of(data: Dataset) -> NDArray[np.int64]:
    """Return the indices (K,) of the spikes in a record's output; none where it wraps."""
    if any(finding.code == "angle-wraps" for finding in data.findings):
        return np.array([], dtype=np.int64)
    quantum = data.quantum or 0.0
    u = data.input_at_output
    single, pairs = spikes(data.y, u, quantum), spike_pairs(data.y, u, quantum)
    return np.union1d(single, np.union1d(pairs, pairs + 1)) if len(pairs) else single


def _finding(data: Dataset, which: NDArray[np.int64], allowed: bool) -> Finding:
    rows = data.row_span(int(which[0]), int(which[-1]))
    where = f"{in_words(data.row_numbers(which), 'sample')} ({data.in_seconds(data.t_output[which[0]])})"
    what = (
        f"{data.name}: the output jumps away and back again within a sample or two in {where}, which no shaft does. It is cable "
        "noise or a lost count; "
    )
    if allowed:
        return info("output-spikes", f"{what}the intervals allow for its effect.", rows=rows)
    return warning(
        "output-spikes", f"{what}leave these rows out.", parameters=("gain", "time_constant"), rows=rows
    )


def _shift(jacobian: Array, heights: Array) -> Array:
    """The change of the joint vector that a small change x (N,) of the innovations makes: (J'J)⁻¹ J'x."""
    lengths = np.linalg.norm(jacobian, axis=0)
    lengths[lengths == 0] = 1.0
    moved, *_ = np.linalg.lstsq(jacobian / lengths, heights, rcond=None)
    return np.asarray(moved / lengths)


def _share_of_sd(fit: Fit, moved: Array) -> float:
    """The largest change of a parameter, in its standard deviations."""
    sd = np.sqrt(np.diag(fit.covariance))
    return float(np.max(np.abs(moved[sd > 0]) / sd[sd > 0], initial=0.0))


def _heights(fit: Fit, which: Sequence[NDArray[np.int64]]) -> Array:
    """The spikes alone, each as far as it is from the line between its neighbours, in innovations (N,) of all records."""
    parts = []
    for record, indices in zip(fit.records, which, strict=True):
        y, spike = record.data.y, np.zeros((len(record.data.y), 1))
        others = np.setdiff1d(np.arange(len(y)), indices)
        spike[indices, 0] = y[indices] - np.interp(indices, others, y[others])
        parts.append(in_innovations(fit, record, spike)[:, 0])
    return np.concatenate(parts)


def spikes(y: Array, u: Array, quantum: float) -> NDArray[np.int64]:
    """Return the indices (K,) of single values of y (N,) that lie far off both neighbours, on the same side of both.

    The departure from the mean of the neighbours is compared with the largest of the others, and with half a quantum. `u` (N,) is
    the input at the same samples: where that stays, only departures count that a motor doesn't make by setting off.
    """
    if len(y) < _SHORTEST:
        return np.array([], dtype=np.int64)
    off = np.abs(y[1:-1] - 0.5 * (y[2:] + y[:-2]))
    # One spike makes three of these large, which in a short record is more than two in a hundred.
    limit, anywhere = (
        _LARGE * max(_usual(each, _AROUND), 0.5 * quantum) for each in (_where_calm(off, u), off)
    )
    beyond = (y[1:-1] - y[2:]) * (y[1:-1] - y[:-2]) > 0
    candidates = (np.flatnonzero((off > limit) & beyond) + 1).tolist()
    stands_out = [k for k in candidates if _goes_on(y, k) and (off[k - 1] > anywhere or _is_undriven(u, k))]
    indices = np.array(stands_out, dtype=np.int64)
    return _if_few(indices, len(y)) if limit > 0 else np.array([], dtype=np.int64)


def spike_pairs(y: Array, u: Array, quantum: float) -> NDArray[np.int64]:
    """Return the indices (K,) of the first of two values in a row of y (N,) that lie far off both neighbours, as a spike does.

    The nearer of the two is compared, by its departure from the line between the neighbours, as a single one is. `u` (N,) is the
    input at the same samples: where that changes and changes again, a motor that is quicker than the samples may follow it.
    """
    if len(y) < _SHORTEST:
        return np.array([], dtype=np.int64)
    before, first, second, after = y[:-3], y[1:-2], y[2:-1], y[3:]
    across = (after - before) / 3.0
    departures = np.minimum(np.abs(first - before - across), np.abs(after - second - across))
    limit = _LARGE * max(_usual(_where_calm(departures, u), _AROUND_PAIR), 0.5 * quantum)
    highest, lowest = np.maximum(before, after), np.minimum(before, after)
    beyond = (np.minimum(first, second) > highest) | (np.maximum(first, second) < lowest)
    candidates = (np.flatnonzero((departures > limit) & beyond) + 1).tolist()
    indices = np.array([k for k in candidates if _goes_on(y, k, 2) and _is_undriven(u, k)], dtype=np.int64)
    return _if_few(indices, len(y)) if limit > 0 else np.array([], dtype=np.int64)


def _where_calm(departures: Array, u: Array) -> Array:
    """The departures (D,) without those of a motor that sets off, around plain changes of the input u (N,).

    Number k is that of sample k + 1 and of what follows it. All of them where fewer than half would be left.
    """
    changes = np.flatnonzero(np.abs(np.diff(u)) > _PLAIN * np.ptp(u)) + 1
    near = changes[:, None] + np.arange(-2, _LATE + 1)
    calm = np.ones(len(u), dtype=np.bool_)
    calm[np.clip(near - 1, 0, len(u) - 1)] = False
    calm = calm[: len(departures)]
    return departures[calm] if np.mean(calm) > _CALM else departures


def _usual(departures: Array, around: int) -> float:
    """The largest of departures (D,) that a spike doesn't make, which makes so many large ones `around` it."""
    return float(np.sort(departures)[: -max(around, round(_MOST * len(departures)))].max(initial=0.0))


def _if_few(indices: NDArray[np.int64], samples: int) -> NDArray[np.int64]:
    """The indices (K,) of what lies off in so many samples, none where it is too many to be a few spikes."""
    return indices if len(indices) <= max(_MOST * samples, 1) else np.array([], dtype=np.int64)


def _is_undriven(u: Array, k: int) -> bool:
    """Whether the input plainly changes once at most around samples k and k + 1: there and back takes two changes."""
    changes = np.abs(np.diff(u[max(k - 1 - _LATE, 0) : k + 3]))
    return bool(np.count_nonzero(changes > _PLAIN * np.ptp(u)) < 2)


def _goes_on(y: Array, k: int, width: int = 1) -> bool:
    """Whether the values around a number of samples, `width` from sample k on, go on as if they weren't there.

    At a reversal they don't.
    """
    last = k + width - 1
    if not (k >= 2 and last < len(y) - 2):
        return False
    across = (y[last + 1] - y[k - 1]) / (width + 1)
    size = min(abs(y[k] - y[k - 1] - across), abs(y[last + 1] - y[last] - across))
    return bool(
        abs(y[k - 1] - y[k - 2] - across) < 0.5 * size
        and abs(y[last + 2] - y[last + 1] - across) < 0.5 * size
    )


DOUBTS.member("spikes")(Doubt(codes=("output-spikes",), about_fit=_about_fit))
