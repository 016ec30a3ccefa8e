"""A stand-in for the panel's server, for tests of the page: the same protocol, rows from a motor of three lines.

`python -m tests.panel.fake` serves it at http://127.0.0.1:8765/ for work on the page. It checks nobody's right to anything.
"""

from __future__ import annotations

import asyncio
import json
import struct
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from importlib.metadata import files
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from servobench.core.errors import UsageError
from servobench.panel.catalogue import catalogue
from servobench.panel.commands import settings_error_text
from servobench.panel.preview import preview_signal
from servobench.rig.experiment import Experiment
from servobench.systems.signals.base import SIGNALS
from servobench.systems.signals.square import Square

STATIC = Path(__file__).parents[2] / "src" / "servobench" / "panel" / "static"
COLUMNS = (
    *("t", "reference", "commanded", "applied", "counts", "position", "speed_raw"),
    *("speed", "current", "residual", "late", "saturated", "command"),
)
LARGEST = 2**20  # bytes of a file
SAMPLE_TIME = 0.001
GAIN, TIME_CONSTANT, COULOMB, COUNTS = 22.0, 0.09, 0.12, 2048
POLICY = b"default-src 'self'; frame-ancestors 'none'"


def frame(first: float, rows: np.ndarray) -> bytes:
    """A binary frame: header, times in float64, the other columns in float32."""
    n, columns = rows.shape
    head = struct.pack("<IIIId", 0x31425653, n, columns, 0, first)
    return head + rows[:, 0].astype("<f8").tobytes() + rows[:, 1:].T.astype("<f4").tobytes()


@dataclass
class Motor:
    """A first-order lag with an encoder and a low-pass filter behind its derivative."""

    signal: Any = field(default_factory=Square)
    cutoff: float = 50.0
    enabled: bool = False
    since: int = 0
    tick: int = 0
    number: int = 0
    state: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def rows(self, until: int) -> np.ndarray:
        """The rows up to that tick."""
        out = np.empty((until - self.tick, len(COLUMNS)))
        t = np.arange(self.tick, until) * SAMPLE_TIME
        reference = self.signal(t - self.since * SAMPLE_TIME)
        theta, omega, filtered, before = self.state
        for k in range(len(out)):
            wanted = float(reference[k]) if self.enabled else 0.0
            applied = float(np.clip(wanted, -10, 10))
            counts = np.floor(theta / (2 * np.pi) * COUNTS)
            seen = counts * 2 * np.pi / COUNTS
            raw = (seen - before) / SAMPLE_TIME
            filtered += (1 - np.exp(-self.cutoff * SAMPLE_TIME)) * (raw - filtered)
            before = seen
            current = (applied - 0.042 * omega) / 8.4
            row = (reference[k], wanted, applied, counts, seen, raw, filtered, current, seen - theta)
            out[k] = (t[k], *row, 0, applied != wanted, self.number)
            drive = applied - COULOMB * np.tanh(omega / 0.2)
            omega += SAMPLE_TIME * (GAIN * drive - omega) / TIME_CONSTANT
            theta += SAMPLE_TIME * omega
        self.state, self.tick = (theta, omega, filtered, before), until
        return out


