"""The same recording given twice."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from servobench.core.finding import Finding, list_text, warning
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset


def _find_repeats(records: Sequence[Dataset]) -> list[Finding]:
    """Whether the same samples are there twice: they would count twice, and the intervals come out too narrow."""
    copies: dict[bytes, Counter[str]] = {}
    for record in records:
        copies.setdefault(record.digest, Counter())[record.name] += 1
    repeated = [_copies_text(names) for names in copies.values() if names.total() > 1]
    if not repeated:
        return []
    sentence = f"{'; '.join(repeated)}: a copy adds no information and makes the intervals too narrow. Keep one of each."
    return [warning("data-repeated", sentence)]


def _copies_text(names: Counter[str]) -> str:
    """What is said of one recording's `names`, each with how often it is given."""
    if len(names) > 1:
        return f"{list_text([*names])} hold the same samples"
    ((name, count),) = names.items()
    return f"{name} is given {'twice' if count == 2 else f'{count} times'}"


DOUBTS.member("data_repeated")(Doubt(codes=("data-repeated",), about_data=_find_repeats))
