"""A column of a recording on its way into a dataset: finite samples at increasing times, in a known unit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array, Channel
from servobench.core.errors import MissingInformation, UsageError
from servobench.core.finding import Finding, info
from servobench.core.rounding import count_text
from servobench.core.units import unit as unit_named
from servobench.recordings.recording import Recording, Series

_WHOLE = 2.0**53  # beyond it a float can't tell one whole number from the next


@dataclass(frozen=True, kw_only=True, eq=False)
class Column:
    """Samples `x` (N,) in `unit` at increasing times `t` (N,) [s]; `rows` (N,) are their numbers in the recording, from 1.

    `name` is the channel's. `quantum` is the smallest step of x, in `unit`, where it is known.
    """

    name: str
    t: Array
    x: Array
    unit: str
    rows: NDArray[np.int64]
    quantum: float | None = None

    @property
    def quantity(self) -> str:
        """The quantity that the unit measures."""
        return unit_named(self.unit).quantity

    def times(self, factor: float, unit: str) -> Column:
        """Return the same samples times a factor, in another unit."""
        quantum = None if self.quantum is None else abs(factor) * self.quantum
        return replace(self, x=factor * self.x, unit=unit, quantum=quantum)

    def in_si(self) -> Column:
        """Return the same samples in SI units; a unit of a quantity that has no name here stays as it is."""
        return self.times(*si_factor(self.unit))


def si_factor(symbol: str) -> tuple[float, str]:
    """Return the factor from a unit to the SI unit of the same quantity, and that unit; where there is none, 1 and the unit."""
    unit = unit_named(symbol)
    return (1.0, unit.symbol) if unit.quantity == "other" else (unit.factor, unit.si)


def input_and_output(recording: Recording) -> tuple[Series, Series]:
    """Return the series of the input and the output.

    Raises `MissingInformation` where a channel, a unit or times aren't known, with a sentence for each of them.
    """
    missing: list[str] = []
    named = {"input": recording.input, "output": recording.output}
    channels = ", ".join(repr(series.channel.name) for series in recording.series)
    for role, name in named.items():
        what = "what drives the motor" if role == "input" else "what was measured on its shaft"
        example = "V" if role == "input" else "rad"
        if name is None:
            missing.append(
                f"which channel is the {role}, {what}: say `{role}=COL[:UNIT]`; there are {channels}"
            )
        elif recording[name].channel.unit is None:
            missing.append(
                f"the unit of the {role} {name!r}: say `{role}={name}:UNIT`, such as {name}:{example}"
            )
    known = [name for name in named.values() if name is not None]
    if any(recording[name].t is None for name in known):
        missing.append(
            "the times of the samples: say `time=COL[:UNIT]`, or `sample_time=S` where they are evenly spaced"
        )
    if missing or recording.input is None or recording.output is None:
        raise MissingInformation(recording.name, missing)
    return recording[recording.input], recording[recording.output]


def finite_column(
    recording: Recording, series: Series, role: Literal["input", "output"]
) -> tuple[Column, list[Finding]]:
    """Return the finite samples of a channel, and a finding where others had to be left out.

    Raises `UsageError` where nothing is left, or times don't increase.
    """
    t, x, name = series.t, series.values, series.channel.name
    if t is None or series.channel.unit is None:
        raise MissingInformation(recording.name, [f"the times and the unit of {name!r}"])
    finite = np.isfinite(t) & np.isfinite(x)
    rows = np.flatnonzero(finite) + 1
    if not len(rows):
        raise UsageError(f"{recording.name}: the {role} {name!r} has no row with a number and a time")
    column = Column(
        name=name,
        t=np.asarray(t[finite], dtype=np.float64),
        x=np.asarray(x[finite], dtype=np.float64),
        unit=series.channel.unit,
        rows=rows,
    )
    _check_times(recording.name, role, column)
    return column, _omission(role, name, np.flatnonzero(~finite) + 1, len(x))


def _omission(role: str, name: str, rows: NDArray[np.int64], total: int) -> list[Finding]:
    if not len(rows):
        return []
    share = f"{len(rows)} of {total} rows of the {role} {name!r}"
    sentence = f"{share} have no finite value or time and are left out, the first of them row {rows[0]}."
    return [info("rows-left-out", sentence, rows=(int(rows[0]), int(rows[-1])))]


def _check_times(source: str, role: str, column: Column) -> None:
    backwards = np.flatnonzero(np.diff(column.t) <= 0.0)
    if not len(backwards):
        return
    k, where = int(backwards[0]), count_text(len(backwards), "place")
    raise UsageError(
        f"{source}: the times of the {role} {column.name!r} don't increase in {where}, the first from row "
        f"{column.rows[k]} ({column.t[k]:.9g} s) to row {column.rows[k + 1]} ({column.t[k + 1]:.9g} s); "
        "name the right column with `time=...`, or remove the repeated rows"
    )


def counter_column(column: Column, channel: Channel) -> Column:
    """Return counts at the middle of their bins, with their quantum; what isn't whole counts stays as it is.

    A counter shows floor(θ/Q), so that the shaft is on average half a count further than it says: y = (counts + 1/2) Q,
    which follows from counts ≤ θ/Q < counts + 1.
    Where the recording knows the counts in a revolution, the result is in rad, otherwise in counts.
    """
    if (
        column.quantity == "position"
        and np.all(np.abs(column.x) < _WHOLE)
        and np.all(column.x == np.rint(column.x))
    ):
        column = replace(column, x=column.x + 0.5, quantum=1.0)
    if channel.counts_per_rev is None:
        return column
    return column.times(
        2.0 * np.pi / channel.counts_per_rev, "rad" if column.quantity == "position" else "rad/s"
    )