class Bench:
    """The bench that all viewers see: one motor, one lease, some recordings."""

    def __init__(self) -> None:
        self.motor = Motor()
        self.began = time.monotonic()
        self.operator: WebSocket | None = None
        self.viewers: set[WebSocket] = set()
        self.signal: dict[str, Any] = {"type": "square", "low": 1.0, "high": 3.0, "frequency": 0.4}
        self.controller: dict[str, Any] = {"type": "open_loop"}
        self.chain = "derivative | lowpass 50 rad/s"
        self.device: dict[str, Any] | None = {
            "name": "twin",
            "settings": {},
            "title": "QUBE-Servo, simulated",
        }
        self.fault: dict[str, str] | None = None
        self.recording: dict[str, Any] | None = None
        self.refuse = ""
        self.silent = False  # nothing goes out, as on a line that was cut
        self.compiling = False  # what follows the motor isn't ready
        self.deaf = False  # no STOP reaches the loop
        self.deaf_to_settings = False  # nor does it answer what is set
        self.stopped = ""
        self.hold = False
        self.limits: list[dict[str, str]] = []
        self.opening: dict[str, Any] | None = None
        self.closed = ""
        self.working: dict[str, Any] | None = None  # what an identification says of itself until it's None
        self.results: dict[
            str, dict[str, Any]
        ] = {}  # what differs from what an identification says otherwise
        self.spoilt: set[str] = set()  # recordings whose file can't be read
        self.uploads: list[tuple[str, int]] = []
        self.warnings: list[str] = []  # of the next upload
        self.unclear: dict[str, Any] | None = None  # what is asked about the next upload
        self.said: dict[str, Any] = {}
        self.received: list[dict[str, Any]] = []
        self.signs: list[dict[str, Any]] = []  # what pages say of themselves, which nobody answers
        self.loop: asyncio.AbstractEventLoop
        self.pending: dict[str, Any] | None = None
        self.kept = np.empty((0, len(COLUMNS)))
        self.recordings = {
            name: {
                "name": name,
                "created": f"2026-11-2{day}T09:{minute}:00Z",
                "duration": 10.0,
                "samples": 10000,
                "signal": signal,
                "notes": notes,
                "verdict": verdict,
                "deleted": False,
            }
            for day, minute, name, signal, notes, verdict in [
                (1, 41, "square-1-3", "square", "first try, no load", "trusted"),
                (1, 17, "prbs-disc", "prbs", "", "doubtful"),
                (0, 52, "chirp-slow", "chirp", "cable was loose", None),
            ]
        }

    def state(self, viewer: WebSocket) -> dict[str, Any]:
        return {
            "kind": "state",
            "followed": True,
            "running": self.device is not None and self.opening is None and not self.closed,
            "opening": self.opening,
            "closed": self.closed,
            "enabled": self.motor.enabled,
            "stopped": self.stopped,
            "operator": viewer is self.operator,
            "taken": self.operator is not None,
            "signal": self.signal,
            "controller": self.controller,
            "chain": self.chain,
            "sample_time": SAMPLE_TIME,
            "device": self.device,
            "fault": self.fault,
            "late": 3,
            "missed": 0,
            "limits": self.limits,
            "recording": self.recording,
            "command": self.motor.number,
        }

    async def tell(self, message: dict[str, Any] | bytes) -> None:
        if self.silent:
            return
        for viewer in list(self.viewers):
            with suppress(RuntimeError, WebSocketDisconnect):
                if isinstance(message, bytes):
                    await viewer.send_bytes(message)
                else:
                    await viewer.send_text(json.dumps(message))

    def turn(self, ticks: int) -> None:
        """Let the time of so many ticks pass at once: their rows come with the next frame."""
        self.began -= ticks * SAMPLE_TIME

    def drop_all(self) -> None:
        """Close every viewer's socket, as a server that goes does; called from another thread."""
        for viewer in list(self.viewers):
            asyncio.run_coroutine_threadsafe(viewer.close(1001), self.loop)

    async def tell_state(self) -> None:
        if self.silent:
            return
        for viewer in list(self.viewers):
            with suppress(RuntimeError, WebSocketDisconnect):
                await viewer.send_text(json.dumps(self.state(viewer)))

    def take(self, viewer: WebSocket, asked: dict[str, Any]) -> dict[str, Any]:
        """Do what was asked, and return the answer."""
        do = asked.get("do")
        if do == "stop":
            if self.deaf:
                return {"ok": True, "number": 10**6}  # the server told the loop, which says nothing
            self.stopped = "STOP was pressed; the voltage is zero"
            self.motor.number += 1
            self.motor.enabled = False
            self.acknowledge({"enabled": False})
            return {"ok": True, "number": self.motor.number}
        if do == "lease":
            if self.operator not in (None, viewer):
                return {"ok": False, "error": "somebody else drives the motor; you can watch, and STOP"}
            self.operator = viewer
            return {"ok": True}
        if viewer is not self.operator:
            return {"ok": False, "error": "only who has taken control can do this"}
        if do == "release":
            self.operator = None
        elif do == "open":
            self.device = {**asked["device"], "title": asked["device"]["name"]}
        elif do == "acknowledge":
            self.fault = None
        elif do == "record":
            self.recording = {
                "name": asked.get("name") or "run-4",
                "samples": 0,
                "length": 0.0,
                "duration": asked.get("duration"),
            }
        elif do == "end_record":
            self.ended = self.end_recording()
        elif do in ("set", "start", "halt"):
            return self.command(asked)
        return {"ok": True}

    def command(self, asked: dict[str, Any]) -> dict[str, Any]:
        do, self.motor.number = asked["do"], self.motor.number + 1
        what, accepted = do, not self.refuse
        if do in ("start", "halt"):
            self.motor.enabled, self.motor.since = do == "start", self.motor.tick
            self.stopped = ""
        if "signal" in asked:
            what = "signal"
            try:
                given = dict(asked["signal"])
                self.motor.signal = SIGNALS[given.pop("type")](**given)
                self.signal, self.motor.since = asked["signal"], self.motor.tick
            except ValidationError as error:
                return {"ok": False, "error": settings_error_text(error)}
        if "controller" in asked and accepted:
            what, self.controller = "controller", asked["controller"]
        if "chain" in asked and accepted:
            what, self.chain = "chain", asked["chain"]
            self.motor.cutoff = float(self.chain.split("lowpass ")[1].split()[0])
        self.acknowledge({what: None}, accepted)
        return {"ok": True, "number": self.motor.number}

    def acknowledge(self, what: dict[str, Any], accepted: bool = True) -> None:
        """The loop's word on the last command."""
        acknowledged = {"number": self.motor.number, "tick": self.motor.tick, "accepted": accepted}
        acknowledged["time"] = self.motor.tick * SAMPLE_TIME
        self.pending = {"kind": "applied", **acknowledged, "what": what, "why": self.refuse or None}

    def end_recording(self) -> dict[str, Any]:
        """The outcome of the recording."""
        name = str((self.recording or {}).get("name"))
        seconds = (self.recording or {}).get("samples", 0) * SAMPLE_TIME
        entry = {
            "created": "2026-11-21T10:00:00Z",
            "duration": seconds,
            "samples": round(seconds / SAMPLE_TIME),
        }
        kind = str(self.signal["type"])
        self.recordings[name] = {
            "name": name,
            **entry,
            "signal": kind,
            "notes": "",
            "verdict": None,
            "deleted": False,
        }
        wanted, self.recording = (self.recording or {}).get("duration"), None
        early = "it was stopped by hand" if wanted and seconds < wanted else ""
        return {"name": name, "length": seconds, "duration": wanted, "early": early}

    async def run(self) -> None:
        """Fifteen times a second, as each is drawn: new rows to everybody; now and then the state and the live model."""
        turn = 0
        while True:
            await asyncio.sleep(1 / 15)
            turn += 1
            await self.tell({"kind": "beat"})
            until = int((time.monotonic() - self.began) / SAMPLE_TIME)
            if turn % 5 == 0:
                await self.tell_state()
            if self.device is None or self.closed or until <= self.motor.tick:
                continue
            first, rows = self.motor.tick, self.motor.rows(until)
            self.kept = np.concatenate([self.kept, rows])[-10000:]
            await self.tell(frame(first, rows))
            if self.recording is not None:
                self.recording["samples"] += len(rows)
                self.recording["length"] = self.recording["samples"] * SAMPLE_TIME
                wanted = self.recording["duration"]
                if wanted and self.recording["samples"] * SAMPLE_TIME >= wanted:
                    await self.tell({"kind": "recorded", **self.end_recording()})
                    await self.tell({"kind": "library"})
            if turn % 3 == 0 and not self.compiling:
                await self.tell(self.live(until))

    def live(self, samples: int) -> dict[str, Any]:
        share = 0.3 / np.sqrt(1 + samples / 500)
        truth = {
            "gain": (GAIN, "rad/(s·V)"),
            "time_constant": (TIME_CONSTANT, "s"),
            "coulomb_voltage": (COULOMB, "V"),
        }
        parameters = {
            name: {"value": v, "interval": [v * (1 - share * k), v * (1 + share * k)], "unit": unit}
            for k, (name, (v, unit)) in enumerate(truth.items(), 1)
        }
        enough = bool(share * 2 < 0.02)
        return {"kind": "live", "parameters": parameters, "white": True, "enough": enough, "samples": samples}


