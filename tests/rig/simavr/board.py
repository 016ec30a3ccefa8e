"""The rig in lock-step: the firmware's binary in simavr, driven from Python, in device time, the same in each run."""

from __future__ import annotations

import ctypes as c
from functools import cache
from typing import Any

from servobench.rig.wire.frames import Reader, encode
from servobench.rig.wire.messages import Message, protocol
from tests.rig.simavr import build

CYCLES = 16_000_000  # per second
MS = 16_000  # cycles
OWNER = 0x5EBE

PROTOCOL = protocol()
STATES, FAULTS, REFUSALS, MODES = (PROTOCOL.codes[name] for name in ("states", "faults", "refusals", "modes"))


class Motor(c.Structure):
    """The motor around the chip; as in simrig.c."""

    _fields_ = [
        *(
            (name, c.c_double)
            for name in ("resistance", "inductance", "constant", "inertia", "damping", "coulomb")
        ),
        *((name, c.c_double) for name in ("supply", "counts_per_rev", "start")),
        ("step", c.c_uint32),
    ]

    @property
    def truth(self) -> dict[str, float]:
        """Its gain [rad/(s·V)], slow and fast time constant [s] and Coulomb voltage [V]."""
        damping = self.resistance * self.damping + self.constant**2
        a, b = self.inductance * self.inertia, self.resistance * self.inertia + self.inductance * self.damping
        root = (b * b - 4 * a * damping) ** 0.5
        return {
            "gain": self.constant / damping,
            "time_constant": 2 * a / (b - root),
            "fast": 2 * a / (b + root),
            "coulomb_voltage": self.resistance * self.coulomb / self.constant,
        }


def motor(**others: float) -> Motor:
    """Return the motor of a QUBE-Servo 2 at 12 V, with other values where they are given."""
    values = {
        "resistance": 8.4,
        "inductance": 1.16e-3,
        "constant": 0.042,
        "inertia": 2.0952e-5,
        "damping": 1e-6,
        "coulomb": 8e-4,
        "supply": 12.0,
        "counts_per_rev": 2048.0,
        "start": 0.5,
        "step": 80,
    }
    return Motor(**{**values, **others})


class View(c.Structure):
    """The simulator's state for a test; as in simrig.c."""

    _fields_ = [
        *((name, c.c_uint64) for name in ("cycle", "pwm_high", "pwm_rises", "received")),
        ("edges", c.c_int64),
        *((name, c.c_double) for name in ("angle", "speed", "current", "voltage", "duty")),
        *((name, c.c_uint8) for name in ("pwm", "enable", "in1", "in2", "crashed")),
        ("padding", c.c_uint8 * 3),
        ("output_lost", c.c_uint32),
    ]


@cache
def _library() -> c.CDLL:
    library = c.CDLL(str(build.library()))
    library.rig_new.restype = c.c_void_p
    library.rig_new.argtypes = [c.c_char_p, c.POINTER(Motor)]
    library.rig_edges_left.restype = c.c_int64
    for name, arguments in {
        "rig_free": [],
        "rig_run": [c.c_uint64],
        "rig_run_to_frame": [c.c_uint64],
        "rig_write": [c.c_char_p, c.c_int],
        "rig_unsent": [],
        "rig_read": [c.c_char_p, c.c_int],
        "rig_look": [c.POINTER(View)],
        "rig_move_encoder": [c.c_double, c.c_int64],
        "rig_edges_left": [],
        "rig_block": [c.c_int],
        "rig_stick": [c.c_int],
        "rig_disturb": [],
        "rig_reset": [],
    }.items():
        getattr(library, name).argtypes = [c.c_void_p, *arguments]
    return library


