"""The events of a run in a report: commands with their ticks, faults, acknowledgements."""

import json
import re
from dataclasses import replace

import pytest

from servobench.identification.result import Result
from servobench.recordings.recording import Event, Recording
from servobench.report.document import Report
from servobench.report.events import MOST_SHOWN, events_of
from servobench.rig.loop.messages import Command
from servobench.systems.control.pid import Pid
from servobench.systems.signals.constant import Constant


def event(kind: str, tick: int, **about: object) -> Event:
    return Event(
        tick=tick, time=0.002 * tick, kind=kind, text=json.dumps({"kind": kind, "tick": tick, **about})
    )


def taken(tick: int, number: int, command: Command, why: str = "") -> Event:
    what = command.model_dump(mode="json", exclude_defaults=True)
    return event("command", tick, number=number, accepted=not why, what=what, why=why)


OPENED, ENDED = event("opened", 0, info={}), event("ended", 1500, reason="finished")


def table(recording: Recording, *events: Event) -> list[tuple[str, str, str, str]]:
    found = events_of(replace(recording, events=(OPENED, *events, ENDED)))
    assert found is not None
    assert found.more == ""
    return [(row.time, row.tick, row.what, row.said) for row in found.rows]


def test_a_run_in_which_nothing_happened_has_no_such_table(run: Recording, good: Result) -> None:
    assert events_of(run) is None
    quiet = replace(run, events=(OPENED, ENDED))
    assert events_of(quiet) is None
    assert "What was changed, and what went wrong" not in Report(quiet, good).html()


def test_each_command_stands_there_with_its_tick_and_what_it_changed(run: Recording) -> None:
    rows = table(
        run,
        taken(50, 1, Command(signal=Constant(value=2.0), chain="unwrap")),
        taken(70, 2, Command(controller=Pid(kp=0.5))),
        taken(90, 3, Command(enabled=False)),
        taken(95, 4, Command(enabled=True, acknowledge=True)),
        taken(99, 5, Command(controller=Pid(kp=0.5)), why="kp is too large"),
        taken(120, 6, Command(stop="enough", reason="finished")),
    )

    assert [row[:3] for row in rows] == [
        ("0.1\u00a0s", "50", "Command 1"),
        ("0.14\u00a0s", "70", "Command 2"),
        ("0.18\u00a0s", "90", "Command 3"),
        ("0.19\u00a0s", "95", "Command 4"),
        ("0.198\u00a0s", "99", "Command 5, refused"),
        ("0.24\u00a0s", "120", "Command 6"),
    ]
    said = [row[3] for row in rows]
    assert said[0] == "signal: constant: value 2; chain: unwrap"
    assert said[1].startswith("controller: pid: output position, kp 0.5")
    assert "None" not in said[1]  # the tracking time isn't set
    assert said[2] == "zero volts instead of the controller's voltage"
    assert said[3] == "the controller's voltage is applied; the fault is acknowledged"
    assert said[4] == "kp is too large"
    assert said[5] == "stop: enough; reason: finished"


def test_faults_and_what_the_recorder_missed_stand_there_too(run: Recording) -> None:
    rows = table(
        run,
        event("fault", 500, code="stalled", sentence="the shaft stood still"),
        event("acknowledged", 600, code="stalled"),
        event("rows-missed", 700, first=700, count=12_000),
        event("events-missed", 800, first=3, count=1),
        event("door-opened", 900, who="somebody"),
    )

    assert [row[2:] for row in rows] == [
        ("Fault", "the shaft stood still"),
        ("Acknowledged", "stalled"),
        ("Samples not recorded", "12\u202f000 samples"),
        ("Events not recorded", "1 event"),
        ("door-opened", rows[4][3]),
    ]
    assert "somebody" in rows[4][3]


@pytest.mark.parametrize(
    "text", ["", "no JSON", "[1]", "null", '{"what": 3}', '{"what": {"signal": null}}', "[" * 100_000]
)
@pytest.mark.parametrize("kind", ["command", "fault", "rows-missed"])
def test_an_event_of_another_program_is_shown_as_it_is(run: Recording, kind: str, text: str) -> None:
    assert len(table(run, Event(tick=1, time=0.002, kind=kind, text=text))) == 1


def test_of_many_events_the_first_are_shown_and_the_rest_counted(run: Recording) -> None:
    events = tuple(taken(k, k, Command(enabled=True)) for k in range(1, MOST_SHOWN + 8))
    found = events_of(replace(run, events=(OPENED, *events, ENDED)))

    assert found is not None
    assert [row.tick for row in found.rows] == [str(k) for k in range(1, MOST_SHOWN + 1)]
    assert found.more == "7 events more are in the recording."


def test_the_page_shows_them_and_nothing_in_them_is_markup(run: Recording, good: Result) -> None:
    hostile = "<script>alert('x')</script>"
    commanded = replace(run, events=(OPENED, taken(50, 1, Command(stop=hostile)), ENDED))
    page = Report(commanded, good).html()

    assert "What was changed, and what went wrong" in page
    assert "Command 1" in page
    assert hostile not in page
    body = re.search(r'aria-label="Commands and faults of .*?</table>', page, flags=re.DOTALL)
    assert body is not None
    assert body[0].count("<tr>") == 2
    assert "&lt;script&gt;" in body[0]
