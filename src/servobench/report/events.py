"""The events of a run: commands with their changes, faults, and rows that the recorder missed."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from servobench.core.parameter_names import plain_words
from servobench.core.rounding import SPACE, count_text, group_digits, plain
from servobench.recordings.recording import Event, Recording
from servobench.report.history import toml_text

MOST_SHOWN = 50
_ALWAYS = ("opened", "ended")  # each run has them, and the page says them elsewhere


@dataclass(frozen=True, kw_only=True)
class EventRow:
    """One event as a row of texts: its time, the tick at which it took effect, what it was, and what is said of it."""

    time: str
    tick: str
    what: str
    said: str


@dataclass(frozen=True, kw_only=True)
class Events:
    """The events of a run by its name, as rows of a table; `more` says how many aren't shown, empty where all are."""

    name: str
    rows: tuple[EventRow, ...]
    more: str


def events_of(recording: Recording) -> Events | None:
    """Return the events of a recording but for its beginning and its end, fifty at most; None where there are no others."""
    events = [event for event in recording.events if event.kind not in _ALWAYS]
    if not events:
        return None
    left = len(events) - MOST_SHOWN
    more = (
        f"{count_text(left, 'event')} more {'is' if left == 1 else 'are'} in the recording."
        if left > 0
        else ""
    )
    return Events(name=recording.name, rows=tuple(map(_row, events[:MOST_SHOWN])), more=more)


def _row(event: Event) -> EventRow:
    try:
        about = json.loads(event.text)
    except (ValueError, RecursionError):  # of another program, or damaged
        about = None
    what, said = (
        _command(about) if event.kind == "command" and isinstance(about, Mapping) else _other(event, about)
    )
    return EventRow(
        time=f"{plain(event.time, 6)}{SPACE}s", tick=group_digits(event.tick), what=what, said=said
    )


def _command(about: Mapping[str, Any]) -> tuple[str, str]:
    """A command: its number, and what it changed, or why it was refused."""
    number = about.get("number")
    name = f"Command {number}" if isinstance(number, int) else "Command"
    if not about.get("accepted", True):
        return f"{name}, refused", str(about.get("why", ""))
    what = about.get("what")
    changes = (
        [_change(key, value) for key, value in what.items()] if isinstance(what, Mapping) else [str(what)]
    )
    return name, "; ".join(changes)


def _change(key: str, value: Any) -> str:
    """One thing that a command changed."""
    words = {
        ("enabled", True): "the controller's voltage is applied",
        ("enabled", False): "zero volts instead of the controller's voltage",
        ("acknowledge", True): "the fault is acknowledged",
    }
    known = words.get((key, value)) if isinstance(value, bool) else None
    return known or f"{plain_words(key)}: {toml_text(_without_unset(value))}"


def _without_unset(value: Any) -> Any:
    """A value without the settings that aren't set."""
    if isinstance(value, Mapping):
        return {key: _without_unset(item) for key, item in value.items() if item is not None}
    return [_without_unset(item) for item in value] if isinstance(value, list) else value


def _other(event: Event, about: Any) -> tuple[str, str]:
    """A fault, its acknowledgement, rows that the recorder missed, or an unknown event."""
    if not isinstance(about, Mapping):
        return event.kind, event.text
    if event.kind == "fault":
        return "Fault", str(about.get("sentence", ""))
    if event.kind == "acknowledged":
        return "Acknowledged", str(about.get("code", ""))
    names = {
        "rows-missed": ("Samples not recorded", "sample"),
        "events-missed": ("Events not recorded", "event"),
    }
    if event.kind in names and isinstance(count := about.get("count"), int):
        what, one = names[event.kind]
        return what, count_text(count, one)
    return event.kind, event.text
