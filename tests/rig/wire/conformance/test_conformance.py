"""The conformance test: boards that keep the rig's protocol pass, the firmware too, and each defect is found by its check."""

from functools import partial
from pathlib import Path
from typing import Any

import pytest

from servobench.rig.wire import serial_port
from servobench.rig.wire.conformance import __main__ as command
from servobench.rig.wire.conformance.base import outcomes
from servobench.rig.wire.conformance.checks import AT_REST
from servobench.rig.wire.conformance.driven import DRIVEN
from servobench.rig.wire.conformance.session import Session
from servobench.rig.wire.messages import protocol
from tests.rig.simavr.board import CYCLES
from tests.rig.simavr.build import needed
from tests.rig.simavr.lockstep import LockStepPort
from tests.rig.wire.conformance.fake_board import ENABLED, MODES, STATES, FakeBoard, Refused, need

ROOT = Path(__file__).resolve().parents[4]
CHECKS = [*AT_REST, *DRIVEN]


def session_with(board: FakeBoard) -> Session:
    return Session(board, now=board.now, owner=4711)


def failures(board: FakeBoard) -> list[str]:
    return [each.check.name for each in outcomes(CHECKS, session_with(board)) if each.verdict == "failed"]


def lines(session: Session, *, spin: bool) -> tuple[int, list[str]]:
    written: list[str] = []
    status = command.report(session, spin=spin, write=written.append)
    return status, "".join(written).splitlines()


@pytest.mark.parametrize("firmware", ["rig-500000", pytest.param("rig-115200", marks=pytest.mark.long)])
def test_the_firmware_passes_all_of_it_in_simavr(firmware: str) -> None:
    needed()
    port = LockStepPort(firmware)

    status, said = lines(Session(port, now=lambda: port.board.look().cycle / CYCLES, owner=4711), spin=True)

    assert status == 0, "\n".join(said)
    assert said[-2] == f"{len(CHECKS)} passed, 0 failed, 0 not offered"


def test_another_maker_s_board_passes_all_of_it() -> None:
    assert failures(FakeBoard()) == []


def test_each_rule_is_a_sentence_of_the_protocol_s_page() -> None:
    page = " ".join((ROOT / "docs/reference/rig-protocol.md").read_text(encoding="utf-8").split())

    assert [each.rule for each in CHECKS if " ".join(each.rule.split()) not in page] == []


def test_nothing_is_put_out_unless_it_was_asked_for() -> None:
    class Watched(FakeBoard):
        most = 0

        def tick(self) -> None:
            super().tick()
            self.most = max(self.most, abs(self.duty))

    still, turned = Watched(), Watched()

    assert lines(session_with(still), spin=False)[0] == 0
    assert lines(session_with(turned), spin=True)[0] == 0
    assert still.most == 0
    assert turned.most == 256


def test_what_is_not_offered_and_what_was_not_asked_for_is_reported() -> None:
    class Lawless(FakeBoard):
        has_law = False

    status, said = lines(session_with(Lawless()), spin=False)

    assert status == 0
    assert "not offered  law" in "\n".join(said)
    assert f"{len(AT_REST) - 1} passed, 0 failed, 1 not offered, {len(DRIVEN)} turn the motor" in said[-2]


# One defect each, of a kind that a first firmware has.


class IgnoresSchema(FakeBoard):
    def on_claim(self, sequence: int, schema: int, owner: int) -> None:
        super().on_claim(sequence, self.schema, owner)


class OtherSchema(FakeBoard):
    schema = protocol().schema ^ 2


class SaysNothingInTable(FakeBoard):
    def on_hello(self, sequence: int, schema: int) -> None:
        if self.state != ENABLED:
            super().on_hello(sequence, schema)


class AcceptsDamage(FakeBoard):
    def right(self, payload: bytes) -> bool:
        return True


class CountsNoDamage(FakeBoard):
    def take_byte(self, byte: int) -> None:
        before = self.counters["crc_bad"]
        super().take_byte(byte)
        self.counters["crc_bad"] = before


