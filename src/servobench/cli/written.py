"""The files that a command wrote, as plain data of the schema `servobench.written/1`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from servobench.core.finding import Finding
    from servobench.recordings.recording import Recording

SCHEMA = "servobench.written/1"


def document_of_files(
    files: Sequence[Path], recordings: Sequence[Recording] = (), findings: Iterable[Finding] = ()
) -> dict[str, Any]:
    """Return the files that were written, the recordings in them, and what there is to know of these."""
    return {
        "schema": SCHEMA,
        "files": [str(file) for file in files],
        "recordings": [
            {"name": each.name, "samples": max((len(series.values) for series in each.series), default=0)}
            for each in recordings
        ],
        "findings": [finding_document(each) for each in findings],
    }


def finding_document(finding: Finding) -> dict[str, Any]:
    """Return a finding as plain data."""
    return {"code": finding.code, "severity": str(finding.severity), "sentence": finding.sentence}
