"""The process in which libraries read foreign files: `python -m servobench.recordings.loading.child`.

Each line of its standard input asks for one file; recordings, or the sentence that says why not, go to its standard output.
It ends with its input, and by anything that it doesn't expect: the program that started it says what that means.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
import warnings
from pathlib import Path
from typing import IO

from servobench.core.errors import FormatError, UsageError
from servobench.recordings.formats.base import read_here
from servobench.recordings.loading.transfer import send, send_line

try:
    import resource
except ImportError:  # Windows has none; there the parent's watch is all
    resource = None  # type: ignore[assignment]


def main() -> None:
    """Read files until standard input ends."""
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # Ctrl-C reaches all processes; the parent says what it means
    warnings.simplefilter("ignore")  # what matters of a library's warnings is a finding
    answers = _private_stdout()
    for line in sys.stdin:
        _answer(json.loads(line), answers)


def _private_stdout() -> IO[bytes]:
    """A private standard output: text that a library prints must not get between the answers."""
    ours = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    return ours


def _answer(request: dict[str, str | int], answers: IO[bytes]) -> None:
    path = Path(str(request["path"]))
    _limit(memory=int(request["memory"]), seconds=int(request["seconds"]))
    try:
        recordings = read_here(str(request["format"]), path)
    except OSError as error:
        sentence = f"{path} can't be read: {error.strerror or error}"
        send_line({"error": "FormatError", "sentence": sentence}, answers)
    except (FormatError, UsageError) as error:
        kind = "FormatError" if isinstance(error, FormatError) else "UsageError"
        send_line({"error": kind, "sentence": str(error)}, answers)
    else:
        send(recordings, answers)


def _limit(*, memory: int, seconds: int) -> None:
    """Limit this process to that much memory [bytes] and so much more CPU time [s], where the platform can."""
    if resource is None:
        return
    until = round(time.process_time()) + seconds
    no_dump = resource.RLIMIT_CORE, 0
    for limit, value in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, until), no_dump):
        most = resource.getrlimit(limit)[1]
        soft = value if most == resource.RLIM_INFINITY else min(value, most)
        resource.setrlimit(limit, (soft, most))


if __name__ == "__main__":
    main()