class HasShortBuffer(FakeBoard):
    """A frame that is too long is cut into two, and the second one counted, too."""

    def take_byte(self, byte: int) -> None:
        if len(self.rest) >= 64:
            super().take_byte(0)
        super().take_byte(byte)


class IgnoresSecondChecksum(FakeBoard):
    def check_second(self, payload: bytes) -> None:
        pass


class ChecksDutiesOnly(FakeBoard):
    def check_second(self, payload: bytes) -> None:
        if payload[0] == protocol().message("duty").code:
            super().check_second(payload)


class WaitsForWholeFrames(FakeBoard):
    """Each write has to hold whole frames: what a program sees that reads its port by packets."""

    def write(self, data: bytes) -> None:
        self.rest = bytearray()
        super().write(data)


class TakesFirstOfPacket(FakeBoard):
    def write(self, data: bytes) -> None:
        super().write(data.lstrip(b"\0").partition(b"\0")[0] + b"\0")


class NumbersOfSevenBits(FakeBoard):
    def next_number(self, number: int) -> int:
        return (number + 1) & 0x7F


class CountsNoGaps(FakeBoard):
    def gap(self, number: int) -> int:
        return 0


class CountsFromNought(FakeBoard):
    def gap(self, number: int) -> int:
        return (number - self.received) & 0xFF


class IgnoresLength(FakeBoard):
    def check_length(self, message: Any, payload: bytes) -> None:
        pass


class EnablesTwice(FakeBoard):
    def on_enable(self, sequence: int, owner: int, mode: int) -> None:
        if self.state == ENABLED:
            self.state = STATES["ready"]
        super().on_enable(sequence, owner, mode)


class IgnoresOwner(FakeBoard):
    def check_owner(self, owner: int) -> None:
        need(self.owner != 0, "owner")


class IsStolen(FakeBoard):
    def on_claim(self, sequence: int, schema: int, owner: int) -> None:
        if self.state == ENABLED and owner != self.owner:
            self.owner = owner
        super().on_claim(sequence, schema, owner)


class StopsByLength(FakeBoard):
    def check_length(self, message: Any, payload: bytes) -> None:
        need(len(payload) == message.struct.size, "unknown")


class CountsIn16Bits(FakeBoard):
    def on_set_position(self, sequence: int, owner: int, position: int) -> None:
        super().on_set_position(sequence, owner, (position + 2**15) % 2**16 - 2**15)


class ClampsDuties(FakeBoard):
    def on_duty(self, sequence: int, owner: int, duty: int) -> None:
        super().on_duty(sequence, owner, max(-1024, min(1024, duty)))


class WatchdogCanBeOff(FakeBoard):
    def on_configure(self, sequence: int, owner: int, watchdog_ms: int, stall_duty: int) -> None:
        super().on_configure(sequence, owner, watchdog_ms or 500, stall_duty)


class WatchdogIsFixed(FakeBoard):
    def feed(self) -> None:
        self.left = 50


class NeverTrips(FakeBoard):
    def trip(self) -> None:
        pass


class TripsBeforeItIsFed(FakeBoard):
    def on_enable(self, sequence: int, owner: int, mode: int) -> None:
        super().on_enable(sequence, owner, mode)
        self.feed()


class IsFedByEverything(FakeBoard):
    def take(self, payload: bytes) -> None:
        super().take(payload)
        if self.left:
            self.feed()


class IsFedByWhatItRefuses(FakeBoard):
    def on_duty(self, sequence: int, owner: int, duty: int) -> None:
        try:
            super().on_duty(sequence, owner, duty)
        except Refused:
            if self.left:
                self.feed()
            raise


class ForgetsItsFault(FakeBoard):
    def on_stop(self, sequence: int) -> None:
        if self.state == STATES["fault"]:
            self.on_clear(sequence)
        super().on_stop(sequence)


class RecoversByItself(FakeBoard):
    def on_duty(self, sequence: int, owner: int, duty: int) -> None:
        if self.state == STATES["fault"]:
            self.state, self.faults = ENABLED, 0
        super().on_duty(sequence, owner, duty)


