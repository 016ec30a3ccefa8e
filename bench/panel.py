"""The cost and the latency of the panel: the server's processor time, painted frames, the age of what is painted, and the
loop's punctuality with it.

`servobench panel` runs as a program with the simulated motor at 1 kHz, and Chromium shows it: 3 scopes with 4 traces of 10 s,
every sample drawn. A frame counts as painted when the page has stroked a canvas in it. The age is the time from a sample's
deadline in the loop to the end of the first frame's painting that has it; what the compositor and the screen add isn't in it.
The loop's latency is that of bench/realtime.py, with the panel and an open page, and in a program without a panel, in turns.
Its 99th percentile stands where it jumps: the loop spins for as long as 99.7 of 100 wake-ups are late, up to 150 us, so that it
is some 10 ns where one in a hundred wake-ups isn't later than that, and tens or hundreds of us where it is. Two times of some
seconds of the same loop without any panel differ by a factor of hundreds in it; so the ratio is the median of several pairs, and
both values stand beside it, with the time from the deadline to the voltage's being written, which has no such jump.
Linux only; it needs the panel's extra, Playwright and Chromium.
"""

from __future__ import annotations

import asyncio
import importlib.util
import json
import os
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # the tests' program and browser

import numpy as np
from figures import Figure, shown

from servobench.rig.experiment import DeviceChoice, Experiment
from servobench.rig.loop.process import LoopProcess
from servobench.rig.loop.ring import RowReader, RowRing
from servobench.rig.loop.spec import COLUMNS
from tests.panel.browser import NAMES, chromium
from tests.panel.doubles import rows_until
from tests.processes import children
from tests.stories.program import PATIENCE, Page, Program, running

SAMPLE_TIME = 0.001
SOCKETS = (1, 20)
SHARED_MEMORY = Path("/dev/shm")


@dataclass(frozen=True, kw_only=True)
class Size:
    """The length and the number of the measurements."""

    seconds: float = 10.0
    filled: float = 11.0
    """Until the scopes' 10 s are full [s]."""
    settled: float = 2.0
    """Until a page has what was before it [s]."""
    zeroing: float = 2.0
    """For which the loop's time 0 is looked for [s]."""
    pairs: int = 5


WATCH = """
(() => {
    const found = (window.watched = { on: false, frames: [] });
    let newest = -Infinity; // time of the newest row that has come [s]
    let painted = false;
    const stroke = CanvasRenderingContext2D.prototype.stroke;
    CanvasRenderingContext2D.prototype.stroke = function (...given) {
        if (!painted && found.on) {
            painted = true;
            const seen = newest;
            // A message to oneself comes when the frame's scripts are over.
            const { port1, port2 } = new MessageChannel();
            port1.onmessage = () => {
                painted = false;
                found.frames.push([performance.timeOrigin + performance.now(), seen]);
            };
            port2.postMessage(null);
        }
        return stroke.apply(this, given);
    };
    const Given = window.WebSocket;
    window.WebSocket = class extends Given {
        constructor(...given) {
            super(...given);
            this.addEventListener("message", ({ data }) => {
                if (typeof data === "string") return;
                const view = new DataView(data);
                newest = view.getFloat64(24 + 8 * (view.getUint32(4, true) - 1), true);
            });
        }
    };
})();
"""


def experiment(duration: float | None = None) -> Experiment:
    """The experiment of all runs: the paper's square wave at 1 kHz, on the simulated motor in real time."""
    return Experiment(
        sample_time=SAMPLE_TIME,
        duration=duration,
        device=DeviceChoice(name="twin", settings={"timing": "host"}),
    )


@contextmanager
def panel() -> Iterator[Program]:
    """The panel as a program, with that experiment."""
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "experiment.toml"
        file.write_text(experiment().to_toml(), encoding="utf-8")
        with running(Path(name), "--experiment", str(file)) as program:
            yield program


