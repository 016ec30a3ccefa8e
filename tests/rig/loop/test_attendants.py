"""The attendants of each tick of a live run: their answers and when they come, by accounting alone."""

import json
import math
from collections.abc import Iterator

import pytest

from servobench.core.channels import Sample
from servobench.rig.clock import Tick
from servobench.rig.devices.guarded import Guarded
from servobench.rig.loop.attendants import (
    RECORDER_SILENT,
    GuardTeller,
    OperatorWatch,
    ProgramWatch,
    RecorderWatch,
)
from servobench.rig.loop.place import Place
from servobench.rig.loop.ring import (
    FAULT,
    OPERATOR_HEARTBEAT,
    RECORDER_HEARTBEAT,
    RECORDER_STATE,
    MessageRing,
    RowRing,
)
from servobench.rig.loop.spec import FAILED, RECORDING
from tests.rig.loop.shaft import Shaft

SECOND = 10**9  # ns


@pytest.fixture
def rows() -> Iterator[RowRing]:
    with RowRing.create(2, 16) as ring:
        yield ring


def place(index: int) -> Place:
    sample = Sample(index=index, time=0.01 * index, counts=0)
    tick = Tick(index=index, scheduled=0.01 * index, actual=0.01 * index, late=False, sample=sample)
    return Place(tick=tick, reference=0.0, commanded=0.0, applied=0.0, saturated=False)


@pytest.mark.promise("S23")
def test_a_recorder_that_is_silent_for_too_long_or_failed_ends_the_run(rows: RowRing) -> None:
    now = [5 * SECOND]
    watch = RecorderWatch(rows, now=lambda: now[0])
    rows.set(RECORDER_STATE, RECORDING)
    rows.set(RECORDER_HEARTBEAT, now[0])

    now[0] += round(RECORDER_SILENT * SECOND)
    assert watch(place(1)) is None
    now[0] += 1
    stopped = watch(place(2))
    assert stopped is not None
    assert stopped.reason == "error"
    assert "no sign of the recorder for more than 5 s; the motor was stopped" in stopped.sentence

    rows.set(RECORDER_HEARTBEAT, now[0])
    assert watch(place(3)) is None
    rows.set(RECORDER_STATE, FAILED)
    stopped = watch(place(4))
    assert stopped is not None
    assert "nothing more could be recorded" in stopped.sentence


@pytest.mark.promise("S20")
def test_an_operator_is_missed_once_the_time_is_over_and_not_before(rows: RowRing) -> None:
    now = [7 * SECOND]
    watch = OperatorWatch(rows, 0.25, now=lambda: now[0])
    for _ in range(3):  # as long as somebody shows from time to time
        rows.set(OPERATOR_HEARTBEAT, now[0])
        now[0] += SECOND // 4
        assert watch(place(1)) is None
    now[0] += 1
    stopped = watch(place(2))

    assert stopped is not None
    assert stopped.reason == "interrupted"
    assert "no sign of the operator for 0.25 s" in stopped.sentence


def test_a_program_that_is_gone_ends_the_run() -> None:
    gone = [False]
    watch = ProgramWatch(lambda: gone[0])

    assert watch(place(1)) is None
    gone[0] = True
    stopped = watch(place(2))
    assert stopped is not None
    assert stopped.reason == "interrupted"


@pytest.mark.promise("S37")
def test_a_fault_and_its_acknowledgement_are_reported_once_with_their_ticks(rows: RowRing) -> None:
    guarded = Guarded(Shaft(), when_faulted="hold")  # type: ignore[arg-type]
    with MessageRing.create() as events:
        told = events.reader(0)
        teller = GuardTeller(guarded, rows, events)
        guarded.start(0.01, 0)
        for index, voltage in enumerate([1.0, 1.0, math.nan, 1.0, 1.0]):
            guarded.read()
            guarded.write(voltage)
            assert teller(place(index)) is None
            assert rows.get(FAULT) == (index >= 2)
        teller.acknowledge()
        teller.acknowledge()  # there is nothing left to acknowledge
        assert rows.get(FAULT) == 0
        guarded.read()
        assert guarded.write(1.0) == 1.0
        assert teller(place(5)) is None
        found = [json.loads(text) for text in told.read()]

    assert [(event["kind"], event["tick"], event["code"]) for event in found] == [
        ("fault", 2, "voltage-not-finite"),
        ("acknowledged", 4, "voltage-not-finite"),
    ]
    assert "nan isn't a voltage" in found[0]["sentence"]