class ForgetsWhyItStarted(FakeBoard):
    def send(self, name: str, **values: Any) -> None:
        super().send(name, **({**values, "reset_cause": 16} if name == "info" else values))


class AlwaysBoots(FakeBoard):
    boots_after_claim = 1


class HasSlowClock(FakeBoard):
    def clock(self) -> int:
        return self.ticks * 15 // 16


class CountsSamplesOn(FakeBoard):
    def on_sampling(self, sequence: int, owner: int, period: int, block: int) -> None:
        before = self.index
        super().on_sampling(sequence, owner, period, block)
        self.index = before


class SamplesForEver(FakeBoard):
    def on_sampling(self, sequence: int, owner: int, period: int, block: int) -> None:
        super().on_sampling(sequence, owner, period or self.period, block)


class DrownsInSamples(FakeBoard):
    def send(self, name: str, **values: Any) -> None:
        if self.period != 1 or name in ("sample", "block"):
            super().send(name, **values)


class HasNoBlocks(FakeBoard):
    def on_sampling(self, sequence: int, owner: int, period: int, block: int) -> None:
        super().on_sampling(sequence, owner, period, 0)


class TakesAnyChunk(FakeBoard):
    def check_first(self, first: int) -> None:
        pass


class HasSmallTable(FakeBoard):
    def on_table(
        self, sequence: int, owner: int, first: int, count: int, last: int, duty: tuple[int, ...]
    ) -> None:
        need(len(self.table) + count <= 64, "value")
        super().on_table(sequence, owner, first, count, last, duty)


class HoldsTheLastDuty(FakeBoard):
    def run_out(self) -> None:
        pass


class EndsInAFault(FakeBoard):
    def take_from_table(self) -> None:
        if self.table_ended and not self.table:
            self.run_out()
        else:
            super().take_from_table()


class TableIsUnwatched(FakeBoard):
    def take_from_table(self) -> None:
        super().take_from_table()
        self.left = 0


class StaysInTheTable(FakeBoard):
    def on_duty(self, sequence: int, owner: int, duty: int) -> None:
        mode = self.mode
        super().on_duty(sequence, owner, duty)
        self.mode = mode


class EndsItsOwnSamples(FakeBoard):
    def on_sampling(self, sequence: int, owner: int, period: int, block: int) -> None:
        mode, self.mode = self.mode, MODES["direct"]
        super().on_sampling(sequence, owner, period, block)
        self.mode = mode


class SamplesAfterRelease(FakeBoard):
    def on_release(self, sequence: int, owner: int) -> None:
        period = self.period
        super().on_release(sequence, owner)
        self.period = period


class TakesAnyGain(FakeBoard):
    def on_gains(self, sequence: int, owner: int, kp: int, ki: int, limit: int) -> None:
        self.kp, self.ki, self.limit = kp, ki, limit


class LawIsUnwatched(FakeBoard):
    def on_reference(self, sequence: int, owner: int, reference: int) -> None:
        super().on_reference(sequence, owner, reference)
        self.left = 10**9


class TurnsTheWrongWay(FakeBoard):
    def tick(self) -> None:
        before = self.position
        super().tick()
        self.position = 2 * before - self.position


class TellsOtherDuties(FakeBoard):
    def sample(self) -> None:
        duty, self.duty = self.duty, self.duty // 2
        super().sample()
        self.duty = duty if self.mode == MODES["direct"] else self.duty


class RunsOnAfterItsFault(FakeBoard):
    def tick(self) -> None:
        super().tick()
        if self.state == STATES["fault"]:
            self.speed = 5000.0


class IsAStepLate(FakeBoard):
    held = 0

    def take_from_table(self) -> None:
        super().take_from_table()
        self.held, self.duty = self.duty, self.held


class NeverStalls(FakeBoard):
    def watch_stall(self) -> None:
        pass


class StallsEarly(FakeBoard):
    def watch_stall(self) -> None:
        super().watch_stall()
        if self.still >= 1000:
            self.fault("stall")


class LawHasNoLimit(FakeBoard):
    def limited(self, duty: int) -> int:
        return max(-1024 << 24, min(1024 << 24, duty))


