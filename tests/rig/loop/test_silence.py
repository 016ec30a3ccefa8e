"""When a loop counts as silent: by what its thread waits for, and for how long that may take."""

import time

import pytest

from servobench.rig.devices.observed import Call
from servobench.rig.loop.last_resort import CallsInRing, LastResort
from servobench.rig.loop.ring import CALL, RowRing
from servobench.rig.loop.silence import OPENING_PATIENCE, PATIENCE, RUN_PATIENCE, silence_of

SAMPLE_TIME = 1.0  # s, of a slow loop
AWAITED = 2 * SAMPLE_TIME  # s; a call that may last a sample time, and as much for being late
MARGIN = 0.2  # s; so long may this test take between setting the word and reading it


def waiting(ring: RowRing, call: Call, duration: float) -> None:
    """Let a loop's thread have been in a call for so long [s]."""
    ring.set(CALL, (time.monotonic_ns() - round(1e9 * duration)) << 3 | call)


@pytest.mark.parametrize(
    ("call", "allowed"),
    [
        (Call.WRITE, PATIENCE),
        (Call.STOP, PATIENCE),
        (Call.READ, PATIENCE + AWAITED),  # a board that keeps the time lets a read wait for its next sample
        (Call.BETWEEN, PATIENCE + AWAITED),  # a loop by the computer's clock sleeps there
    ],
)
def test_a_call_is_silent_once_it_takes_longer_than_it_may(call: Call, allowed: float) -> None:
    with RowRing.create(2, 8) as ring:
        waiting(ring, call, allowed - MARGIN)
        assert silence_of(ring, SAMPLE_TIME) is None

        waiting(ring, call, allowed + MARGIN)
        silence = silence_of(ring, SAMPLE_TIME)
        assert silence is not None
        assert silence.call is call


@pytest.mark.parametrize(
    ("call", "allowed"),
    [(Call.OPEN, OPENING_PATIENCE), (Call.WRITE, RUN_PATIENCE), (Call.READ, RUN_PATIENCE + AWAITED)],
)
def test_a_loop_is_given_up_once_nothing_is_to_be_expected(call: Call, allowed: float) -> None:
    with RowRing.create(2, 8) as ring:
        for duration, too_long in ((allowed - MARGIN, False), (allowed + MARGIN, True)):
            waiting(ring, call, duration)
            silence = silence_of(ring, SAMPLE_TIME)
            assert silence is not None
            assert silence.too_long is too_long


def test_a_board_that_starts_anew_while_it_is_opened_is_no_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LastResort, "put_off", lambda self, patience: None)
    with RowRing.create(2, 8) as ring:
        CallsInRing(ring, SAMPLE_TIME, LastResort(), opening_time=4.0)
        waiting(ring, Call.OPEN, 4.0 + PATIENCE - MARGIN)
        assert silence_of(ring, SAMPLE_TIME) is None

        waiting(ring, Call.OPEN, 4.0 + PATIENCE + MARGIN)
        assert silence_of(ring, SAMPLE_TIME) is not None

        waiting(ring, Call.WRITE, PATIENCE + MARGIN)  # the rest of the run is watched as ever
        assert silence_of(ring, SAMPLE_TIME) is not None
