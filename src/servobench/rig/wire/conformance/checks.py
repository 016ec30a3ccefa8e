"""Requirements on a board while its motor stands still: no duty but zero is applied here."""

from __future__ import annotations

import itertools
from typing import Any

from servobench.rig.wire.conformance.base import Check, expect, rule
from servobench.rig.wire.conformance.session import QUIET, Session, name_of
from servobench.rig.wire.frames import encode
from servobench.rig.wire.messages import protocol

AT_REST: list[Check] = []
"""The checks, in the order in which they are carried out."""

_SLACK = 4  # ms; what a frame of the longest kind takes on a slow line, and a tick on either side
_UNKNOWN = 0x70  # a code that no message has


def _expect_refusal(status: dict[str, Any], why: str, what: str) -> None:
    """Expect a refusal of that kind."""
    refusal = name_of("refusals", status["refusal"])
    expect(refusal == why, f"{what} was answered by the refusal {refusal}; expected {why}")


def _expect_acceptance(status: dict[str, Any], what: str, state: str) -> None:
    """Expect no refusal, and a state."""
    _expect_refusal(status, "none", what)
    _expect_state(status, state, what)


def _expect_state(status: dict[str, Any], state: str, what: str) -> None:
    board_state = name_of("states", status["state"])
    expect(board_state == state, f"after {what} the board was in {board_state}; expected {state}")


def _status(session: Session) -> dict[str, Any]:
    return session.ask("hello", schema=protocol().schema)


@rule(AT_REST, "Asks who is there; answered by INFO and STATUS in any state.")
def _hello(session: Session) -> None:
    for state in ("switch_on_disabled", "ready", "operation_enabled"):
        if state == "ready":
            session.claim()
        if state == "operation_enabled":
            session.enable()
        status = _status(session)
        expect(bool(session.all("info")), f"no INFO came before the STATUS that answers HELLO in {state}")
        _expect_acceptance(status, "HELLO", state)


@rule(AT_REST, "A host that finds another one than its own refuses to go on, and a device refuses its CLAIM.")
def _schema(session: Session) -> None:
    other = protocol().schema ^ 1
    status = session.ask("hello", schema=other)
    _expect_refusal(status, "schema", "HELLO with another schema")
    schema = session.some("info")[0]["schema"]
    expect(schema == protocol().schema, f"INFO gave the schema {schema}; expected {protocol().schema}")
    status = session.ask("claim", schema=other)
    _expect_refusal(status, "schema", "CLAIM with another schema")
    _expect_state(status, "switch_on_disabled", "that")


@rule(
    AT_REST,
    "A frame whose length, stuffing or checksum is wrong is dropped and counted, and so are gaps in the numbers.",
)
def _frames_with_damage(session: Session) -> None:
    before = _status(session)["crc_bad"]
    whole = encode(session.payload("stop"))
    damaged = [
        bytes([*whole[:k], whole[k] ^ bit, *whole[k + 1 :]])
        for k in range(len(whole) - 1)
        for bit in (1, 0x80)
    ]
    damaged = [each for each in damaged if 0 not in each[:-1]]
    for each in damaged:
        session.send(each)
        session.wait(QUIET / 2)
        expect(not session.all("status"), f"the damaged frame {each.hex(' ')} was answered")
    counted = (_status(session)["crc_bad"] - before) & 0xFFFF
    expect(counted == len(damaged), f"crc_bad went up by {counted} for {len(damaged)} damaged frames")


@rule(
    AT_REST,
    "A frame whose length, stuffing or checksum is wrong is dropped and counted, and so are gaps in the numbers.",
)
def _frames_without_an_end(session: Session) -> None:
    before = _status(session)["crc_bad"]
    session.send(b"\x55" * 300 + b"\0" + encode(session.payload("stop")))
    session.until("STATUS after a frame of 300 bytes", lambda: session.all("status"))
    counted = (_status(session)["crc_bad"] - before) & 0xFFFF
    expect(counted == 1, f"crc_bad went up by {counted} for a frame of 300 bytes; expected 1")


