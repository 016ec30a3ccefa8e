"""`servobench inspect`: what is in a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from servobench.cli.option_names import with_options
from servobench.cli.options import AS_IT_IS, AsJson, Overwrite, Reading, ReportFile, with_reading

if TYPE_CHECKING:
    from rich.console import Console

    from servobench.core.finding import Finding
    from servobench.recordings.formats.mapping import Mapping
    from servobench.recordings.measurement.dataset import Dataset
    from servobench.recordings.recording import Recording, Series


@with_reading
def inspect(
    file: Annotated[Path, typer.Argument(metavar="FILE", hidden=True)],
    write_mapping: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="Write what was recognised as a mapping to edit, with questions about the rest.",
        ),
    ] = None,
    report: ReportFile = None,
    reading: Reading = AS_IT_IS,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Show what is in a file and what it can support.

    It lists recordings and channels, what is wrong with their times and values, and what is missing to identify them. Options
    that say what the columns are apply as in `servobench identify`.
    """
    from servobench.cli.inspection_document import inspection_document
    from servobench.cli.output_file import check_free
    from servobench.cli.progress import Progress
    from servobench.cli.recordings import load_all
    from servobench.cli.terminal import messages, output, print_json, say
    from servobench.core.errors import UsageError
    from servobench.core.rounding import count_text
    from servobench.recordings.reading import recordings_meant

    for option, target in {"--write-mapping": write_mapping, "--report": report}.items():
        check_free(target, option, [file, reading.mapping], overwrite)
    if report is not None and write_mapping is not None and report.resolve() == write_mapping.resolve():
        raise UsageError(f"--report and --write-mapping both name {report}; give two names")
    with Progress() as progress:
        loaded = load_all([file], progress, reading)
    meant = recordings_meant(loaded, **reading.options)
    looks = [_look(each, mapping) for each, mapping in meant]
    recordings = [look.recording for look in looks]
    console = messages() if as_json else output()
    source = recordings[0].source
    say(console, f"{source.name}: {source.format}, {count_text(len(recordings), 'recording')}")
    say(console, f"SHA-256 {source.sha256}")
    for look in looks:
        console.print()
        _show(console, look)
    if as_json:
        print_json(inspection_document(meant))
    if report is not None:
        from servobench.report.inspection import InspectionReport

        InspectionReport(recordings).write(report)
        say(console, f"\nreport: {report}")
    if write_mapping is not None:
        _propose(recordings, file, write_mapping)
        say(
            console,
            f"\nmapping: {write_mapping}; edit it, then: servobench identify {file} --mapping {write_mapping}",
        )


@dataclass(frozen=True)
class _Look:
    """A recording with the roles that were said or recognised, its data, what is missing for that, or what is against it."""

    recording: Recording
    data: Dataset | None = None
    missing: tuple[str, ...] = ()
    against: str = ""


def _look(recording: Recording, mapping: Mapping) -> _Look:
    """The recording with the given options applied; raises `UnknownName` for a missing column."""
    from servobench.core.errors import MissingInformation, ServobenchError, UnknownName
    from servobench.recordings.evidence import evidence_of

    try:
        part = evidence_of(recording, mapping)
        described = part.recording if mapping != type(mapping)() else recording
        return _Look(described, part.dataset())
    except MissingInformation as error:
        return _Look(recording, missing=tuple(error.missing))
    except UnknownName:
        raise
    except ServobenchError as error:
        return _Look(recording, against=str(error))


def _propose(recordings: Sequence[Recording], file: Path, target: Path) -> None:
    """Write the proposal of a mapping; raises `StorageError` where that can't be done."""
    from servobench.core.errors import StorageError
    from servobench.recordings.formats.proposal import proposal

    try:
        # A name of a file may hold bytes that are no text.
        target.write_bytes(
            proposal(recordings, f"servobench identify {file} --mapping THIS.toml").encode("utf-8", "replace")
        )
    except OSError as error:
        raise StorageError(f"{target} can't be written: {error.strerror or error}") from error


def _show(console: Console, look: _Look) -> None:
    from rich.text import Text

    from servobench.cli.result_text import show_findings
    from servobench.cli.terminal import one_line, say
    from servobench.core.finding import Severity

    recording = look.recording
    console.print(Text(one_line(recording.name), style="bold"))
    # What is missing or damaged comes first: all that follows is about what is left.
    show_findings(console, [each for each in recording.findings if each.severity is not Severity.INFO])
    _show_channels(console, recording)
    for line in _times(recording):
        say(console, f"  {line}")
    for line in _pictures(console, recording):
        console.print(one_line(line), soft_wrap=True)
    if recording.stopped.reason != "unknown":
        say(console, f"  ended: {one_line(recording.stopped.sentence)}")
    show_findings(console, [each for each in recording.findings if each.severity is Severity.INFO])
    lines, doubts = _support(look)
    for line in lines:
        say(console, one_line(line))
    show_findings(console, doubts)


