"""The verb inspect: what is in data, before anything is identified."""

from __future__ import annotations

from typing import Unpack

from servobench.recordings.formats.describe import Description, describe
from servobench.recordings.reading import ReadingOptions, recordings_meant


def inspect(data: object = None, **options: Unpack[ReadingOptions]) -> tuple[Description, ...]:
    """Return the contents of each recording in a file, a DataFrame, a recording, or a list of these.

    The contents are its channels and times, the input and output as far as stated or recognised, and the
    information still missing for an identification. `options` say how to read it, as for `identify`: see
    `ReadingOptions`. Raises `UsageError` for data that can't be read.

    >>> for each in inspect({"t": [0, 0.1, 0.2], "voltage": [0, 1, 1], "angle_deg": [0, 0, 1]}):
    ...     print(each.mapping.input, each.mapping.output)
    voltage:V angle_deg:deg
    """
    return tuple(describe(recording, mapping) for recording, mapping in recordings_meant(data, **options))
