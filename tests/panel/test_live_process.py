"""Live identification in its own process: what it publishes, what frames make of it, and how it ends."""

from __future__ import annotations

import itertools
import json
import os
import select
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.panel.frames import COLUMNS
from servobench.panel.live_process import LiveProcess, Look, live_of
from servobench.panel.pump import Pump
from servobench.rig.experiment import Experiment
from servobench.rig.loop.opening import opening
from servobench.rig.loop.ring import RowRing
from servobench.rig.loop.spec import COLUMNS as WIDE
from tests.datasets import QUANTUM
from tests.panel.conftest import wait_for
from tests.panel.doubles import INFO as DOUBLE
from tests.panel.doubles import LoopDouble
from tests.panel.test_live import INFO, STEP, check_near, columns

Array = NDArray[np.float64]


@contextmanager
def identified(
    wish: dict[str, float] | None = None,
) -> Iterator[tuple[LiveProcess, RowRing, Callable[[], None]]]:
    """The process beside a ring in which a run of 8 s of a real motor's rows has come and gone on."""
    opened = opening(Experiment(sample_time=STEP), INFO, commanded_live=True, timing="host")
    names = ["t", *(series.channel.name for series in opened.series)]
    run = columns(8.0)

    def go_on() -> None:
        for row in np.column_stack([run["t"], run["applied"], run["counts"]]):
            given = dict(zip(("t", "applied", "counts"), row, strict=True))
            ring.push([*(given.get(name, 0.0) for name in names), *[0.0] * (WIDE - len(names))])

    with RowRing.create(WIDE, 16384) as ring:
        live = live_of(SimpleNamespace(info=INFO, recording=opened, ring=ring), STEP, wish or {})  # type: ignore[arg-type]
        assert live is not None
        try:
            yield live, ring, go_on
        finally:
            live.close()


def seen_by(live: LiveProcess, until: int) -> tuple[list[Look], list[dict[str, Any]]]:
    """All that it publishes until it has reached a row."""
    seen: list[Look] = []
    said: list[dict[str, Any]] = []

    def reached() -> bool:
        seen.extend(live.look(0.0))
        text = live.message()
        said.extend([json.loads(text)] if text else [])
        return bool(seen) and seen[-1].reached >= until

    wait_for(reached)
    return seen, said


@pytest.mark.parametrize("count", [0, 1, 61, 62, 200])
def test_records_say_what_was_seen(count: int) -> None:
    residuals = np.linspace(-1.0, 1.0, count)
    found = [Look.of(record) for record in Look(reached=1000, first=700, residuals=residuals).records()]
    assert {each.reached for each in found} == {1000}
    assert found[0].first == 700
    np.testing.assert_array_equal(np.concatenate([each.residuals for each in found]), residuals)
    for before, each in itertools.pairwise(found):
        assert each.first == before.first + len(before.residuals)


def test_it_follows_a_ring_and_says_what_is_known_and_what_is_left_over() -> None:
    """All rows are reached once, the last residuals are a few counts, and a wish is heard."""
    with identified() as (live, ring, go_on):
        go_on()
        seen, said = seen_by(live, 8000)
        firsts = [each.first for each in seen]
        assert firsts == sorted(firsts)
        assert sum(len(each.residuals) for each in seen) == seen[-1].reached == ring.written
        last = np.concatenate([each.residuals for each in seen])[-1000:]
        assert np.abs(last[np.isfinite(last)]).max() < 20 * QUANTUM
        check_near(said[-1])
        assert said[-1]["enough"] is False

        live.set_wish({"gain": 0.5})
        opened_again = ring.written
        ring.push([8.0, *[0.0] * (WIDE - 1)])
        ring.push([8.3, *[0.0] * (WIDE - 1)])
        _, more = seen_by(live, opened_again + 2)
        assert more[-1]["samples"] == 8002


def test_one_that_dies_says_so_once_and_scopes_go_on() -> None:
    with LoopDouble(Experiment(sample_time=STEP)) as loop:
        live = live_of(loop, STEP, {})
        assert live is not None
        pump = Pump(loop, STEP, "derivative", lambda news: None, live)
        os.kill(live.pid, signal.SIGKILL)
        said: list[dict[str, Any]] = []
        rows = 0

        def told() -> bool:
            nonlocal rows
            loop.tick()
            news = pump.look()
            rows += len(news.values)
            said.extend([json.loads(news.live)] if news.live else [])
            return bool(said)

        wait_for(told)
        assert "has ended (status -9)" in said[0]["ended"]
        assert said[0]["parameters"] == {}
        told()
        assert len(said) == 1
        assert rows == loop.ring.written
        live.close()
        live.close()


def test_the_end_of_its_input_is_its_end() -> None:
    with identified() as (live, _ring, _):
        handle = os.pidfd_open(live.pid)
        assert live._process.stdin is not None
        live._process.stdin.close()
        assert select.select([handle], [], [], 60)[0]
        os.close(handle)
        assert live._process.wait() == 0


class Said:
    """Identification that says what a test wants."""

    def __init__(self) -> None:
        self.next: list[Look] = []
        self.ended = ""

    def look(self) -> list[Look]:
        return [self.next.pop(0)] if self.next else []

    def message(self) -> str:
        return ""


def test_rows_wait_for_their_residuals_a_moment_and_no_longer() -> None:
    with LoopDouble(Experiment(sample_time=STEP)) as loop:
        live = Said()
        pump = Pump(loop, STEP, "derivative", lambda news: None, live)
        residual = COLUMNS.index("residual")
        for _ in range(40):
            loop.tick()

        live.next.append(Look(reached=30, first=0, residuals=np.arange(30.0)))
        news = pump.look()
        np.testing.assert_array_equal(news.values[:, residual], np.arange(30.0))

        # It's late: rows go without, and what comes for them after that is left out.
        assert np.isnan(pump.look().values[:, residual]).all()
        for _ in range(5):
            loop.tick()
        live.next.append(Look(reached=45, first=30, residuals=np.arange(30.0, 45.0)))
        news = pump.look()
        assert (news.first, len(news.values)) == (40, 5)
        np.testing.assert_array_equal(news.values[:, residual], np.arange(40.0, 45.0))


def test_a_device_that_does_not_tell_its_angle_is_not_identified() -> None:
    silent = SimpleNamespace(info=type(DOUBLE)(name="none", channels=DOUBLE.channels[:1]))
    assert live_of(silent, STEP, {}) is None  # type: ignore[arg-type]
