"""Small helpers for tests of formats: text to recording, and what it says."""

from collections.abc import Sequence
from pathlib import Path

from servobench.core.finding import Finding
from servobench.recordings.formats.base import load
from servobench.recordings.recording import Recording


def loaded(folder: Path, content: str | bytes, name: str = "log.csv") -> Recording:
    """Write a file and load the one recording in it."""
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    (recording,) = load(path)
    return recording


def columns(recording: Recording) -> dict[str, list[float]]:
    """Return the values by channel."""
    return {series.channel.name: series.values.tolist() for series in recording.series}


def units(recording: Recording) -> dict[str, str | None]:
    """Return the units by channel."""
    return {series.channel.name: series.channel.unit for series in recording.series}


def codes(findings: Sequence[Finding]) -> list[str]:
    """Return the codes of findings, in their order."""
    return [finding.code for finding in findings]


def finding(findings: Sequence[Finding], code: str) -> Finding:
    """Return the one finding of that code."""
    (found,) = [each for each in findings if each.code == code]
    return found