@rule(AT_REST, "A frame whose `check` is wrong is refused as `damaged`.")
def _second_checksum(session: Session) -> None:
    session.enable()
    messages: dict[str, dict[str, Any]] = {
        "duty": {"duty": 0},
        "table": {"first": 0, "count": 8, "last": 0, "duty": [0]},
        "reference": {"reference": 0},
        "configure": {"watchdog_ms": 50, "stall_duty": 400},
        "gains": {"kp": 0, "ki": 0, "limit": 1024},
        "sampling": {"period": 10, "block": 0},
        "enable": {"mode": 0},
        "set_position": {"position": 0},
        "release": {},
    }
    for name, values in messages.items():
        status = session.ask(name, check=_wrong_check(session, name, values), **values)
        # A board without a law knows neither REFERENCE nor GAINS.
        if name in ("reference", "gains") and name_of("refusals", status["refusal"]) == "unknown":
            continue
        _expect_refusal(status, "damaged", f"{name.upper()} with a wrong check")
        _expect_state(status, "operation_enabled", "that")


def _wrong_check(session: Session, name: str, values: dict[str, Any]) -> int:
    """A second checksum that is none of the message which comes next."""
    right = session.payload(name, **values)
    session.payload(name, skip=-2, **values)  # the number is given back
    return int.from_bytes(right[-2:], "little") ^ 0x0100


@rule(AT_REST, "so that a zero ends a frame and nothing else: whoever joins late waits for one.")
def _frames_in_pieces(session: Session) -> None:
    for part in (1, 3):
        frame = encode(session.payload("hello", schema=protocol().schema))
        session.send(b"")
        for first in range(0, len(frame), part):
            session.port.write(frame[first : first + part])
            if first + part < len(frame):
                session.wait(0.02)
                expect(not session.all("status"), "a frame was answered before its end")
        session.until("STATUS that answers a frame in pieces", lambda: session.all("status"))


@rule(AT_REST, "so that a zero ends a frame and nothing else: whoever joins late waits for one.")
def _frames_in_a_row(session: Session) -> None:
    session.send(b"\x07\x41\0\0\0" + b"".join(encode(session.payload("stop")) for _ in range(3)))
    session.until(
        "third STATUS, each frame of three in a row has one", lambda: len(session.all("status")) >= 3
    )
    numbers = [each["ack"] for each in session.all("status")]
    expected = [(session._said - 2 + k) & 0xFF for k in range(3)]
    expect(numbers == expected, f"three frames in a row were answered as {numbers}; expected {expected}")


@rule(AT_REST, "a sequence number that counts up by one with each frame of its sender and wraps at 256")
def _own_numbers(session: Session) -> None:
    for _ in range(130):  # two frames each: beyond the wrap
        before = list(session.heard)
        _status(session)
        session.heard = [*before, *session.heard]
    numbers = [values["sequence"] for _, values in session.heard]
    gaps = [(b - a) & 0xFF for a, b in itertools.pairwise(numbers) if (b - a) & 0xFF != 1]
    expect(not gaps, f"the board's numbers went on by {gaps[:5]}; expected 1 each time")
    expect(len(numbers) > 256, f"{len(numbers)} frames came for 130 HELLO; expected INFO and STATUS for each")


@rule(
    AT_REST,
    "A frame whose length, stuffing or checksum is wrong is dropped and counted, and so are gaps in the numbers.",
)
def _gaps_in_the_numbers(session: Session) -> None:
    before = session.ask("stop")["received_gaps"]
    counted = (session.ask("stop", skip=3)["received_gaps"] - before) & 0xFFFF
    expect(counted == 3, f"received_gaps went up by {counted} where 3 numbers were left out")
    again = (session.ask("stop")["received_gaps"] - before) & 0xFFFF
    expect(again == 3, f"received_gaps went up by {again - 3} where none was left out")


@rule(AT_REST, "No message of that code and length.")
def _unknown_messages(session: Session) -> None:
    number = (session._said + 1) & 0xFF
    session.payload("stop")  # takes the number
    session.send(encode(bytes([_UNKNOWN, number])))
    _expect_refusal(session.answer(number, _UNKNOWN), "unknown", f"the code 0x{_UNKNOWN:02x}")
    claim = session.payload("claim", schema=protocol().schema)
    session.send(encode(claim + b"\0"))
    _expect_refusal(session.answer(claim[1], claim[0]), "unknown", "CLAIM with a byte too many")
    _expect_state(session.ask("stop"), "switch_on_disabled", "that")


