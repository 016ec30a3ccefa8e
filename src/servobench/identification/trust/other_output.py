"""Another output of a recording, if the one used doesn't determine the time constant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import takewhile
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from servobench.core.finding import Finding
    from servobench.identification.result import Result
    from servobench.recordings.recording import Recording


_UNTOLD = ("parameter-unknown", "known-together", "nothing-known")


def with_other_output(result: Result, recordings: Sequence[Recording]) -> Result:
    """Return the result, with the speed that all recordings have named where their position doesn't tell the time constant.

    A position that is refreshed or counted coarsely shows a short time constant less well than a speed which the device computed
    from finer times. Of several speeds the one whose name begins most like the position's is named; a result that isn't refused
    for its time constant, and one of a speed, are returned as they are.
    """
    refused = [finding for finding in result.findings if _leaves_time_constant_open(finding)]
    speed = _speed_beside_position(recordings) if refused else None
    if speed is None:
        return result
    hint = f" The speed `{speed}` was recorded, too: try `output={speed}`."
    findings = tuple(
        replace(each, sentence=each.sentence + hint) if each in refused else each for each in result.findings
    )
    return replace(result, findings=findings)


def _leaves_time_constant_open(finding: Finding) -> bool:
    return finding.code in _UNTOLD and "time_constant" in finding.parameters


def _speed_beside_position(recordings: Sequence[Recording]) -> str | None:
    """The name of a speed that begins as that of the output does, which is a position; None where there is none in all."""
    outputs = {recording.output for recording in recordings}
    output = outputs.pop() if len(outputs) == 1 else None
    if output is None or any(_quantity(each, output) != "position" for each in recordings):
        return None
    names = [series.channel.name for series in recordings[0].series]
    speeds = [name for name in names if all(_quantity(each, name) == "speed" for each in recordings)]
    alike = {name: _alike(name, output) for name in speeds}
    best = max(speeds, key=lambda name: alike[name], default=None)
    return best if best is not None and alike[best] > 0 else None


def _alike(first: str, second: str) -> int:
    """The number of letters that two names have in common at their begin."""
    return len(list(takewhile(lambda pair: pair[0] == pair[1], zip(first, second, strict=False))))


def _quantity(recording: Recording, name: str) -> str | None:
    """The quantity of a channel by its unit, None where it isn't there or has no unit."""
    from servobench.core.units import is_unit, unit

    symbol = recording[name].channel.unit if name in recording else None
    return unit(symbol).quantity if symbol and is_unit(symbol) else None
