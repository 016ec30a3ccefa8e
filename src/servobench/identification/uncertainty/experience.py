"""The errors of first-order models of other real motors: factors and relative floors.

Recordings of one motor disagree by more than any one of them can show of itself. `bench/real.py` tries intervals on recordings
of other motors, each against the others of its own; the figures here are those with which the intervals hold (decision 0036).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

RECORDINGS: Final = 171
MOTORS: Final = 24


@dataclass(frozen=True, kw_only=True)
class Experience:
    """The growth of intervals where a record shows that the model isn't the whole truth.

    `factor` multiplies what the residual says. The floors are standard deviations relative to the value: of the gain, of the lag
    (time constant + delay), of how the lag is split between the two (relative to the lag), and of the friction.

    Friction depends on the grease, its temperature and the load, and differs between recordings by far more than the gain does:
    by 11, 14, 23 and 35 % in the four families that state it. So far it is the one figure that no single family decides.
    """

    factor: float
    gain: float
    lag: float
    split: float
    friction: float


# Half-widths of 95 % intervals; the standard deviations that are used are those over 1.96.
SEVERAL_EVENTS: Final = Experience(factor=1.0, gain=0.01, lag=0.03, split=0.12, friction=0.25)
FEW_EVENTS: Final = Experience(factor=2.0, gain=0.015, lag=0.10, split=0.10, friction=0.25)
ONE_LEVEL: Final = Experience(factor=2.0, gain=0.015, lag=0.35, split=0.10, friction=0.05)
