"""A recording in progress."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

from servobench.core.errors import ServobenchError
from servobench.core.finding import Severity
from servobench.panel.lease import Refusal
from servobench.panel.library import EXPERIMENT, RECORDING, About, Library, keep_about, replace_file
from servobench.panel.pump import Loop
from servobench.rig.experiment import Experiment
from servobench.rig.loop.recording_process import RecorderProcess, RecorderResult
from servobench.rig.loop.ring import RECORDER_STATE, ROWS_KEPT
from servobench.rig.loop.spec import DONE, FAILED

BY_HAND = "it was stopped by hand"


class Capture:
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
        self._until: int | None = None  # the number of the row that it was ended before
        self._ended_by = ""
        self._created = datetime.now().isoformat(timespec="seconds")

    async def begin(self) -> None:
        """Start the recorder; raises `StorageError`."""
        self._recorder = await asyncio.to_thread(self._start)
        if self._ended_by:  # it was ended meanwhile
            self.loop.end_recording()

    def _start(self) -> RecorderProcess:
        replace_file(self.folder / EXPERIMENT, self._experiment.to_toml())
        return self.loop.record_from(
            self._first, str(self.folder / RECORDING), self._experiment, self.duration
        )

    def end(self, why: str) -> None:
        """Let it end with the row that is the last one now; the first time counts."""
        if self._ended_by:
            return
        self._ended_by = why
        self._until = self.loop.ring.written
        if self._recorder is not None:
            self.loop.end_recording()

    def outcome(self) -> dict[str, Any]:
        """Return what became of it, once it is finished: its length [s], the one that was requested, and why it is shorter."""
        # Between the first row and the last there is a sample time less than was requested; a late tick is no early end.
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
        """Whether the recorder has ended, or has announced its end."""
        if self._recorder is None:
            return False
        return self.loop.ring.get(RECORDER_STATE) in (DONE, FAILED) or not self._recorder.running

    @property
    def samples(self) -> int:
        """The number of rows in the file."""
        return 0 if self._recorder is None else max(0, self.loop.ring.get(ROWS_KEPT) - self._first)

    def state(self) -> dict[str, Any]:
        """Return how far it is, as the pages see it: the length [s] of what belongs to it, and the rows in the file.

        A recorder on a busy machine takes seconds to begin; the rows wait for it in the ring, and are recorded all the same.
        """
        rows = (self.loop.ring.written if self._until is None else self._until) - self._first
        length = min(rows * self._experiment.sample_time, self.duration or math.inf)
        return {
            "name": self.folder.name,
            "length": length,
            "samples": self.samples,
            "duration": self.duration,
        }

    async def finish(self) -> str:
        """Wait for the recorder's end; return what went wrong, empty where nothing did."""
        if self._recorder is None:
            return "the recorder never started"
        went: RecorderResult = await asyncio.to_thread(self._recorder.wait)
        try:
            if went.error:
                await asyncio.to_thread(self._save_part)
            await asyncio.to_thread(self._keep_about)
        except ServobenchError as error:
            went = RecorderResult(path=None, rows=went.rows, error=went.error or str(error))
        return went.error

    def _save_part(self) -> None:
        """Make what was written before the recorder failed a whole file."""
        from servobench.recordings.native.recover import make_whole

        make_whole(self.folder / RECORDING)

    def _keep_about(self) -> None:
        known = about(
            self.folder / RECORDING, self._created, str(self._experiment.model_dump()["signal"]["type"])
        )
        self._length = known.duration
        keep_about(self.folder, known)


class Captures:
    """The recordings of a device: one at a time, `now`, in folders of a library.

    `changed` is called where one begins, `ended` with its outcome and what went wrong, empty where nothing did.
    """

    def __init__(
        self, library: Library, changed: Callable[[], None], ended: Callable[[Capture, str], None]
    ) -> None:
        self.now: Capture | None = None
        self._library = library
        self._changed = changed
        self._ended = ended
        self._making = False

    @property
    def name(self) -> str | None:
        """The name of the recording that is being made, if one is."""
        return None if self.now is None else self.now.folder.name

    async def begin(
        self, going_on: Callable[[], Loop], experiment: Experiment, name: str | None, duration: float | None
    ) -> str:
        """Begin a recording of the loop that `going_on` returns, for a duration [s] or until it is ended; return its name.

        Raises `Refusal` where one goes on, or `going_on` does, and as `Library.new`.
        """
        going_on()
        if self.now is not None or self._making:
            raise Refusal(f"{self.name or 'another recording'} is being recorded: end that first")
        self._making = True
        try:
            folder = await asyncio.to_thread(self._library.new, name)
            try:
                capture = self.now = Capture(going_on(), experiment, folder, duration)
                self._changed()
                await capture.begin()
            except ServobenchError:
                self.now = None
                await asyncio.to_thread(self._library.forget, folder)
                raise
        finally:
            self._making = False
        return folder.name

    def end(self, why: str) -> None:
        """Let the one that goes on, if one does, end with the row that is the last one now."""
        if self.now is not None:
            self.now.end(why)

    def look(self) -> None:
        """Take note of its end, where its recorder has ended."""
        if self.now is not None and self.now.over:
            self._end_task(self.now)

    async def finish(self, why: str) -> None:
        """Let it end, and wait for that."""
        if self.now is not None:
            self.now.end(why)
            await self._end_task(self.now)

    def _end_task(self, capture: Capture) -> asyncio.Task[None]:
        """The callback for a recording's end; it is called once."""
        if capture.ending is None:
            capture.ending = asyncio.get_running_loop().create_task(self._end(capture))
        return capture.ending

    async def _end(self, capture: Capture) -> None:
        error = await capture.finish()
        self.now = None
        self._ended(capture, error)


def about(path: Path, created: str, signal: str) -> About:
    """Return what is to be known of a native file without reading it; raises what `read` raises."""
    from servobench.recordings.native.reader import read

    recording = read(path)[0]
    t = recording.series[0].t
    length = 0.0 if t is None or not len(t) else float(t[-1] - t[0])
    return About(
        created=created,
        duration=length,
        samples=len(recording.series[0].values),
        signal=signal,
        warnings=tuple(each.sentence for each in recording.findings if each.severity is not Severity.INFO),
    )
