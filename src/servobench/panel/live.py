"""Live identification: rows of a running loop in, parameters with intervals out, five times a second."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array, DeviceInfo
from servobench.core.errors import UsageError
from servobench.identification.estimators.recursion.motion import Samples
from servobench.identification.estimators.recursion.start import Setting
from servobench.identification.live import LiveEstimate

_INTERVAL = 0.2  # s of the run between two messages
_RECENT = 2.0  # s of the run in which the shortest way of a sample is looked for
_KEPT = 8192  # residuals that haven't been fetched yet


class LiveFit:
    """Follows a device whose encoder's resolution is known, at a sample time [s].

    `wish` are half-widths of 95 % intervals over the values, by name, such as `stopping_rule.parse_wish` returns; `set_wish`
    changes them while the motor runs. Raises `UsageError` for a device that doesn't say how many counts a revolution has.
    """

    def __init__(self, info: DeviceInfo, sample_time: float, wish: Mapping[str, float] | None = None) -> None:
        encoder = info.channel("counts")
        if encoder is None or not encoder.counts_per_rev:
            raise UsageError(
                f"the device {info.name!r} doesn't give its encoder's counts per revolution, so it can't be "
                "identified live: make a recording, and give them when you identify it"
            )
        self._quantum = 2 * math.pi / encoder.counts_per_rev
        self._modulus = 2.0**encoder.counter_bits if encoder.counter_bits else None
        setting = Setting(quantum=self._quantum, sample_time=sample_time, delay=info.delay)
        self._live = LiveEstimate(setting, wish)
        self._by_host = info.timing != "virtual"
        self._by_device = info.timing == "device"
        self._ahead = np.empty(0)  # of the host's count before the device's, at the last samples [s]
        self._recent = max(1, round(_RECENT / sample_time))  # samples
        self._writing = np.zeros(2)  # the sum of the times that writes took [s], and their number
        self._counts: float | None = None
        self._travel = 0.0
        self._next: int | None = None
        self._last_reported = -math.inf
        self._waiting = np.empty(0)  # numbers of rows whose residuals will be known later
        self._numbers, self._residuals = np.empty(0), np.empty(0)

    def set_wish(self, wish: Mapping[str, float] | None) -> None:
        """Say how well the parameters are to be known; None for no wish."""
        self._live.wish = dict(wish or {})

    def take(self, columns: Mapping[str, Array], first: int | None = None) -> dict[str, Any] | None:
        """Take rows in order and return the `live` message where one is due, else None.

        `columns` has `t` [s], `applied` [V] and `counts`, as the counter shows them, (N,) each, and where the loop notes it when
        each voltage was `handed` to the device and `written` [s], from when on it holds; of a device that keeps the time by the
        host's clock, with when the host had `received` the sample [s]. Rows without a finite value are left out. `first` is the
        number of the first row: where it isn't the one after the last, rows were lost, and where the motor is is found anew.
        """
        t, u, counts = (np.asarray(columns[name], dtype=np.float64) for name in ("t", "applied", "counts"))
        if first is not None:
            if self._next is not None and first != self._next:
                self._live.start_again()
                self._counts = None
                self._waiting = np.empty(0)
            self._next = first
        begin = self._next or 0
        self._next = begin + len(t)
        driven, has_counts = np.isfinite(t) & np.isfinite(u), np.isfinite(t) & np.isfinite(counts)
        y = (self._unwrap(counts[has_counts]) + 0.5) * self._quantum
        if has_counts.any():
            t_in = self._hold_times(columns, t)[driven]
            known = self._live.take(Samples(t=t[has_counts], y=y, t_in=t_in, u=u[driven]))
            self._keep(known, begin + np.flatnonzero(has_counts))
        if not has_counts.any() or t[has_counts][-1] - self._last_reported < _INTERVAL:
            return None
        self._last_reported = float(t[has_counts][-1])
        return self.message()

    @property
    def reached(self) -> int:
        """The number of the first row about which more may become known: all before it have their residuals, or never will."""
        return int(self._waiting[0]) if len(self._waiting) else self._next or 0

    def residuals(self, first: int, until: int) -> Array:
        """Return the residuals (N,) of the live model [rad] of rows number `first` to before `until`; NaN where there are none.

        Rows before `until` are forgotten by that.
        """
        residuals = np.full(max(until - first, 0), np.nan)
        here = (self._numbers >= first) & (self._numbers < until)
        residuals[(self._numbers[here] - first).astype(np.int64)] = self._residuals[here]
        later = self._numbers >= until
        self._numbers, self._residuals = self._numbers[later], self._residuals[later]
        return residuals

    def _keep(self, known: Array, rows: NDArray[np.int64]) -> None:
        """Keep residuals that have become known after rows with those numbers were taken; some may be known later only."""
        rows_so_far = np.concatenate([self._waiting, rows])
        end = max(len(rows_so_far) - self._live.behind, 0)
        # After the run was gone through again some come a second time: they are left out.
        count = min(len(known), end)
        self._waiting = rows_so_far[end:]
        self._numbers = np.concatenate([self._numbers, rows_so_far[end - count : end]])[-_KEPT:]
        self._residuals = np.concatenate([self._residuals, known[len(known) - count :]])[-_KEPT:]

    def message(self) -> dict[str, Any]:
        """Return the `live` message: the parameters with their 95 % intervals, the whiteness light, and whether it is enough."""
        # When a voltage begins to act within the write is unknown: evenly distributed over it.
        unknown = float(self._writing[0] / max(self._writing[1], 1.0))
        return self._live.message(unknown / math.sqrt(3))

    def _hold_times(self, columns: Mapping[str, Array], t: Array) -> Array:
        """The times from which the inputs hold [s], (N,): when the device had taken them, where that is noted; see `measure`."""
        if not self._by_host or "written" not in columns:
            return t
        written = np.asarray(columns["written"], dtype=np.float64)
        if self._by_device:
            if "received" not in columns:
                return t
            written = written - self._host_ahead(np.asarray(columns["received"], dtype=np.float64) - t)
        noted = np.isfinite(written) & (written >= t)
        if "handed" in columns and noted.any():
            took = np.asarray(columns["written"], dtype=np.float64)[noted]
            took = took - np.asarray(columns["handed"], dtype=np.float64)[noted]
            self._writing += took[np.isfinite(took)].sum(), np.isfinite(took).sum()
        return np.where(noted, written, t)

    def _host_ahead(self, ahead: Array) -> float:
        """The lead of the host's count over the device's [s]: samples are received late, and never early.

        Of the last seconds only, in which clocks of quartz drift apart by less than a millisecond.
        """
        self._ahead = np.concatenate([self._ahead, ahead[np.isfinite(ahead)]])[-self._recent :]
        return float(self._ahead.min()) if len(self._ahead) else math.nan

    def _unwrap(self, counts: Array) -> Array:
        """Counts without the wraps of the counter, over all rows so far: a step is less than half the counter's range."""
        if not len(counts):
            return counts
        before = counts[0] if self._counts is None else self._counts
        steps = np.diff(counts, prepend=before)
        if self._modulus:
            steps -= self._modulus * np.rint(steps / self._modulus)
        self._counts = float(counts[-1])
        travel = self._travel + np.cumsum(steps)
        self._travel = float(travel[-1])
        return travel