class Board:
    """A rig, from power-on; a context manager."""

    def __init__(self, firmware: str = "rig-500000", around: Motor | None = None) -> None:
        self._library = _library()
        self.motor = around or motor()
        self._rig = self._library.rig_new(str(build.firmware(firmware)).encode(), c.byref(self.motor))
        assert self._rig
        self._reader = Reader()
        self._sequence = -1
        self.heard: list[tuple[Message, dict[str, Any]]] = []
        """Messages that came and weren't taken yet."""
        self.sequence_gaps = 0
        self._last: int | None = None

    def __enter__(self) -> Board:
        self.run(ms=2)
        return self

    def __exit__(self, *_: object) -> None:
        self._library.rig_free(self._rig)

    @property
    def damaged(self) -> int:
        """Frames from the rig that were damaged."""
        return self._reader.damaged

    # Time

    def run(self, ms: float = 0, cycles: int = 0) -> None:
        """Let device time pass, and hear what comes meanwhile."""
        self.let_pass(ms, cycles)
        self._hear()

    def let_pass(self, ms: float, cycles: int = 0) -> None:
        """Let device time pass, and leave what comes to somebody else."""
        self._library.rig_run(self._rig, round(ms * MS) + cycles)

    def look(self) -> View:
        view = View()
        self._library.rig_look(self._rig, c.byref(view))
        assert not view.crashed
        return view

    # Words

    def write(self, data: bytes) -> None:
        assert self._library.rig_write(self._rig, data, len(data)) == len(data)

    def read(self) -> bytes:
        """Return the bytes that came, in place of hearing messages in them."""
        buffer = c.create_string_buffer(65536)
        count = self._library.rig_read(self._rig, buffer, len(buffer))
        return buffer.raw[:count]

    def run_to_frame(self, ms: float) -> None:
        self._library.rig_run_to_frame(self._rig, round(ms * MS))

    def _hear(self) -> None:
        for payload in self._reader.feed(self.read()):
            message = PROTOCOL.of(payload)
            assert message is not None
            values = message.unpack(payload)
            if self._last is not None:
                self.sequence_gaps += (values["sequence"] - self._last - 1) & 0xFF
            self._last = values["sequence"]
            self.heard.append((message, values))

    def send(self, name: str, **values: Any) -> None:
        """Send a message; an owner's message has the owner, unless another one is given."""
        message = PROTOCOL.message(name)
        if any(field.name == "owner" for field in message.fields):
            values = {"owner": OWNER, **values}
        self._sequence += 1
        self.write(encode(message.pack(self._sequence, **values)))

    def ask(self, name: str, **values: Any) -> dict[str, Any]:
        """Send a message that is answered by a STATUS, and return that."""
        self.send(name, **values)
        code = PROTOCOL.message(name).code
        for _ in range(200):
            self.run(ms=0.5)
            for status in self.taken("status"):
                if status["command"] == code:
                    return status
        raise AssertionError(f"no answer to {name}")

    def taken(self, name: str) -> list[dict[str, Any]]:
        """Take the messages of that name that have come, and drop all others before them."""
        found = [values for message, values in self.heard if message.name == name]
        self.heard = []
        return found

    def claim(self) -> dict[str, Any]:
        return self.ask("claim", schema=PROTOCOL.schema)

    def enable(self, mode: str = "direct") -> None:
        """Claim the rig and switch it on."""
        assert self.claim()["refusal"] == 0
        assert self.ask("enable", mode=MODES[mode])["state"] == STATES["operation_enabled"]

    def duty(self, value: int, ms: float = 0) -> None:
        """Put a duty out for that long, renewed each 10 ms."""
        self.send("duty", duty=value)
        while ms > 0:
            self.run(ms=min(ms, 10))
            ms -= 10
            if ms > 0:
                self.send("duty", duty=value)

    def status(self) -> dict[str, Any]:
        return self.ask("hello", schema=PROTOCOL.schema)

    # What happens to it

    def move_encoder(self, rate: float, edges: int) -> None:
        self._library.rig_move_encoder(self._rig, rate, edges)

    def edges_left(self) -> int:
        return int(self._library.rig_edges_left(self._rig))

    def block(self, blocked: bool = True) -> None:
        self._library.rig_block(self._rig, blocked)

    def stick(self, channels: int) -> None:
        self._library.rig_stick(self._rig, channels)

    def disturb(self) -> None:
        self._library.rig_disturb(self._rig)

    def reset(self) -> None:
        self._library.rig_reset(self._rig)
