"""The specification for the loop's process at its start, as one line of JSON on its standard input."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from json import dumps, loads
from typing import Literal, Self

WhenFaulted = Literal["end", "hold"]
COLUMNS = 16  # of the ring; a row fills the first of them

# What the words RECORDER_STATE and LOOP_STATE of the ring say.
# ASKED: a recorder was started and isn't attached yet; until it is, no other process removes the memory.
NO_RECORDER, RECORDING, FAILED, DONE, ASKED = 0, 1, 2, 3, 4
STARTING, RUNNING, ENDED = 0, 1, 2


@dataclass(frozen=True, kw_only=True)
class LoopSpec:
    """The experiment as TOML text, the names of the rings of rows, commands and events, and the rules of the run.

    `missed_go_on` lets a run go on that misses too many ticks, where no motor can come to harm.
    `recorded` says that a recorder reads the rows; where it fails the run ends, unless `unrecorded_goes_on`. `when_faulted` ends
    a run at a fault, or holds zero volts until it's acknowledged. `enabled` lets the controller's voltage through from the start.
    `operator_timeout` [s] ends the run if no operator has reported for that long; None if no operator is needed.
    `real_time` asks for real-time scheduling, on the processor `cpu` where it is given.
    """

    experiment: str
    rows: str
    commands: str
    events: str
    recorded: bool
    unrecorded_goes_on: bool = False
    missed_go_on: bool = False
    when_faulted: WhenFaulted = "end"
    enabled: bool = True
    operator_timeout: float | None = None
    real_time: bool = True
    cpu: int | None = None

    def to_line(self) -> str:
        """Return the spec as one line."""
        return dumps(asdict(self)) + "\n"

    @classmethod
    def from_line(cls, line: str) -> Self:
        """Return the spec in a line of ours."""
        return cls(**loads(line))
