"""One run: a recording, damaged or not, as a user's file would be read, and the codes of what is found."""

from collections.abc import Iterable
from dataclasses import dataclass

from damaged_parts.damages import Copy, copies
from damaged_parts.recordings import Ours, undamaged
from servobench.core.finding import Severity
from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.recordings.formats.mapping import assign
from servobench.recordings.measurement.measure import measure
from servobench.recordings.recording import Recording


@dataclass(frozen=True, kw_only=True)
class Run:
    """The outcome for a recording: the verdict, the codes of all findings, and those of findings beyond mere information.

    `wanted` are the codes of which one is right, empty for a sound recording.
    """

    kind: str
    severity: str
    words: str
    seed: int
    verdict: str
    codes: tuple[str, ...]
    grave: tuple[str, ...]
    wanted: tuple[str, ...] = ()

    @property
    def hit(self) -> bool:
        """Whether one of the right codes is among the findings."""
        return bool(set(self.wanted) & set(self.codes))


def identified(recordings: Iterable[Recording], nominal: str | None = None) -> Result:
    """Return the result of recordings, which go through the same doors as a user's file."""
    return identify([measure(assign(recording)) for recording in recordings], nominal=nominal)


def damaged_run(copy: Copy, seed: int) -> Run:
    """Return what came of one damaged copy."""
    result = identified(copy.made(seed), copy.nominal)
    return _run(result, copy.damage, copy.severity, copy.words, seed, copy.codes)


def undamaged_run(ours: Ours, seed: int) -> Run:
    """Return what came of a sound recording."""
    return _run(identified([ours.made(seed)]), "none", "none", ours.words, seed, ())


def damaged_runs(seeds: Iterable[int]) -> list[Run]:
    """Return the runs of all damages."""
    numbers = tuple(seeds)
    return [damaged_run(copy, seed) for copy in copies() for seed in numbers]


def undamaged_runs(seeds: Iterable[int]) -> list[Run]:
    """Return the runs of all sound recordings."""
    numbers = tuple(seeds)
    return [undamaged_run(ours, seed) for ours in undamaged() for seed in numbers]


def _run(result: Result, kind: str, severity: str, words: str, seed: int, wanted: tuple[str, ...]) -> Run:
    codes = [finding.code for finding in result.findings]
    grave = [finding.code for finding in result.findings if finding.severity != Severity.INFO]
    return Run(
        kind=kind,
        severity=severity,
        words=words,
        seed=seed,
        verdict=str(result.verdict),
        codes=tuple(dict.fromkeys(codes)),
        grave=tuple(dict.fromkeys(grave)),
        wanted=wanted,
    )
