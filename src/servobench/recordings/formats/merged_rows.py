"""Signals that a program merged into one table by their times: each row fills the column of one signal, the others are empty."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, info
from servobench.recordings.recording import Series

_SHARE = 0.95  # of the rows with a value of the input, in which the output has none
_LONGEST_PAUSE = 3.0  # median steps between the values of the input; a longer one is a gap


def are_merged(input: Series, output: Series) -> bool:
    """Return whether the rows of two series of one table belong to either of them, and the input comes regularly."""
    if input.t is None or output.t is None or not np.array_equal(input.t, output.t, equal_nan=True):
        return False
    has_input, has_output = np.isfinite(input.values), np.isfinite(output.values)
    if has_input.sum() < 2 or np.mean(~has_output[has_input]) < _SHARE:
        return False
    steps = np.diff(input.t[has_input & np.isfinite(input.t)])
    steps = steps[steps > 0]
    # The last value is only known to have held where none can have been lost.
    return len(steps) > 0 and bool(steps.max() <= _LONGEST_PAUSE * np.median(steps))


def about_merged_rows(input: Series, output: Series) -> Finding:
    """Return the finding on two series that are merged."""
    count = int(np.isfinite(input.values).sum())
    sentence = (
        f"No row holds both input and output: `{input.channel.name}` has a value in {count} of {len(input.values)} rows, which "
        f"holds until the next, and `{output.channel.name}` has its values in other rows."
    )
    return info("rows-merged", sentence)
