"""The document that `servobench inspect --json` prints: plain data of the schema `servobench.inspection/1`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any

from servobench.cli.option_names import with_options
from servobench.cli.written import finding_document
from servobench.core.json_numbers import finite
from servobench.recordings.formats.describe import describe

if TYPE_CHECKING:
    from servobench.recordings.formats.mapping import Mapping
    from servobench.recordings.recording import Recording

SCHEMA = "servobench.inspection/1"


def inspection_document(recordings: Sequence[tuple[Recording, Mapping]]) -> dict[str, Any]:
    """Return what is in each recording of a file, with what was said of it."""
    source = recordings[0][0].source
    document = {
        "schema": SCHEMA,
        "source": {"name": source.name, "format": source.format, "sha256": source.sha256},
        "recordings": [_of(recording, mapping) for recording, mapping in recordings],
    }
    return dict(finite(document))


def _of(recording: Recording, mapping: Mapping) -> dict[str, Any]:
    description = describe(recording, mapping)
    return {
        "name": description.name,
        "channels": [asdict(each) for each in description.channels],
        "times": [
            {name: getattr(each, name) for name in ("samples", "start", "end", "median_step", "longest_step")}
            for each in description.time_bases
        ],
        "mapping": {
            each.name: getattr(description.mapping, each.name)
            for each in fields(description.mapping)
            if each.name not in ("each", "recordings")
            and getattr(description.mapping, each.name) not in (None, "")
        },
        "missing": [with_options(each) for each in description.missing],
        "findings": [finding_document(each) for each in description.findings],
    }