@rule(AT_REST, "No other transition exists; what asks for one is refused.")
def _states(session: Session) -> None:
    direct = {"mode": protocol().codes["modes"]["direct"]}
    _expect_refusal(session.ask("enable", **direct), "owner", "ENABLE of a board that nobody has claimed")
    _expect_refusal(session.ask("clear"), "state", "CLEAR without a fault")
    _expect_refusal(session.ask("claim", schema=protocol().schema, owner=0), "value", "CLAIM by the owner 0")
    _expect_acceptance(session.ask("claim", schema=protocol().schema), "CLAIM", "ready")
    _expect_acceptance(session.ask("claim", schema=protocol().schema), "a second CLAIM", "ready")
    _expect_refusal(session.ask("duty", duty=0), "state", "DUTY in ready")
    _expect_refusal(session.ask("enable", mode=9), "value", "ENABLE in the mode 9")
    _expect_acceptance(session.ask("enable", **direct), "ENABLE", "operation_enabled")
    _expect_refusal(session.ask("enable", **direct), "state", "ENABLE in operation_enabled")
    _expect_refusal(session.ask("claim", schema=protocol().schema), "state", "CLAIM in operation_enabled")
    _expect_refusal(session.ask("release"), "state", "RELEASE in operation_enabled")
    _expect_refusal(
        session.ask("configure", watchdog_ms=50, stall_duty=400), "state", "CONFIGURE in operation_enabled"
    )
    _expect_refusal(session.ask("set_position", position=0), "state", "SET_POSITION in operation_enabled")
    _expect_acceptance(session.ask("stop"), "STOP", "ready")
    _expect_acceptance(session.ask("release"), "RELEASE", "switch_on_disabled")


@rule(
    AT_REST,
    "While the bridge is on nobody else can claim the device, and actuation of anybody else is refused.",
)
def _owners(session: Session) -> None:
    session.enable()
    other = session.owner ^ 0x0101 or 1
    _expect_refusal(session.ask("duty", owner=other, duty=0), "owner", "DUTY of another owner")
    _expect_refusal(session.ask("enable", owner=other, mode=0), "owner", "ENABLE of another owner")
    _expect_refusal(
        session.ask("claim", schema=protocol().schema, owner=other), "state", "CLAIM of another owner"
    )
    owner = _status(session)["owner"]
    expect(owner == session.owner, f"the owner is {owner} then; expected {session.owner}")


@rule(AT_REST, "STOP is obeyed whoever sends it.")
def _stop(session: Session) -> None:
    session.enable()
    longer = session.payload("stop") + b"\x01\x02"
    session.send(encode(longer))
    _expect_acceptance(session.answer(longer[1], longer[0]), "a STOP with two bytes too many", "ready")


@rule(AT_REST, "Sets the encoder's count, in ready.")
def _set_position(session: Session) -> None:
    session.claim()
    for position in (2**31 - 1, -(2**31), 0):
        status = session.ask("set_position", position=position)
        _expect_acceptance(status, "SET_POSITION", "ready")
        # The shaft may be touched meanwhile, and the count wraps.
        moved = (status["position"] - position + 2**31) % 2**32 - 2**31
        expect(abs(moved) < 100, f"the position was {status['position']} after it was set to {position}")


@rule(AT_REST, "-1024 to 1024.")
def _duties_out_of_range(session: Session) -> None:
    session.enable()
    for duty in (1025, -1025, 32767, -32768):
        _expect_refusal(session.ask("duty", duty=duty), "value", f"the duty {duty}")


@rule(AT_REST, "**Host watchdog**: 50 ms by default, 20 to 500, never off.")
def _range_of_the_watchdog(session: Session) -> None:
    session.claim(watchdog_ms=100)
    for wrong in (0, 19, 501, 0xFFFF):
        status = session.ask("configure", watchdog_ms=wrong, stall_duty=400)
        _expect_refusal(status, "value", f"a watchdog of {wrong} ms")
        expect(
            status["watchdog_ms"] == 100,
            f"the watchdog is {status['watchdog_ms']} ms after that; expected 100",
        )
    for right in (20, 500):
        status = session.ask("configure", watchdog_ms=right, stall_duty=400)
        _expect_acceptance(status, f"a watchdog of {right} ms", "ready")
        expect(
            status["watchdog_ms"] == right,
            f"STATUS reports a watchdog of {status['watchdog_ms']} ms; expected {right}",
        )


