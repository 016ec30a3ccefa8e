"""From the rows of a stream to parts of a recording: what each column is, and what was wrong on the way, counted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servobench.core.channels import LARGEST_VALUE, Array
from servobench.core.errors import UsageError
from servobench.core.finding import Finding, info, warning
from servobench.core.rounding import count_text
from servobench.core.units import unit
from servobench.recordings.evidence import Evidence, evidence_of
from servobench.recordings.formats.columns import Column, heading, recording_of, time_unit
from servobench.recordings.formats.mapping import Mapping
from servobench.recordings.formats.roles import ColumnSpec
from servobench.recordings.recording import Recording, Source
from servobench.recordings.streams.base import Rows
from servobench.recordings.streams.order import Link, RowOrder

OPENING = 50  # rows from which the columns and the time between rows are found
_FEW_DAMAGED = 0.01  # of the rows: a line that was cut when the stream began tells nothing against the rest
_OF_ALL_PARTS = frozenset({"time-recognised", "time-stated"})  # of what is said of a part's times
_FEWEST = 2  # rows that can be read as a recording


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """Rows that follow each other, as `evidence` with roles, units and times; `link` says how the first follows what was before.

    The rows come every `sample_time` [s].
    """

    evidence: Evidence
    link: Link
    sample_time: float

    @property
    def recording(self) -> Recording:
        """The rows."""
        return self.evidence.recording


class Intake:
    """Takes the rows of the stream of that `name`, whose columns are as `mapping` says, as for `assign`.

    The first rows are kept until there are fifty; `take` raises then what `assign` raises, `MissingInformation` among them.
    """

    def __init__(self, mapping: Mapping, name: str) -> None:
        self._mapping = mapping
        self._name = name
        self._names: tuple[str, ...] = ()
        self._first = np.empty((0, 0))
        self._order: RowOrder | None = None
        self._time: tuple[int, float] | None = None
        self._waiting: list[tuple[float, Array, Link]] = []
        self._damaged, self._example = 0, ""
        self._before: tuple[float, Array, Link] | None = None
        self._number = 0
        self.rows = 0
        self.unread = ""
        """The last line that came, where none was a row so far."""

    def take(self, rows: Rows) -> list[Part]:
        """Return the parts that rows became; those of the beginning come together, and a single row waits for the next."""
        self._damaged += rows.damaged
        self._example = self._example or (rows.example if rows.damaged else "")
        self.unread = "" if rows.names else rows.example or self.unread
        if not len(rows.values):
            return []
        values = self._possible(rows)
        if self._order is None:
            self._first = np.concatenate([self._first.reshape(-1, values.shape[1]), values])
            if len(self._first) < OPENING:
                return []
            return self._begin()
        return self._parts(self._order.take(self._times(values), values))

    def end(self) -> list[Part]:
        """Return what was still kept when the stream ended."""
        if self._order is None:
            return self._begin() if len(self._first) >= _FEWEST else []
        last, self._waiting = self._waiting, []
        if not last or last[0][2] == "restart" or self._before is None:
            self._damaged += len(last)
            return []
        self.rows += len(last)
        whole = self._part([self._before, *last])  # as a row alone can't be read
        return [_slice(whole, 1, 2, last[0][2])]

    @property
    def order(self) -> RowOrder | None:
        """The order of the rows so far; None before the first are known."""
        return self._order

    @property
    def damaged(self) -> int:
        """Lines that were no rows, and rows with an impossible time or value."""
        return self._damaged + (self._order.damaged if self._order else 0)

    def findings(self) -> tuple[Finding, ...]:
        """Return what was wrong with the stream."""
        left_out = []
        if self._damaged:
            example = f", such as {self._example!r}" if self._example else ""
            left_out.append(
                f"{count_text(self._damaged, 'damaged line', 'damaged lines')} of the stream{example}"
            )
        if self._order and self._order.damaged:
            left_out.append(
                f"{count_text(self._order.damaged, 'row')} of the stream with times that don't fit their neighbours', "
                "as from a clock that runs backwards or jumps"
            )
        severity = warning if self.damaged > _FEW_DAMAGED * self.rows else info
        about_damage = [severity("stream-damaged", f"Left out: {'; '.join(left_out)}.")] if left_out else []
        return (*about_damage, *(_about_order(self._order) if self._order else ()))

    def _possible(self, rows: Rows) -> Array:
        if self._names and rows.names != self._names and len(rows.values):
            raise UsageError(
                f"{self._name}: the columns changed from {self._names} to {rows.names}; start again"
            )
        self._names = self._names or rows.names
        good = (np.abs(rows.values) <= LARGEST_VALUE).all(axis=1)
        self._damaged += int((~good).sum())
        values: Array = rows.values[good]
        return values

    def _begin(self) -> list[Part]:
        """Read the first rows: which column is the time, and how far apart they are."""
        raw = self._recording(self._first)
        self._time = self._time_column(raw)
        if self._time is None:
            evidence_of(raw, self._mapping)  # which says what is missing, where it isn't the sample time
        step, tick = self._mapping.sample_time or 0.0, 1.0
        if self._time is not None:
            column, tick = self._time
            steps = np.diff(self._first[:, column]) * tick
            if not (steps > 0).any():
                raise UsageError(
                    f"{self._name}: the time {self._names[column]!r} doesn't increase; name another column"
                )
            step = float(np.median(steps[steps > 0]))
        self._order = RowOrder(step=step, tick=tick)
        first, self._first = self._first, np.empty((0, 0))
        return self._parts(self._order.take(self._times(first), first))

    def _time_column(self, raw: Recording) -> tuple[int, float] | None:
        """The place of the column of times and its unit [s]; None where the rows are evenly spaced, as was said."""
        if self._mapping.sample_time is not None:
            return None
        names = [each.channel.name for each in raw.series]
        spec = ColumnSpec.parse(self._mapping.time) if self._mapping.time else None
        if spec is not None and spec.column not in names and spec.column.isdecimal():
            spec = replace(spec, column=names[int(spec.column) - 1])
        for place, (name, own) in enumerate(zip(names, self._names, strict=True)):
            symbol = time_unit(heading(own))
            if spec is not None and name == spec.column:
                symbol = spec.unit or symbol
            elif spec is not None:
                continue
            if symbol is not None:
                return place, unit(symbol).factor
        return None

    def _times(self, values: Array) -> Array:
        """The times of rows (N, C) [s]."""
        if self._time is not None:
            column, factor = self._time
            times: Array = values[:, column] * factor
            return times
        first = self._number
        self._number += len(values)
        step = float(self._mapping.sample_time or 0.0)
        evenly: Array = step * (first + np.arange(len(values), dtype=np.float64))
        return evenly

    def _parts(self, rows: Sequence[tuple[float, Array, Link]]) -> list[Part]:
        groups = list(_split([*self._waiting, *rows], "restart"))
        self._waiting = groups.pop() if groups and len(groups[-1]) < _FEWEST else []
        parts: list[Part] = []
        for group in groups:
            if len(group) < _FEWEST:  # a clock that began again twice at once: no motion
                self._damaged += 1
                continue
            whole, begin = self._part(group), 0
            for run in _split(group, "restart", "gap", "rate"):
                parts.append(_slice(whole, begin, begin + len(run), run[0][2]))
                begin += len(run)
            self.rows += len(group)
            self._before = group[-1]
        return parts

    def _part(self, run: Sequence[tuple[float, Array, Link]]) -> Part:
        t = np.array([time for time, _, _ in run])
        values = np.array([row for _, row, _ in run])
        if self._time is not None:
            values[:, self._time[0]] = t / self._time[1]
        evidence = evidence_of(self._recording(values), self._mapping)
        series = tuple(replace(each, t=t) for each in evidence.recording.series)
        recording = replace(
            evidence.recording, series=series, findings=_without_times(evidence.recording.findings)
        )
        step = self._order.step if self._order else 0.0
        return Part(evidence=replace(evidence, recording=recording), link=run[0][2], sample_time=step)

    def _recording(self, values: Array) -> Recording:
        columns = [
            Column(heading=heading(name), values=np.ascontiguousarray(values[:, k]))
            for k, name in enumerate(self._names)
        ]
        return recording_of(columns, name="stream", source=Source(name=self._name, format="stream"))


def _slice(part: Part, begin: int, end: int, link: Link) -> Part:
    """The rows from one number to before another."""
    series = tuple(
        replace(each, t=None if each.t is None else each.t[begin:end], values=each.values[begin:end])
        for each in part.recording.series
    )
    return replace(
        part, evidence=replace(part.evidence, recording=replace(part.recording, series=series)), link=link
    )


def _split(
    rows: Sequence[tuple[float, Array, Link]], *links: Link
) -> Iterator[list[tuple[float, Array, Link]]]:
    """Rows in pieces that begin at one of these links."""
    run: list[tuple[float, Array, Link]] = []
    for row in rows:
        if row[2] in links and run:
            yield run
            run = []
        run.append(row)
    if run:
        yield run


def _without_times(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Findings of a part that hold for the whole: not those about its own times."""
    return tuple(each for each in findings if not each.code.startswith("time-") or each.code in _OF_ALL_PARTS)


def _about_order(order: RowOrder) -> Iterator[Finding]:
    if order.lost:
        yield info(  # whether a gap matters is for identification to say
            "stream-gaps",
            f"{count_text(order.lost, 'row was', 'rows were')} lost in {count_text(order.gaps, 'gap')}.",
        )
    ways = ((order.repeated, "came twice"), (order.late, "came too late"))
    left_out = [f"{count_text(number, 'row')} that {how}" for number, how in ways if number]
    if left_out:
        yield info("stream-rows-left-out", f"Left out: {' and '.join(left_out)}.")
    if order.clock_wraps:
        yield info(
            "stream-clock-wraps",
            f"The clock of the stream wrapped {count_text(order.clock_wraps, 'time')}; the jumps are removed.",
        )
    if order.rate_changes:
        rates = ", ".join(f"{rate * 1e3:.4g} ms" for rate in order.rates)
        yield warning(
            "stream-rate-changes",
            f"The time between rows changed {count_text(order.rate_changes, 'time')}, to {rates}.",
        )
    if order.restarts:
        yield info(
            "stream-restarts",
            f"The clock of the stream started again {count_text(order.restarts, 'time')}; what follows is another recording.",
        )
