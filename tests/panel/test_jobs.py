"""Identifications: told while they go on, ended when somebody wants that, and kept off the loop's processors."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

import servobench as sb
from servobench.core.errors import FormatError, NotIdentifiable, UnknownName, UsageError
from servobench.panel import jobs, work
from servobench.panel.jobs import JobEnded, Jobs
from servobench.panel.work import COMPILING, IDENTIFYING, PIECES, STAGES, do_elsewhere
from servobench.recordings.formats.base import save


class Clock:
    """A time that a test moves."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(jobs, "time", made)
    monkeypatch.setattr(jobs, "TELL_INTERVAL", 0.0)
    return made


class Room:
    """Jobs, what they tell, and a work whose stages last as long as a test says."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.jobs = Jobs()
        self.told: list[Mapping[str, Any]] = []

    async def done(
        self, lasts: Mapping[str, float], name: str = "first", samples: int = 1000
    ) -> dict[str, Any]:
        async def stages(
            asked: Mapping[str, Any], said: Callable[[str], None] = lambda _: None
        ) -> dict[str, Any]:
            for stage in STAGES:
                said(stage)
                await asyncio.sleep(0.01)  # it's told what has just begun
                self.clock.now += lasts[stage]
                await asyncio.sleep(0.01)
            return {"result": name}

        return await self.jobs.identify(stages, self.told.append, name, {}, samples)

    def left(self, stage: str, name: str) -> list[float | None]:
        return [each["left"] for each in self.told if each["name"] == name and each.get("doing") == stage]


LASTS = dict(zip(STAGES, (1.0, 2.0, 10.0, 3.0), strict=True))


def test_what_the_last_one_took_tells_what_is_left_of_the_next(clock: Clock) -> None:
    async def story() -> None:
        room = Room(clock)
        assert await room.done(LASTS) == {"result": "first"}
        assert set(room.left(IDENTIFYING, "first")) == {None}  # nobody knows yet
        assert room.told[-1] == {"kind": "work", "name": "first", "over": True}
        # Twice the samples take 20 s in place of 10 s; when 10 s are over, 10 s are left of them, and 3 s for the report.
        await room.done(LASTS, "second", samples=2000)
        assert room.left("starting", "second")[0] == pytest.approx(1 + 2 + 20 + 3)
        assert room.left(IDENTIFYING, "second")[0] == pytest.approx(23)
        assert room.left(IDENTIFYING, "second")[-1] == pytest.approx(13)
        assert room.left("writing the report", "second")[0] == pytest.approx(3)
        # One that takes longer than any says nothing that isn't so.
        await room.done({**LASTS, "starting": 5.0}, "third")
        assert room.left("starting", "third")[-1] is None

    asyncio.run(story())


def test_of_a_first_one_its_steps_are_reported_and_compiling_is_no_part_of_its_pace(clock: Clock) -> None:
    async def story() -> None:
        room = Room(clock)

        async def compiling(asked: Mapping[str, Any], said: Callable[[str], None] = lambda _: None) -> Any:
            for stage in STAGES:
                parts = [(stage, 2.0), (f"{COMPILING} (0 done)", 20.0), (stage, 1.0)]
                for doing, lasts in parts if stage == IDENTIFYING else parts[:1]:
                    said(doing)
                    await asyncio.sleep(0.01)
                    clock.now += lasts
                    await asyncio.sleep(0.01)
            return {}

        await room.jobs.identify(compiling, room.told.append, "first", {}, 1000)
        steps = list(dict.fromkeys((each.get("step"), each.get("doing")) for each in room.told[:-1]))
        third = [(3, IDENTIFYING), (3, f"{COMPILING} (0 done)")]
        assert steps == [(1, STAGES[0]), (2, STAGES[1]), *third, (4, STAGES[3])]
        assert {(each["of"], each["left"]) for each in room.told[:-1]} == {(len(STAGES), None)}
        # The next one finds it compiled: 2 s and 1 s are what the stage took, not 23 s; the others took 2 s each.
        await room.done(dict.fromkeys(STAGES, 2.0), "second")
        assert room.left(STAGES[0], "second")[0] == pytest.approx(2 + 2 + 3 + 2)

    asyncio.run(story())


def test_one_that_is_ended_says_so_and_can_be_begun_again(clock: Clock) -> None:
    async def story() -> None:
        room = Room(clock)
        going = asyncio.create_task(room.done(LASTS))
        await asyncio.sleep(0.005)
        with pytest.raises(JobEnded, match="first is already being identified"):
            await room.done(LASTS)
        room.jobs.end("first")
        with pytest.raises(JobEnded, match="was ended"):
            await going
        with pytest.raises(UnknownName, match="identification in progress"):
            room.jobs.end("first")
        assert await room.done(LASTS) == {"result": "first"}

    asyncio.run(story())


def test_a_server_that_ends_is_no_wish_of_somebody(clock: Clock) -> None:
    async def story() -> None:
        going = asyncio.create_task(Room(clock).done(LASTS))
        await asyncio.sleep(0.005)
        going.cancel()
        with pytest.raises(asyncio.CancelledError):
            await going

    asyncio.run(story())


def workers() -> list[int]:
    """The processes of ours that do such work."""
    found = []
    for place in Path("/proc").iterdir():
        try:
            parent = (place / "stat").read_text().rpartition(")")[2].split()[1]
            command = (place / "cmdline").read_text()
        except (OSError, IndexError):
            continue
        if parent == str(os.getpid()) and "servobench.panel.work" in command:
            found.append(int(place.name))
    return found


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("work") / "recording.mcap"
    with sb.connect("twin") as motor:
        experiment = sb.Experiment(
            signal=sb.Square(low=1, high=3, frequency=0.4), duration=5, sample_time=0.002
        )
        save(sb.run(experiment, motor), path)
    return path


def asked(recorded: Path) -> dict[str, Any]:
    return {
        "do": "identify",
        "file": os.fspath(recorded),
        "structure": "auto",
        "report": os.fspath(recorded.with_name("report.html")),
    }


def test_work_is_done_by_one_thread_of_low_priority_in_another_process(
    recorded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    seen: dict[str, tuple[int, str]] = {}

    def said(doing: str) -> None:
        for process in workers():
            surroundings = Path(f"/proc/{process}/environ").read_text().split("\0")
            threads = next((each for each in surroundings if each.startswith("OMP_NUM_THREADS=")), "")
            seen[doing] = (os.getpriority(os.PRIO_PROCESS, process), threads)

    answer = asyncio.run(do_elsewhere(asked(recorded), said))

    assert answer["result"]["schema"] == "servobench.result/2"
    expected = min(19, os.getpriority(os.PRIO_PROCESS, 0) + 10)
    for stage in STAGES[1:]:  # at the start it isn't there yet
        assert seen[stage] == (expected, "OMP_NUM_THREADS=1"), stage


def test_the_filter_of_the_scopes_is_no_part_of_an_identification(tmp_path: Path) -> None:
    """The report names the command that makes it again: both find the same, from the counts."""
    path = tmp_path / "looked_at.mcap"
    chain = "derivative | lowpass 55 rad/s"
    with sb.connect("twin") as motor:
        experiment = sb.Experiment(signal=sb.Square(low=1, high=3, frequency=0.4), duration=5, chain=chain)
        save(sb.run(experiment, motor), path)

    (recording,) = sb.load(path)
    said = PIECES["identify"](asked(path))["result"]

    assert chain in recording.experiment
    assert said["parameters"] == sb.identify(sb.measure(recording)).to_dict()["parameters"]
    assert f"servobench identify {path.name}" in path.with_name("report.html").read_text(encoding="utf-8")


def test_where_nothing_is_compiled_yet_that_is_reported(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cache of its own, which is empty: as after an installation. It is ended once it goes on, as all of it takes long."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))

    async def story() -> list[str]:
        told: list[str] = []
        seen = asyncio.Event()

        def said(doing: str) -> None:
            told.append(doing)
            if doing in STAGES and told.count(doing) > 1:
                seen.set()

        task = asyncio.ensure_future(do_elsewhere(asked(recorded), said))
        await asyncio.wait_for(seen.wait(), 60)
        task.cancel()
        await asyncio.wait([task])
        return told

    told = asyncio.run(story())
    first = told.index(f"{COMPILING} (0 done)")
    again = next(k for k in range(first, len(told)) if told[k] in STAGES)
    assert told[again] == told[first - 1] != STAGES[0]  # the stage goes on where it was
    done = [f"{COMPILING} ({number} done)" for number in range(again)]
    assert list(dict.fromkeys(told[first:again])) == [each for each in done if each in told[first:again]]
    assert again - first > 1  # the first kernel that is called calls others


def test_work_that_is_ended_leaves_no_process(recorded: Path) -> None:
    async def story() -> None:
        reached = asyncio.Event()
        task = asyncio.ensure_future(
            do_elsewhere(asked(recorded), lambda doing: reached.set() if doing == IDENTIFYING else None)
        )
        await asyncio.wait_for(reached.wait(), 60)
        assert len(workers()) == 1
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert workers() == []

    asyncio.run(story())


def test_what_goes_wrong_elsewhere_is_the_error_that_it_was_there(tmp_path: Path) -> None:
    nothing = {"do": "identify", "file": str(tmp_path / "no.mcap"), "structure": "auto", "report": "no"}
    with pytest.raises((UsageError, NotIdentifiable, FormatError), match=r"no\.mcap"):
        asyncio.run(do_elsewhere(nothing))


def test_a_process_that_dies_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(work.sys, "executable", "/bin/false")
    with pytest.raises(UsageError, match="ended with status 1: without a word"):
        asyncio.run(do_elsewhere({"do": "identify"}))