@rule(AT_REST, "When it trips the bridge is off within the millisecond, and the fault lasts until CLEAR.")
def _watchdog_trips(session: Session) -> None:
    for timeout in (20, 50, 500):
        session.enable(watchdog_ms=timeout)
        begun = _feed_once(session)
        _expect_trip(session, begun, timeout)
        session.rest()


def _feed_once(session: Session) -> int:
    """Feed the watchdog once, at zero duty; return when that was by the board's clock [ms]."""
    hello = session.payload("hello", schema=protocol().schema)
    session.send(encode(hello) + encode(session.payload("duty", duty=0)))
    return int(session.answer(hello[1], hello[0])["time"])


def _expect_trip(session: Session, begun: int, timeout: int, meanwhile: str = "") -> None:
    status = session.fault(2 * timeout / 1000 + 0.5)
    took = (status["time"] - begun) & 0xFFFFFFFF
    names = protocol().names("faults", status["faults"])
    expect(names == ("watchdog",), f"the fault was {' and '.join(names)}{meanwhile}; expected watchdog")
    _expect_state(status, "fault", "the watchdog")
    expect(
        timeout - 1 <= took <= timeout + _SLACK,
        f"a watchdog of {timeout} ms tripped after {took} ms by the board's clock{meanwhile}",
    )


@rule(AT_REST, "It runs from the first actuation on, when there is something to take away")
def _watchdog_waits(session: Session) -> None:
    session.enable(watchdog_ms=20)
    session.wait(0.2)
    _expect_state(_status(session), "operation_enabled", "200 ms without any actuation")


@rule(AT_REST, "Only accepted actuation (DUTY, TABLE, REFERENCE) feeds it.")
def _what_feeds_the_watchdog(session: Session) -> None:
    session.enable(watchdog_ms=200)
    begun = _feed_once(session)
    heard = list(session.heard)
    give_up = session.now() + 0.7
    while (
        not any(name == "status" and values["faults"] for name, values in heard) and session.now() < give_up
    ):
        session.send(
            b"\x05abcd\0"
            + encode(session.payload("hello", schema=protocol().schema))
            + encode(session.payload("sampling", period=20, block=0))
            + encode(session.payload("duty", duty=1025))
            + encode(session.payload("duty", duty=0, check=0))
            + encode(session.payload("duty", duty=0, owner=session.owner ^ 1 or 2))
            + encode(session.payload("table", first=0, count=1, last=0, duty=[0]))
        )
        session.wait(0.02)
        heard = list(session.heard)
    session.heard = [
        (name, {**values, "command": 0}) if name == "status" and values["faults"] else (name, values)
        for name, values in heard
    ]
    _expect_trip(session, begun, 200, " although only what doesn't feed it came")


@rule(AT_REST, "The bridge is off until CLEAR; actuation is refused.")
def _faults_last(session: Session) -> None:
    session.enable(watchdog_ms=20)
    session.say("duty", duty=0)
    session.fault(0.5)
    _expect_refusal(session.ask("duty", duty=0), "state", "DUTY after a fault")
    _expect_refusal(session.ask("enable", mode=0), "state", "ENABLE after a fault")
    _expect_refusal(session.ask("claim", schema=protocol().schema), "state", "CLAIM after a fault")
    status = session.ask("stop")
    _expect_state(status, "fault", "STOP")
    expect(bool(status["faults"]), "STOP cleared the fault; expected only CLEAR to do so")
    status = session.ask("clear")
    _expect_acceptance(status, "CLEAR", "switch_on_disabled")
    expect(not status["faults"], "CLEAR left the faults' bits as they were; expected 0")
    expect(
        not status["owner"],
        f"after CLEAR the owner is {status['owner']}; expected 0: it has to be claimed again",
    )


