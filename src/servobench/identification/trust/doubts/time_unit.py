"""Times that would be seconds of a motor that nobody has."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from servobench.core.finding import Finding, warning
from servobench.core.rounding import plain
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_SLOW = 0.5  # s between samples: no motor is recorded so slowly on purpose
_OR_ROWS = ", and if it numbers the rows, `sample_time=S` with the time from one to the next"
_SLOWEST = 2.5  # s: nor on purpose by anybody who gives the unit


def may_be_milliseconds(findings: Iterable[Finding], sample_time: float) -> bool:
    """Return whether times are seconds by convention only, by what reading them found, and the samples far apart [s]."""
    return sample_time >= _SLOW and any(finding.code == "time-recognised" for finding in findings)


def likely_unit(sample_time: float) -> tuple[str, str]:
    """Return the name and the symbol of the unit that times may be in where they put the samples so far apart [s].

    >>> likely_unit(1000.0)
    ('microseconds', 'us')
    """
    if 1e-6 * sample_time >= _SLOW:
        return "nanoseconds", "ns"
    return ("microseconds", "us") if 1e-3 * sample_time >= _SLOW else ("milliseconds", "ms")


def _of_each(records: Sequence[Dataset]) -> list[Finding]:
    return [finding for record in records for finding in _time_unit(record)]


def _time_unit(data: Dataset) -> list[Finding]:
    """Whether times in seconds, by convention or as somebody said, put the samples of a motor far apart."""
    by_convention = may_be_milliseconds(data.findings, data.sample_time)
    if not (by_convention or data.sample_time >= _SLOWEST):
        return []
    name, symbol = likely_unit(data.sample_time)
    sentence = (
        f"{data.name}: read in seconds{' by convention' if by_convention else ''}, the time column puts the samples "
        f"{plain(data.sample_time, 3)} s apart, which is slow for a motor; if it is in {name}, say "
        f"`time=COL:{symbol}`{_OR_ROWS if by_convention and data.sample_time == 1.0 else ''}."
    )
    return [warning("time-unit-doubtful", sentence, parameters=("gain", "time_constant", "delay"))]


DOUBTS.member("time_unit")(Doubt(codes=("time-unit-doubtful",), about_data=_of_each))
