"""The signals besides Ctrl-C that ask a process to end: each stops the motor first."""

from __future__ import annotations

import signal

REQUESTS = {
    "SIGTERM": ", the system's or another program's request to end",
    "SIGHUP": ", as its terminal was closed",
    "SIGQUIT": ", as Ctrl-\\ was pressed",
    "SIGBREAK": ", a request to end",
    "SIGUSR1": ", another program's signal",
    "SIGUSR2": ", another program's signal",
    "SIGXCPU": ", as its share of the processor was used up",
}
"""The names of the signals that end a process in an orderly way, on all systems, and what each means."""


def requests_here() -> list[signal.Signals]:
    """Return those that this system has."""
    return [signal.Signals[name] for name in REQUESTS if name in signal.Signals.__members__]