@rule(AT_REST, "Why it started, bits of the reset causes; 0 where a boot loader took them away.")
def _reset_cause(session: Session) -> None:
    known = sum(protocol().codes["reset_causes"].values())
    status = _status(session)
    info = session.some("info")[0]
    expect(
        not info["reset_cause"] & ~known,
        f"the reset cause is {info['reset_cause']}; expected bits of {known}",
    )
    same = status["reset_cause"] == info["reset_cause"]
    expect(same, f"INFO gives the reset cause {info['reset_cause']}, STATUS {status['reset_cause']}")


@rule(AT_REST, "1 until the first CLAIM after a start, then 0.")
def _first_claim(session: Session) -> None:
    session.claim()
    _status(session)
    boots = session.some("info")[0]["boots"]
    expect(boots == 0, f"after a CLAIM boots is {boots}; expected 0")


@rule(AT_REST, "Time of a tick of the device's clock [µs]; all counting of time is in ticks.")
def _clock(session: Session) -> None:
    before, begun = _status(session)["time"], session.now()
    session.wait(1.0)
    took = (_status(session)["time"] - before) & 0xFFFFFFFF
    waited = (session.now() - begun) * 1000
    # Half a percent of a ceramic resonator, and an answer's way both times.
    expect(abs(took - waited) <= 0.005 * waited + 40, f"its clock went on by {took} ms in {waited:.0f} ms")


@rule(AT_REST, "Begins sampling at the next tick with index 0, or ends it.")
def _samples(session: Session) -> None:
    session.enable()
    for period in (10, 5):
        session.ask("sampling", period=period, block=0)
        session.until("20 samples", lambda: len(session.all("sample")) >= 20, 1.5)
        _expect_steps(session, "sample", [each["index"] for each in session.all("sample")], 1)
        _expect_steps(session, "sample", [each["time"] for each in session.all("sample")], period)
        first = session.some("sample")[0]["index"]
        expect(first == 0, f"the first sample has the index {first}; expected 0")
    session.ask("sampling", period=0, block=0)
    session.heard = []
    session.wait(QUIET)
    expect(not session.all("sample"), "samples came after SAMPLING with the period 0")


def _expect_steps(session: Session, what: str, numbers: list[int], step: int) -> None:
    wrong = [(b - a) & 0xFFFFFFFF for a, b in itertools.pairwise(numbers) if (b - a) & 0xFFFFFFFF != step]
    expect(not wrong, f"from a {what} to the next its index or time went on by {wrong[:5]}; expected {step}")


@rule(AT_REST, "Where the port is too slow for the samples they are lost, and answers come all the same.")
def _answers_before_samples(session: Session) -> None:
    session.enable()
    session.ask("sampling", period=1, block=0)
    session.wait(0.3)
    for _ in range(5):
        _expect_acceptance(_status(session), "HELLO between samples", "operation_enabled")


@rule(AT_REST, "Eight samples in a row.")
def _blocks(session: Session) -> None:
    session.enable()
    session.ask("sampling", period=2, block=1)
    session.until("8 blocks", lambda: len(session.all("block")) >= 8, 2.0)
    expect(not session.all("sample"), "single samples came with block = 1")
    blocks = session.all("block")
    _expect_steps(session, "block", [each["index"] for each in blocks], 8)
    _expect_steps(session, "block", [each["time"] for each in blocks], 16)
    first = blocks[0]["index"]
    expect(first == 0, f"the first block has the index {first}; expected 0")
    put_out = {duty for each in blocks for duty in each["duty"]}
    expect(
        put_out == {0}, f"blocks report the duties {sorted(put_out)[:8]} where none was put out; expected 0"
    )


@rule(
    AT_REST,
    "A chunk that doesn't begin at `table_next` is refused as a gap, and the host goes on from there.",
)
def _gaps_in_the_table(session: Session) -> None:
    session.enable("table")
    session.say("table", first=0, count=8, last=0, duty=[0] * 8)
    for first in (0, 16):
        status = session.ask("table", first=first, count=8, last=0, duty=[0] * 8)
        _expect_refusal(status, "gap", f"a chunk from {first} on after one of 0 to 7")
        expect(status["table_next"] == 8, f"table_next is {status['table_next']} then; expected 8")


