"""The verb `run` for a motor that turns in real time: the loop in its own process, recorded by another."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from servobench.recordings.recording import Recording, Stopped
from servobench.rig.devices.base import Device
from servobench.rig.experiment import Experiment
from servobench.rig.loop.process import LoopProcess
from servobench.rig.loop.recorder import InMemory
from servobench.rig.loop.run import LOOK_INTERVAL, WATCH_INTERVAL, Look, Progress, Watch, run
from servobench.rig.loop.ticks import stop_text


def run_live(
    experiment: Experiment,
    *,
    to: str | os.PathLike[str],
    watch: Watch | None = None,
    look: Look | None = None,
    say: Callable[[str], None] | None = None,
    over: Callable[[str], None] | None = None,
    alarm: Callable[[str], None] | None = None,
    real_time: bool = True,
) -> Recording:
    """Carry out an experiment on the device that it names, in a process of its own, recorded to the native file `to`.

    As `run`, but nothing in this process can hold the loop up: `watch` and `look` see what the loop handed on; `say` is
    told what is waited for at the end, `over` that the motor is stopped before its time, `alarm` at once what somebody beside
    the motor has to know (on standard error without).
    Ctrl-C stops the motor, and is a result. Raises what `run` raises, `DeviceError` where the loop's process can't be begun, and
    `DeviceSilent` where a call of the device doesn't return.
    """
    with LoopProcess(experiment, record=to, real_time=real_time, alarm=alarm) as loop:
        onlooker: Callable[[], None] | None = _Onlooker(loop, watch, look)
        while True:
            try:
                return loop.wait(onlooker, say=say, over=over)
            except KeyboardInterrupt as interrupt:
                loop.stop(stop_text(interrupt))
                onlooker = None  # what comes now is the end
                if say is not None:
                    say("stopping the motor")


def run_where_its_time_passes(
    experiment: Experiment,
    device: Device,
    *,
    to: str | os.PathLike[str] | None = None,
    look: Look | None = None,
    alarm: Callable[[str], None] | None = None,
) -> Recording:
    """Carry out an experiment on the device that it names: here where its time is computed, otherwise in its own process.

    `device` is that device, not yet connected. Without `to` the recording is kept in memory. Raises as `run` and `run_live`.
    """
    if device.info.timing == "virtual":
        with device as motor:
            return run(experiment, motor, to=to, look=look)
    if to is not None:
        return run_live(experiment, to=to, look=look, alarm=alarm)
    with TemporaryDirectory(prefix="servobench-") as folder:
        return run_live(experiment, to=Path(folder) / "recording.mcap", look=look, alarm=alarm)


class _Onlooker:
    """Shows the rows of a running loop to those who watch, each at their own pace."""

    def __init__(self, loop: LoopProcess, watch: Watch | None, look: Look | None) -> None:
        self._loop = loop
        self._watch = watch
        self._look = look
        self._next_watch = self._next_look = time.monotonic()
        self._seen = _RowsSoFar(loop) if look is not None else None
        self._reported = False
        self._shown = 0

    def __call__(self) -> None:
        now = time.monotonic()
        if self._watch is not None and now >= self._next_watch:
            self._next_watch = now + WATCH_INTERVAL
            self._stop_loop(self._call_watch(self._watch), "interrupted")
        if self._look is not None and self._seen is not None and now >= self._next_look:
            self._next_look = now + LOOK_INTERVAL
            self._stop_loop(self._look(self._seen.so_far()), "finished")

    def _call_watch(self, watch: Watch) -> str | None:
        ring = self._loop.ring
        if ring.written == self._shown:  # the loop doesn't go on, so there is no progress
            return None
        self._shown = ring.written
        rows = ring.reader(max(0, ring.written - 1)).read(1)
        if not len(rows):
            return None
        names = [series.channel.name for series in self._loop.recording.series]
        value = dict(zip(names, rows[0, 1:], strict=False))
        if not math.isfinite(value["counts"]):  # the sample that ends the run
            return None
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

    def _stop_loop(self, word: str | None, reason: Literal["finished", "interrupted"]) -> None:
        if word is not None and not self._reported:
            self._reported = True
            self._loop.stop(word, reason)


class _RowsSoFar:
    """Gathers the rows so far as a recording for `look`."""

    def __init__(self, loop: LoopProcess) -> None:
        self._width = loop.width
        self._reader = loop.rows(0)
        self._kept = InMemory(loop.recording)

    def so_far(self) -> Recording:
        while len(rows := self._reader.read()):
            self._kept.append(rows[:, : self._width])
        return self._kept.end(Stopped(reason="unknown", sentence="the run goes on"), ())
