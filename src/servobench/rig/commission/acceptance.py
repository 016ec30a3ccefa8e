"""The verb `commission`: all checks in their order, as far as each one permits the next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

from servobench._version import __version__
from servobench.core.channels import DeviceInfo
from servobench.core.errors import DeviceError, UsageError
from servobench.core.json_numbers import finite
from servobench.rig.commission.bench import Bench, CheckEnded
from servobench.rig.commission.checks.base import Check, Outcome, State, as_sentence, in_order, no_outcome

SCHEMA = "servobench.commission/1"
STATES: tuple[State, ...] = ("verified", "failed", "unsupported", "unknown")


@dataclass(frozen=True, kw_only=True)
class Checked:
    """One check with its outcome, the names of its recordings, and what is below its picture, empty where it has none."""

    name: str
    title: str
    """The check's subject, in a few words."""
    outcome: Outcome
    recordings: tuple[str, ...] = ()
    picture: str = ""


@dataclass(frozen=True, kw_only=True)
class Signature:
    """The name that signs the acceptance off, and the day (ISO 8601)."""

    name: str
    """The name as it was given."""
    date: str
    """The day (ISO 8601)."""


@dataclass(frozen=True, kw_only=True)
class Acceptance:
    """The outcome of commissioning: the device, each check's outcome, when (ISO 8601, UTC), and why it ended early.

    `device` are the device's settings as they were given, `ended` is empty where all checks had their turn.
    """

    info: DeviceInfo
    """The device's description of itself."""
    checks: tuple[Checked, ...]
    created: str
    """When it was begun (ISO 8601, UTC)."""
    settings: tuple[tuple[str, str], ...] = ()
    sample_time: float = 0.002
    """Time between two samples [s]."""
    voltage_limit: float = 0.0
    """Largest voltage that a check might put out [V]."""
    ended: str = ""
    interrupted: bool = False
    """Whether somebody asked for the end."""
    signature: Signature | None = None
    """The person who signed it off, None if nobody did."""
    version: str = __version__
    """The version of this software."""

    @property
    def counts(self) -> dict[State, int]:
        """The number of checks in each state."""
        return {state: sum(each.outcome.state == state for each in self.checks) for state in STATES}

    @property
    def failed(self) -> tuple[Checked, ...]:
        """The checks that failed."""
        return tuple(each for each in self.checks if each.outcome.state == "failed")

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data of the schema `servobench.commission/1`."""
        document: dict[str, Any] = finite(
            {
                "schema": SCHEMA,
                "device": {
                    "name": self.info.name,
                    "serial": self.info.serial,
                    "timing": self.info.timing,
                    "settings": dict(self.settings),
                },
                "checks": [_as_data(each) for each in self.checks],
                "counts": dict(self.counts),
                "sample_time": self.sample_time,
                "voltage_limit": self.voltage_limit,
                "ended": self.ended,
                "signed": asdict(self.signature) if self.signature else None,
                "provenance": {"version": self.version, "created": self.created},
            }
        )
        return document


def _as_data(checked: Checked) -> dict[str, Any]:
    outcome = checked.outcome
    return {
        "name": checked.name,
        "title": checked.title,
        "state": outcome.state,
        "did": outcome.did,
        "expected": outcome.expected,
        "found": outcome.found,
        "figures": [
            {**asdict(each), "interval": list(each.interval) if each.interval else None}
            for each in outcome.figures
        ],
        "remedy": outcome.remedy,
        "recordings": list(checked.recordings),
    }


def commission(
    bench: Bench,
    created: str,
    *,
    begin: Callable[[str], None] | None = None,
    end: Callable[[Checked], None] | None = None,
) -> Acceptance:
    """Carry out all checks in their order, and return what was found.

    `begin` is told the title of each check, `end` its outcome. A check whose run is cut short has failed; after a failed check
    that `halts`, a lost device or Ctrl-C the others aren't carried out. `created` is the time (ISO 8601, UTC).
    Raises what the first run raises: `UsageError` for settings that the device refuses, `DeviceError` where it can't be opened;
    `StorageError` at any time.
    """
    checks: list[Checked] = []
    ended, interrupted = "", False
    for name, kind in in_order():
        if ended:
            checks.append(Checked(name=name, title=kind.title, outcome=no_outcome(ended)))
            continue
        if begin is not None:
            begin(kind.title)
        turn = _carry_out(bench, name, kind())
        ended, interrupted = turn.ended, turn.interrupted
        bench.outcomes[name] = turn.outcome
        checks.append(
            Checked(
                name=name,
                title=kind.title,
                outcome=turn.outcome,
                recordings=bench.run_names(),
                picture=kind.picture,
            )
        )
        if end is not None:
            end(checks[-1])
    return Acceptance(
        info=bench.info,
        checks=tuple(checks),
        created=created,
        settings=bench.info.settings,
        sample_time=bench.sample_time,
        voltage_limit=bench.limit,
        ended=ended,
        interrupted=interrupted,
    )


class _Turn(NamedTuple):
    """A check carried out: why nothing comes after it (empty where something does), and whether somebody asked for that."""

    outcome: Outcome
    ended: str = ""
    interrupted: bool = False


def _carry_out(bench: Bench, name: str, check: Check) -> _Turn:
    bench.begin(name)
    missing = [each for each in check.needs if not bench.is_settled(each)]
    if missing:
        titles = {other: kind.title for other, kind in in_order()}
        state = bench.outcomes[missing[0]].state
        return _Turn(no_outcome(f"“{titles[missing[0]]}” {'is unknown' if state == 'unknown' else state}"))
    first = not bench.recordings
    failed, interrupted, cut_short = (
        f"“{check.title}” {word}" for word in ("failed", "was interrupted", "was cut short")
    )
    try:
        outcome = check.carry_out(bench)
    except CheckEnded as end:
        why = interrupted if end.interrupted else failed if end.state == "failed" else cut_short
        outcome = _early_outcome(end.state, end.sentence, end.remedy)
        return _Turn(outcome, why if end.halts or check.halts else "", end.interrupted)
    except KeyboardInterrupt:
        return _Turn(_early_outcome("unknown", "It was interrupted.", "Run it again."), interrupted, True)
    except DeviceError as error:
        if first:
            raise
        return _Turn(
            _early_outcome("failed", as_sentence(str(error)), "Look at the supply and the cable."), failed
        )
    except UsageError as error:
        if first:
            raise
        return _Turn(
            _early_outcome("unknown", as_sentence(f"the device refuses it: {error}"), "Change its settings.")
        )
    return _Turn(outcome, failed if check.halts and outcome.state == "failed" else "")


def _early_outcome(state: State, sentence: str, remedy: str) -> Outcome:
    return Outcome(
        state=state,
        did="It was begun, and cut short.",
        expected="The run goes on to its end.",
        found=sentence,
        remedy=remedy,
        carried_out=False,
    )


def sign_off(acceptance: Acceptance, name: str, date: str) -> Acceptance:
    """Return the acceptance with the name of who signs it off, and the day (ISO 8601)."""
    return replace(acceptance, signature=Signature(name=name, date=date))
