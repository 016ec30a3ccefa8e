"""The verb inspect: what is in data, before anything is identified."""

from __future__ import annotations

from servobench.recordings.adapters.base import recordings_in
from servobench.recordings.formats.describe import Description, describe


def inspect(data: object) -> tuple[Description, ...]:
    """Return what is in each recording of a file, a DataFrame, a recording, or a list of such.

    Its channels and times, which of them are recognised as input and output, and what has to be said before it can be identified.
    Raises `UsageError` for what can't be read.

    >>> for each in inspect({"t": [0, 0.1, 0.2], "voltage": [0, 1, 1], "angle_deg": [0, 0, 1]}):
    ...     print(each.mapping.input, each.mapping.output)
    voltage:V angle_deg:deg
    """
    return tuple(describe(each) for each in recordings_in(data))
