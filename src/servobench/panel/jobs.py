"""Identifications in progress: how far they are, how long they will take, and how they are cancelled."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from servobench.core.errors import UnknownName, UsageError
from servobench.panel.work import IDENTIFYING, STAGES, Work

TELL_INTERVAL = 0.5  # s
_WAITING, _DONE = "waiting for its turn", "done"

Tell = Callable[[Mapping[str, Any]], None]


class JobEnded(UsageError):
    """The job was cancelled before it was done, or is running already."""


@dataclass
class _Job:
    """One identification: of which recording, with how many samples, when it was requested and what it does since when [s].

    `spent` is how long it has been at each stage [s]: without what was compiled within it, which is done once for all.
    """

    name: str
    samples: int
    asked: float = field(default_factory=lambda: time.monotonic())
    doing: str = _WAITING
    stage: str = _WAITING
    since: float = field(default_factory=lambda: time.monotonic())
    spent: dict[str, float] = field(default_factory=dict)
    ended: bool = False
    task: asyncio.Task[dict[str, Any]] | None = None

    def now(self, doing: str) -> None:
        """It does this from now on: a stage, or something else within the one before."""
        if self.doing == self.stage:
            self.spent[self.stage] = self.time_on_stage()
        self.doing, self.since = doing, time.monotonic()
        if doing in STAGES:
            self.stage = doing

    def time_on_stage(self) -> float:
        """For how long it has been at its stage [s]."""
        going = time.monotonic() - self.since if self.doing == self.stage else 0.0
        return self.spent.get(self.stage, 0.0) + going


class Jobs:
    """Has recordings identified, tells everybody how far that is, and learns from each how long the next one will take."""

    def __init__(self) -> None:
        self._going: dict[str, _Job] = {}
        self._pace: dict[str, float] = {}  # s of each stage last time; of identifying s for each sample

    async def identify(
        self, work: Work, tell: Tell, name: str, asked: Mapping[str, Any], samples: int
    ) -> dict[str, Any]:
        """Return the result of the work; raises what it raises, and `JobEnded` if it was cancelled or is running already."""
        if name in self._going:
            raise JobEnded(f"{name} is already being identified: wait, or end it")
        job = self._going[name] = _Job(name, samples)
        job.task = asyncio.ensure_future(work(asked, job.now))
        telling = asyncio.create_task(self._tell_often(job, tell))
        try:
            answer = await job.task
            self._learn(job)
            return answer
        except asyncio.CancelledError:
            if not job.ended:
                raise
            raise JobEnded(f"the identification of {name} was ended") from None
        finally:
            telling.cancel()
            del self._going[name]
            tell({"kind": "work", "name": name, "over": True})

    def end(self, name: str) -> None:
        """End an identification; raises `UnknownName` where none goes on."""
        job = self._going.get(name)
        if job is None or job.task is None:
            raise UnknownName("identification in progress", name, self._going)
        job.ended = True
        job.task.cancel()

    async def _tell_often(self, job: _Job, tell: Tell) -> None:
        while True:
            tell({"kind": "work", "name": job.name, **self._progress(job)})
            await asyncio.sleep(TELL_INTERVAL)

    def _progress(self, job: _Job) -> dict[str, Any]:
        """The progress: the step and its number of how many, the time that has passed, and the time that it will take, in s.

        That is what the last one took. Of a first one nobody knows it, nor of what is compiled, nor of one that takes longer.
        """
        left = None
        if job.doing in STAGES and all(stage in self._pace for stage in STAGES):
            here, *later = [self._expected_time(stage, job) for stage in STAGES[STAGES.index(job.doing) :]]
            rest = here - job.time_on_stage()
            left = rest + sum(later) if rest > 0 else None
        step = STAGES.index(job.stage) + 1 if job.stage in STAGES else 0
        seconds = time.monotonic() - job.asked
        return {"doing": job.doing, "step": step, "of": len(STAGES), "seconds": seconds, "left": left}

    def _expected_time(self, stage: str, job: _Job) -> float:
        return self._pace[stage] * (job.samples if stage == IDENTIFYING else 1)

    def _learn(self, job: _Job) -> None:
        job.now(_DONE)
        for stage in STAGES:
            lasted = job.spent.get(stage, 0.0)
            self._pace[stage] = lasted / max(1, job.samples) if stage == IDENTIFYING else lasted
