"""The messages between the loop's process and the program that started it: one JSON text each."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, Self

from pydantic import TypeAdapter, ValidationError

from servobench.core.channels import DeviceInfo
from servobench.core.errors import UsageError
from servobench.core.finding import Finding
from servobench.core.settings import Settings, problems_text
from servobench.recordings.recording import Stopped
from servobench.rig.experiment.experiment import AnyController
from servobench.systems.control.base import Controller
from servobench.systems.signals.base import AnySignal, Signal

NOT_CLOSED = "close-failed"
"""The code of the finding of a device that raised an error when it was closed."""


class Command(Settings):
    """A command to a running loop: given fields change at the next tick, the others stay.

    A new signal begins at its own time 0. A new controller, or one with other gains, takes over without a bump where its law can.
    `stop` ends the run with that sentence.
    """

    signal: AnySignal | None = None
    """The new reference."""
    controller: AnyController | None = None
    """The new controller."""
    enabled: bool | None = None
    """Whether the controller's voltage is applied; if not, zero volts."""
    chain: str | None = None
    """Measurement chain through which the rows are to be examined from now on; the loop passes it on."""
    acknowledge: bool = False
    """Whether a latched fault is acknowledged, so that the motor may turn again."""
    stop: str | None = None
    """The sentence with which the run is to end."""
    reason: Literal["finished", "interrupted", "error"] = "interrupted"
    """The kind of an end by `stop`: as requested, an interruption, or a failure."""

    def to_text(self, number: int) -> str:
        """Return the command as the text that goes to the loop."""
        return json.dumps({"number": number, **self.model_dump(mode="json", exclude_defaults=True)})


@dataclass(frozen=True, kw_only=True)
class Order:
    """A command as the loop takes it: its number, and what it changes."""

    number: int
    command: Command

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the order in a text; raises `UsageError`, which begins with its number if it has one."""
        fields: Any = None
        try:
            fields = json.loads(text, parse_constant=_no_number)
            number = fields.pop("number")
            if not isinstance(number, int) or isinstance(number, bool):
                raise ValueError(f"the number of a command is {number!r}; expected a whole number")
            return cls(number=number, command=Command.model_validate(fields))
        except (ValidationError, ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:
            raise UsageError(f"no command: {_reason(error)}") from None

    @property
    def signal(self) -> Signal | None:
        """The signal that it brings, if any."""
        return self.command.signal

    @property
    def controller(self) -> Controller | None:
        """The controller that it brings, if any."""
        return self.command.controller

    @property
    def enabled(self) -> bool | None:
        """Whether the controller's voltage is applied from then on."""
        return self.command.enabled


@dataclass(frozen=True, kw_only=True)
class Notice:
    """An event from the loop: one of the kinds below, its time, and what it is about.

    `opened` (`info`: the device), `command` (`number`, `accepted`, `what`, `why`), `fault` (`code`, `sentence`), `acknowledged`,
    `ended` (`reason`, `sentence`, `findings`), `failed` (`error`, `sentence`: nothing was begun).
    `tick` is the tick that it belongs to, at which a command took effect; `time` [s] the run's own time.
    """

    kind: Literal["opened", "command", "fault", "acknowledged", "ended", "failed"]
    tick: int = -1
    time: float = 0.0
    about: Mapping[str, Any]

    def to_text(self) -> str:
        """Return the event as a text."""
        return json.dumps({"kind": self.kind, "tick": self.tick, "time": self.time, **self.about})

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the event in a text of ours."""
        about = json.loads(text)
        return cls(kind=about.pop("kind"), tick=about.pop("tick"), time=about.pop("time"), about=about)


def info_to_json(info: DeviceInfo) -> Any:
    """Return a device's description as JSON can hold it."""
    return _adapter(DeviceInfo).dump_python(info, mode="json")


def info_from_json(document: Any) -> DeviceInfo:
    """Return the device's description that `info_to_json` has made JSON of."""
    info: DeviceInfo = _adapter(DeviceInfo).validate_python(document)
    return info


def info_of(event: Notice) -> DeviceInfo:
    """Return the device's description in the event `opened`."""
    return info_from_json(event.about["info"])


def ending_to_json(stopped: Stopped, findings: tuple[Finding, ...]) -> dict[str, Any]:
    """Return why a run ended and what was found as JSON can hold it."""
    items = _adapter(tuple[Finding, ...]).dump_python(findings, mode="json")
    return {"reason": stopped.reason, "sentence": stopped.sentence, "findings": items}


def ending_from_json(document: Mapping[str, Any]) -> tuple[Stopped, tuple[Finding, ...]]:
    """Return why a run ended and what was found, as `ending_to_json` wrote it; raises pydantic's `ValidationError`."""
    stopped: Stopped = _adapter(Stopped).validate_python(
        {key: document[key] for key in ("reason", "sentence")}
    )
    return stopped, _adapter(tuple[Finding, ...]).validate_python(document.get("findings", ()))


def stop_reason(event: Notice) -> Stopped:
    """Return why a run ended, of the event `ended`."""
    return ending_from_json(event.about)[0]


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def _no_number(text: str) -> float:
    raise ValueError(f"{text} isn't a number that a command may contain")


def _reason(error: Exception) -> str:
    """One line about it."""
    if isinstance(error, json.JSONDecodeError):
        return (
            f"it isn't JSON (at character {error.pos + 1}); expected an object with `number` and the values "
            "to change"
        )
    if isinstance(error, AttributeError | TypeError):
        return "it isn't an object; expected one with `number` and the values to change"
    if isinstance(error, ValidationError):
        return problems_text(error)
    if isinstance(error, KeyError):
        return "its number is missing"
    return str(error) or type(error).__name__
