"""An input in two columns, how large it is and which way it acts, as boards log a duty and the pin that reverses the bridge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.finding import Finding, info
from servobench.core.units import unit
from servobench.recordings.recording import Recording, Series

_AGREES = 0.8  # of the rows in motion: at a reversal the shaft goes on for a while
_BOTH = 0.05  # of them at least turn either way
_FEWEST = 20  # rows in motion


def with_sign(size: Series, direction: Series) -> tuple[Series, Finding]:
    """Return a series with the sign of another, which holds 1 and −1, or 1 and 0 for the two states of a pin.

    Of a motor that is driven one way it holds one of them.
    Raises `UsageError` for a direction of other values or of another length.
    """
    names = f"`{size.channel.name}` and `{direction.channel.name}`"
    if len(size.values) != len(direction.values):
        raise UsageError(
            f"{names} have {len(size.values)} and {len(direction.values)} rows; a sign needs as many rows as its column"
        )
    signs = _signs(direction.values)
    if signs is None:
        raise UsageError(
            f"`{direction.channel.name}` can't be the sign of `{size.channel.name}`: expected a column of 1 and −1, of 1 and 0, "
            "or of words such as F and R, or of one of them throughout"
        )
    channel = replace(
        size.channel,
        name=f"{size.channel.name}*{direction.channel.name}",
        minimum=None if size.channel.maximum is None else -size.channel.maximum,
    )
    low = "−1" if direction.values[np.isfinite(direction.values)].min() < 0 else "0"
    sentence = f"`{size.channel.name}` is positive where `{direction.channel.name}` is 1, and negative where it is {low}."
    return Series(channel=channel, values=size.values * signs, t=size.t), info("column-signed", sentence)


def missing_sign(recording: Recording, input: Series, output: Series) -> str:
    """Return the name of the column that plainly has the input's sign; empty where none does.

    The input is never negative, the output turns both ways, and the column says which in four rows of five.
    """
    moving = _motion_rows(input.values, output)
    if moving is None:
        return ""
    rows, rate = moving
    for each in recording.series:
        signs = _signs(each.values) if len(each.values) == len(input.values) else None
        if signs is None or len(np.unique(signs[np.isfinite(signs)])) < 2:
            continue
        agree = float(np.mean(signs[rows] == np.sign(rate)))
        if max(agree, 1.0 - agree) >= _AGREES:
            return each.channel.name
    return ""


def _motion_rows(u: Array, output: Series) -> tuple[np.ndarray, Array] | None:
    """The rows in which a positive input turns the shaft, and how fast; None where it turns one way or the input has signs."""
    if len(u) != len(output.values) or np.any(u < 0) or not output.channel.unit:
        return None
    y = output.values
    rate = np.gradient(y) if unit(output.channel.unit).quantity == "position" and len(y) > 1 else y
    rows = np.flatnonzero((u > 0) & np.isfinite(rate) & (rate != 0))
    if len(rows) < _FEWEST or not _BOTH < np.mean(rate[rows] > 0) < 1 - _BOTH:
        return None
    return rows, rate[rows]


def _signs(values: Array) -> Array | None:
    """Signs (N,), 1 or −1 and 0 between them, of a column that can be one; None of another."""
    states = set(np.unique(values[np.isfinite(values)]).tolist())
    if not (states and states <= {-1.0, 0.0, 1.0}):
        return None
    return values if -1.0 in states else np.where(values == 0.0, -1.0, values)
