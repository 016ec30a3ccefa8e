"""The usable samples of an input and an output: those with an increasing time and a finite value."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import LONGEST_STEP, SHORTEST_STEP, Array, measurable
from servobench.core.errors import FormatError
from servobench.core.finding import Finding, info, warning
from servobench.core.rounding import with_unit
from servobench.core.runs import runs
from servobench.recordings.formats.epoch import epoch_unit
from servobench.recordings.formats.merged_rows import about_merged_rows, are_merged
from servobench.recordings.formats.overflow import counter_of_overflow
from servobench.recordings.formats.roles import Role
from servobench.recordings.formats.times import (
    in_words,
    is_out_of_order,
    keep_increasing,
    mean_step,
    sorts_evenly,
)
from servobench.recordings.recording import Series

_MOST_LEFT_OUT = (
    0.1  # of the samples, for times that go back; more than that is another run, or another column
)
_FEW_LEFT_OUT = 0.01  # of the samples: what a logger spoils when it starts tells nothing against the rest
_MOST_USUAL = 0.5  # of the samples, with one and the same time
_MOST_ROUNDED = 0.5  # of the samples, with the time of the one before
_MOST_REPEATED = 0.1  # of those, with another value; a logger that repeats rows has none
_LONGEST_RECORDING = 1e12  # sample times; thirty years at a kilohertz
_FEW_IN_A_ROW = 3  # samples without an input that is the same before and after them
_RUN = 10  # samples that follow a jump far back before it is another run


def usable(name: str, series: Mapping[Role, Series]) -> tuple[dict[Role, Series], list[Finding]]:
    """Return the series without the samples that can't be used, and what is to be known of those.

    `name` is the recording's. Raises `FormatError` where the times are those of several runs, or less than two samples are left.
    """
    findings: list[Finding] = []
    checked: list[tuple[Array, NDArray[np.bool_]]] = []
    usable_series: dict[Role, Series] = {}
    for role, each in series.items():
        t = measurable(np.asarray(each.t, dtype=np.float64))
        values = measurable(each.values)
        keep = next(
            (keep for known, keep in checked if known is t or np.array_equal(known, t, equal_nan=True)), None
        )
        if keep is None:
            keep = keep_increasing(t)
            checked.append((t, keep))
            findings.extend(_about_times(name, t, keep, _duplicate_rows(series.values(), t)))
        _check_not_rounded(name, each, t, keep)
        _check_step(name, t[keep])
        _check_span(name, t[keep])
        finite = np.isfinite(values)
        if not finite[keep].all():
            findings.append(
                about_merged_rows(each, series["output"])
                if role == "input" and "output" in series and are_merged(each, series["output"])
                else _omission(role, each.channel.name, values, keep & ~finite)
            )
        keep = keep & finite
        if keep.sum() < 2:
            raise FormatError(
                f"{name}: the {role} `{each.channel.name}` has {int(keep.sum())} samples with a time and a possible value; "
                "at least two are needed"
            )
        usable_series[role] = replace(each, values=values[keep], t=t[keep])
    return usable_series, findings


def _check_step(name: str, t: Array) -> None:
    """Raise `FormatError` where the steps of times t (N,) [s] aren't those of any motor's samples."""
    if len(t) < 2:
        return
    step = float(np.median(np.diff(t)))
    if not SHORTEST_STEP <= step <= LONGEST_STEP:
        dates = epoch_unit(t)
        remedy = (
            f"In {dates} the times would be dates: say `time=COL:{dates}`"
            if dates not in (None, "s")
            else "Name the right column and unit with `time=COL:UNIT`"
        )
        raise FormatError(
            f"{name}: the samples are {step:.3g} s apart; expected {SHORTEST_STEP:g} to {LONGEST_STEP:g} s. {remedy}, or give "
            "the sample time with `sample_time=...`"
        )


def _check_span(name: str, t: Array) -> None:
    """Raise `FormatError` where increasing times t (N,) [s] lie further apart than any recording is long."""
    if len(t) > 1 and t[-1] - t[0] > _LONGEST_RECORDING * np.median(np.diff(t)):
        raise FormatError(
            f"{name}: the times go from {t[0]:g} s to {t[-1]:g} s, more than {_LONGEST_RECORDING:g} sample times: one of these "
            "times is wrong. Correct it, or give the sample time with `sample_time=...`"
        )


def _omission(role: Role, name: str, values: Array, which: NDArray[np.bool_]) -> Finding:
    samples = np.flatnonzero(which) + 1
    sentence = f"Samples where the {role} `{name}` has no or an impossible value are left out: {in_words(samples, 'sample')}."
    # Of an input that isn't known it isn't known either what it did; an output may well come now and then.
    severity = warning if role == "input" and not _stays_the_same(values, which) else info
    return severity("rows-left-out", sentence, rows=(int(samples[0]), int(samples[-1])))


def _stays_the_same(values: Array, lost: NDArray[np.bool_]) -> bool:
    """Whether an input (N,) has the same value before and after each of the few samples in a row in which it is lost."""
    known = np.flatnonzero(np.isfinite(values))
    after = np.searchsorted(known, np.flatnonzero(lost))
    if not (after.min() > 0 and after.max() < len(known)):
        return False
    before, behind = known[after - 1], known[after]
    return bool(np.all(values[before] == values[behind]) and np.all(behind - before <= _FEW_IN_A_ROW + 1))


def _duplicate_rows(series: Iterable[Series], t: Array) -> NDArray[np.bool_]:
    """Which samples have the time and the values of the one before: rows that a logger wrote twice (N,)."""
    again: NDArray[np.bool_] = np.diff(t, prepend=np.nan) == 0
    for each in series:
        if len(each.values) == len(t):
            again[1:] &= each.values[1:] == each.values[:-1]
    return again


def _about_times(name: str, t: Array, keep: NDArray[np.bool_], again: NDArray[np.bool_]) -> list[Finding]:
    """The finding on samples without a usable time; raises `FormatError` where they are more than a slip.

    Samples that were written `again` lose nothing.
    """
    if keep.all():
        return []
    finite = np.flatnonzero(np.isfinite(t))
    if len(finite) > 1 and (t[finite] == t[finite[0]]).all():
        raise FormatError(
            f"{name}: all times are {t[finite[0]]:g} s; name the right column with `time=COL:UNIT`"
        )
    _check_one_run(name, t[finite], keep[finite])
    samples = np.flatnonzero(~keep) + 1
    sentence = (
        f"No time, or one that isn't later than those before it, left out: {in_words(samples, 'sample')}."
    )
    severity = warning if np.mean(~keep & ~again) > _FEW_LEFT_OUT else info
    return [severity("rows-left-out", sentence, rows=(int(samples[0]), int(samples[-1])))]


def _check_one_run(name: str, t: Array, keep: NDArray[np.bool_]) -> None:
    """Raise `FormatError` where finite times t (N,), of which `keep` increase, are those of several runs, or none at all."""
    jumps = np.flatnonzero(np.diff(t) < 0)
    if not len(jumps):
        return
    back = ~keep
    back[1:] &= np.diff(t) != 0
    k = int(jumps[np.argmin(t[jumps + 1] - t[jumps])])
    far = t[k] - t[k + 1] > 0.5 * (t[k] - t[0])
    if np.mean(back) > _MOST_LEFT_OUT or (far and _longest_block(back) >= _RUN):
        often = "once," if len(jumps) == 1 else f"{len(jumps)} times, the furthest"
        sentence = f"the time goes back {often} {_step_back(float(t[k]), float(t[k + 1]))} at sample {k + 2}"
        _check_no_overflow(name, t, k, sentence)
        raise FormatError(f"{name}: {sentence}. {_order_remedy(t)}")


def _order_remedy(t: Array) -> str:
    """What to do with finite times t (N,) [s] that go back."""
    if not is_out_of_order(t):
        remedy = "Put each run, or each stretch between wraps of the counter, into its own file"
    elif sorts_evenly(t):
        remedy = "Sort the rows by it"
    else:
        return (
            "Sort the rows by it if they are only out of order; if it is no time but, for example, a computed duration, name "
            "another column with `time=...`, or give the sample time with `sample_time=...`"
        )
    return f"{remedy}; or name another column with `time=...`"


def _step_back(before: float, after: float) -> str:
    """How far the time goes back from one sample to the next [s], with as many digits of the two as tell them apart."""
    far = before - after
    ratio = max(abs(before), abs(after)) / far
    digits = min(max(6, 4 + math.ceil(math.log10(max(ratio, 1.0)))), 15)
    return f"by {with_unit(far, 's', 3)}, from {before:.{digits}g} s to {after:.{digits}g} s"


def _check_no_overflow(name: str, t: Array, k: int, sentence: str) -> None:
    """Raise `FormatError` where finite times t (N,) go back behind sample k, as a `sentence` says, because of an overflow."""
    step = mean_step(t)
    counter = None if step is None else counter_of_overflow(t[k], t[k + 1], step.step)
    if step is None or counter is None:
        return
    raise FormatError(
        f"{name}: {sentence}, as a {counter} does when it overflows. If the samples are evenly spaced, say "
        f"`sample_time={step.figure:.6g}` (in s), the mean step; otherwise split the recording there"
    )


def _check_not_rounded(name: str, series: Series, t: Array, keep: NDArray[np.bool_]) -> None:
    """Raise `FormatError` where most samples have the time of the one before but not its value: times too coarse to be used."""
    values = measurable(np.asarray(series.values, dtype=np.float64))
    # A row that a logger repeats as it was loses nothing where it is left out.
    same = np.diff(t) == 0
    changed = same & np.isfinite(np.diff(values)) & (np.diff(values) != 0)
    if same.sum() <= _MOST_ROUNDED * len(t) or changed.sum() <= _MOST_REPEATED * same.sum():
        return
    _check_no_steps(name, t)
    step = mean_step(t)
    about = "SECONDS" if step is None else f"{step.figure:.4g}"
    mean = "" if step is None else f", the mean step, uncertain by {step.resolution:.2g} s"
    raise FormatError(
        f"{name}: {int(same.sum())} of the {len(t)} samples of `{series.channel.name}` have the same time as the one "
        "before: the times are rounded. If the samples are evenly spaced, give their sample time, about "
        f"`sample_time={about}` (in s){mean}"
    )


def _check_no_steps(name: str, t: Array) -> None:
    """Raise `FormatError` where most of the times t (N,) [s] are the same, and others are earlier: steps from row to row.

    A clock that froze goes on to one value, and never back.
    """
    times, rows = np.unique(t, return_counts=True)
    usual = float(times[np.argmax(rows)])
    if rows.max() <= _MOST_USUAL * len(t) or usual <= 0.0 or np.all(np.diff(t) >= 0.0):
        return
    raise FormatError(
        f"{name}: {int(rows.max())} of the {len(t)} times are {usual:g} s, as of a column with the step from row to row: "
        f"name the time column with `time=COL:UNIT`, or give the sample time as `sample_time={usual:g}` (in s)"
    )


def _longest_block(which: NDArray[np.bool_]) -> int:
    """The length of the longest block of samples that stand one after the other."""
    return max((end - first for first, end in runs(which)), default=0)
