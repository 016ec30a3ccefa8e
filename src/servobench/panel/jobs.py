"""Identifications while they are made: how far they are, how long they will take, and how they are ended before that."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from servobench.errors import UnknownName, UsageError
from servobench.panel.work import IDENTIFYING, STAGES, Work

TELL_INTERVAL = 0.5  # s
_WAITING = "waiting for its turn"

Tell = Callable[[Mapping[str, Any]], None]


class Ended(UsageError):
    """What was asked for was ended by somebody before it was done; or it goes on already."""


@dataclass
class _Job:
    """One identification: of which recording, with how many samples; `begun` says when each of its stages began [s]."""

    name: str
    samples: int
    begun: dict[str, float] = field(default_factory=dict)
    ended: bool = False
    task: asyncio.Task[dict[str, Any]] | None = None

    def now(self, doing: str) -> None:
        """It does this from now on."""
        self.begun[doing] = time.monotonic()


class Jobs:
    """Has recordings identified, tells everybody how far that is, and learns from each how long the next one will take."""

    def __init__(self) -> None:
        self._going: dict[str, _Job] = {}
        self._pace: dict[str, float] = {}  # s of each stage last time; of identifying s for each sample

    async def identify(
        self, work: Work, tell: Tell, name: str, asked: Mapping[str, Any], samples: int
    ) -> dict[str, Any]:
        """Return what the work brings; raises what it raises, and `Ended` where somebody ended it, or it goes on already."""
        if name in self._going:
            raise Ended(f"{name} is being identified already: wait for that, or end it")
        job = self._going[name] = _Job(name, samples)
        job.now(_WAITING)
        job.task = asyncio.ensure_future(work(asked, job.now))
        telling = asyncio.create_task(self._tell_often(job, tell))
        try:
            answer = await job.task
            self._learn(job)
            return answer
        except asyncio.CancelledError:
            if not job.ended:
                raise
            raise Ended(f"the identification of {name} was ended") from None
        finally:
            telling.cancel()
            del self._going[name]
            tell({"kind": "work", "name": name, "over": True})

    def end(self, name: str) -> None:
        """End an identification; raises `UnknownName` where none goes on."""
        job = self._going.get(name)
        if job is None or job.task is None:
            raise UnknownName("identification that goes on", name, self._going)
        job.ended = True
        job.task.cancel()

    async def _tell_often(self, job: _Job, tell: Tell) -> None:
        while True:
            tell({"kind": "work", "name": job.name, **self._progress(job)})
            await asyncio.sleep(TELL_INTERVAL)

    def _progress(self, job: _Job) -> dict[str, Any]:
        """What it does, for how long it has gone on, and how long it will take if it goes like the last one, all in s."""
        now = time.monotonic()
        doing = list(job.begun)[-1]
        left = None
        if doing in STAGES and all(stage in self._pace for stage in STAGES):
            here, *later = [self._expected(stage, job) for stage in STAGES[STAGES.index(doing) :]]
            rest = here - (now - job.begun[doing])
            left = rest + sum(later) if rest > 0 else None  # it takes longer than the last one: nobody knows
        return {"doing": doing, "seconds": now - job.begun[_WAITING], "left": left}

    def _expected(self, stage: str, job: _Job) -> float:
        return self._pace[stage] * (job.samples if stage == IDENTIFYING else 1)

    def _learn(self, job: _Job) -> None:
        times = [*job.begun.values(), time.monotonic()]
        for k, stage in enumerate(job.begun):
            lasted = times[k + 1] - times[k]
            self._pace[stage] = lasted / max(1, job.samples) if stage == IDENTIFYING else lasted
