"""A recorder that begins in the middle of a run, and ends before it does."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from servobench.core.channels import DeviceInfo
from servobench.core.errors import UsageError
from servobench.recordings.native.reader import read
from servobench.recordings.recording import Recording
from servobench.rig.loop.messages import Notice, info_from_json, info_to_json
from servobench.rig.loop.opening import opening
from servobench.rig.loop.recording_process import Late, RecorderSpec, record
from servobench.rig.loop.ring import LOOP_STATE, RECORD_UNTIL, RECORDER_STATE, ROWS_KEPT, MessageRing, RowRing
from servobench.rig.loop.spec import DONE, ENDED, FAILED
from tests.rig.loop.shaft import Shaft, experiment

TS = 0.01
WIDTH = 16


class Running:
    """A loop that goes on: `ticks` of it have gone by, and each wait of the recorder lets ten more pass."""

    def __init__(
        self, path: Path, ticks: int, duration: float | None, missed: frozenset[int] = frozenset()
    ) -> None:
        self._stack = ExitStack()
        self.rows = self._stack.enter_context(RowRing.create(WIDTH, 256))
        self.events = self._stack.enter_context(MessageRing.create(16))
        self.info: DeviceInfo = Shaft().info
        self.asked = experiment(sample_time=TS)
        self.opened = opening(self.asked, self.info, commanded_live=True, timing=self.info.timing)
        self.tick = 0
        self.missed = missed
        self.ends_at: int | None = None
        self.until: int | None = None
        for k in range(20):  # more than the ring of events holds, the device's own among them
            self.events.push(
                Notice(kind="command", about={"number": k, "accepted": True, "what": {}, "why": ""}).to_text()
            )
        self.pass_by(ticks)
        self.first = self.rows.written
        self.spec = RecorderSpec(
            rows=self.rows.name,
            events=self.events.name,
            path=str(path),
            experiment=self.asked.to_toml(),
            late=Late(
                row=self.first, event=self.events.written, info=info_to_json(self.info), duration=duration
            ),
        )

    def pass_by(self, ticks: int) -> None:
        for _ in range(ticks):
            if self.tick not in self.missed:
                values = {"applied": 0.5 * self.tick, "scheduled": self.tick * TS, "counts": self.tick}
                row = [self.tick * TS, *(values.get(s.channel.name, 0.0) for s in self.opened.series)]
                self.rows.push([*row, *[0.0] * (WIDTH - len(row))])
            self.tick += 1

    def record(self) -> Recording:
        record(self.spec, self.rows, self.events, self)
        (recording,) = read(self.spec.path)
        return recording

    def wait(self) -> None:
        if self.until is not None and self.tick > self.until:
            self.rows.set(RECORD_UNTIL, self.until)
        if self.ends_at is None or self.tick < self.ends_at:
            self.pass_by(10)
        elif self.rows.get(LOOP_STATE) != ENDED:
            self.events.push(
                Notice(
                    kind="ended", about={"reason": "interrupted", "sentence": "enough", "findings": []}
                ).to_text()
            )
            self.rows.set(LOOP_STATE, ENDED)

    def loop_gone(self) -> bool:
        return False

    def alone(self) -> bool:
        return False

    def end_wanted(self) -> bool:
        return False

    def __enter__(self) -> Running:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "late.mcap"


def ticks_of(recording: Recording) -> list[int]:
    return [round(value / TS) for value in recording["scheduled"].values]


def test_it_records_from_its_first_row_for_as_long_as_asked_though_the_run_goes_on(path: Path) -> None:
    with Running(path, 300, 1.0) as loop:
        recording = loop.record()

        assert loop.rows.get(RECORDER_STATE) == DONE
        assert loop.rows.get(LOOP_STATE) != ENDED
        assert loop.rows.get(ROWS_KEPT) >= loop.first + 100
    assert ticks_of(recording) == list(range(300, 400))
    assert recording.input_before == 0.5 * 299  # what was put out until then
    assert recording.info == loop.info
    assert recording.stopped.reason == "finished"
    assert recording.findings == loop.opened.findings
    assert recording.events == ()  # those before it are none of its own


def test_from_the_very_first_row_the_input_before_is_the_run_s_own(path: Path) -> None:
    with Running(path, 0, 0.5) as loop:
        recording = loop.record()

    assert ticks_of(recording) == list(range(50))
    assert recording.input_before == loop.opened.input_before


def test_the_time_counts_not_the_rows_where_ticks_were_missed(path: Path) -> None:
    with Running(path, 300, 1.0, missed=frozenset({*range(320, 330), 399, 400})) as loop:
        recording = loop.record()

    assert ticks_of(recording) == [*range(300, 320), *range(330, 399)]


def test_it_ends_at_the_row_that_the_word_says(path: Path) -> None:
    with Running(path, 100, None) as loop:
        loop.until = 155
        recording = loop.record()

    assert ticks_of(recording)[0] == 100
    # The word is set after rows behind it have come, which may have been written already.
    assert 154 <= ticks_of(recording)[-1] < 155 + 20
    assert recording.stopped.reason == "finished"


def test_it_ends_with_its_run_where_that_is_sooner(path: Path) -> None:
    with Running(path, 100, 100.0) as loop:
        loop.ends_at = 150
        recording = loop.record()

    assert ticks_of(recording) == list(range(100, 150))
    assert recording.stopped.sentence == "enough"


def test_where_it_can_not_begin_the_word_says_so(path: Path) -> None:
    with Running(path, 10, 1.0) as loop:
        loop.spec = replace(loop.spec, path=str(path.parent / "nowhere" / "a.mcap"))
        with pytest.raises(UsageError, match="no folder"):
            loop.record()
        assert loop.rows.get(RECORDER_STATE) == FAILED


def test_the_spec_reads_back(path: Path) -> None:
    with Running(path, 10, 1.0) as loop:
        back = RecorderSpec.from_line(loop.spec.line().encode())

        assert back.late is not None
        assert info_from_json(back.late.info) == loop.info
        assert replace(back, late=None) == replace(loop.spec, late=None)
        alone = replace(loop.spec, late=None)
        assert RecorderSpec.from_line(alone.line().encode()) == alone


def test_rows_of_the_whole_run_are_as_they_were(path: Path) -> None:
    with Running(path, 100, 0.5) as loop:
        recording = loop.record()
        np.testing.assert_array_equal(recording["counts"].values, np.arange(100.0, 150.0))
        np.testing.assert_array_equal(recording["applied"].values, 0.5 * np.arange(100.0, 150.0))
