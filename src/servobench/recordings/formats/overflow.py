"""Times of a counter that overflowed and began again at zero."""

from __future__ import annotations

from servobench.core.units import unit

_BITS = (16, 32)
_UNITS = {"us": "microseconds", "ms": "milliseconds", "ns": "nanoseconds"}
_STEPS = 3  # from the last time before to the first one after: a sample or two may be lost
_FEWEST = 20  # samples between two overflows; of fewer any step back looks like one


def counter_of_overflow(before: float, after: float, step: float) -> str | None:
    """Return which counter overflows from the time `before` to `after` with steps of `step` [s]; None where none does.

    >>> counter_of_overflow(65.53, 0.004, 0.01)
    '16-bit counter of milliseconds'
    """
    for bits in _BITS:
        for symbol, name in _UNITS.items():
            full = 2.0**bits * unit(symbol).factor
            if full >= _FEWEST * step and 0 <= after < _STEPS * step and 0 < full - before < _STEPS * step:
                return f"{bits}-bit counter of {name}"
    return None
