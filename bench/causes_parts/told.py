"""The causes that each recording gets: the codes that accuse a motor, a sensor or a record of something."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import accusations
import numpy as np

from causes_parts.motors import drawn, recorded
from servobench.core.errors import ServobenchError
from servobench.core.finding import Finding, Severity
from servobench.identification.identify import identify
from servobench.recordings.measurement.dataset import Dataset

# What says that something in particular is wrong with the motor, its sensor, its amplifier or its record.
ACCUSATIONS = accusations.ACCUSATIONS | {
    "gain-local",
    "output-still",
    "structure-wrong",
    "unwrap-ambiguous",
}


@dataclass(frozen=True, kw_only=True)
class Told:
    """One recording, its verdict, and the accusations in its findings; `seconds` is processor time [s]."""

    name: str
    verdict: str
    codes: tuple[str, ...]
    sentences: tuple[str, ...] = ()
    seconds: float = 0.0


def plain(seeds: Iterable[int], show: Callable[[Told], None] = lambda told: None) -> list[Told]:
    """Return what plain motors are told, one for each seed."""
    found = []
    for seed in seeds:
        random = np.random.default_rng([2026, seed])
        motor = drawn(random)
        name = f"{seed:4} {motor.input}, {motor.output}, {motor.start}"
        found.append(told(name, [recorded(motor, random)]))
        show(found[-1])
    return found


def told(name: str, data: Sequence[Dataset]) -> Told:
    """Return what recordings are told when they are fitted jointly."""
    started = time.process_time()
    try:
        result = identify(data)
    except ServobenchError as error:
        return Told(name=name, verdict="unread", codes=(), sentences=(str(error),))
    moved = any(
        np.ptp(each.y) > 0 for each in data
    )  # of an output that never moved it is true that it stands still
    accused = [each for each in result.findings if _accuses(each) and (moved or each.code != "output-still")]
    return Told(
        name=name,
        verdict=str(result.verdict),
        codes=tuple(sorted({each.code for each in accused})),
        sentences=tuple(each.sentence for each in accused),
        seconds=time.process_time() - started,
    )


def _accuses(finding: Finding) -> bool:
    return finding.code in ACCUSATIONS and finding.severity is not Severity.INFO