def processor_time(pid: int) -> float:
    """The time that a process has had of a processor, all its threads together [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def live_process(program: Program) -> int:
    """The process in which a panel identifies the motor while it runs."""
    (found,) = children(program.process.pid, "servobench.panel.live_process")
    return found


@dataclass
class Viewers:
    """Sockets that take what they are sent, and do nothing with it."""

    frames: int = 0

    async def share(self, program: Program, count: int, size: Size) -> dict[str, float]:
        """The share of a core that the server needs for `count` of them, and that live identification needs in addition."""
        import httpx
        from websockets.asyncio.client import connect

        async with httpx.AsyncClient(base_url=program.base, timeout=30.0) as client:
            await client.get(f"/?token={program.key}")
            told = (await client.get("/api/session", headers={"sec-fetch-site": "same-origin"})).json()
            cookie = "; ".join(f"{name}={value}" for name, value in client.cookies.items())
        sockets = [
            await connect(
                program.base.replace("http", "ws") + "/ws",
                origin=program.base,  # type: ignore[arg-type]
                additional_headers={"cookie": cookie},
                max_size=None,
                proxy=None,
            )
            for _ in range(count)
        ]
        for socket in sockets:
            await socket.send(json.dumps({"do": "hello", "token": told["token"]}))
        taking = [asyncio.create_task(self._take(socket)) for socket in sockets]
        await sockets[0].send(json.dumps({"do": "lease"}))
        async with asyncio.timeout(PATIENCE):
            while not self.frames:  # until the device is open
                await asyncio.sleep(0.1)
        await sockets[0].send(json.dumps({"do": "start"}))
        await asyncio.sleep(size.settled)
        self.frames = 0
        pids = {"server": program.process.pid, "live": live_process(program)}
        before, begun = {who: processor_time(pid) for who, pid in pids.items()}, time.monotonic()
        await asyncio.sleep(size.seconds)
        lasted = time.monotonic() - begun
        used = {who: (processor_time(pid) - before[who]) / lasted for who, pid in pids.items()}
        for task, socket in zip(taking, sockets, strict=True):
            task.cancel()
            await socket.close()
        return used

    async def _take(self, socket: Any) -> None:
        own = 0
        async for message in socket:
            if isinstance(message, bytes):
                self.frames += 1
                own += 1
                if own % 3 == 0:  # ten times a second, as a page that draws
                    await socket.send(json.dumps({"do": "beat", "row": rows_until(message)}))


def costs(size: Size) -> list[Figure]:
    """The server's share of a core, for one viewer and for 20; that of live identification, a process beside it, has no limit."""
    figures = []
    live = []
    with panel() as program:
        for count, limit in zip(SOCKETS, (3.0, 8.0), strict=True):
            viewers = Viewers()
            shares = asyncio.run(viewers.share(program, count, size))
            sent = viewers.frames / size.seconds / count
            what = f"panel: server's share of a core, {count} socket{'s' if count > 1 else ''} with {sent:.0f} frames/s"
            figures.append(Figure(what=what, value=100 * shares["server"], unit="%", at_most=limit))
            live.append(100 * shares["live"])
    what = "panel: share of a core of live identification, its own process at low priority"
    return [*figures, Figure(what=what, value=max(live), unit="%")]


@dataclass(frozen=True)
class Shown:
    """The frames that a page painted: their number in a second, and the age of the samples when they were painted first [ms]."""

    rate: float
    ages: np.ndarray


def looked_at(program: Program, browser: Any, size: Size) -> tuple[Shown, np.ndarray]:
    """Let a page show the turning motor; return what was painted, and the loop's `times` meanwhile [us]."""
    with Page(browser, program.address, script=WATCH) as page:
        page.drive()
        page.button("Start").click()
        page.page.get_by_text("Driving").wait_for()
        with ring_of(program) as ring:
            page.page.wait_for_timeout(1000 * size.filled)
            zero = time_zero(ring, size.zeroing)
            reader = ring.reader(ring.written)
            page.page.evaluate("() => { watched.on = true; }")
            page.page.wait_for_timeout(1000 * size.seconds)
            frames = np.array(page.page.evaluate("() => { watched.on = false; return watched.frames; }"))
            late = times(reader)
    # The browser's times count from 1970, the loop's from its own start on the monotonic clock.
    painted = frames[:, 0] / 1e3 - (time.time() - time.monotonic()) - zero
    return Shown(
        rate=(len(frames) - 1) / (painted[-1] - painted[0]), ages=1e3 * ages(painted, frames[:, 1])
    ), late


def ages(painted: np.ndarray, newest: np.ndarray) -> np.ndarray:
    """The age of each sample when the first frame that has it was painted [s]."""
    found = [
        now - np.arange(after, before, -SAMPLE_TIME)
        for now, before, after in zip(painted[1:], newest[:-1], newest[1:], strict=True)
    ]
    return np.concatenate(found)


@contextmanager
def ring_of(program: Program) -> Iterator[RowRing]:
    """The ring of rows between a panel and its loop; what identifies it has one, too, of wider rows."""
    with ExitStack() as stack:
        found = SHARED_MEMORY.glob(f"servobench-rows-{program.process.pid}-*")
        rings = [stack.enter_context(RowRing.attach(path.name)) for path in found]
        (ring,) = (ring for ring in rings if ring.columns == COLUMNS)
        yield ring


