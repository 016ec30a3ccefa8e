"""The folder of a run: what is in it, and which folder may be used for one."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Any

from servobench.errors import StorageError, UsageError

if TYPE_CHECKING:
    from servobench.recording.recording import Recording

_OURS = "# Written by `servobench run`"
_MAGIC = b"\x89MCAP0\r\n"


@dataclass(frozen=True)
class RunFolder:
    """The five files of a run in the folder `path`: what was asked for, what happened (as a table, too), answer and report."""

    path: Path

    @property
    def experiment(self) -> Path:
        """What was asked for, in full."""
        return self.path / "experiment.toml"

    @property
    def recording(self) -> Path:
        """What happened, with nothing left out."""
        return self.path / "recording.mcap"

    @property
    def part(self) -> Path:
        """What a run that was killed leaves in place of its recording, which marks the folder as not whole."""
        return self.recording.with_name(f"{self.recording.name}.part")

    @property
    def data(self) -> Path:
        """The same as a text table."""
        return self.path / "data.csv"

    @property
    def result(self) -> Path:
        """The answer as JSON."""
        return self.path / "result.json"

    @property
    def report(self) -> Path:
        """The report, one page that opens without a network."""
        return self.path / "report.html"

    @property
    def files(self) -> tuple[Path, ...]:
        """All five."""
        return (self.experiment, self.recording, self.data, self.result, self.report)

    def begin(self, experiment: str) -> None:
        """Make the folder, remove what an earlier run left in it, and write the experiment's text.

        Files that no run writes stay. Raises `StorageError` where the folder can't be written.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            for file in self.files:
                file.unlink(missing_ok=True)
            self._write_experiment(experiment)
        except OSError as error:
            raise StorageError(f"{self.path} can't be written: {error.strerror or error}") from error

    @contextmanager
    def begun(self, experiment: str) -> Iterator[None]:
        """Begin, and take it back where nothing was recorded: a device that can't be opened leaves no folder."""
        from servobench.cli.failures import NotBegun
        from servobench.loop.ticks import stopped_by

        try:
            self.begin(experiment)
            yield
        except BaseException as error:
            if not any(self.path.glob(f"{self.recording.name}*")):
                with suppress(OSError):
                    self.experiment.unlink(missing_ok=True)
                    self.path.rmdir()  # only where nothing else is in it
                if isinstance(error, KeyboardInterrupt):
                    raise NotBegun(stopped_by(error)) from None
            raise

    def make_whole(self) -> Recording:
        """Make a whole folder of what a killed run left: the recording as far as it is right, its table and the experiment.

        Where the recorder outlived the command the recording is whole, and the rest is made from it.
        Returns the recording, which says that it was cut short. Raises `UsageError` where the folder holds no unfinished
        recording, `FormatError` where nothing in it can be read, and `StorageError` where the folder can't be written.
        """
        from servobench.formats.base import save
        from servobench.recording.lease import is_held
        from servobench.recording.mcap_file import being_written
        from servobench.recording.reader import read
        from servobench.recording.recover import make_whole

        if is_held(self.part):
            raise UsageError(being_written(self.part))
        unfinished = self.part.exists()
        if not unfinished and (self.data.exists() or not self.recording.exists()):
            state = "is whole already" if self.recording.exists() else "is no folder of a run"
            raise UsageError(
                f"{self.path} holds no {self.part.name}, so it {state}: nothing is to be recovered"
            )
        recording = read(self.part if unfinished else self.recording)[-1]
        save(recording, self.data)
        try:
            if not self.experiment.exists():
                self._write_experiment(recording.experiment)
        except OSError as error:
            raise StorageError(f"{self.path} can't be written: {error.strerror or error}") from error
        if unfinished:
            make_whole(self.recording)  # last, as the part marks the folder until everything is there
        return recording

    def _write_experiment(self, experiment: str) -> None:
        self.experiment.write_text(f"{_OURS}\n{experiment}", encoding="utf-8", newline="\n")

    def write_result(self, result: Mapping[str, Any]) -> None:
        """Write the answer."""
        text = json.dumps(result, indent=2, ensure_ascii=False, allow_nan=False)
        # A byte in a file's name that is no text has no UTF-8 either; its escape is JSON, too.
        self.result.write_text(text + "\n", encoding="utf-8", errors="backslashreplace", newline="\n")


def run_folder(out: Path | None, now: datetime) -> RunFolder:
    """Return the folder for a run: `out`, or a new one that is called after the time.

    `out` may be new, empty, or the folder of an earlier run, whose place the new run takes.
    Raises `UsageError` for a file, a folder that holds something else, and a run whose recording was never finished.
    """
    if out is None:
        return RunFolder(_fresh(now))
    folder = RunFolder(out)
    if out.exists() and not out.is_dir():
        raise UsageError(f"--out {out}: is a file; give a folder")
    if folder.part.exists():
        from servobench.recording.lease import is_held
        from servobench.recording.mcap_file import being_written

        if is_held(folder.part):
            raise UsageError(f"--out {out}: {being_written(folder.part)}")
        raise UsageError(
            f"--out {out}: holds the unfinished recording of an earlier run; keep what is in it with "
            f"`servobench recover {out}`, or remove {folder.part.name}, or give another folder"
        )
    if out.is_dir() and any(out.iterdir()) and not _is_ours(folder):
        raise UsageError(
            f"--out {out}: holds files, and isn't the folder of an earlier run; give a new or an empty folder"
        )
    return folder


def _fresh(now: datetime) -> Path:
    """A name that nothing has yet."""
    name = f"run-{now:%Y%m%d-%H%M%S}"
    candidates = chain([Path(name)], (Path(f"{name}-{again}") for again in count(2)))
    return next(path for path in candidates if not path.exists())


def _is_ours(folder: RunFolder) -> bool:
    """Whether a run has written the folder; one that never began has no recording."""
    try:
        if not folder.experiment.read_text(encoding="utf-8", errors="replace").startswith(_OURS):
            return False
        with folder.recording.open("rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except FileNotFoundError:
        return folder.experiment.exists()
    except OSError:
        return False
