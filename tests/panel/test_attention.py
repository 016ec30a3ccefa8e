"""The driver has to see the motor: the page reports its own drawing, and without reports the motor stops."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servobench.panel import attention
from servobench.panel.attention import LAG, SILENCE, Attention
from servobench.panel.frames import COLUMNS, History
from tests.panel.test_session import Room, heard, played, state_of


class Clock:
    """A monotonic time that a test moves."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    for module in (attention, __import__("servobench.panel.frames", fromlist=["time"])):
        monkeypatch.setattr(module, "time", type("Time", (), {"monotonic": staticmethod(found)}))
    return found


def rows(first: int, count: int) -> np.ndarray:
    t = np.arange(first, first + count)[:, None] * 0.002
    return np.hstack([t, np.zeros((count, len(COLUMNS) - 1))])


def fed(history: History, clock: Clock, seconds: float, page: Attention, behind: int = 0) -> None:
    """Let rows come thirty times a second, which the page draws, some rows later."""
    for _ in range(round(30 * seconds)):
        clock.now += 1 / 30
        history.add(history.next, rows(history.next, 16))
        page.heartbeat(max(history.next - behind, 0))


def test_a_page_that_draws_what_comes_lacks_nothing_and_one_that_falls_silent_does(clock: Clock) -> None:
    history, page = History(), Attention()
    assert page.reason_unseen(history)  # nothing was heard of it yet
    fed(history, clock, 3.0, page)
    clock.now += 0.99 * SILENCE
    assert page.reason_unseen(history) == ""
    clock.now += 0.02 * SILENCE
    assert "has drawn nothing" in page.reason_unseen(history)


@pytest.mark.parametrize("behind", [0.9 * LAG, 1.2 * LAG, 2.0])
def test_a_page_that_says_much_of_what_is_long_past_is_too_late(clock: Clock, behind: float) -> None:
    history, page = History(), Attention()
    fed(history, clock, 5.0, page, behind=round(behind * 30 * 16))

    assert bool("late" in page.reason_unseen(history)) == (behind > LAG)


def test_a_page_that_draws_a_run_that_is_over_is_late_for_the_next_one(clock: Clock) -> None:
    before, after, page = History(), History(), Attention()
    fed(before, clock, 5.0, page)
    for _ in range(30):
        clock.now += 1 / 30
        after.add(after.next, rows(after.next, 16))
        page.heartbeat(before.next)

    assert "late" in page.reason_unseen(after)


def test_a_row_is_known_by_when_it_came(clock: Clock) -> None:
    history = History()
    assert history.came(0) is None
    for _ in range(3):
        clock.now += 1
        history.add(history.next, rows(history.next, 10))

    assert [history.came(row) for row in (0, 9, 10, 29)] == [101.0, 101.0, 102.0, 103.0]
    assert history.came(30) is None  # it hasn't come
    assert history.came(31) == 101.0  # no row of this run


async def driving(room: Room) -> Any:
    page = await room.page()
    assert (await room.say(page, do="lease"))["ok"]
    assert (await room.say(page, do="start"))["ok"]
    await room.let_news_come()
    return page


def looked(room: Room) -> None:
    """Look at the operator's page, as it is done ten times a second."""
    room.motor._look_at_operator()


@pytest.mark.promise("S48")
def test_zero_volts_are_put_out_where_the_operators_page_falls_silent_and_why_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def story(room: Room) -> None:
        page = await driving(room)
        looked(room)
        assert room.loop.enabled

        silent(monkeypatch)
        assert not room.motor._may_go_on  # the loop hears no more of anybody, either
        looked(room)
        looked(room)

        assert not room.loop.enabled
        assert len(room.loop.commands) == 2  # once, however often is looked
        messages = await heard(page)
        assert [each["kind"] for each in messages].count("stopped") == 1
        assert "has drawn nothing for 0.7 s" in state_of(messages)["stopped"]

    played(tmp_path, story)


@pytest.mark.promise("S49")
def test_a_page_that_is_hidden_is_zero_volts_at_once(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        page = await driving(room)

        await said(room, page, do="hidden")

        assert not room.loop.enabled
        assert "hidden by another tab or window" in room.motor.state_for(page)["stopped"]

    played(tmp_path, story)


@pytest.mark.promise("S49")
def test_a_hidden_page_of_who_only_watches_stops_nothing(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        await driving(room)
        other = await room.page()

        await said(room, other, do="hidden")
        looked(room)

        assert room.loop.enabled

    played(tmp_path, story)


def test_a_page_that_is_back_drives_again_unless_another_one_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def story(room: Room) -> None:
        page, other = await driving(room), await room.page()
        assert not (await room.say(other, do="lease"))["ok"]
        silent(monkeypatch)
        looked(room)
        assert not room.motor.state_for(other)["taken"]

        monkeypatch.undo()
        await said(room, page, do="beat", row=0)
        assert room.motor.state_for(page)["operator"]
        assert (await room.say(page, do="start"))["ok"]
        assert room.loop.enabled

        await said(room, page, do="hidden")
        assert (await room.say(other, do="lease"))["ok"]
        assert not room.motor.state_for(page)["operator"]
        assert not (await room.say(page, do="start"))["ok"]

    played(tmp_path, story)


@pytest.mark.promise("S48")
def test_who_takes_over_from_a_silent_page_takes_over_zero_volts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def story(room: Room) -> None:
        await driving(room)
        other = await room.page()
        silent(monkeypatch)  # and nobody has looked since

        assert (await room.say(other, do="lease"))["ok"]

        assert not room.loop.enabled

    played(tmp_path, story)


def test_a_motor_that_rests_needs_nobody(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        page = await room.page()
        await room.say(page, do="lease")
        await said(room, page, do="hidden")
        looked(room)

        assert room.motor._may_go_on
        assert room.loop.commands == []

    played(tmp_path, story)


@pytest.mark.parametrize("row", [-1, 1.5, True, "7", None])
def test_a_beat_that_says_no_row_is_refused(tmp_path: Path, row: object) -> None:
    async def story(room: Room) -> None:
        page = await driving(room)
        answer = await room.say(page, do="beat", row=row)
        assert "isn't a row" in answer["error"]

    played(tmp_path, story)


async def said(room: Room, page: Any, **what: object) -> None:
    """Say what nobody answers."""
    from servobench.panel.socket import _answer
    from servobench.panel.viewers import as_text

    await _answer(as_text({"id": 7, **what}), page, room.motor)
    assert not [text for text in page._texts if '"kind":"answer"' in text]


def silent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let all pages have been silent for too long."""
    now = time.monotonic
    monkeypatch.setattr(
        attention, "time", type("Time", (), {"monotonic": staticmethod(lambda: now() + SILENCE)})
    )