def _show_channels(console: Console, recording: Recording) -> None:
    import numpy as np

    from servobench.cli.layout import show_table

    headings = ("channel", "unit", "samples", "smallest", "largest", "")
    rows = []
    for series in recording.series:
        finite = series.values[np.isfinite(series.values)]
        ends = [f"{finite.min():.6g}", f"{finite.max():.6g}"] if len(finite) else ["-", "-"]
        remarks = "; ".join(_remarks(recording, series, len(finite)))
        rows.append(
            (series.channel.name, series.channel.unit or "?", str(len(series.values)), *ends, remarks)
        )
    show_table(console, headings, rows, right=headings[2:5])


def _remarks(recording: Recording, series: Series, finite: int) -> list[str]:
    name = series.channel.name
    remarks = [role for role in ("input", "output") if getattr(recording, role) == name]
    if series.t is None:
        remarks.append("without times")
    if finite < len(series.values):
        remarks.append(f"{len(series.values) - finite} not finite")
    if series.channel.counter_bits:
        remarks.append(f"{series.channel.counter_bits}-bit counter")
    if series.channel.counts_per_rev:
        remarks.append(f"{series.channel.counts_per_rev:g} counts/rev")
    return remarks


def _times(recording: Recording) -> list[str]:
    """A line on each set of times."""
    from servobench.recordings.formats.times import time_base

    different = {id(series.t): series.t for series in recording.series if series.t is not None}
    lines = []
    for t in different.values():
        base = time_base(t)
        if base.median_step is None or base.start is None or base.end is None:
            lines.append(f"times: {base.samples}, all equal")
            continue
        steps = {f"{step:.3g}" for step in (base.shortest_step, base.p99_step, base.longest_step)}
        spread = f"at least {base.shortest_step:.3g} s, 99 of 100 up to {base.p99_step:.3g} s, at most {base.longest_step:.3g} s"
        line = f"times: {base.start:.6g} s to {base.end:.6g} s, every {base.median_step:.4g} s"
        lines.append(f"{line} ({spread})" if len(steps) > 1 else line)
    return list(dict.fromkeys(lines)) or ["no times were recognised"]


def _pictures(console: Console, recording: Recording) -> list[str]:
    """The channels that are examined over time, and how the intervals between the samples are spread."""
    import numpy as np

    from servobench.cli.pictures import histogram, line_over_time, pen_for
    from servobench.core.rounding import percent, with_unit
    from servobench.recordings.formats.describe import channels_to_show
    from servobench.recordings.formats.inspection import extremes, intervals

    pen, lines = pen_for(console), []
    shown = [recording[name] for name in channels_to_show(recording)]
    for series in shown:
        t = np.arange(len(series.values), dtype=np.float64) if series.t is None else series.t
        held = series.channel.name == recording.input
        picture = line_over_time(
            t, series.values, pen, width=console.width - 2, unit=series.channel.unit or "", held=held
        )
        if series.t is None and picture:
            picture[-1] = picture[-1].replace(" s", "")
        lines += ["", f"  {series.channel.name}", *(f"  {line}" for line in picture)]
        ends = extremes(series)
        if ends is not None and ends.looks_limited:
            share = percent(100 * max(ends.at_smallest, ends.at_largest))
            lines.append(f"  {share} % of its samples are at an end of its range: it is limited.")
    for spread in [intervals(series.t) for series in shown[:1] if series.t is not None]:
        if spread is None or spread.is_even:
            continue
        low, high = (with_unit(float(edge), "s", 3) for edge in (spread.edges[0], spread.edges[-1]))
        beyond = f", {spread.beyond} longer ones" if spread.beyond else ""
        lines += ["", f"  intervals: {low} {histogram(spread.counts, pen)} {high}{beyond}"]
    return [*lines, ""] if lines else []


def _unit_in(recording: Recording, data: Dataset) -> str:
    """The unit of the column that is the output, and that of the results where it is another one."""
    from servobench.recordings.formats.mapping import assign

    written = recording[recording.output].channel.unit if recording.output else None
    if recording.output is None:
        named = assign(recording)
        written = named[named.output or ""].channel.unit
    if written in (None, "", data.output_unit):
        return data.output_unit
    return f"{written} (results are in {data.output_unit})"


def _support(look: _Look) -> tuple[list[str], list[Finding]]:
    """The recording's possible use, what has to be stated first, and the findings against using it."""
    from servobench.core.finding import Severity, lower_first
    from servobench.identification.trust.doubts.base import about_data

    data = look.data
    if look.missing:
        questions = [f"  • {with_options(each)}" for each in look.missing]
        return ["To identify it, this is missing:", *questions], []
    if data is None:
        return [f"It can't be identified as it is: {with_options(look.against)}"], []
    refusals = [each for each in data.findings if each.severity is Severity.REFUSAL]
    if refusals:
        return [f"It can't be identified as it is: {lower_first(with_options(refusals[0].sentence))}"], []
    against = about_data([data])
    refused = any(each.severity is Severity.REFUSAL for each in against)
    verb = "reads it so" if refused else "can use it as it is"
    low, high = f"{data.u.min():.4g}", f"{data.u.max():.4g}"
    levels = low if low == high else f"{low} to {high}"
    text = (
        f"`servobench identify` {verb}: the output is a {data.kind} in {_unit_in(look.recording, data)}, "
        f"{data.duration:.4g} s long, the input {levels} {data.input_unit}."
    )
    return [text, *(["That can't be identified:"] if refused else [])], against
