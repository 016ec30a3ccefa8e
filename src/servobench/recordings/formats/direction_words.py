"""A column of words for the way a motor is driven, as boards print it beside a duty: F and R, CW and CCW."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, info

# Which of two turning senses is positive is a convention: the other one turns the gain's sign round.
_WORDS: Final = {
    **dict.fromkeys(("f", "fw", "fwd", "forward", "forwards", "cw"), 1.0),
    **dict.fromkeys(("r", "rev", "reverse", "bw", "bwd", "backward", "backwards", "ccw"), -1.0),
    **dict.fromkeys(("n", "neutral", "none", "stop", "stopped", "idle", "brake", "coast", ""), 0.0),
}


def is_direction(word: str) -> bool:
    """Return whether a word says which way a motor is driven, or that it isn't."""
    return word.strip().lower() in _WORDS


def signs_of(cells: Sequence[str]) -> Array | None:
    """Return 1, −1 and 0 (N,) for words of directions; None where another word is among them, or one way and none."""
    if not all(map(is_direction, cells)):
        return None
    signs = np.array([_WORDS[cell.strip().lower()] for cell in cells])
    ways = set(signs.tolist())
    # Beside a word for no way one way alone would be taken for the two states of a pin.
    return signs if {1.0, -1.0} <= ways or (len(ways) == 1 and signs.any()) else None


def about_direction(name: str, cells: Iterable[str]) -> Finding:
    """Return the finding on a column of such words, each of which is named with its sign."""
    words = sorted({cell.strip() for cell in cells} - {""}, key=lambda word: -_WORDS[word.lower()])
    read = ", ".join(f"{word!r} is read as {_WORDS[word.lower()]:g}".replace("-", "−") for word in words)
    return info("direction-words", f"`{name}` holds directions: {read}.")
