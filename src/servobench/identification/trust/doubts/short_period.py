"""An input that repeats after a few rows: however long the record, it shows the motor in these few rows alone."""

from __future__ import annotations

from collections.abc import Sequence

from servobench.core.finding import Finding, warning
from servobench.core.rounding import count_text
from servobench.identification.estimators.repetition import period
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

# A motor's gain, time constant, delay, friction and offset are five numbers, and in steady motion a period has as many as rows.
_ROWS = 5


def repeats_soon(data: Dataset) -> bool:
    """Return whether the input repeats after five rows or fewer."""
    cycle = period(data)
    return cycle is not None and cycle.length <= _ROWS


def _about(records: Sequence[Dataset]) -> list[Finding]:
    cycles = [cycle for record in records if repeats_soon(record) and (cycle := period(record)) is not None]
    if len(cycles) < len(records):
        return []
    rows = count_text(cycles[0].length, "row")
    sentence = (
        f"The input repeats after {rows}: so many numbers are all that the record shows of the motor, and other time constants "
        "with other delays explain them as well. Record steps that last longer, or sample faster."
    )
    return [warning("period-short", sentence, parameters=("gain", "time_constant", "delay"))]


DOUBTS.member("short_period")(Doubt(codes=("period-short",), about_data=_about))
