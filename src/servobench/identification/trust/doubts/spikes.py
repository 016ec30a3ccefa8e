"""Single values that lie far off their neighbours: no shaft makes them, so they are left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.finding import Finding, info, warning
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.trust.doubts.goal import OF_A_SHAFT
from servobench.recordings.formats.times import in_words
from servobench.recordings.measurement.dataset import Dataset, keep_with_data

CODE = "output-spikes"
"""The code of findings on spikes."""

_LARGE = 6.0  # times what is usual among the largest second differences
_SHORTEST = 20  # samples of a record in which one that lies off can be recognised
_AROUND = 3  # departures that a single spike makes: its own and its neighbours'
_AROUND_PAIR = 5  # departures that two in a row make, of two in a row: their own, and those up to two samples before and after
_LATE = 2  # samples of delay of a motor behind its input, as it often has them
_PLAIN = (
    0.05  # of the input's range: a change by less, as of a measured voltage or a slow sine, makes no jump
)
_CALM = 0.5  # of the samples: of fewer without a change of the input nearby, nothing is usual
_MOST = 0.02  # of the samples: more than that isn't a few spikes but noise


def without_spikes(records: Sequence[Dataset]) -> tuple[tuple[Dataset, ...], list[Finding]]:
    """Return the records without the spikes of their outputs, and what was left out; the inputs stay whole.

    Behind a filter each reading is in many values, so such a record stays as it is, and its spikes are a doubt. So is one that a
    pulse of the input may have made, or one step of a loop's reference.
    """
    cleaned, findings = [], []
    for data in records:
        stays = bool(data.chain.linear) or data.input_unit in OF_A_SHAFT
        which = np.array([], dtype=np.int64) if stays else _spikes_of_no_input(data)
        if len(which):
            left_out = _finding(info, data, which, "these values are left out")
            data = replace(data.without(which), findings=(*data.findings, left_out))
            findings.append(left_out)
        cleaned.append(data)
    return tuple(cleaned), findings


def had_spikes(data: Dataset) -> bool:
    """Return whether the output has spikes, or had some that were left out."""
    return any(each.code == CODE for each in data.findings) or len(spikes_of(data)) > 0


def _spikes_of_no_input(data: Dataset) -> NDArray[np.int64]:
    """The indices (K,) of the spikes that no input made, also of those that larger ones hid; none where they are too many.

    Where the input goes there and back around a spike, a motor that is quicker than the samples may have followed it.
    """
    which = np.array([], dtype=np.int64)
    while True:
        left = np.setdiff1d(np.arange(len(data.y)), which)
        rest = data.without(which) if len(which) else data
        u = rest.input_at_output
        more = [k for k in spikes_of(rest).tolist() if _is_undriven(u, k)]
        if not more:
            return which
        which = np.union1d(which, left[more])
        if not len(_if_few(which, len(data.y))):
            return which[:0]


def _about_fit(fit: Fit) -> list[Finding]:
    """Spikes that are still in any record of a fit."""
    which = [spikes_of(record.data) for record in fit.records]
    return [
        _finding(warning, record.data, each, "leave these rows out")
        for record, each in zip(fit.records, which, strict=True)
        if len(each)
    ]


@keep_with_data
def spikes_of(data: Dataset) -> NDArray[np.int64]:
    """Return the indices (K,) of the spikes in a record's output; none where it wraps."""
    if any(finding.code == "angle-wraps" for finding in data.findings):
        return np.array([], dtype=np.int64)
    quantum = data.quantum or 0.0
    u = data.input_at_output
    single, pairs = spikes(data.y, u, quantum), spike_pairs(data.y, u, quantum)
    return np.union1d(single, np.union1d(pairs, pairs + 1)) if len(pairs) else single


def _finding(say: Callable[..., Finding], data: Dataset, which: NDArray[np.int64], so: str) -> Finding:
    """What to say of spikes (K,), and what comes of it (`so`)."""
    where = f"{in_words(data.row_numbers(which), 'sample')} ({data.in_seconds(data.t_output[which[0]])})"
    return say(
        CODE,
        f"{data.name}: the output jumps away and back again within a sample or two in {where}, which no shaft does. It is cable "
        f"noise or a lost count; {so}.",
        parameters=("gain", "time_constant"),
        rows=data.row_span(int(which[0]), int(which[-1])),
    )


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


DOUBTS.member("spikes")(Doubt(codes=(CODE,), about_fit=_about_fit))
