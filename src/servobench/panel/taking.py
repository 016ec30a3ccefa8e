"""A recording while it is made."""

from __future__ import annotations

import asyncio
from datetime import datetime
from pathlib import Path
from typing import Any

from servobench.errors import ServobenchError
from servobench.experiment import Experiment
from servobench.loop.recording_process import Recorded, RecorderProcess
from servobench.loop.ring import RECORDER_STATE, ROWS_KEPT
from servobench.loop.spec import DONE, FAILED
from servobench.panel.library import EXPERIMENT, RECORDING, About, keep_about, replace_file
from servobench.panel.pump import Loop

BY_HAND = "it was ended by hand"


class Taking:
    """Rows of a loop on their way into a run's folder, by a process of its own; `duration` [s] is None until it's ended."""

    def __init__(self, loop: Loop, experiment: Experiment, folder: Path, duration: float | None) -> None:
        self.loop = loop
        self.folder = folder
        self.duration = duration
        self.ending: asyncio.Task[None] | None = None
        self._experiment = experiment.model_copy(update={"duration": duration, "name": folder.name})
        self._recorder: RecorderProcess | None = None
        self._first = loop.ring.written
        self._length = 0.0  # s, of the file
        self._ended_by = ""
        self._created = datetime.now().isoformat(timespec="seconds")

    async def begin(self) -> None:
        """Start the recorder; raises `StorageError`."""
        replace_file(self.folder / EXPERIMENT, self._experiment.to_toml())
        self._recorder = await asyncio.to_thread(
            self.loop.record_from, self._first, str(self.folder / RECORDING), self._experiment, self.duration
        )

    def end(self, why: str) -> None:
        """Let it end with the row that is the last one now; the first reason that is given counts."""
        self._ended_by = self._ended_by or why
        self.loop.end_recording()

    def outcome(self) -> dict[str, Any]:
        """Return what became of it, once it is finished: its length [s], the one that was asked for, and why it is shorter."""
        # Between the first row and the last there is a sample time less than was asked for; a late tick is no early end.
        early = self.duration is not None and self._length < self.duration - 2 * self._experiment.sample_time
        by_hand = self.duration is None and self._ended_by == BY_HAND
        return {
            "name": self.folder.name,
            "length": self._length,
            "duration": self.duration,
            "early": self._ended_by if early or (self.duration is None and not by_hand) else "",
        }

    @property
    def over(self) -> bool:
        """Whether the recorder has ended, or says that it is about to."""
        if self._recorder is None:
            return False
        return self.loop.ring.get(RECORDER_STATE) in (DONE, FAILED) or not self._recorder.running

    @property
    def samples(self) -> int:
        """How many rows are in the file."""
        return 0 if self._recorder is None else max(0, self.loop.ring.get(ROWS_KEPT) - self._first)

    def state(self) -> dict[str, Any]:
        """Return how far it is, as the pages see it."""
        return {"name": self.folder.name, "samples": self.samples, "duration": self.duration}

    async def finish(self) -> str:
        """Wait for the recorder's end; return what went wrong, empty where nothing did."""
        if self._recorder is None:
            return "the recorder never began"
        went: Recorded = await asyncio.to_thread(self._recorder.wait)
        try:
            if went.error:
                await asyncio.to_thread(self._save_part)
            await asyncio.to_thread(self._keep_about)
        except ServobenchError as error:
            went = Recorded(path=None, rows=went.rows, error=went.error or str(error))
        return went.error

    def _save_part(self) -> None:
        """Make what was written before the recorder failed a whole file."""
        from servobench.recording.recover import make_whole

        make_whole(self.folder / RECORDING)

    def _keep_about(self) -> None:
        known = about(
            self.folder / RECORDING, self._created, str(self._experiment.model_dump()["signal"]["type"])
        )
        self._length = known.duration
        keep_about(self.folder, known)


def about(path: Path, created: str, signal: str) -> About:
    """Return what is to be known of a native file without reading it; raises what `read` raises."""
    from servobench.recording.reader import read

    recording = read(path)[0]
    t = recording.series[0].t
    length = 0.0 if t is None or not len(t) else float(t[-1] - t[0])
    return About(created=created, duration=length, samples=len(recording.series[0].values), signal=signal)