@rule(AT_REST, "In the mode `table` the host keeps up to 128 duties ahead.")
def _size_of_the_table(session: Session) -> None:
    session.enable("table")
    size = protocol().constants["table_size"]
    _expect_refusal(
        session.ask("table", first=0, count=9, last=0, duty=[0]), "value", "a chunk with a count of 9"
    )
    _expect_refusal(
        session.ask("table", first=0, count=1, last=0, duty=[1025]), "value", "a chunk with the duty 1025"
    )
    for first in range(0, size, 8):
        session.say("table", first=first, count=8, last=0, duty=[0] * 8)
    session.wait(QUIET)
    expect(not session.all("status"), f"a table of {size} duties was refused")
    _expect_refusal(
        session.ask("table", first=size, count=1, last=0, duty=[0]),
        "value",
        f"the duty {size + 1} of a table",
    )


@rule(AT_REST, "in the mode `table` from the first sample.")
def _watchdog_of_the_table(session: Session) -> None:
    session.enable("table", watchdog_ms=20)
    session.say("table", first=0, count=8, last=0, duty=[0] * 8)
    session.wait(QUIET)
    expect(not session.all("status"), "a fault came before the first sample of a table")
    begun = session.ask("sampling", period=5, block=0)["time"]
    _expect_trip(session, begun, 20, " in a table, counted from SAMPLING")


@rule(AT_REST, "The table ran out before its last duty had come.")
def _empty_table(session: Session) -> None:
    session.enable("table")
    session.say("table", first=0, count=8, last=0, duty=[0] * 8)
    session.ask("sampling", period=10, block=0)
    names = protocol().names("faults", session.fault(1.0)["faults"])
    expect(names == ("table_empty",), f"the fault was {' and '.join(names)}; expected table_empty")


@rule(AT_REST, "1: the table ends with them, and zero follows.")
def _end_of_the_table(session: Session) -> None:
    session.enable("table")
    session.say("table", first=0, count=8, last=1, duty=[0] * 8)
    session.ask("sampling", period=10, block=0)
    session.wait(0.2)
    _expect_state(_status(session), "operation_enabled", "the last duty of a table")


@rule(AT_REST, "A DUTY frame ends the table and is put out at once.")
def _duty_ends_the_table(session: Session) -> None:
    session.enable("table")
    session.say("table", first=0, count=8, last=0, duty=[0] * 8)
    session.say("duty", duty=0)
    _expect_refusal(
        session.ask("table", first=8, count=8, last=0, duty=[0] * 8), "state", "TABLE after a DUTY"
    )


@rule(AT_REST, "While the samples set the duty they can't be ended.")
def _samples_of_a_table(session: Session) -> None:
    session.enable("table")
    session.say("table", first=0, count=8, last=1, duty=[0] * 8)
    session.ask("sampling", period=10, block=0)
    _expect_refusal(
        session.ask("sampling", period=0, block=0), "state", "the end of sampling in the mode table"
    )


@rule(AT_REST, "Gives the device back: ready to switch_on_disabled. Ends sampling.")
def _release(session: Session) -> None:
    session.claim()
    session.ask("sampling", period=10, block=0)
    _expect_acceptance(session.ask("release"), "RELEASE", "switch_on_disabled")
    session.heard = []
    session.wait(QUIET)
    expect(not session.all("sample"), "samples came after RELEASE")


@rule(AT_REST, "At each sample a PI law on the device sets the duty; it follows REFERENCE in counts.")
def _law(session: Session) -> str | None:
    session.claim()
    status = session.ask("gains", kp=0, ki=0, limit=1)
    if name_of("refusals", status["refusal"]) == "unknown":
        return "it has no law of its own"
    _expect_refusal(status, "none", "GAINS")
    for kp, ki, limit in ((-1, 0, 1), (0, -1, 1), (2**24 + 1, 0, 1), (0, 0, 0), (0, 0, 1025)):
        _expect_refusal(
            session.ask("gains", kp=kp, ki=ki, limit=limit), "value", f"GAINS with {kp}, {ki}, {limit}"
        )
    for mode in ("position", "speed"):
        session.rest()
        session.enable(mode, watchdog_ms=20)
        session.ask("sampling", period=10, block=0)
        session.say("reference", reference=0)
        names = protocol().names("faults", session.fault(0.5)["faults"])
        expect(
            names == ("watchdog",),
            f"the fault was {' and '.join(names)} after one REFERENCE; expected watchdog",
        )
    return None
