"""`servobench convert`: a recording in another file format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from servobench.cli.options import AS_IT_IS, AsJson, Overwrite, Reading, with_reading

if TYPE_CHECKING:
    from servobench.recordings.evidence import Evidence
    from servobench.recordings.recording import Recording


@with_reading
def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", hidden=True)],
    target: Annotated[Path, typer.Argument(metavar="OUT", hidden=True)],
    reading: Reading = AS_IT_IS,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Write the recordings in a file in another format.

    The ending of OUT selects the format. Nothing is renamed, scaled or resampled. Options or a mapping that
    say what the columns are also set roles, units and times; samples without a usable time are then left out.
    """
    from servobench.cli.output_file import check_free
    from servobench.cli.progress import Progress
    from servobench.cli.recordings import evidence_of, load_all
    from servobench.cli.result_text import show_findings
    from servobench.cli.terminal import messages, output, print_json, say
    from servobench.cli.written import document_of_files
    from servobench.core.rounding import count_text
    from servobench.recordings.formats.base import save
    from servobench.recordings.reading import select

    check_free(target, "OUT", [source, reading.mapping], overwrite)
    with Progress() as progress:
        recordings = load_all([source], progress)
    if set(reading.flags) - {"--recording"}:
        recordings = [_measurable_recording(each) for each in evidence_of(recordings, reading)]
    elif reading.recording:
        recordings = select(recordings, reading.recording)
    save(recordings, target)
    console = messages() if as_json else output()
    say(console, f"{target}: {count_text(len(recordings), 'recording')} from {source}")
    findings = [finding for each in recordings for finding in each.findings]
    show_findings(console, findings)
    if as_json:
        print_json(document_of_files([target], recordings, findings))


def _measurable_recording(evidence: Evidence) -> Recording:
    """The recording with its options; raises `UsageError` for a chain that wasn't applied: no file holds its output."""
    from servobench.core.errors import UsageError

    if evidence.chain:
        raise UsageError(
            f"{evidence.recording.name}: the output `{evidence.recording.output}` hasn't passed the chain "
            f"`{evidence.chain}` yet; leave the chain out here, and give it to `servobench identify`"
        )
    return evidence.recording
