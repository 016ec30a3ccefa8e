"""The end of a failing command: an error message, and the exit status for its kind of error."""

from __future__ import annotations

import errno
import os
import platform
import sys
import tempfile
import traceback
from contextlib import suppress

from rich.text import Text

from servobench._version import __version__
from servobench.cli.option_names import with_options
from servobench.cli.terminal import OutputGone, messages, one_line, printable
from servobench.core.errors import MissingInformation, ServobenchError, UnknownName

DONE = 0
OUR_FAULT = 1
USER_MISTAKE = 2
REFUSED = 3
DEVICE_FAILED = 4
CANNOT_WRITE = 5
FAILED_LIMITS = 6
UNDECIDED = 7
INTERRUPTED = 130

_NO_PLACE = {
    getattr(errno, name) for name in ("ENOSPC", "EDQUOT", "EFBIG", "EROFS", "EIO") if hasattr(errno, name)
}


class NotBegun(KeyboardInterrupt):
    """A run that was stopped before it began; the text says by whom."""


class PartialStop(KeyboardInterrupt):
    """A command that was stopped when a part was done; the text says what is kept, and what to do."""


def report_failure(error: BaseException, *, debug: bool = False) -> int:
    """Say what went wrong on standard error, and return the exit status.

    A mistake of the user, a device or a disk that failed get a sentence. An error of ours gets one as well, and its traceback
    goes to a file; with `debug` the traceback is shown for any error.
    """
    status, sentence = _status_and_sentence(error)
    with suppress(OSError):  # if nothing reads the messages, the exit status still reports it
        if debug:
            messages().out("".join(traceback.format_exception(error)), highlight=False)
        if status == OUR_FAULT:
            sentence = f"{sentence}; {_traceback_place(error)}"
        if sentence:
            complain(sentence)
    return status


def complain(sentence: str) -> None:
    """Say on standard error what went wrong."""
    # Not wrapped: a path or a column's name is to be found again in a log.
    text = printable(with_options(sentence))
    messages().print(Text.assemble(("Error: ", "bold red"), text), soft_wrap=True)


def flush_output(status: int) -> int:
    """Return the exit status of a command once all of its output is away, another one where it can't be."""
    try:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
    except OSError as error:
        _forget_output()
        return report_failure(OutputGone() if isinstance(error, BrokenPipeError) else error)
    return status


def _status_and_sentence(error: BaseException) -> tuple[int, str]:
    """The exit status of an error, and the sentence to say."""
    if isinstance(error, OutputGone | BrokenPipeError):
        return CANNOT_WRITE, ""
    if isinstance(error, NotBegun):
        return INTERRUPTED, f"{error} before the run began; nothing was recorded"
    if isinstance(error, PartialStop):
        return INTERRUPTED, str(error)
    if isinstance(error, KeyboardInterrupt):
        return INTERRUPTED, "interrupted before there was a result; complete files are kept"
    if isinstance(error, MissingInformation):
        return USER_MISTAKE, _list_of(str(error).splitlines()[0], error.missing)
    if isinstance(error, UnknownName):
        return error.exit_status, one_line(str(error))
    if isinstance(error, ServobenchError) and error.exit_status != OUR_FAULT:
        return error.exit_status, str(error)
    if isinstance(error, MemoryError):
        return (
            USER_MISTAKE,
            "there isn't enough memory for this; use shorter recordings, or fewer at a time",
        )
    if isinstance(error, OSError) and (error.filename or error.errno in _NO_PLACE):
        what = f"{error.filename}: " if error.filename else "the output can't be written: "
        status = CANNOT_WRITE if error.errno in _NO_PLACE else USER_MISTAKE
        return status, f"{what}{error.strerror or error}"
    return OUR_FAULT, f"a fault of servobench, not yours: {type(error).__name__}: {_first_line(error)}"


def _list_of(heading: str, sentences: tuple[str, ...]) -> str:
    return "\n".join([heading, *(f"  • {one_line(sentence)}" for sentence in sentences)])


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or ["no details"])[0]


def _traceback_place(error: BaseException) -> str:
    """The place of the traceback of an error of ours, as the end of a sentence; the traceback itself where it can't be kept."""
    trace = "".join(traceback.format_exception(error))
    about = (
        f"servobench {__version__}, Python {platform.python_version()}, {platform.platform()}\n{sys.argv}\n\n"
    )
    try:
        with tempfile.NamedTemporaryFile(
            "w",
            prefix="servobench-",
            suffix=".txt",
            encoding="utf-8",
            errors="backslashreplace",
            delete=False,
        ) as file:
            file.write(about + trace)
    except OSError:
        return f"please report it with these lines:\n{about}{trace}"
    return f"please report it with the file {file.name}"


def _forget_output() -> None:
    """Let what is still in the buffers go nowhere; otherwise the interpreter complains about it when it ends."""
    with suppress(OSError):  # a stream that stands for another one, as in a test, has no number
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
