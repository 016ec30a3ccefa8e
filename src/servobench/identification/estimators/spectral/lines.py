"""Lines of the spectrum: which part of a record is transformed, and which of its lines the input excites.

A stretch of N samples has lines at 2πk/(NT). It is chosen so that periodic signals fall on lines: whole cycles of a sine, whole
periods of another periodic input, or otherwise the whole record. There is no window: leakage is a transient, and is fitted
(Pintelon and Schoukens 2012).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.identification.estimators.base import from_first_output, is_regular
from servobench.identification.estimators.spectral.path import Complex, Path
from servobench.identification.estimators.spectral.sines import Run, sines
from servobench.recordings.measurement.dataset import Dataset

Lines = NDArray[np.int64]

_EXCITED = 1e-4  # of the strongest line; what rounding leaves of a computed signal is far below, a square's harmonics above
_SAME = 1e-3  # of the range: samples a period apart that differ by less are the same
_QUIET = 0.4  # of the lines between the first and the last excited one, for these to be examined one by one
_FEWEST = 24  # lines


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretch:
    """N samples of a record from number `first` on: `lines` k (K,) below Nyquist's, `excited` and `detection` among them.

    `data` is the record, `count` N.
    `cycles` is how often the input repeats in it, 1 where it doesn't. Detection lines are harmonics of the period that the input
    leaves out. Where `separate`, each excited line has a response of its own, as there are quiet ones between them; otherwise
    the input excites all lines, and the response varies smoothly along them. `tone` [rad/s] is the frequency of a sine.
    """

    data: Dataset
    first: int
    count: int
    cycles: int
    excited: Lines
    detection: Lines
    separate: bool
    tone: float | None = None

    @property
    def sample_time(self) -> float:
        """The mean time between samples [s]."""
        return self.data.duration / (len(self.data.t_output) - 1)

    @cached_property
    def lines(self) -> Lines:
        """The numbers of the lines, from 1 up to the last below Nyquist's frequency."""
        return np.arange(1, (self.count + 1) // 2)

    @cached_property
    def path(self) -> Path:
        """The path from input to data at the lines."""
        omega = np.asarray(2 * np.pi / (self.count * self.sample_time) * self.lines, dtype=np.float64)
        return Path(self.data, self.sample_time, omega)

    @cached_property
    def input(self) -> Complex:
        """The spectrum U (K,) of the input, N^(-1/2) Σ u e^(-j2πkn/N)."""
        return _spectrum(self.data.u[self.first : self.first + self.count])

    @cached_property
    def output(self) -> Complex:
        """The spectrum (K,) of the output; that of its circular difference for a position, in which a ramp is a constant."""
        y = self.data.y[self.first : self.first + self.count]
        if self.data.kind == "position":
            # A straight line is the transient of an integrator: it is fitted anyway, and taking most of it out saves digits.
            y = y - np.linspace(y[0], y[-1], len(y))
        return _spectrum(y) * self.path.difference


def stretches(data: Dataset) -> tuple[Stretch, ...]:
    """Return the parts of a record to transform: one for each sine, or one for all.

    Raises `NotIdentifiable` where samples don't come evenly, or input or output don't change, or there are too few samples.
    """
    if not is_regular(data):
        raise NotIdentifiable(
            f"{data.name}: a frequency response can't be taken at irregular times; output_error can use them"
        )
    data = from_first_output(data)
    first = int(np.argmax(data.valid)) if data.valid.any() else len(data.y)
    u = data.u[first:]
    if len(u) < 2 * _FEWEST or np.ptp(u) == 0 or np.ptp(data.y) == 0:
        what = "the input doesn't change" if len(u) and np.ptp(u) == 0 else "the output doesn't change"
        raise NotIdentifiable(
            f"{data.name}: {f'{len(u)} samples are too few' if len(u) < 2 * _FEWEST else what}; "
            "the record has no frequency response: record a changing input for longer"
        )
    runs = sines(u)
    if runs:
        return tuple(_of_sine(data, first, run) for run in runs)
    period = repeats_after(u)
    return (_of_periods(data, first, len(u), period) if period else _of_all(data, first, len(u)),)


def repeats_after(u: Array) -> int | None:
    """Return the smallest number of samples after which a signal (N,) repeats at least once as a whole, None where it doesn't."""
    n = len(u)
    x = u - u.mean()
    size = 1 << int(np.ceil(np.log2(2 * n)))
    products = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: n // 2 + 1]
    head = np.concatenate([[0.0], np.cumsum(x**2)])
    p = np.arange(1, n // 2 + 1)
    apart = (head[n - p] + head[n] - head[p] - 2 * products[p]) / (head[n] * (n - p) / n)
    tolerance = _SAME * float(np.ptp(u))
    for period in p[apart <= 4 * _SAME**2 * np.ptp(u) ** 2 * n / head[n] + 1e-9]:
        if np.abs(u[period:] - u[:-period]).max() <= tolerance:
            return int(period)
    return None


def _of_sine(data: Dataset, first: int, run: Run) -> Stretch:
    line, step = run.cycles, data.duration / (len(data.t_output) - 1)
    last = (run.count + 1) // 2 - 1
    return Stretch(
        data=data, first=first + run.first, count=run.count, cycles=run.cycles, excited=np.array([line]),
        detection=np.arange(2 * line, last + 1, line), separate=True, tone=run.frequency / step,
    )  # fmt: skip


def _of_periods(data: Dataset, first: int, available: int, period: int) -> Stretch:
    """The last whole periods: what the start leaves is smallest there."""
    cycles = available // period
    count = cycles * period
    first += available - count
    power = np.abs(_spectrum(data.u[first : first + count]))
    harmonics = np.arange(cycles, len(power) + 1, cycles)
    strong = power[harmonics - 1] > _EXCITED * power.max()
    return Stretch(
        data=data, first=first, count=count, cycles=cycles, excited=harmonics[strong],
        detection=harmonics[~strong], separate=True,
    )  # fmt: skip


def _of_all(data: Dataset, first: int, count: int) -> Stretch:
    power = np.abs(_spectrum(data.u[first : first + count]))
    excited = 1 + np.flatnonzero(power > _EXCITED * power.max())
    span = excited[-1] - excited[0] + 1
    separate = bool(1.0 - len(excited) / span >= _QUIET) or len(excited) == 1
    return Stretch(
        data=data, first=first, count=count, cycles=1, excited=excited, detection=np.empty(0, dtype=np.int64), separate=separate
    )  # fmt: skip


def _spectrum(x: Array) -> Complex:
    """The lines from 1 to the last below Nyquist's."""
    lines = np.fft.rfft(x)[1 : (len(x) + 1) // 2] / np.sqrt(len(x))
    return np.asarray(lines, dtype=np.complex128)
