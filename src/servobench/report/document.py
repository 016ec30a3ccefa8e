"""The noun `Report`: a result in one HTML file."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from servobench.core.arguments import check_type
from servobench.core.errors import StorageError
from servobench.identification.result import Result
from servobench.recordings.recording import Recording


@dataclass(frozen=True, eq=False)
class Report:
    """A result and its recordings as a page that opens from disk without a network.

    `recording` is one recording, several, or None if there are only datasets. `command` is the command that
    gave the result; without it the report builds one from the recordings.

    >>> import servobench as sb
    >>> with sb.connect("twin") as motor:
    ...     recording = sb.run(sb.Experiment(duration="3 s"), motor)
    >>> "<html" in Report(recording, sb.identify(recording)).html()
    True
    """

    recording: Recording | Sequence[Recording] | None
    result: Result
    command: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        check_type("result", self.result, Result, "a Result, which identify() returns")
        if self.recording is not None:
            for each in self.recording if isinstance(self.recording, Sequence) else (self.recording,):
                check_type("recording", each, Recording, "Recordings, which load() and run() return, or None")

    @property
    def recordings(self) -> tuple[Recording, ...]:
        """The recordings, none or several."""
        if self.recording is None:
            return ()
        return (self.recording,) if isinstance(self.recording, Recording) else tuple(self.recording)

    def html(self) -> str:
        """Return the page. The same report gives the same text."""
        from servobench.report.html import page

        text = page(self.result, self.recordings, self.command)
        # A name of a file may hold bytes that are no text.
        return text.encode("utf-8", "replace").decode("utf-8")

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the page to a file: all of it or, where that can't be done, nothing; an earlier file is replaced.

        Raises `StorageError`, which says why.
        """
        write_page(self.html(), path)


def write_page(html: str, path: str | os.PathLike[str]) -> None:
    """Write a page to a file: all of it or, where that can't be done, nothing; an earlier file is replaced.

    Raises `StorageError`, which says why.
    """
    target = Path(path)
    if target.is_dir():
        raise StorageError(
            f"{target} is a folder; expected the name of a file for the report, such as {target / 'report.html'}"
        )
    if not target.parent.is_dir():
        raise StorageError(f"{target} can't be written: there is no folder {target.parent}; make it first")
    try:
        _replace(target, html.encode("utf-8"))
    except OSError as error:
        raise StorageError(f"{target} can't be written: {error.strerror or error}") from error


def _replace(target: Path, content: bytes) -> None:
    """Write a file beside the target and give it the target's name once it's complete."""
    handle, part = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".part", dir=target.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        Path(part).chmod(0o666 & ~_umask())
        Path(part).replace(target)
    except BaseException:
        with suppress(OSError):
            Path(part).unlink()
        raise


def _umask() -> int:
    """The rights that new files don't get; it can only be read by setting it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
