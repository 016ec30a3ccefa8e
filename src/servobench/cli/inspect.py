"""`servobench inspect`: what is in a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from servobench.recording.recording import Recording, Series


def inspect(file: Annotated[Path, typer.Argument(metavar="FILE", hidden=True)]) -> None:
    """Tell what is in a file, and what it can support.

    Its recordings and channels, what is wrong with their times and values, and what has to be said to identify them.
    """
    from servobench.cli.progress import Progress
    from servobench.cli.recordings import loaded
    from servobench.cli.terminal import output, say
    from servobench.rounding import counted

    with Progress() as progress:
        recordings = loaded([file], progress)
    console = output()
    source = recordings[0].source
    say(console, f"{source.name}: {source.format}, {counted(len(recordings), 'recording')}")
    say(console, f"SHA-256 {source.sha256}")
    for recording in recordings:
        console.print()
        _show(console, recording)


def _show(console: Console, recording: Recording) -> None:
    from rich.text import Text

    from servobench.cli.answer import show_findings
    from servobench.cli.terminal import printable, say

    console.print(Text(printable(recording.name), style="bold"))
    _show_channels(console, recording)
    for line in _times(recording):
        say(console, f"  {line}")
    if recording.stopped.reason != "unknown":
        say(console, f"  ended: {recording.stopped.sentence}")
    show_findings(console, recording.findings)
    for line in _support(recording):
        say(console, line)


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
    """What each set of times is like, in a line."""
    from servobench.formats.times import time_base

    different = {id(series.t): series.t for series in recording.series if series.t is not None}
    lines = []
    for t in different.values():
        base = time_base(t)
        if base.median_step is None or base.start is None or base.end is None:
            lines.append(f"times: {base.samples}, none of them later than another")
            continue
        lines.append(
            f"times: {base.start:.6g} s to {base.end:.6g} s, every {base.median_step:.6g} s "
            f"(at least {base.shortest_step:.3g} s, 99 of 100 below {base.p99_step:.3g} s, at most {base.longest_step:.3g} s)"
        )
    return list(dict.fromkeys(lines)) or ["no times that are recognised"]


def _support(recording: Recording) -> list[str]:
    """What the recording can be used for as it is, or what has to be said before."""
    from servobench.errors import MissingInformation, ServobenchError
    from servobench.formats.mapping import assign
    from servobench.measurement.measure import measure

    try:
        data = measure(assign(recording))
    except MissingInformation as error:
        return ["To identify it, more has to be known:", *(f"  • {sentence}" for sentence in error.missing)]
    except ServobenchError as error:
        return [f"It can't be identified as it is: {error}"]
    levels = len(set(data.u.tolist()))
    lines = [
        f"`servobench identify` can take it as it is: the output is a {data.kind} in {data.output_unit}, "
        f"{data.duration:.4g} s long, the input {data.u.min():.4g} to {data.u.max():.4g} {data.input_unit}."
    ]
    if levels == 1:
        lines.append("The input never changes, so that no model can come of it.")
    if data.kind == "speed" and not data.chain:
        lines.append(
            "Nobody says how the speed was measured; if it was filtered or averaged, say so with --chain."
        )
    return lines
