"""The folder of a run: its files, and which folders may be used for one."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from servobench.cli.output_folder import make, make_folder, remove_if_empty
from servobench.core.errors import StorageError, UsageError
from servobench.recordings.native.lease import hold, is_held
from servobench.recordings.native.mcap_file import busy_text

if TYPE_CHECKING:
    from servobench.recordings.recording import Recording

_OURS = "# Written by `servobench run`"
_MAGIC = b"\x89MCAP0\r\n"


@dataclass(frozen=True)
class RunFolder:
    """The five files of a run in the folder `path`: what was requested, what happened (as a table, too), answer and report."""

    path: Path

    @property
    def experiment(self) -> Path:
        """The experiment, in full."""
        return self.path / "experiment.toml"

    @property
    def recording(self) -> Path:
        """The recording, complete."""
        return self.path / "recording.mcap"

    @property
    def part(self) -> Path:
        """The part that a killed run leaves in place of its recording, which marks the folder as incomplete."""
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
        """Remove what an earlier run left in the folder, and write the experiment's text.

        Files that no run writes stay. Raises `StorageError` where the folder can't be written.
        """
        try:
            for file in self.files:
                if file != self.experiment:  # it is locked, and written over
                    file.unlink(missing_ok=True)
            self._write_experiment(experiment)
        except OSError as error:
            raise StorageError(f"{self.path} can't be written: {error.strerror or error}") from error

    @contextmanager
    def reserve(self, overwrite: bool) -> Iterator[None]:
        """Keep other runs out until this one has written its last file; a folder in which nothing was recorded is removed.

        The lock is on the experiment's file. Raises `UsageError` where another run has the folder, or it holds files that no
        finished run wrote, or those of a run that isn't to be replaced (`overwrite`), and `StorageError` where it can't be
        written.
        """
        self._check()
        file, ours = None, False
        try:
            file = self._open_experiment()
            if not hold(file):
                raise UsageError(f"--out {self.path}: {busy_text(self.path)}")
            self._check()  # again, as another run may just have ended
            if self.recording.exists() and not overwrite:
                raise UsageError(
                    f"--out {self.path} holds an earlier run; give another folder, or --overwrite to replace it"
                )
            ours = True
            yield
        except BaseException as error:
            stopped = error if isinstance(error, KeyboardInterrupt) else None
            if (ours or stopped) and self._remove_if_empty(file) and stopped:
                raise _not_begun(stopped) from None
            raise
        finally:
            if file is not None:
                file.close()

    def _open_experiment(self) -> BinaryIO:
        """The experiment's file, open for writing, with the text that it has; a new one where there is none."""
        make(self.path, exist_ok=True)
        try:
            return self.experiment.open("a+b")
        except OSError as error:
            raise StorageError(f"{self.path} can't be written: {error.strerror or error}") from error

    def _remove_if_empty(self, experiment: BinaryIO | None) -> bool:
        """Return whether nothing was recorded; then remove the folder, unless it holds something else or belongs to another
        run.
        """
        if any(self.path.glob(f"{self.recording.name}*")):
            return False
        if experiment is None:  # interrupted on the way to it
            with suppress(OSError), self.experiment.open("r+b") as file:
                return self._remove_if_empty(file)
            remove_if_empty(self.path)
            return not self.path.exists()
        if not hold(experiment):
            return False
        if sys.platform == "win32":
            experiment.close()  # an open file can't be removed there
        with suppress(OSError):
            self.experiment.unlink(missing_ok=True)
        remove_if_empty(self.path)
        return True

    def _check(self) -> None:
        """Raise `UsageError` where a run may not write to this folder."""
        out = self.path
        if out.exists() and not out.is_dir():
            raise UsageError(f"--out {out} is a file; give a folder")
        if self.part.exists():
            if is_held(self.part):
                raise UsageError(f"--out {out}: {busy_text(self.part)}")
            raise UsageError(
                f"--out {out} holds the unfinished recording of an earlier run; save it with `servobench recover "
                f"{out}`, or remove {self.part.name}, or give another folder"
            )
        if out.is_dir() and not self._is_free():
            raise UsageError(
                f"--out {out} contains files and isn't the folder of an earlier run; give a new or empty folder"
            )

    def _is_free(self) -> bool:
        """Whether the folder holds only what runs write: an experiment, left by a run that never began."""
        entries = list(self.path.iterdir())
        if not entries:
            return True
        try:
            experiment = self.experiment.read_text(encoding="utf-8", errors="replace")
            if not experiment:
                return entries == [self.experiment]
            if not experiment.startswith(_OURS):
                return False
            with self.recording.open("rb") as file:
                return file.read(len(_MAGIC)) == _MAGIC
        except FileNotFoundError:
            return self.experiment.exists()
        except OSError:
            return False

    def make_whole(self) -> Recording:
        """Make a whole folder of what a killed run left: the recording as far as it is right, its table and the experiment.

        Where the recorder outlived the command the recording is whole, and the rest is made from it.
        Returns the recording, which says that it was cut short. Raises `UsageError` where the folder holds no unfinished
        recording, `FormatError` where nothing in it can be read, and `StorageError` where the folder can't be written.
        """
        from servobench.recordings.formats.base import save
        from servobench.recordings.native.reader import read
        from servobench.recordings.native.recover import make_whole

        if is_held(self.part):
            raise UsageError(busy_text(self.part))
        unfinished = self.part.exists()
        if not unfinished and (self.data.exists() or not self.recording.exists()):
            state = "is whole already" if self.recording.exists() else "is no folder of a run"
            raise UsageError(
                f"{self.path} holds no {self.part.name}, so it {state}: there is nothing to recover"
            )
        recording = read(self.part if unfinished else self.recording)[-1]
        save(recording, self.data)
        try:
            # What was watched, and not run, has none.
            if recording.experiment and not self.experiment.exists():
                self._write_experiment(recording.experiment)
        except OSError as error:
            raise StorageError(f"{self.path} can't be written: {error.strerror or error}") from error
        if unfinished:
            make_whole(self.recording)  # last, as the part marks the folder until everything is there
        return recording

    def _write_experiment(self, experiment: str) -> None:
        self.experiment.write_text(f"{_OURS}\n{experiment}", encoding="utf-8", newline="\n")

    def write_result(self, result: Mapping[str, Any]) -> None:
        """Write the answer, whole or not at all; raises `StorageError` where it can't be written."""
        text = json.dumps(result, indent=2, ensure_ascii=False, allow_nan=False)
        try:
            # A byte in a file's name that is no text has no UTF-8 either; its escape is JSON, too.
            self.result.write_text(text + "\n", encoding="utf-8", errors="backslashreplace", newline="\n")
        except OSError as error:
            with suppress(OSError):
                self.result.unlink(missing_ok=True)
            raise StorageError(f"{self.result} can't be written: {error.strerror or error}") from error


@contextmanager
def run_folder(out: Path | None, now: datetime, overwrite: bool = False) -> Iterator[RunFolder]:
    """Reserve the folder for a run: `out`, or a new one that is called after the time and that no other run gets.

    `out` may be new or empty, and where `overwrite` says so the folder of an earlier run, whose place the new run takes.
    Raises `UsageError` for a file, a folder that holds something else, one that another run writes to, and a run whose recording
    was never finished; `StorageError` where it can't be written.
    """
    folder = RunFolder(out or make_folder("run", now))
    with folder.reserve(overwrite):
        yield folder


def _not_begun(interrupt: KeyboardInterrupt) -> KeyboardInterrupt:
    from servobench.cli.failures import NotBegun
    from servobench.rig.loop.ticks import stop_text

    return NotBegun(stop_text(interrupt))
