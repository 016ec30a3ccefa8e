"""The same recording given twice."""

from __future__ import annotations

from collections.abc import Sequence

from servobench.core.finding import Finding, warning
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset


def _find_repeats(records: Sequence[Dataset]) -> list[Finding]:
    """Whether the same recording is there twice: it would count twice, and the intervals come out too narrow."""
    seen: set[tuple[str, str]] = set()
    for record in records:
        key = (record.source.sha256, record.name)
        if record.source.sha256 and key in seen:
            sentence = (
                f"{record.name} is given more than once: the copy adds no information "
                "and makes the intervals too narrow."
            )
            return [warning("data-repeated", sentence)]
        seen.add(key)
    return []


DOUBTS.member("data_repeated")(Doubt(codes=("data-repeated",), about_data=_find_repeats))
