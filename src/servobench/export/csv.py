"""The parameters as a table: for spreadsheets, and for collecting many motors in one file."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from typing import ClassVar

from servobench.export.base import TARGETS, Wishes
from servobench.export.summary import ResultSummary

_HEADINGS = ("parameter", "value", "sd", "low", "high", "level", "unit", "state", "verdict")


@TARGETS.member("csv")
class Csv:
    """A row for each parameter and for each combination that is known where its parts aren't.

    Value, standard deviation, ends of the interval, unit, the state (known, combination, bounded, unknown) and the result's
    verdict. Unknown cells are empty.
    """

    suffix: ClassVar[str] = ".csv"
    wishes: ClassVar[frozenset[str]] = frozenset()

    def render(self, answer: ResultSummary, wishes: Wishes, stem: str) -> Mapping[str, bytes]:
        """Return the one file."""
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow(_HEADINGS)
        known = [(name, e, "known") for name, e in answer.combinations.items()]
        for name, e, state in [
            *((name, e, answer.states[name]) for name, e in answer.estimates.items()),
            *known,
        ]:
            numbers = [repr(x) if math.isfinite(x) else "" for x in (e.value, e.sd, *e.interval, e.level)]
            table.writerow([harmless(name), *numbers, harmless(e.unit), state, answer.verdict])
        return {f"{stem}.csv": text.getvalue().encode()}


def harmless(text: str) -> str:
    """Return a text as a cell that no spreadsheet takes for a formula: a quote before =, +, -, @, tab and return."""
    return f"'{text}" if text[:1] in {"=", "+", "-", "@", "\t", "\r"} else text
