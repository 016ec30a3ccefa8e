"""The panel with the real loop in its own process, on the twin: who stops the motor, and how soon, by the loop's own rows."""

from __future__ import annotations

import asyncio
import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from servobench.panel.frames import COLUMNS
from servobench.panel.leftovers import complete_leftovers
from servobench.panel.library import Library
from servobench.recordings.native.reader import read
from tests.panel.doubles import rows_until
from tests.processes import children
from tests.stories.program import running, started

PATIENCE = 120.0  # s; the first loop compiles its kernels, maybe on a busy machine
SAMPLE_TIME = 0.002


class Lost(Exception):
    """The server has closed a page's socket or stopped its motor: who shows neither for 0.9 s is gone, as on a computer that
    stands still.
    """


class Page:
    """A page without a browser: what it hears, and the rows that it is sent. It always listens, as a browser does."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.heard: list[dict[str, Any]] = []
        self.rows: list[np.ndarray] = []
        self.draws, self.behind = (
            True,
            0,
        )  # whether it says that it draws what comes, and by how many rows it is behind
        self._news = asyncio.Event()
        self._listening = asyncio.create_task(self._listen())

    async def _listen(self) -> None:
        with suppress(ConnectionClosed):
            async for message in self.socket:
                if isinstance(message, str):
                    self.heard.append(json.loads(message))
                else:
                    count = int(np.frombuffer(message, "<u4", 1, 4)[0])
                    t = np.frombuffer(message, "<f8", count, 24)
                    rest = np.frombuffer(message, "<f4", -1, 24 + 8 * count).reshape(-1, count)
                    self.rows.append(np.column_stack([t, *rest]))
                    if self.draws:
                        row = max(rows_until(message) - self.behind, 0)
                        await self.socket.send(json.dumps({"do": "beat", "row": row}))
                self._news.set()

    async def listen_until(self, what: Callable[[], bool]) -> None:
        """Wait for something to be heard; raises `Lost` where the server has closed the socket before."""
        while not what():
            news = asyncio.create_task(self._news.wait())
            done, _ = await asyncio.wait(
                {news, self._listening}, timeout=PATIENCE, return_when=asyncio.FIRST_COMPLETED
            )
            news.cancel()
            assert done, f"nothing was heard for {PATIENCE:g} s"
            self._news.clear()
            if self._listening.done() and not what():
                self._listening.result()  # raises what ended it, if it wasn't the server
                raise Lost(f"closed: {self.socket.close_code} {self.socket.close_reason}")

    def last(self, name: str) -> float:
        """The newest value of a column; NaN before there is one."""
        return float(self.rows[-1][-1, COLUMNS.index(name)]) if self.rows else float("nan")

    @property
    def state(self) -> dict[str, Any]:
        return next((each for each in reversed(self.heard) if each["kind"] == "state"), {})

    @property
    def stops(self) -> int:
        """How often the panel has said that it stopped the motor."""
        return sum(each["kind"] == "stopped" for each in self.heard)

    async def say(self, **said: object) -> dict[str, Any]:
        number = len(self.heard) + 1000
        try:
            await self.socket.send(json.dumps({"id": number, **said}))
        except ConnectionClosed as error:
            raise Lost(str(error)) from error
        found: list[dict[str, Any]] = []

        def answered() -> bool:
            found[:] = [each for each in self.heard if each["kind"] == "answer" and each["id"] == number]
            return bool(found)

        await self.listen_until(answered)
        return found[0]

    def column(self, name: str) -> np.ndarray:
        return np.concatenate(self.rows)[:, COLUMNS.index(name)]


@dataclass
class Program:
    """`servobench panel` as a program."""

    process: subprocess.Popen[str]
    base: str
    links: Callable[[], str]
    folder: Path

    @property
    def key(self) -> str:
        """The token of a link that nobody has used yet."""
        return self.links().partition("/?token=")[2]

    async def page(self, stack: list[Any], **wanted: object) -> Page:
        async with httpx.AsyncClient(base_url=self.base, timeout=PATIENCE) as client:
            await client.get(f"/?token={self.key}")
            told = (await client.get("/api/session", headers={"sec-fetch-site": "same-origin"})).json()
            cookie = "; ".join(f"{name}={value}" for name, value in client.cookies.items())
        socket = await connect(
            self.base.replace("http", "ws") + "/ws",
            origin=self.base,  # type: ignore[arg-type]
            additional_headers={"cookie": cookie},
            max_size=None,
            open_timeout=PATIENCE,
            proxy=None,
            **wanted,  # type: ignore[arg-type]
        )
        stack.append(socket)
        await socket.send(json.dumps({"do": "hello", "token": told["token"]}))
        page = Page(socket)
        await page.listen_until(lambda: bool(page.state.get("running")))
        return page


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Program]:
    folder = tmp_path_factory.mktemp("panel")
    with running(folder) as found:
        yield Program(found.process, found.base, lambda: found.address, found.folder)


def played(story: Callable[[list[Any]], Awaitable[None]]) -> None:
    """Play a story with its sockets; from its beginning where the computer stood still and a page was lost by that."""

    async def all_of_it() -> None:
        sockets: list[Any] = []
        try:
            await asyncio.wait_for(story(sockets), 3 * PATIENCE)
        finally:
            for each in sockets:
                await each.close()

    for left in (2, 1, 0):
        try:
            return asyncio.run(all_of_it())
        except Lost:
            if not left:
                raise


async def turning(page: Page) -> None:
    """Drive the motor once rows come, as a person does, until they show that it's driven.

    Where the computer stood still, the panel has stopped a motor that the page showed too late.
    """
    await page.listen_until(lambda: bool(page.rows))
    before = page.stops
    assert (await page.say(do="lease"))["ok"]
    signal_ = {"type": "constant", "value": 2.0}
    assert (await page.say(do="set", signal=signal_))["ok"]
    assert (await page.say(do="start"))["ok"]
    await page.listen_until(lambda: page.last("applied") == 2.0 or page.stops > before)
    if page.stops > before:
        raise Lost(f"stopped: {page.heard[-1]}")


def ticks_to_rest(page: Page, command: int) -> int:
    """The number of ticks from the first row with that command in force until zero volts were applied, and stayed."""
    applied, number = page.column("applied"), page.column("command")
    first = int(np.argmax(number >= command))
    assert number[first] >= command
    assert np.all(applied[first:] == 0.0), "the row that has the command has its voltage"
    return int(np.argmax(applied[first:] == 0.0))


def test_stop_by_anybody_is_zero_volts_in_the_tick_that_takes_it(program: Program) -> None:
    async def story(sockets: list[Any]) -> None:
        driver, other = await program.page(sockets), await program.page(sockets)
        await turning(driver)

        await other.say(do="stop")
        await driver.listen_until(lambda: bool(driver.state) and not driver.state["enabled"])
        await driver.listen_until(lambda: driver.last("applied") == 0.0)

        stopped = [
            each for each in driver.heard if each["kind"] == "applied" and each["what"] == {"enabled": False}
        ]
        (command,) = stopped[-1:]
        assert ticks_to_rest(driver, command["number"]) == 0
        # The loop looks for commands once a tick, after it has put out the voltage: the next one has it.
        number, scheduled = driver.column("command"), driver.column("t")
        k = int(np.argmax(number >= command["number"]))
        assert scheduled[k] >= scheduled[k - 1]
        await driver.say(do="release")

    played(story)


def test_a_closed_socket_is_zero_volts_within_250_ms_of_the_devices_time(program: Program) -> None:
    async def story(sockets: list[Any]) -> None:
        onlooker = await program.page(sockets)
        driver = await program.page(sockets)
        await turning(driver)
        await onlooker.listen_until(lambda: onlooker.last("applied") == 2.0)

        # No goodbye: the line is cut, as where the browser is killed.
        ring_time = onlooker.last("t")
        driver.socket.transport.abort()
        await onlooker.listen_until(
            lambda: (
                any(each["kind"] == "stopped" for each in onlooker.heard) and onlooker.last("applied") == 0.0
            )
        )

        t, applied = onlooker.column("t"), onlooker.column("applied")
        last_driven = float(t[np.flatnonzero(applied == 2.0)[-1]])
        # `ring_time` is that of a row that came before the line was cut; it is up to a frame older than the row of that moment.
        assert last_driven - ring_time <= 0.25
        state = onlooker.state
        assert not state["taken"]

    played(story)


def test_a_recording_made_in_between_holds_what_was_seen_and_is_identified(program: Program) -> None:
    async def story(sockets: list[Any]) -> None:
        page = await program.page(sockets)
        await turning(page)
        answer = await page.say(do="record", name="between", duration=0.5)
        assert answer["ok"], answer
        refused = await page.say(do="record", duration=1)
        assert "between" in refused["error"]
        await page.listen_until(lambda: any(each["kind"] == "recorded" for each in page.heard))

        (recording,) = read(program.folder / "between" / "recording.mcap")
        due = recording["scheduled"].values
        assert due[-1] - due[0] == pytest.approx(
            0.5 - SAMPLE_TIME, abs=10 * SAMPLE_TIME
        )  # but for ticks that were missed
        assert recording.input_before == pytest.approx(2.0, abs=0.01)
        t, counts = page.column("t"), page.column("counts")
        mine = recording.series[0].t
        assert mine is not None
        seen = np.isin(mine, t)
        assert seen.mean() > 0.9
        np.testing.assert_array_equal(
            recording["counts"].values[seen].astype(np.float32), counts[np.searchsorted(t, mine[seen])]
        )
        assert "constant" in recording.experiment
        await page.say(do="release")

    played(story)


def test_a_recorder_that_dies_is_a_fault_that_shows_and_stops_the_motor(program: Program) -> None:
    async def story(sockets: list[Any]) -> None:
        page = await program.page(sockets)
        await turning(page)
        assert (await page.say(do="record", name="killed"))["ok"]
        await page.listen_until(
            lambda: page.state["recording"] is not None and page.state["recording"]["samples"] > 0
        )

        (recorder,) = children(program.process.pid, "recording_process")
        os.kill(recorder, signal.SIGKILL)
        await page.listen_until(lambda: page.state["fault"] is not None)
        await page.listen_until(lambda: not page.state["enabled"])

        assert page.state["fault"]["code"] == "recording-failed"
        await page.listen_until(lambda: page.last("applied") == 0.0)
        assert (await page.say(do="acknowledge"))["ok"]
        await page.listen_until(lambda: page.state["fault"] is None)
        # What it had written by then is kept.
        assert len(read(program.folder / "killed" / "recording.mcap")[0]["counts"].values) > 0
        await page.say(do="release")

    played(story)


def test_a_page_that_answers_no_pings_is_gone(program: Program) -> None:
    script = (
        "import asyncio, json, struct, sys\n"
        "from websockets.asyncio.client import connect\n"
        "async def main():\n"
        "    given = json.loads(sys.argv[1])\n"
        "    async with connect(given['address'], origin=given['origin'], proxy=None,\n"
        "                       additional_headers={'cookie': given['cookie']}) as socket:\n"
        "        await socket.send(json.dumps({'do': 'hello', 'token': given['token']}))\n"
        "        row = 0\n"
        "        async for message in socket:\n"
        "            if not isinstance(message, bytes):\n"
        "                heard = json.loads(message)\n"
        "                if heard.get('id') == 2:\n"
        "                    print('driving' if heard['ok'] else heard, flush=True)\n"
        "                continue\n"
        # A person drives once there is something to see; a page that drives before shows the motor too late, and is stopped.
        "            begins = row == 0\n"
        "            row = int(struct.unpack_from('<d', message, 16)[0]) + struct.unpack_from('<I', message, 4)[0]\n"
        "            await socket.send(json.dumps({'do': 'beat', 'row': row}))\n"
        "            if begins:\n"
        "                await socket.send(json.dumps({'do': 'lease', 'id': 1}))\n"
        "                await socket.send(json.dumps({'do': 'start', 'id': 2}))\n"
        "asyncio.run(main())\n"
    )

    async def story(sockets: list[Any]) -> None:
        onlooker = await program.page(sockets)
        async with httpx.AsyncClient(base_url=program.base, timeout=PATIENCE) as client:
            await client.get(f"/?token={program.key}")
            told = (await client.get("/api/session", headers={"sec-fetch-site": "same-origin"})).json()
            cookie = "; ".join(f"{name}={value}" for name, value in client.cookies.items())
        given = {
            "address": program.base.replace("http", "ws") + "/ws",
            "origin": program.base,
            "cookie": cookie,
            "token": told["token"],
        }
        page = subprocess.Popen(
            [sys.executable, "-c", script, json.dumps(given)], stdout=subprocess.PIPE, text=True
        )
        try:
            assert page.stdout is not None
            assert (await asyncio.to_thread(page.stdout.readline)).strip() == "driving"
            await onlooker.listen_until(
                lambda: any(each["kind"] == "state" and each["enabled"] for each in onlooker.heard)
            )
            page.send_signal(signal.SIGSTOP)  # it is there, its line is open, and nobody answers

            await onlooker.listen_until(lambda: not onlooker.state["enabled"])
            await onlooker.listen_until(lambda: not onlooker.state["taken"])
            assert onlooker.state["running"]
        finally:
            page.kill()
            page.communicate()

    played(story)


def test_the_servers_death_ends_the_loop_and_what_identifies_it(tmp_path: Path) -> None:
    with panel_in(tmp_path) as program:

        async def story(sockets: list[Any]) -> None:
            page = await program.page(sockets)
            await turning(page)

        played(story)
        handles = {}
        for name in ("servobench.rig.loop.child", "servobench.panel.live_process"):
            (found,) = children(program.process.pid, name)
            handles[name] = os.pidfd_open(found)
        program.process.kill()
        for name, handle in handles.items():
            assert select.select([handle], [], [], PATIENCE)[0], f"{name} goes on without anybody"
            os.close(handle)


@contextmanager
def panel_in(folder: Path) -> Iterator[Program]:
    """A panel of its own for a test that kills it."""
    found = started(folder)
    process = found.process
    try:
        yield Program(process, found.base, lambda: found.address, found.folder)
    finally:
        found.terminal.end(signal.SIGKILL)


async def killed_and_outlived(program: Program) -> None:
    """Kill a panel, and wait until all that it has started have ended."""
    names = ("recording_process", "loop.child", "live_process")
    handles = [os.pidfd_open(each) for name in names for each in children(program.process.pid, name)]
    program.process.kill()
    for handle in handles:
        assert (await asyncio.to_thread(select.select, [handle], [], [], PATIENCE))[0], "it goes on"
        os.close(handle)


@pytest.mark.promise("S25")
def test_a_recording_of_which_the_panel_is_killed_is_finished_by_its_recorder(tmp_path: Path) -> None:
    seen: dict[str, Any] = {}

    async def story(sockets: list[Any]) -> None:
        page = await program.page(sockets)
        assert (await page.say(do="lease"))["ok"]
        (ready,) = children(program.process.pid, "recording_process")
        assert (await page.say(do="record", name="first"))["ok"]
        assert children(program.process.pid, "recording_process") == [
            ready
        ]  # the one that was there beforehand
        await page.listen_until(lambda: (page.state["recording"] or {"samples": 0})["samples"] > 300)

        seen["told"] = page.state["recording"]["samples"]
        seen["t"] = page.column("t")
        await killed_and_outlived(program)

    with panel_in(tmp_path) as program:
        played(story)
        memory = [*Path("/dev/shm").glob(f"servobench-*-{program.process.pid}-*")]

    folder = program.folder / "first"
    (recording,) = read(folder / "recording.mcap")  # a whole file
    (t,) = {id(each.t): each.t for each in recording.series}.values()
    assert t is not None
    assert len(t) >= seen["told"]
    # What a page has seen that is older than 250 ms is there, from the take's first row on.
    old = seen["t"][(seen["t"] >= t[0]) & (seen["t"] < seen["t"][-1] - 0.25)]
    assert len(old) > 100
    assert np.isin(old, t).all()
    assert "the program that started the run has ended" in recording.stopped.sentence
    assert memory == [], sorted((each.name, each.stat().st_size) for each in memory)


@pytest.mark.promise("S25")
def test_a_recorder_that_isn_t_ready_when_the_panel_is_killed_still_records(tmp_path: Path) -> None:
    async def story(sockets: list[Any]) -> None:
        page = await program.page(sockets)
        assert (await page.say(do="lease"))["ok"]
        (ready,) = children(program.process.pid, "recording_process")
        handle = os.pidfd_open(ready)
        os.kill(ready, signal.SIGKILL)
        assert (await asyncio.to_thread(select.select, [handle], [], [], PATIENCE))[0]
        os.close(handle)
        assert (await page.say(do="record", name="late"))["ok"]
        await killed_and_outlived(program)  # its recorder has hardly begun to load what it needs

    with panel_in(tmp_path) as program:
        played(story)

    (recording,) = read(program.folder / "late" / "recording.mcap")
    assert len(recording["applied"].values) > 0
    assert "the program that started the run has ended" in recording.stopped.sentence
    # The next panel tells of it as of any other.
    complete_leftovers(Library(program.folder), None)
    (told,) = Library(program.folder).list()
    assert told["samples"] == len(recording["applied"].values)
    assert told["signal"] == "square"


def test_a_recording_ends_where_its_operator_leaves_and_says_why(program: Program) -> None:
    async def story(sockets: list[Any]) -> None:
        onlooker, page = await program.page(sockets), await program.page(sockets)
        assert (await page.say(do="lease"))["ok"]
        assert (await page.say(do="record", name="ended-by-leave", duration=600.0))["ok"]
        await page.listen_until(lambda: (page.state["recording"] or {"samples": 0})["samples"] > 0)
        page.socket.transport.abort()
        await onlooker.listen_until(lambda: any(each["kind"] == "recorded" for each in onlooker.heard))

        (said,) = [each for each in onlooker.heard if each["kind"] == "recorded"]
        assert said["early"] == "the operator's page is gone; the voltage is zero"
        assert said["length"] < 600.0

    played(story)
