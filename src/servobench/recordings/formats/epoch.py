"""Times that count from 1970: the size of the numbers gives their unit."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.units import unit

_FIRST, _LAST = 631_152_000, 4_102_444_800  # s: the beginnings of the years 1990 and 2100
_SLOWEST = 10.0  # s from one sample to the next


def epoch_unit(values: Array) -> str | None:
    """Return the unit, `s`, `ms`, `us` or `ns`, in which values (N,) are dates between 1990 and 2100; None where there is none.

    >>> epoch_unit(np.array([1709642096102, 1709642096112, 1709642096122]))
    'ms'
    """
    values = values[np.isfinite(values)]
    if len(values) < 2:
        return None
    low, high, step = float(values.min()), float(values.max()), float(np.median(np.abs(np.diff(values))))
    for symbol in ("s", "ms", "us", "ns"):
        factor = unit(symbol).factor
        if low * factor >= _FIRST and high * factor <= _LAST and step * factor <= _SLOWEST:
            return symbol
    return None