def app() -> Starlette:
    """The whole server, with one bench in `app.state.bench`."""
    bench = Bench()
    shipped = {Path(str(f)).name: f.locate() for f in files("uplot-python") or [] if "static" in str(f)}

    async def page(_: Request) -> Response:
        return HTMLResponse((STATIC / "index.html").read_text("utf-8"))

    async def static(request: Request) -> Response:
        return FileResponse(STATIC / Path(request.path_params["name"]).name)

    async def uplot(request: Request) -> Response:
        return FileResponse(str(shipped[request.path_params["name"]]))

    async def session(_: Request) -> Response:
        about = {"device": bench.device, "version": "0.0", "largest_upload": LARGEST}
        return JSONResponse({"token": "fake", "operator": True, **about})

    async def preview(request: Request) -> Response:
        experiment = Experiment(controller=bench.controller, sample_time=SAMPLE_TIME)
        try:
            return JSONResponse(preview_signal(await request.json(), experiment))
        except UsageError as error:
            return JSONResponse({"error": str(error)}, status_code=400)

    async def stop(_: Request) -> Response:
        bench.motor.enabled = bench.motor.enabled and bench.deaf
        await bench.tell({"kind": "stopped", "sentence": "STOP was pressed; the motor gets no voltage"})
        return JSONResponse({"stopped": True})

    async def recordings(_: Request) -> Response:
        return JSONResponse(list(bench.recordings.values()))

    async def change(request: Request) -> Response:
        entry = bench.recordings[request.path_params["name"]]
        what = request.path_params["what"]
        if what == "notes":
            entry["notes"] = (await request.json())["notes"]
        elif what in ("delete", "undelete"):
            entry["deleted"] = what == "delete"
        elif what == "identify":
            while bench.working is not None:
                await bench.tell({"kind": "work", "name": entry["name"], **bench.working})
                await asyncio.sleep(0.05)
            found = identified(entry["name"])
            entry["verdict"] = found["verdict"]
            await bench.tell({"kind": "work", "name": entry["name"], "over": True})
            return JSONResponse(found)
        await bench.tell({"kind": "library"})
        return JSONResponse({})

    async def result(request: Request) -> Response:
        name = request.path_params["name"]
        if not bench.recordings[name]["verdict"]:
            return JSONResponse({"error": f"{name} isn't identified yet"}, status_code=404)
        return JSONResponse({**identified(name), **bench.results.get(name, {})})

    async def ended(request: Request) -> Response:
        bench.working = None
        return JSONResponse({})

    async def upload(request: Request) -> Response:
        bench.uploads.append((request.query_params["name"], len(await request.body())))
        bench.recordings["prbs-disc"]["warnings"] = bench.warnings
        while bench.hold:
            await asyncio.sleep(0.01)
        if bench.unclear is None:
            return JSONResponse({"name": "uploaded", "open": False, "warnings": bench.warnings})
        entry = {"name": "theirs", "created": "2026-11-21T10:00:00", "duration": 0.0, "samples": 1000}
        more = {"signal": "", "notes": "", "verdict": "", "deleted": False, "columns": "open"}
        bench.recordings["theirs"] = {**entry, **more}
        return JSONResponse({"name": "theirs", "open": True})

    async def columns(request: Request) -> Response:
        entry = bench.recordings[request.path_params["name"]]
        if request.method == "GET":
            return JSONResponse({**(bench.unclear or {}), "said": bench.said})
        bench.said = await request.json()
        entry["columns"], entry["duration"] = "said", 4.995
        return JSONResponse({})

    async def rows(request: Request) -> Response:
        name = request.path_params["name"]
        if name in bench.spoilt:
            return JSONResponse({"error": f"{name} isn't an MCAP file"}, status_code=422)
        return Response(frame(0, bench.kept), media_type="application/octet-stream")

    async def download(request: Request) -> Response:
        return Response(b"t\n0\n", headers={"Content-Disposition": "attachment; filename=fake.csv"})

    async def report(_: Request) -> Response:
        return HTMLResponse("<title>report</title><h1>Report</h1>")

    async def socket(ws: WebSocket) -> None:
        await ws.accept()
        if (await ws.receive_json()).get("do") != "hello":
            await ws.close(4401)
            return
        if len(bench.kept):
            await ws.send_bytes(frame(bench.motor.tick - len(bench.kept), bench.kept))
        bench.viewers.add(ws)
        await ws.send_text(json.dumps(bench.state(ws)))
        with suppress(
            RuntimeError, WebSocketDisconnect
        ):  # gone while it waited, or while it was being answered
            while True:
                asked = await ws.receive_json()
                if asked.get("do") in ("beat", "hidden"):
                    bench.signs.append(asked)
                    continue
                bench.received.append(asked)
                bench.pending = None
                if bench.silent or (bench.deaf_to_settings and asked.get("do") == "set"):
                    continue
                answer = bench.take(ws, asked)
                await ws.send_text(json.dumps({"kind": "answer", "id": asked.get("id"), **answer}))
                if asked.get("do") == "end_record":
                    await bench.tell({"kind": "recorded", **bench.ended})
                    await bench.tell({"kind": "library"})
                if asked.get("do") == "stop":
                    await bench.tell(
                        {"kind": "stopped", "sentence": "STOP was pressed; the motor gets no voltage"}
                    )
                if bench.pending is not None:
                    while bench.hold:
                        await asyncio.sleep(0.01)
                    await bench.tell(bench.pending)
                await bench.tell_state()
        bench.viewers.discard(ws)
        if bench.operator is ws:
            bench.operator, bench.motor.enabled = None, False

    async def fault(request: Request) -> Response:
        code = request.query_params.get("code", "stall")
        sentence = {
            "stall": "the shaft stood still for 1 s at 6 V; free it, then acknowledge",
            "ticks-missed": "60 of the last 500 ticks were missed; the voltage is zero",
        }[code]
        bench.fault, bench.motor.enabled = {"code": code, "sentence": sentence}, False
        await bench.tell({"kind": "fault", **bench.fault})
        return JSONResponse({})

    async def refuse(request: Request) -> Response:
        bench.refuse = request.query_params.get("why", "")
        return JSONResponse({})

    routes = [
        Route("/", page),
        Route("/static/{name}", static),
        Route("/uplot/{name}", uplot),
        Route("/api/session", session),
        Route("/api/catalogue", lambda _: JSONResponse(catalogue())),
        Route("/api/preview", preview, methods=["POST"]),
        Route("/api/stop", stop, methods=["POST"]),
        Route("/api/recordings", recordings),
        Route("/api/recordings/{name}/columns", columns, methods=["GET", "POST"]),
        Route("/api/recordings/{name}/rows", rows),
        Route("/api/recordings/{name}/result", result),
        Route("/api/recordings/{name}/download", download),
        Route("/api/recordings/{name}/identify/end", ended, methods=["POST"]),
        Route("/api/recordings/{name}/{what}", change, methods=["POST"]),
        Route("/api/upload", upload, methods=["POST"]),
        Route("/reports/{name}", report),
        Route("/fake/fault", fault, methods=["POST"]),
        Route("/fake/refuse", refuse, methods=["POST"]),
        WebSocketRoute("/ws", socket),
    ]

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        bench.loop = asyncio.get_running_loop()
        going = asyncio.create_task(bench.run())
        yield
        going.cancel()

    made = Starlette(routes=routes, lifespan=lifespan, middleware=[Middleware(Headers)])
    made.state.bench = bench
    return made


