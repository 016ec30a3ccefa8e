"""The child process that reads foreign files, from the parent's side."""

from __future__ import annotations

import atexit
import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any, cast

from servobench.core.errors import FormatError, UsageError
from servobench.recordings.formats.bag_folder import size_of
from servobench.recordings.formats.unpacking import most_bytes
from servobench.recordings.loading.transfer import recordings_from_pipe
from servobench.recordings.recording import Recording

_LIBRARIES = 2**30  # bytes; address space that Python and the libraries take before they read anything
_COPIES = 3  # of a file's content that are there at a time: as it is stored, as it is unpacked, and as floats
_SECONDS = 30  # for a file of any size, on a busy machine
_BYTES_A_SECOND = 1e6  # beyond that
_LOOK_EVERY = 0.02  # s
_LONGEST_LINE = 2**26  # bytes, of a description without samples
_ONE_THREAD = {
    "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "1",
    "ARROW_DEFAULT_MEMORY_POOL": "system",
}  # fmt: skip
"""So that libraries don't reserve address space for each core, which counts against the limit."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """The memory and time that reading one file may take."""

    memory: int
    """Of the child process [bytes]."""
    seconds: int
    """Until it has answered."""
    content: int
    """The limit for the size of the file's numbers [bytes]."""

    @property
    def too_long(self) -> str:
        """The sentence on a file that takes longer."""
        return f"its library takes longer than {self.seconds} s"

    @classmethod
    def of(cls, file: Path) -> Limits:
        """Return the limits for a file, by its size."""
        content, size = most_bytes(file), size_of(file)
        return cls(
            memory=_LIBRARIES + _COPIES * content,
            seconds=_SECONDS + round(size / _BYTES_A_SECOND),
            content=content,
        )


class ReaderProcess:
    """Reads foreign files in a child process, which is started when it is needed and again where it died; a context manager."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._errors: IO[bytes] | None = None
        self._one_at_a_time = threading.Lock()

    def __enter__(self) -> ReaderProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the child, whatever it does; it may be closed twice."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            for pipe in (process.stdin, process.stdout, self._errors):
                with suppress(BrokenPipeError):  # what was asked last may not have left
                    cast("IO[bytes]", pipe).close()
            process.wait()

    def read(self, format: str, file: Path) -> tuple[Recording, ...]:
        """Return the recordings in a file of a format; raises `FormatError` where it can't be read within the limits.

        Raises `UsageError` where its library isn't installed.
        """
        limits = Limits.of(file)
        with self._one_at_a_time:
            process = self._live_child()
            watch = _Watch(process.pid, limits)
            complete = False
            try:
                with watch:
                    reply = _reply(process, format, file, limits)
                    output = cast("IO[bytes]", process.stdout)
                    recordings = (
                        ()
                        if "error" in reply
                        else recordings_from_pipe(reply, output, limits.content, file.name)
                    )
                complete = True
            except (EOFError, OSError) as error:
                why = watch.verdict or self._last_words(limits)
                raise FormatError(f"{file.name} can't be read: {why}") from error
            finally:
                if not complete:
                    self.close()
        if "error" in reply:
            raise (FormatError if reply["error"] == "FormatError" else UsageError)(reply["sentence"])
        return recordings

    def _live_child(self) -> subprocess.Popen[bytes]:
        """The child; a new one where there is none, or it has died."""
        if self._process is not None and self._process.poll() is not None:
            self.close()
        if self._process is None:
            self._errors = TemporaryFile()  # noqa: SIM115 - closed with the child
            self._process = subprocess.Popen(
                # -P: nothing that lies in the user's folder counts as a module.
                [sys.executable, "-P", "-m", "servobench.recordings.loading.child"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                env={**os.environ, **_ONE_THREAD},
            )
        return self._process

    def _last_words(self, limits: Limits) -> str:
        """The reason why a child ended by itself."""
        process, errors = cast("subprocess.Popen[bytes]", self._process), cast("IO[bytes]", self._errors)
        status = process.wait()
        if hasattr(signal, "SIGXCPU") and status == -signal.SIGXCPU:
            return limits.too_long
        errors.seek(0)
        lines = errors.read().decode(errors="replace").split("\n")
        words = next((line.strip() for line in reversed(lines) if line.strip()), f"exit status {status}")
        words = signal.Signals(-status).name if status < 0 else words[:200]
        return f"the library that reads it crashed ({words})"


def _reply(process: subprocess.Popen[bytes], format: str, file: Path, limits: Limits) -> dict[str, Any]:
    """The child's reply on a file, before any samples; raises `EOFError` where it dies, `FormatError` for too much."""
    request = {
        "format": format,
        "path": str(file.absolute()),
        "memory": limits.memory,
        "seconds": limits.seconds,
    }
    pipe = cast("IO[bytes]", process.stdin)
    pipe.write(json.dumps(request).encode("ascii") + b"\n")
    pipe.flush()
    line = cast("IO[bytes]", process.stdout).readline(_LONGEST_LINE)
    if len(line) == _LONGEST_LINE:
        raise FormatError(f"{file.name} can't be read: its description takes more than {_LONGEST_LINE} bytes")
    if not line.endswith(b"\n"):
        raise EOFError
    reply: dict[str, Any] = json.loads(line)
    return reply


class _Watch:
    """Ends a process that takes more memory, or longer, than it may; `verdict` is the sentence that says so."""

    def __init__(self, pid: int, limits: Limits) -> None:
        self.verdict = ""
        self._pid = pid
        self._limits = limits
        self._answered = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._answered.set()
        self._thread.join()

    def _look(self) -> None:
        import psutil

        begun = time.monotonic()
        with suppress(psutil.NoSuchProcess):  # it has died by itself
            process = psutil.Process(self._pid)
            while not self._answered.wait(_LOOK_EVERY):
                if time.monotonic() - begun > self._limits.seconds:
                    self.verdict = self._limits.too_long
                elif process.memory_info().rss > self._limits.memory:
                    self.verdict = f"its library takes more than {self._limits.memory} bytes of memory"
                if self.verdict:
                    process.kill()
                    return


def the_reader() -> ReaderProcess:
    """Return the reader of this program, which ends with it."""
    return _reader_of(os.getpid())


@cache
def _reader_of(_: int) -> ReaderProcess:
    """The reader of a process: a copy of this one must not talk to the child of another."""
    reader = ReaderProcess()
    atexit.register(reader.close)
    return reader
