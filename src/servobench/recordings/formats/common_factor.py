"""The common factor of a matrix as MATLAB displays it: a line `1.0e+03 *` above numbers that have to be multiplied by it."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from servobench.core.errors import FormatError
from servobench.core.finding import Finding, info

_FACTOR = re.compile(r"\s*(?P<factor>[0-9]\.[0-9]*e[+-]?[0-9]{1,3})\s*\*\s*", re.IGNORECASE)


def common_factor(content: Sequence[str], rows: NDArray[np.int64], name: str) -> tuple[int | None, float]:
    """Return the line of the factor, counted from 0, and the factor; None and 1 where the lines of a table have none.

    `rows` (N,) are the numbers of the lines in their file.

    Raises `FormatError`, which begins with the file's `name`, where there are several: which numbers each is for isn't known.
    """
    places = [k for k, line in enumerate(content) if "*" in line and _FACTOR.fullmatch(line)]
    if len(places) > 1:
        raise FormatError(
            f"{name}: rows {rows[places[0]]} and {rows[places[1]]} both give a common factor of the numbers below them "
            f"(`{content[places[0]].strip()}`); write the numbers with `writematrix`, or display them after `format long g`"
        )
    if not places:
        return None, 1.0
    match = _FACTOR.fullmatch(content[places[0]])
    return places[0], float(match["factor"]) if match else 1.0


def about_factor(factor: float, row: int) -> Finding:
    """Return the finding on a factor that stands in a row of the file."""
    sentence = (
        f"All numbers are multiplied by {factor:g}, the common factor in row {row}. MATLAB's display rounds them to a few "
        "digits; `writematrix` keeps all of them."
    )
    return info("common-factor", sentence, rows=(row, row))
