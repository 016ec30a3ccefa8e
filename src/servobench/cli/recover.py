"""`servobench recover`: recover what is readable of a recording that was cut short, alone or in the folder of its run."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from servobench.cli.options import AsJson, Overwrite

if TYPE_CHECKING:
    from servobench.recordings.recording import Recording


def recover(
    file: Annotated[Path, typer.Argument(metavar="FILE", hidden=True)],
    to: Annotated[
        Path | None, typer.Option("--to", metavar="FILE", help="The new file; by default one next to FILE.")
    ] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Save the intact part of a recording that was cut short.

    FILE is a truncated recording (.mcap or .mcap.part), which isn't changed. Or it is the folder of a killed run, which is
    repaired: recording.mcap instead of recording.mcap.part, data.csv, and experiment.toml if that is missing.
    """
    from servobench.cli.result_text import show_findings
    from servobench.cli.terminal import messages, output, print_json, say
    from servobench.cli.written import document_of_files
    from servobench.core.rounding import count_text

    target, recordings = _recover_file(file, to, overwrite)
    samples = sum(max((len(series.values) for series in each.series), default=0) for each in recordings)
    console = messages() if as_json else output()
    say(console, f"{target}: {count_text(len(recordings), 'recording')}, {count_text(samples, 'sample')}")
    for each in recordings:
        if each.stopped.reason != "unknown":
            say(console, f"ended: {each.stopped.sentence}")
    findings = [finding for each in recordings for finding in each.findings]
    show_findings(console, findings)
    if as_json:
        print_json(document_of_files([target], recordings, findings))


def _recover_file(file: Path, to: Path | None, overwrite: bool) -> tuple[Path, tuple[Recording, ...]]:
    """The new file, and the recordings in it."""
    from servobench.cli.output_file import check_free
    from servobench.cli.run_folder import RunFolder
    from servobench.core.errors import UsageError
    from servobench.recordings.native.recover import recover as recovered

    if not file.is_dir():
        target = to or _path_of_recovery(file)
        check_free(target, "--to", [file], overwrite)
        if not target.exists():
            return target, recovered(file, target)
        # What is there stays until the new one is whole.
        with TemporaryDirectory(prefix=".", dir=target.parent) as new:
            recordings = recovered(file, Path(new) / target.name)
            (Path(new) / target.name).replace(target)
        return target, recordings
    if to is not None:
        raise UsageError(
            f"--to {to}: the folder of a run is repaired in place; for a copy, give its recording.mcap.part"
        )
    folder = RunFolder(file)
    return folder.recording, (folder.make_whole(),)


def _path_of_recovery(file: Path) -> Path:
    """The name of the recovered file: `recording.mcap.part` becomes `recording-recovered.mcap`."""
    name = file.name.removesuffix(".part").removesuffix(".mcap")
    return file.with_name(f"{name}-recovered.mcap")
