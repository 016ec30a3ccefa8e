"""The end of a process, as a sentence."""

from __future__ import annotations

import signal


def exit_text(status: int | None) -> str:
    """Return the end of a process with that exit status: "with status 3", "killed by SIGSEGV (segmentation fault)"."""
    if status is None or status >= 0:
        return f"with status {status}"
    try:
        number = signal.Signals(-status)
    except ValueError:  # a real-time signal has no name
        return f"killed by signal {-status}"
    meaning = signal.strsignal(number)
    return f"killed by {number.name}" + (f" ({meaning.lower()})" if meaning else "")
