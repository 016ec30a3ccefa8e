"""The status of the loop as it reports it: what is active, what is wrong, and what was late."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from servobench.panel.pump import News
from servobench.rig.experiment import Experiment
from servobench.rig.loop.messages import Command, Notice

_LIMITED_FOR = 0.5  # s for which a limit's light stays on


@dataclass
class LoopStatus:
    """The messages of a loop since it began.

    `enabled`: whether it lets the controller's voltage through. `fault` has the fault that holds it, by texts; None without one.
    `late` and `missed` count ticks. `heard` is the number of the last command that it has taken,
    `last_enable` that of the last one that asks for a voltage, `command` of the one in force in the last row that came.
    `limited` says whether the limits' light is on, `limited_until` the time [s] until which it is. `stopped` says who or what
    stopped the motor, until somebody starts it.
    """

    enabled: bool = False
    fault: dict[str, str] | None = None
    late: int = 0
    missed: int = 0
    command: int = 0
    heard: int = 0
    last_enable: int = 0
    limited: bool = False
    limited_until: float = 0.0
    stopped: str = ""

    @property
    def rests(self) -> bool:
        """Whether it is certain to put out zero volts."""
        return not self.enabled and self.heard >= self.last_enable

    def count(self, news: News) -> bool:
        """Take note of what was late and missed; return whether that is more than before."""
        counts = (news.late, news.missed)
        changed = counts != (self.late, self.missed)
        self.late, self.missed = counts
        return changed

    def see(self, news: News) -> bool:
        """Take note of rows, of which there is one at least; return whether the limits' light went on or off."""
        self.command = int(news.values[-1, -1])
        if not math.isnan(news.limited):
            self.limited_until = news.limited + _LIMITED_FOR
        before, self.limited = self.limited, bool(news.values[-1, 0] < self.limited_until)
        return self.limited != before

    def hear(self, event: Notice) -> Command | None:
        """Register the loop's answer to a command; return the command in force from then on, None if it was refused."""
        about = event.about
        self.heard = max(self.heard, about["number"] or 0)
        if not about["accepted"]:
            return None
        taken = Command(**about["what"])
        if taken.enabled is not None:
            self.enabled = taken.enabled
        return taken

    def limits(self, experiment: Experiment) -> list[dict[str, str]]:
        """Return the limits that act in the newest rows, with a sentence each."""
        if not self.limited:
            return []
        limit = experiment.limits.voltage
        sentence = f"The voltage is lower than commanded: the limit is ±{limit:g} V or less."
        return [{"code": "saturated", "sentence": sentence}]


def reply_data(event: Notice) -> dict[str, Any]:
    """Return the message to pages about the loop's answer to a command."""
    about = event.about
    return {
        "kind": "applied",
        "number": about["number"],
        "tick": event.tick,
        "time": event.time,
        "accepted": about["accepted"],
        "what": about["what"],
        "why": about["why"],
    }


def with_changes(experiment: Experiment, taken: Command) -> Experiment:
    """Return the experiment as it is carried on from a command on."""
    names = ("signal", "controller", "chain")
    return experiment.model_copy(
        update={name: value for name in names if (value := getattr(taken, name)) is not None}
    )
