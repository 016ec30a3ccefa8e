"""Sines in an input: one for the whole record, or steps from one frequency to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array

_PURE = 0.01  # of the amplitude: what a measured sine may have beside it, root mean square
_EXACT = 1e-8  # of the amplitude of the differences: what a computed sine may be off its recurrence
_CYCLES = 2.0  # that a run has at least
_FIRST = 16  # samples that tell a run's frequency
_SAMPLES = 32  # that a run has at least
_PATIENCE = 8  # beginnings that lead to no run, in a record that hasn't any
_COVERED = 0.5  # of the record: less than that in runs, and it isn't made of sines


@dataclass(frozen=True, kw_only=True)
class Run:
    """Whole cycles of one sine: `count` samples from number `first` on, with `frequency` [rad a sample]."""

    first: int
    count: int
    cycles: int
    frequency: float


def sines(u: Array) -> list[Run]:
    """Return the sines that an input (N,) consists of, none where it consists of something else.

    One sine is found in measured values too; steps from one to the next only in exact ones, such as a commanded input.
    """
    whole = _single(u)
    if whole is not None:
        run = _whole_cycles(0, len(u), whole)
        return [run] if run else []
    return _sine_runs(u)


def _single(u: Array) -> float | None:
    """The frequency [rad a sample] of the only sine in a signal, None where there is more."""
    from scipy.optimize import minimize_scalar

    x = u - u.mean()
    n = len(x)
    power = np.abs(np.fft.rfft(x * np.hanning(n), 4 * n))
    step = 2 * np.pi / (4 * n)
    peak = step * int(np.argmax(power))
    if peak < 2 * np.pi * _CYCLES / n or _beside(u, peak) > 0.5:
        return None
    minimum = minimize_scalar(
        lambda frequency: _beside(u, frequency),
        bounds=(peak - 2 * step, peak + 2 * step),
        method="bounded",
        options={"xatol": 1e-9 / n},
    )
    return float(minimum.x) if minimum.fun <= _PURE else None


def _beside(u: Array, frequency: float) -> float:
    """The remainder of a signal without a sine of that frequency and a constant, relative to its amplitude."""
    angle = frequency * np.arange(len(u))
    columns = np.column_stack([np.cos(angle), np.sin(angle), np.ones(len(u))])
    linear = np.linalg.lstsq(columns, u, rcond=None)[0]
    left = np.sqrt(np.mean((u - columns @ linear) ** 2))
    return float(left / max(np.hypot(linear[0], linear[1]), 1e-300))


def _sine_runs(u: Array) -> list[Run]:
    """Runs in which the differences w obey w[n+1] + w[n-1] = 2 cos(ω) w[n], as those of a sine and a constant do."""
    w = np.diff(u)
    runs: list[Run] = []
    start, failed, covered = 0, 0, 0
    while start + _SAMPLES < len(w) and failed < _PATIENCE:
        end, cosine = _run(w, start)
        run = None
        if end - start >= _SAMPLES and abs(cosine) < 1:
            run = _whole_cycles(start, end + 1 - start, float(np.arccos(cosine)))
        if run is None:
            failed, start = failed + 1, max(start + _FIRST // 2, end - _FIRST)
        else:
            runs.append(run)
            failed, covered, start = 0, covered + end - start, end
    return runs if covered >= _COVERED * len(w) else []


def _run(w: Array, start: int) -> tuple[int, float]:
    """The end of the recurrence that holds from `start`, and the cosine of its frequency."""
    cosine, end = _cosine(w[start : start + _FIRST]), start + _FIRST
    if not np.isfinite(cosine):
        return end, cosine
    size = float(np.abs(w[start : start + _FIRST]).max())
    while end < len(w):
        part = w[end - 2 : 2 * end - start]  # as much again
        size = max(size, float(np.abs(w[start:end]).max()))
        off = np.abs(part[2:] + part[:-2] - 2 * cosine * part[1:-1]) > _EXACT * size
        if off.any():
            return end + int(np.argmax(off)), cosine
        end = min(end + len(part) - 2, len(w))
        cosine = _cosine(w[start:end])
    return end, cosine


def _cosine(w: Array) -> float:
    """The cosine of the frequency by least squares; NaN where a sine doesn't obey."""
    middle = w[1:-1]
    power = float(middle @ middle)
    if power == 0:
        return float("nan")
    cosine = float(middle @ (w[2:] + w[:-2])) / (2 * power)
    off = np.abs(w[2:] + w[:-2] - 2 * cosine * middle).max()
    return cosine if off <= _EXACT * np.abs(w).max() else float("nan")


def _whole_cycles(first: int, available: int, frequency: float) -> Run | None:
    """The last samples that are nearest to whole cycles, three quarters of those there are at least; None for less than two."""
    cycle = 2 * np.pi / frequency
    most = int(np.floor(available / cycle + 1e-6))
    if most < _CYCLES:
        return None
    cycles = np.arange(most, max(int(np.ceil(0.75 * most)), int(_CYCLES)) - 1, -1)
    counts = np.rint(cycles * cycle).astype(np.int64)
    off = np.abs(counts / cycle - cycles) + np.where(counts > available, np.inf, 0.0)
    # The longest of those that are as near as any but for rounding.
    best = int(np.flatnonzero(off <= off.min() + 1e-9 * most)[0])
    count = int(counts[best])
    return Run(first=first + available - count, count=count, cycles=int(cycles[best]), frequency=frequency)
