"""The verb `run` for a motor that turns in real time: the loop in its own process, recorded by another."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Literal

from servobench.experiment import Experiment
from servobench.loop.process import LoopProcess
from servobench.loop.recorder import InMemory
from servobench.loop.run import LOOK_INTERVAL, WATCH_INTERVAL, Look, Progress, Watch
from servobench.loop.ticks import stopped_by
from servobench.recording.recording import Recording, Stopped


def run_live(
    experiment: Experiment,
    *,
    to: str | os.PathLike[str],
    watch: Watch | None = None,
    look: Look | None = None,
    say: Callable[[str], None] | None = None,
    real_time: bool = True,
) -> Recording:
    """Carry out an experiment on the device that it names, in a process of its own, recorded to the native file `to`.

    As `run`, but nothing in this process can hold the loop up: `watch` and `look` see what the loop handed on; `say` is
    told what is waited for at the end. Ctrl-C stops the
    motor, and is a result. Raises what `run` raises, and `DeviceError` where the loop's process can't be begun.
    """
    with LoopProcess(experiment, record=to, real_time=real_time) as loop:
        onlooker = _Onlooker(loop, watch, look)
        while True:
            try:
                return loop.wait(onlooker, say=say)
            except KeyboardInterrupt as interrupt:
                loop.stop(stopped_by(interrupt))


class _Onlooker:
    """Shows the rows of a running loop to those who watch, each at their own pace."""

    def __init__(self, loop: LoopProcess, watch: Watch | None, look: Look | None) -> None:
        self._loop = loop
        self._watch = watch
        self._look = look
        self._next_watch = self._next_look = time.monotonic()
        self._seen = _Seen(loop) if look is not None else None
        self._told = False

    def __call__(self) -> None:
        now = time.monotonic()
        if self._watch is not None and now >= self._next_watch:
            self._next_watch = now + WATCH_INTERVAL
            self._heed(self._watched(self._watch), "interrupted")
        if self._look is not None and self._seen is not None and now >= self._next_look:
            self._next_look = now + LOOK_INTERVAL
            self._heed(self._look(self._seen.so_far()), "finished")

    def _watched(self, watch: Watch) -> str | None:
        ring = self._loop.ring
        rows = ring.reader(max(0, ring.written - 1)).read(1)
        if not len(rows):
            return None
        names = [series.channel.name for series in self._loop.recording.series]
        value = dict(zip(names, rows[0, 1:], strict=False))
        sample_time = self._loop.experiment.sample_time
        return watch(
            Progress(
                tick=round(value["scheduled"] / sample_time),
                ticks=self._loop.experiment.samples,
                time=float(rows[0, 0]),
                commanded=float(value["commanded"]),
                applied=float(value["applied"]),
                counts=int(value["counts"]),
            )
        )

    def _heed(self, word: str | None, reason: Literal["finished", "interrupted"]) -> None:
        if word is not None and not self._told:
            self._told = True
            self._loop.stop(word, reason)


class _Seen:
    """Gathers the rows so far for somebody who looks at them as a recording."""

    def __init__(self, loop: LoopProcess) -> None:
        self._width = loop.width
        self._reader = loop.rows(0)
        self._kept = InMemory(loop.recording)

    def so_far(self) -> Recording:
        while len(rows := self._reader.read()):
            self._kept.append(rows[:, : self._width])
        return self._kept.end(Stopped(reason="unknown", sentence="the run goes on"), ())
