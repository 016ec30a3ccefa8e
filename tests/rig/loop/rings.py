"""A loop for tests of the recorder: a shaft that is driven tick by tick in virtual time, its rows and events pushed into rings.

It is also what the recorder sees of the world (`Signs`): where the recorder waits, ticks pass.
"""

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, Self

import numpy as np

from servobench.recordings.recording import Recording
from servobench.rig.loop.opening import opening
from servobench.rig.loop.recording_process import RecorderSpec
from servobench.rig.loop.ring import LOOP_STATE, RECORDER_STATE, MessageRing, RowRing
from servobench.rig.loop.spec import ENDED, FAILED
from tests.rig.loop.shaft import Shaft, experiment

COMMAND_EVERY = 10  # ticks


class RingLoop:
    """Pushes a row a tick, and a command's event every tenth tick, until `ticks` are over; where the recorder failed it stops."""

    def __init__(
        self,
        path: Path,
        *,
        ticks: int = 100,
        slots: int = 1024,
        event_slots: int = 256,
        ticks_a_look: int = 3,
        on_wait: Callable[[int], None] = lambda waits: None,
        stops_where_recording_fails: bool = True,
        sample_time: float = 0.01,
        rings: tuple[RowRing, MessageRing] | None = None,
    ) -> None:
        self.device = Shaft()
        self.experiment = experiment(sample_time=sample_time)
        self.device.start(self.experiment.sample_time, None)
        self.names = [
            series.channel.name
            for series in opening(self.experiment, self.device.info, commanded_live=True).series
        ]
        self.rows, self.events = rings or (
            RowRing.create(1 + len(self.names), slots),
            MessageRing.create(event_slots, 1024),
        )
        self.spec = RecorderSpec(
            rows=self.rows.name, events=self.events.name, path=str(path), experiment=self.experiment.to_toml()
        )
        self.ticks, self.ticks_a_look = ticks, ticks_a_look
        self.on_wait, self.waits = on_wait, 0
        self.is_gone = self.is_alone = self.is_answerable = self.stands = False
        self.stops_where_recording_fails = stops_where_recording_fails
        self.failed_at: int | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.rows.close()
        self.events.close()

    def open(self) -> None:
        """Say which device it is."""
        self.say("opened", info=asdict(self.device.info))

    def tick(self) -> None:
        """Let one tick pass, if the run hasn't ended."""
        if self.rows.get(LOOP_STATE) == ENDED or self.stands:
            return
        k = self.rows.written
        if self.stops_where_recording_fails and self.rows.get(RECORDER_STATE) == FAILED:
            self.failed_at = k
            self.end("error", "nothing more could be recorded")
            return
        if k == self.ticks:
            self.end("finished", "done")
            return
        if k and k % COMMAND_EVERY == 0:
            self.say("command", number=k // COMMAND_EVERY, tick=k, time=k * self.experiment.sample_time)
        sample = self.device.read()
        applied = self.device.write(2.0)
        self.rows.push(self.row(k, applied, sample.counts))

    def row(self, k: int, applied: float, counts: int) -> list[float]:
        """Return the row of tick k."""
        t = k * self.experiment.sample_time
        known = {"commanded": applied, "applied": applied, "counts": float(counts), "scheduled": t}
        return [t, *(known.get(name, 0.0) for name in self.names)]

    def end(self, reason: str, sentence: str) -> None:
        """Stop the motor, and say how the run ended."""
        self.device.write(0.0)
        self.device.stop()
        self.say("ended", reason=reason, sentence=sentence, findings=[])
        self.rows.set(LOOP_STATE, ENDED)

    def say(self, kind: str, **more: Any) -> None:
        self.events.push(json.dumps({"kind": kind, **more}))

    def run(self, ticks: int) -> None:
        """Let ticks pass."""
        for _ in range(ticks):
            self.tick()

    def wait(self) -> None:
        self.waits += 1
        self.on_wait(self.waits)
        self.run(self.ticks_a_look)

    def loop_gone(self) -> bool:
        return self.is_gone

    def alone(self) -> bool:
        return self.is_alone

    def end_wanted(self) -> bool:
        return self.is_answerable


def ticks_of(recording: Recording, sample_time: float = 0.01) -> np.ndarray:
    """The numbers of the ticks that a recording has, by their scheduled times; each has to hold what its tick held."""
    ticks = np.rint(recording["scheduled"].values / sample_time).astype(int)
    # Two volts turn the shaft by two counts a tick, and act from the tick after on.
    assert np.array_equal(recording["counts"].values, 2.0 * ticks)
    assert np.array_equal(recording["scheduled"].t, recording["scheduled"].values)
    return ticks