def time_zero(ring: RowRing, seconds: float) -> float:
    """When the loop's time 0 was [s, monotonic]: a row can't be seen before its time, and of a thousand one is seen at once."""
    offsets, last = [], ring.written
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        if ring.written > last:
            now = time.monotonic()
            last = ring.written
            offsets.append(now - ring.reader(last - 1).read(1)[0, 0])
    return min(offsets)


def times(reader: RowReader) -> np.ndarray:
    """From each tick's deadline to the latch of its sample, and until its voltage was written, of all rows from there on [us]."""
    rows = reader.read(1 << 20)
    if reader.missed:
        raise RuntimeError(f"the bench itself missed {reader.missed} rows")
    return 1e6 * (rows[:, [0, 1 + WRITTEN]] - rows[:, [1 + SCHEDULED]])


def alone(size: Size) -> np.ndarray:
    """The same in a program without a panel [us]."""
    with LoopProcess(
        experiment(size.settled + size.seconds), missed_go_on=True
    ) as loop:  # as the panel's loop does
        found = []
        reader = loop.rows(0)
        while loop.ended is None:
            time.sleep(0.2)
            found.append(times(reader))
        ended = loop.ended
    if ended.reason != "finished":
        raise RuntimeError(f"the run without a panel came to an early end: {ended.sentence}")
    return np.concatenate(found)[int(size.settled / SAMPLE_TIME) :]


def columns(*names: str) -> list[int]:
    """The columns of a row with those names."""
    from servobench.rig.devices.base import connect
    from servobench.rig.loop.opening import opening

    asked = experiment()
    with connect(asked.device.name, **asked.device.settings) as device:
        series = opening(asked, device.info, commanded_live=True, timing="host").series
    found = [each.channel.name for each in series]
    return [found.index(name) for name in names]


SCHEDULED, WRITTEN = columns("scheduled", "written")


def live(size: Size) -> list[Figure]:
    """The figures of a page, and its effect on the loop."""
    seen, p99 = [], []
    for _ in range(size.pairs):
        with chromium() as browser, panel() as program:
            found, with_panel = looked_at(program, browser, size)
        seen.append(found)
        p99.append([np.quantile(with_panel, 0.99, axis=0), np.quantile(alone(size), 0.99, axis=0)])
    every = np.concatenate([each.ages for each in seen])
    half = tuple(float(q) for q in np.quantile(every, (0.25, 0.75)))
    return [
        Figure(
            what="panel: frames painted, 3 scopes, 4 traces of 10 s at 1 kHz",
            value=statistics.median(each.rate for each in seen),
            unit="1/s",
            at_least=29.0,
        ),
        Figure(
            what="panel: sample to pixel", value=float(np.median(every)), half=half, unit="ms", at_most=60.0
        ),  # type: ignore[arg-type]
        *loop_figures(np.array(p99)),
    ]


def loop_figures(p99: np.ndarray) -> list[Figure]:
    """The panel's effect on the loop, from 99th percentiles (pairs, with and without, latched and written) [us]."""
    ratios = p99[:, 0] / p99[:, 1]
    figures = [typical("p99 of the loop with the panel open / without", ratios[:, 0], "times", at_most=1.5)]
    for k, what in enumerate(("the loop", "deadline to voltage written")):
        figures += [
            typical(f"p99 of {what}, {which}", p99[:, row, k], "us")
            for row, which in enumerate(("with the panel open", "without"))
        ]
    return figures


def typical(what: str, values: np.ndarray, unit: str, **limits: float) -> Figure:
    """The median of some values, and the range in which half of them lie."""
    low, value, high = (float(q) for q in np.quantile(values, (0.25, 0.5, 0.75)))
    return Figure(what=what, value=value, half=(low, high), unit=unit, **limits)  # type: ignore[arg-type]


def missing() -> str:
    """The reason why this machine can't run the bench; empty if it can."""
    packages = [
        name for name in ("starlette", "uvicorn", "playwright") if importlib.util.find_spec(name) is None
    ]
    if packages:
        return f"{', '.join(packages)} not installed"
    if not any(map(shutil.which, NAMES)):
        return "no Chromium"
    return "" if SHARED_MEMORY.is_dir() else "not Linux"


def main(size: Size = Size()) -> list[Figure]:
    """All figures."""
    if lacking := missing():
        print(f"panel: {lacking}: nothing was measured", file=sys.stderr)
        return []
    return [*costs(size), *live(size)]


def smallest() -> list[Figure]:
    """All figures, of one pair and half a second each."""
    return main(Size(seconds=0.5, filled=0.5, settled=0.2, zeroing=0.2, pairs=1))


if __name__ == "__main__":
    sys.exit(shown(main()))
