"""The same recording given twice."""

from __future__ import annotations

from collections.abc import Sequence

from servobench.core.finding import Finding, list_text, warning
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.shared_samples import share_samples


def _find_repeats(records: Sequence[Dataset]) -> list[Finding]:
    """Whether the same samples are there twice: they would count twice, and the intervals come out too narrow."""
    runs: list[list[Dataset]] = []
    for record in records:
        same = next((run for run in runs if share_samples(run[0], record)), None)
        if same is None:
            runs.append([record])
        else:
            same.append(record)
    repeated = [_copies_text(run) for run in runs if len(run) > 1]
    if not repeated:
        return []
    sentence = f"{'; '.join(repeated)}: a copy adds no information and makes the intervals too narrow. Keep one of each."
    return [warning("data-repeated", sentence)]


def _copies_text(run: Sequence[Dataset]) -> str:
    """What is said of the records of one run."""
    names = list(dict.fromkeys(record.name for record in run))
    if len(names) == 1:
        return f"{names[0]} is given {'twice' if len(run) == 2 else f'{len(run)} times'}"
    whole = len({record.digest for record in run}) == 1
    return f"{list_text(names)} {'hold the same samples' if whole else 'hold mainly the same samples'}"


DOUBTS.member("data_repeated")(Doubt(codes=("data-repeated",), about_data=_find_repeats))
