"""The state of a run at one finished tick."""

from __future__ import annotations

import math
from dataclasses import dataclass

from servobench.rig.clock import Tick


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A tick that is done: the `reference` followed, the voltages commanded and `applied` [V].

    `saturated` says that the two differ, as a limit stood in between. `received` is when the host had the sample, `handed` and
    `written` are when the device was given the voltage and when it had taken it, all three in the count of the clock's `elapsed`
    [s]. `command` is the number of the last command in force.
    """

    tick: Tick
    reference: float
    commanded: float
    applied: float
    saturated: bool
    received: float = math.nan
    handed: float = math.nan
    written: float = math.nan
    command: int = 0
