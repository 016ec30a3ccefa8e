"""The new samples of an output, if a log repeats old values in between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from servobench.core.finding import Finding, info
from servobench.recordings.formats.stale import fresh_rows, stale
from servobench.recordings.measurement.column import Column


def drop_repeats(column: Column, findings: Sequence[Finding]) -> tuple[Column, list[Finding]]:
    """Return a column with the samples that were refreshed only, and the findings with one more where others were left out.

    A value that is repeated until the next one comes says nothing of its own time. Taken for a measurement it is late by half
    a hold in the mean, which no delay describes, and it counts one error as often as it is repeated.
    """
    how = stale(column.x)
    if how is None:
        return column, list(findings)
    rows = fresh_rows(column.x, how.hold)
    if column.x[rows[0]] == column.x[0]:
        # What stands from the first row on was so then, too, however old the value is.
        rows = np.union1d(0, rows)
    sentence = (
        f"{how.sentence(column.name, column.t)} Only the {len(rows)} of {len(column.x)} rows with a new value are "
        "used; the age of a new value becomes part of the delay."
    )
    fresh_column = replace(column, t=column.t[rows], x=column.x[rows], rows=column.rows[rows])
    return fresh_column, [*findings, info("output-stale", sentence, parameters=("delay",))]
