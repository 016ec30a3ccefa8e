"""A board of another maker, in Python: the protocol once more, in virtual time; what a defect changes is a method."""

from __future__ import annotations

import itertools
from collections import deque
from typing import Any

from servobench.rig.wire.frames import check16, crc16, encode
from servobench.rig.wire.messages import Message, protocol

PROTOCOL = protocol()
C = PROTOCOL.constants
STATES, FAULTS, REFUSALS, MODES = (PROTOCOL.codes[name] for name in ("states", "faults", "refusals", "modes"))
TURN = 50  # ms
ACTUATION = ("duty", "table", "reference")
OWNED = {each.code: each for each in PROTOCOL.messages if each.checked}
ENABLED = STATES["operation_enabled"]


class Refused(Exception):
    """A frame that the board refuses."""

    def __init__(self, why: str) -> None:
        super().__init__(why)
        self.code = REFUSALS[why]


def need(holds: bool, why: str) -> None:
    if not holds:
        raise Refused(why)


class FakeBoard:
    """A board that keeps all rules; a port whose reads let its time pass."""

    schema = PROTOCOL.schema
    has_law = True
    boots_after_claim = 0

    def __init__(self) -> None:
        self.ticks = 1000
        self.rest = bytearray()
        self.out = bytearray()
        self.sequence = 0
        self.received = 0xFF
        self.counters = dict.fromkeys(
            ("crc_bad", "received_gaps", "refused", "rx_lost", "tx_lost", "encoder_errors", "ticks_lost"), 0
        )
        self.state, self.faults, self.warnings = STATES["switch_on_disabled"], 0, 0
        self.owner, self.watchdog_ms, self.left = 0, 50, 0
        self.mode, self.duty, self.position, self.speed = 0, 0, 0.0, 0.0
        self.stall_duty, self.still = 410, 0
        self.boots = 1
        self.period = self.until_sample = self.index = self.in_blocks = 0
        self.samples: deque[dict[str, int]] = deque()
        self.table: deque[int] = deque()
        self.table_next, self.table_ended = 0, False
        self.kp, self.ki, self.limit, self.reference, self.sum = 0, 0, 1024, 0, 0
        self.told = (self.state, 0, 0)

    # The port

    def now(self) -> float:
        return self.ticks / 1000

    def read(self) -> bytes:
        for _ in range(TURN):
            if self.out:
                break
            self.tick()
        found, self.out = bytes(self.out), bytearray()
        return found

    def write(self, data: bytes) -> None:
        for byte in data:
            self.take_byte(byte)

    def close(self) -> None:
        pass

    # Frames

    def take_byte(self, byte: int) -> None:
        if byte:
            self.rest.append(byte)
            return
        frame, self.rest = bytes(self.rest), bytearray()
        if not frame:
            return
        payload = self.unstuff(frame)
        if payload is None or not self.right(payload):
            self.counters["crc_bad"] += 1
        else:
            self.take(payload[:-2])

    def unstuff(self, frame: bytes) -> bytes | None:
        found = bytearray()
        place = 0
        while place < len(frame):
            run = frame[place + 1 : place + frame[place]]
            if len(run) != frame[place] - 1:
                return None
            found += run
            place += frame[place]
            if place < len(frame):
                found.append(0)
        return bytes(found) if len(found) >= 4 else None

    def right(self, payload: bytes) -> bool:
        return crc16(payload[:-2]) == int.from_bytes(payload[-2:], "little")

    def send(self, name: str, **values: Any) -> None:
        self.out += encode(PROTOCOL.message(name).pack(self.sequence, **values))
        self.sequence = self.next_number(self.sequence)

    def next_number(self, number: int) -> int:
        return (number + 1) & 0xFF

    # Messages

    def take(self, payload: bytes) -> None:
        message = PROTOCOL.of(payload)
        name = message.name if message else ""
        if name != "hello":
            self.counters["received_gaps"] += self.gap(payload[1])
        self.received = payload[1]
        refusal = 0
        try:
            self.obey(message, payload)
        except Refused as refused:
            refusal = refused.code
            self.counters["refused"] += 1
        if refusal or name not in ACTUATION:
            self.send_status(payload[0], refusal)

    def gap(self, number: int) -> int:
        return (number - self.received - 1) & 0xFF

    def obey(self, message: Message | None, payload: bytes) -> None:
        need(message is not None and message.sender == "host", "unknown")
        assert message is not None
        if not self.has_law and message.name in ("gains", "reference"):
            raise Refused("unknown")
        self.check_length(message, payload)
        values = message.unpack(payload[: message.struct.size])
        if message.checked:
            self.check_second(payload)
            self.check_owner(values["owner"])
        getattr(self, f"on_{message.name}")(
            **{name: each for name, each in values.items() if name != "check"}
        )

    def check_length(self, message: Message, payload: bytes) -> None:
        need(message.name == "stop" or len(payload) == message.struct.size, "unknown")

    def check_second(self, payload: bytes) -> None:
        need(check16(payload[:-2]) == int.from_bytes(payload[-2:], "little"), "damaged")

    def check_owner(self, owner: int) -> None:
        need(owner != 0 and owner == self.owner, "owner")

    def send_status(self, command: int, refusal: int) -> None:
        self.told = (self.state, self.faults, self.warnings)
        self.send(
            "status",
            ack=self.received,
            command=command,
            refusal=refusal,
            state=self.state,
            faults=self.faults,
            warnings=self.warnings,
            reset_cause=1,
            owner=self.owner,
            watchdog_ms=self.watchdog_ms,
            time=self.clock(),
            position=int(self.position),
            table_next=self.table_next,
            **self.counters,
        )

    def clock(self) -> int:
        return self.ticks

    def on_hello(self, sequence: int, schema: int) -> None:
        self.send("info", schema=self.schema, firmware=1, baud=500_000, reset_cause=1, boots=self.boots)
        need(schema == self.schema, "schema")

    def on_claim(self, sequence: int, schema: int, owner: int) -> None:
        need(schema == self.schema, "schema")
        need(owner != 0, "value")
        need(self.state in (STATES["switch_on_disabled"], STATES["ready"]), "state")
        self.owner, self.state, self.boots = owner, STATES["ready"], self.boots_after_claim

    def on_configure(self, sequence: int, owner: int, watchdog_ms: int, stall_duty: int) -> None:
        need(C["watchdog_min_ms"] <= watchdog_ms <= C["watchdog_max_ms"], "value")
        need(1 <= stall_duty <= C["duty_full"], "value")
        need(self.state == STATES["ready"], "state")
        self.watchdog_ms, self.stall_duty = watchdog_ms, stall_duty

    def on_gains(self, sequence: int, owner: int, kp: int, ki: int, limit: int) -> None:
        need(0 <= kp <= 2**24 and 0 <= ki <= 2**24 and 1 <= limit <= C["duty_full"], "value")
        need(self.state == STATES["ready"], "state")
        self.kp, self.ki, self.limit = kp, ki, limit

    def on_sampling(self, sequence: int, owner: int, period: int, block: int) -> None:
        need(block <= 1, "value")
        need(bool(period) or self.state != ENABLED or self.mode == MODES["direct"], "state")
        self.period, self.until_sample, self.index, self.in_blocks = period, 1, 0, block
        self.samples.clear()

    def on_enable(self, sequence: int, owner: int, mode: int) -> None:
        need(mode <= 3, "value")
        need(self.state == STATES["ready"], "state")
        self.state, self.mode, self.still, self.sum = ENABLED, mode, 0, 0
        self.reference = int(self.position) if mode == MODES["position"] else 0

    def on_duty(self, sequence: int, owner: int, duty: int) -> None:
        need(abs(duty) <= C["duty_full"], "value")
        need(self.state == ENABLED, "state")
        self.mode = MODES["direct"]
        self.duty = duty
        self.feed()

    def on_table(
        self, sequence: int, owner: int, first: int, count: int, last: int, duty: tuple[int, ...]
    ) -> None:
        need(self.state == ENABLED and self.mode == MODES["table"], "state")
        self.check_first(first)
        need(count <= C["table_chunk"] and count <= C["table_size"] - len(self.table), "value")
        need(not (self.table_ended and count), "value")
        need(all(abs(each) <= C["duty_full"] for each in duty[:count]), "value")
        self.table.extend(duty[:count])
        self.table_next += count
        self.table_ended |= bool(last)
        if self.left:
            self.feed()

    def check_first(self, first: int) -> None:
        need(first == self.table_next, "gap")

    def on_reference(self, sequence: int, owner: int, reference: int) -> None:
        need(self.state == ENABLED and self.mode in (MODES["position"], MODES["speed"]), "state")
        self.reference = reference
        self.feed()

    def on_stop(self, sequence: int) -> None:
        if self.state == ENABLED:
            self.let_go(STATES["ready"])

    def on_clear(self, sequence: int) -> None:
        need(self.state == STATES["fault"], "state")
        self.state, self.faults, self.owner = STATES["switch_on_disabled"], 0, 0

    def on_release(self, sequence: int, owner: int) -> None:
        need(self.state == STATES["ready"], "state")
        self.state, self.owner = STATES["switch_on_disabled"], 0
        self.period = 0

    def on_set_position(self, sequence: int, owner: int, position: int) -> None:
        need(self.state == STATES["ready"], "state")
        self.position = float(position)

    # Time

    def feed(self) -> None:
        self.left = self.watchdog_ms

    def let_go(self, state: int) -> None:
        self.state, self.duty, self.left = state, 0, 0
        self.table.clear()
        self.table_next, self.table_ended = 0, False

    def fault(self, name: str) -> None:
        self.faults |= FAULTS[name]
        self.let_go(STATES["fault"])

    def tick(self) -> None:
        self.ticks += 1
        torque = self.duty if abs(self.duty) > 3 else 0
        self.speed += (20.0 * torque - self.speed) / 100  # 20 counts/s for a duty, 100 ms
        self.position += self.speed / 1000
        if self.period:
            self.until_sample -= 1
            if self.until_sample <= 0:
                self.until_sample = self.period
                self.sample()
        if self.state == ENABLED:
            self.watch()
        if self.told != (self.state, self.faults, self.warnings):
            self.send_status(0, 0)

    def watch(self) -> None:
        if self.left:
            self.left -= 1
            if not self.left:
                self.trip()
                return
        self.watch_stall()

    def trip(self) -> None:
        self.fault("watchdog")

    def watch_stall(self) -> None:
        self.still = self.still + 1 if abs(self.duty) > self.stall_duty and abs(self.speed) < 1 else 0
        self.warnings = int(self.still >= C["stall_warning_ms"])
        if self.still >= C["stall_cut_ms"]:
            self.fault("stall")

    def sample(self) -> None:
        before = self.duty
        if self.state == ENABLED and self.mode != MODES["direct"]:
            self.set_duty()
        at = {"index": self.index, "time": self.clock(), "position": int(self.position)}
        self.index += 1
        common = {"state": self.state, "faults": self.faults}
        if not self.in_blocks:
            self.send("sample", **at, duty=before, age=0xFFFF, current=512, **common)
            return
        self.samples.append({**at, "duty": self.duty})
        if len(self.samples) == C["block_samples"]:
            each = list(self.samples)
            self.samples.clear()
            self.send(
                "block",
                **{name: each[0][name] for name in at},
                delta=[b["position"] - a["position"] for a, b in itertools.pairwise(each)],
                duty=[one["duty"] for one in each],
                current=[512] * 8,
                table_next=self.table_next,
                **common,
            )

    def set_duty(self) -> None:
        if self.mode == MODES["table"]:
            self.take_from_table()
        elif self.left:
            measured = int(self.position) if self.mode == MODES["position"] else int(self.speed)
            error, full = self.reference - measured, self.limit << 24
            self.sum = max(-full, min(full, self.sum + self.ki * error))
            self.duty = self.limited((self.kp * error << 8) + self.sum) >> 24

    def limited(self, duty: int) -> int:
        return max(-self.limit << 24, min(self.limit << 24, duty))

    def take_from_table(self) -> None:
        if not self.table and not self.table_ended:
            self.run_out()
            return
        if not self.left:
            self.feed()
        self.duty = self.table.popleft() if self.table else 0

    def run_out(self) -> None:
        self.fault("table_empty")
