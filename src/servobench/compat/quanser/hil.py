"""`HIL`, the interface to a board: what `quanser.hardware` is used for."""

from __future__ import annotations

from servobench.compat.quanser.immediate import Immediate
from servobench.compat.quanser.properties import Properties
from servobench.compat.quanser.task_calls import TaskCalls
from servobench.compat.quanser.watchdog_calls import WatchdogCalls


class HIL(Immediate, TaskCalls, Properties, WatchdogCalls):
    """A board with analog, encoder, digital, PWM and other channels.

    Arguments come as in C: an array of channels, their number, and an array of values.
    """
