"""LabVIEW's measurement files in text (.lvm): a header, then segments, each with a header of its channels and a block of rows.

A segment that has the channels of the one before and goes on where it ended belongs to the same recording: its first times come
no later than 2.5 steps after the last ones, by `X0` or else by `Date`, `Time` and `X0` together. Any other begins a recording.
Source: National Instruments, "Specification for the LabVIEW Measurement File (.lvm)".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, NoReturn, final

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import FormatError, UsageError
from servobench.core.finding import Finding, info
from servobench.recordings.formats import text_table
from servobench.recordings.formats.base import FORMATS
from servobench.recordings.formats.columns import quote, recording_of
from servobench.recordings.formats.lvm_segments import MARK, File, Segment, later
from servobench.recordings.formats.times import GAP, time_base
from servobench.recordings.recording import Recording, Source


@final
@FORMATS.member("lvm")
@dataclass(frozen=True, kw_only=True)
class Lvm:
    """LabVIEW measurement files: read, and not written, as their rows have no place for what a recording knows."""

    suffixes: ClassVar[tuple[str, ...]] = (".lvm",)
    written: ClassVar[tuple[str, ...]] = ()
    by_library: ClassVar[bool] = False

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether a file begins like a LabVIEW measurement file."""
        try:
            return text_table.decode(head[: len(head) // 2 * 2], path.name)[0].startswith(MARK)
        except FormatError:
            return False

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return a recording for each run of segments that go on; raises `FormatError` where the file can't be read."""
        data = path.read_bytes()
        text_table.check_lines(data, path.name)
        text, findings = text_table.decode(data, path.name)
        file = File.read(text, path.name)
        segments = [segment for segment in file.segments(path.name) if segment.columns]
        if not segments:
            raise FormatError(f"{path.name} has no channels with numbers")
        runs = _runs(segments)
        names = [path.stem] if len(runs) == 1 else [f"{path.stem} {k}" for k in range(1, len(runs) + 1)]
        source = Source(name=path.name, format="lvm")
        run_findings = _about_runs(segments, runs)
        return tuple(
            _recording(run, name, source, (*findings, *run_findings))
            for run, name in zip(runs, names, strict=True)
        )

    def write(self, recordings: tuple[Recording, ...], path: Path) -> NoReturn:
        """Raise `UsageError`: rows of a LabVIEW measurement file can't hold what a recording knows."""
        raise UsageError(
            f"{path.name}: LabVIEW measurement files can't be written; write .tdms, .mat or .csv instead"
        )


def _runs(segments: Sequence[Segment]) -> list[list[Segment]]:
    """The segments by recording, those that go on moved to where they do."""
    runs: list[list[Segment]] = []
    for segment in segments:
        moved = _continue_run(runs[-1], segment) if runs else None
        if moved is None:
            runs.append([segment])
        else:
            runs[-1].append(moved)
    return runs


def _continue_run(run: Sequence[Segment], segment: Segment) -> Segment | None:
    """The segment with its times after those of a run, by X0 or else by the clock; None where it doesn't go on."""
    first, last = run[0], run[-1]
    if [each.heading for each in last.columns] != [each.heading for each in segment.columns]:
        return None
    shifts = [0]
    if first.start is not None and segment.start is not None:
        shifts.append(segment.start - first.start)
    for shift in shifts:
        moved = [later(each, shift) for each in segment.columns]
        if all(_follows(a.t, b.t) for a, b in zip(last.columns, moved, strict=True)):
            return replace(segment, columns=tuple(moved))
    return None


def _follows(before: Array | None, after: Array | None) -> bool:
    """Whether times continue where those before ended; a segment of one sample has no step, so any later one may follow it."""
    if before is None or after is None:
        return False
    pause = float(after[0] - before[-1])
    step = time_base(before).median_step
    return pause > 0.0 and (step is None or pause <= GAP * step)


def _recording(run: Sequence[Segment], name: str, source: Source, findings: Sequence[Finding]) -> Recording:
    columns = [
        replace(
            each,
            values=np.concatenate([segment.columns[k].values for segment in run]),
            t=None if each.t is None else np.concatenate([t for segment in run if (t := segment.columns[k].t) is not None]),
        )
        for k, each in enumerate(run[0].columns)
    ]  # fmt: skip
    all_findings = (*findings, *(each for segment in run for each in segment.findings))
    return recording_of(columns, name=name, source=source, findings=dict.fromkeys(all_findings))


def _about_runs(segments: Sequence[Segment], runs: Sequence[Sequence[Segment]]) -> list[Finding]:
    """Findings on the segments of a file with several."""
    if len(segments) == 1:
        return []
    if len(runs) == 1:
        sentence = f"The file's {len(segments)} segments follow on from each other: they are one recording."
        return [info("segments-joined", sentence)]
    begins = quote([str(run[0].rows[0]) for run in runs])
    sentence = (
        f"The file's {len(segments)} segments don't all follow on from each other, or have different "
        "channels: they "
    )
    return [info("segments-apart", f"{sentence}are {len(runs)} recordings, which begin in rows {begins}.")]
