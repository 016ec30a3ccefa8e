"""Requirements on a board while its motor turns, or would turn: only on request, with nothing on the shaft."""

from __future__ import annotations

from servobench.core.errors import DeviceError
from servobench.rig.wire.conformance.base import Check, expect, rule
from servobench.rig.wire.conformance.session import Session
from servobench.rig.wire.messages import protocol

DRIVEN: list[Check] = []
"""The checks, in the order in which they are carried out."""

DUTY = 256  # a quarter of the supply
_FEED = 0.05  # s
_REST = 10.0  # s; how long a shaft may coast
_PATTERN = (0, 20, -20, 10, 30, -30, 5, -5)  # duties that hardly move a motor


def _drive(session: Session, duty: int, seconds: float) -> None:
    """Put a duty out for that long [s]; what was heard in all that time is kept."""
    heard = []
    begun = session.now()
    while session.now() - begun < seconds:
        session.say("duty", duty=duty)
        session.wait(_FEED)
        heard += session.heard
    session.heard = heard


def _stand(session: Session) -> None:
    """Wait until the shaft has come to rest; raises `DeviceError` where it goes on turning for 10 s."""
    before, begun = session.ask("stop")["position"], session.now()
    while session.now() - begun < _REST:
        session.wait(0.2)
        position = session.ask("stop")["position"]
        if abs(position - before) <= protocol().constants["stall_counts"]:
            return
        before = position
    raise DeviceError(f"the shaft goes on turning for {_REST:g} s after STOP; expected it to come to rest")


@rule(DRIVEN, "Actuation: puts this duty out at once, and ends a table or a law.")
def _duty_turns_the_motor(session: Session) -> None:
    moved = []
    for duty in (DUTY, -DUTY):
        _stand(session)
        session.enable()
        session.ask("sampling", period=10, block=0)
        _drive(session, duty, 0.5)
        samples = session.some("sample")
        duties = {each["duty"] for each in samples[5:]}
        expect(duties == {duty}, f"samples report the duties {sorted(duties)[:5]}; expected {duty}")
        moved.append(samples[-1]["position"] - samples[0]["position"])
        session.rest()
    expect(
        moved[0] > 10 and moved[1] < -10,
        f"with the duties {DUTY} and {-DUTY} the count moved by {moved[0]} and {moved[1]}; expected up, then down: look at "
        "the encoder, or swap its channels",
    )


@rule(DRIVEN, "When it trips the bridge is off within the millisecond, and the fault lasts until CLEAR.")
def _silence_stops_the_motor(session: Session) -> None:
    session.enable(watchdog_ms=100)
    session.ask("sampling", period=10, block=0)
    _drive(session, DUTY, 0.5)
    turning = _speed(session, 20)
    session.fault(1.0)
    session.heard = []
    session.wait(1.0)
    expect(
        all(each["duty"] == 0 for each in session.all("sample")),
        "samples report a duty after the fault; expected 0",
    )
    after = _speed(session, 20)
    expect(
        turning > 100 and after < turning / 2,
        f"the motor had {turning:.0f} counts/s before the watchdog tripped and {after:.0f} a second later; expected it to stop",
    )


def _speed(session: Session, last: int) -> float:
    """The speed over the last so many samples [counts/s], without its sign."""
    samples = session.some("sample")[-last:]
    moved, took = (int(samples[-1][name] - samples[0][name]) for name in ("position", "time"))
    return abs(moved) / max(1, took) * 1000


@rule(
    DRIVEN,
    "Sample k is latched, then the duty k of the table is put out: `u[k]` holds from sample k to sample k + 1.",
)
def _table_is_played(session: Session) -> None:
    session.enable("table")
    expected = [duty + k for k in range(8) for duty in _PATTERN]
    for first in range(0, 64, 8):
        session.say("table", first=first, count=8, last=int(first == 56), duty=expected[first : first + 8])
    session.ask("sampling", period=2, block=1)
    session.until("9 blocks", lambda: len(session.all("block")) >= 9, 1.0)
    duties = [duty for each in session.all("block")[:9] for duty in each["duty"]]
    wrong = next(
        (k for k, (a, b) in enumerate(zip(duties, [*expected, *[0] * 8], strict=True)) if a != b), None
    )
    expect(
        wrong is None,
        f"duty {wrong} of a table was reported as {duties[wrong or 0]}; expected {[*expected, *[0] * 8][wrong or 0]}",
    )


@rule(DRIVEN, "**Stall**: a warning after 80 ms, the cut after 3 s without motion above the stall duty.")
def _stall(session: Session) -> None:
    _stand(session)
    session.claim()
    session.ask("configure", watchdog_ms=500, stall_duty=1)
    status = session.ask("enable", mode=0)
    begun = status["time"]
    _drive(session, 2, 3.3)  # 2 of 1024 turn no motor
    heard = session.all("status")
    warned = [each["time"] - begun for each in heard if each["warnings"] and not each["faults"]]
    cut = [each["time"] - begun for each in heard if each["faults"] == protocol().codes["faults"]["stall"]]
    expect(
        bool(warned) and 75 <= warned[0] <= 150,
        f"a warning came at {warned[:1]} ms; expected 80 after the first duty",
    )
    expect(
        bool(cut) and 2990 <= cut[0] <= 3100,
        f"the cut came at {cut[:1]} ms; expected 3000 after the first duty",
    )


@rule(DRIVEN, "GAINS limits its duty, and it ends with a DUTY.")
def _law_follows(session: Session) -> str | None:
    _stand(session)
    session.claim()
    if session.ask("gains", kp=64 * 65536, ki=0, limit=DUTY)["refusal"]:
        return "it has no law of its own"
    position = session.ask("set_position", position=0)["position"]
    session.ask("enable", mode=protocol().codes["modes"]["position"])
    session.ask("sampling", period=2, block=1)
    begun, heard = session.now(), []
    while session.now() - begun < 1.0:
        session.say("reference", reference=position + 200)
        session.wait(_FEED)
        heard += session.heard
    session.heard = heard
    blocks = session.some("block")
    put_out = [duty for each in blocks for duty in each["duty"]]
    expect(
        max(put_out) == DUTY,
        f"the law's largest duty was {max(put_out)} far from its reference; expected {DUTY}",
    )
    # Within friction: the duty that doesn't turn the motor, a few counts.
    ended = blocks[-1]["position"]
    expect(ended > 100, f"the law brought the shaft from 0 to {ended} counts; expected it to go on to 200")
    session.say("duty", duty=0)
    refused = session.ask("reference", reference=0)["refusal"] == protocol().codes["refusals"]["state"]
    expect(refused, "REFERENCE was accepted after a DUTY; expected the refusal state")
    return None
