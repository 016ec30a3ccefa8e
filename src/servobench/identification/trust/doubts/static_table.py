"""A table of a static characteristic, read as if its rows were a sample time apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.finding import Finding, warning
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset


def _about(records: Sequence[Dataset]) -> list[Finding]:
    return [_finding(record) for record in records if _is_table(record)]


def _is_table(data: Dataset) -> bool:
    """Whether a file without times gives each row another input, in order from one sign to the other."""
    if all(finding.code != "sample-time-given" for finding in data.findings):
        return False
    steps = np.diff(data.u)
    through_zero = len(steps) > 0 and data.u[0] * data.u[-1] < 0
    return through_zero and bool((steps > 0).all() or (steps < 0).all())


def _finding(data: Dataset) -> Finding:
    sentence = (
        f"{data.name}: the file has no times, and its input goes in order from {data.u[0]:.3g} to "
        f"{data.u[-1]:.3g} with a new value in each row. It looks like a table of settled speeds, "
        "which has no dynamics; record steps with their times."
    )
    return warning("table-static", sentence, parameters=("gain", "time_constant", "delay"))


DOUBTS.member("static_table")(Doubt(codes=("table-static",), about_data=_about))
