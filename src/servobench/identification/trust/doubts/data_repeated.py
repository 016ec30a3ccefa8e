"""The same recording given twice."""

from __future__ import annotations

from collections.abc import Sequence

from servobench.core.finding import Finding, warning
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset


def _find_repeats(records: Sequence[Dataset]) -> list[Finding]:
    """Whether the same samples are there twice: they would count twice, and the intervals come out too narrow."""
    seen: dict[bytes, str] = {}
    for record in records:
        first = seen.get(record.digest)
        if first is not None:
            which = (
                f"{first} and {record.name} hold the same samples"
                if first != record.name
                else f"{first} is given twice"
            )
            sentence = f"{which}: a copy adds no information and makes the intervals too narrow. Leave one of them out."
            return [warning("data-repeated", sentence)]
        seen[record.digest] = record.name
    return []


DOUBTS.member("data_repeated")(Doubt(codes=("data-repeated",), about_data=_find_repeats))
