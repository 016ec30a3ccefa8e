"""`servobench recover`: what can be read of a recording that was cut short."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def recover(
    file: Annotated[Path, typer.Argument(metavar="FILE", hidden=True)],
    to: Annotated[
        Path | None, typer.Option("--to", metavar="FILE", help="The new file; without, one beside FILE.")
    ] = None,
) -> None:
    """Save what is right in a recording that was cut short.

    FILE is a torn recording (.mcap or .mcap.part); it stays as it is.
    """
    from servobench.cli.answer import show_findings
    from servobench.cli.terminal import output, say
    from servobench.recording.recover import recover as recovered
    from servobench.rounding import counted

    target = to or _beside(file)
    recordings = recovered(file, target)
    samples = sum(max((len(series.values) for series in each.series), default=0) for each in recordings)
    console = output()
    say(console, f"{target}: {counted(len(recordings), 'recording')}, {counted(samples, 'sample')}")
    show_findings(console, (finding for each in recordings for finding in each.findings))


def _beside(file: Path) -> Path:
    """The name of the recovered file: `recording.mcap.part` becomes `recording-recovered.mcap`."""
    name = file.name.removesuffix(".part").removesuffix(".mcap")
    return file.with_name(f"{name}-recovered.mcap")