class Headers:
    """The content security policy that the panel sends, so that the page is tried under it."""

    def __init__(self, app: Any) -> None:
        self.app = app

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        async def with_policy(message: Any) -> None:
            if message["type"] == "http.response.start":
                message["headers"] += [(b"content-security-policy", POLICY), (b"cache-control", b"no-store")]
            await send(message)

        await self.app(scope, receive, with_policy)


def identified(name: str) -> dict[str, Any]:
    """The answer to an identification, as far as the page reads it."""
    units = {"gain": "rad/(s·V)", "time_constant": "s", "coulomb_voltage": "V", "delay": "s"}
    own = {"prbs-disc": ("doubtful", (22.10, 0.0909, 0.145, 0.00053), (0.04, 0.0004, 0.004, 0.00004))}
    usual = ("trusted", (22.04, 0.0898, 0.120, 0.00050), (0.03, 0.0003, 0.003, 0.00003))
    verdict, figures, deviations = own.get(name, usual)
    values = {key: (v, sd, units[key]) for key, v, sd in zip(units, figures, deviations, strict=True)}
    return {
        "schema": "servobench.result/2",
        "verdict": verdict,
        "structure": "first_order",
        "findings": [
            {"code": "small_swing", "severity": "info", "sentence": "The input has two levels only."}
        ],
        "parameters": {
            key: {"value": v, "sd": sd, "interval": [v - 2 * sd, v + 2 * sd], "level": 0.95, "unit": unit}
            for key, (v, sd, unit) in values.items()
        },
        "report": f"/reports/{name}",
    }


if __name__ == "__main__":
    import uvicorn

    uvicorn.run(app(), host="127.0.0.1", port=8765, log_level="warning", lifespan="on")