FOUND_BY = {
    IgnoresSchema: "schema",
    OtherSchema: "schema",
    SaysNothingInTable: "hello",
    AcceptsDamage: "frames with damage",
    CountsNoDamage: "frames with damage",
    HasShortBuffer: "frames without an end",
    IgnoresSecondChecksum: "second checksum",
    ChecksDutiesOnly: "second checksum",
    WaitsForWholeFrames: "frames in pieces",
    TakesFirstOfPacket: "frames in a row",
    NumbersOfSevenBits: "own numbers",
    CountsNoGaps: "gaps in the numbers",
    CountsFromNought: "gaps in the numbers",
    IgnoresLength: "unknown messages",
    EnablesTwice: "states",
    IgnoresOwner: "owners",
    IsStolen: "owners",
    StopsByLength: "stop",
    CountsIn16Bits: "set position",
    ClampsDuties: "duties out of range",
    WatchdogCanBeOff: "range of the watchdog",
    WatchdogIsFixed: "watchdog trips",
    NeverTrips: "watchdog trips",
    TripsBeforeItIsFed: "watchdog waits",
    IsFedByEverything: "what feeds the watchdog",
    IsFedByWhatItRefuses: "what feeds the watchdog",
    ForgetsItsFault: "faults last",
    RecoversByItself: "faults last",
    ForgetsWhyItStarted: "reset cause",
    AlwaysBoots: "first claim",
    HasSlowClock: "clock",
    CountsSamplesOn: "samples",
    SamplesForEver: "samples",
    DrownsInSamples: "answers before samples",
    HasNoBlocks: "blocks",
    TakesAnyChunk: "gaps in the table",
    HasSmallTable: "size of the table",
    HoldsTheLastDuty: "empty table",
    EndsInAFault: "end of the table",
    TableIsUnwatched: "watchdog of the table",
    StaysInTheTable: "duty ends the table",
    EndsItsOwnSamples: "samples of a table",
    SamplesAfterRelease: "release",
    TakesAnyGain: "law",
    LawIsUnwatched: "law",
    TurnsTheWrongWay: "duty turns the motor",
    TellsOtherDuties: "duty turns the motor",
    RunsOnAfterItsFault: "silence stops the motor",
    IsAStepLate: "table is played",
    NeverStalls: "stall",
    StallsEarly: "stall",
    LawHasNoLimit: "law follows",
}


@pytest.mark.parametrize("board", FOUND_BY, ids=lambda board: board.__name__)
def test_a_defect_is_found_by_the_check_of_its_rule(board: type[FakeBoard]) -> None:
    assert FOUND_BY[board] in failures(board())


def test_each_check_finds_a_defect() -> None:
    assert {each.name for each in CHECKS} - set(FOUND_BY.values()) == set()


@pytest.mark.parametrize(("board", "status"), [(FakeBoard, 0), (NeverTrips, 1)])
def test_the_command_prints_a_table_and_its_status_says_whether_a_rule_is_broken(
    board: type[FakeBoard], status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    there = board()
    monkeypatch.setattr(serial_port, "SerialPort", lambda name, baud: there)
    monkeypatch.setattr(command, "Session", partial(Session, now=there.now))

    assert command.main(["/dev/ttyUSB0"]) == status
    said = capsys.readouterr().out
    assert ("FAILED       watchdog trips" in said) == (status == 1)
    assert "no STATUS of a fault came within" in said or status == 0


def test_a_board_that_is_not_there_is_a_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Mute(FakeBoard):
        def write(self, data: bytes) -> None:
            pass

    there = Mute()
    monkeypatch.setattr(serial_port, "SerialPort", lambda name, baud: there)
    monkeypatch.setattr(command, "Session", partial(Session, now=there.now))

    assert command.main(["/dev/ttyUSB0"]) == 4
    assert "nobody at /dev/ttyUSB0 answers HELLO" in capsys.readouterr().err
    assert command.main(["/dev/ttyNOWHERE", "--baud", "115200"]) == 4
