"""A speed that comes without word of how it was measured."""

from __future__ import annotations

from collections.abc import Sequence

from servobench.doubts.base import DOUBTS, Doubt
from servobench.finding import Finding, warning
from servobench.measurement.dataset import Dataset


def _of_each(records: Sequence[Dataset]) -> list[Finding]:
    return [finding for record in records for finding in _chain_unknown(record)]


def _chain_unknown(data: Dataset) -> list[Finding]:
    """Whether a speed comes without word of how it was measured."""
    found = []
    if data.kind == "speed" and not data.chain and not data.chain_known:
        found.append(
            warning(
                "chain-unknown",
                f"{data.name}: nobody says how this speed was measured. Counts that were differenced lag by half a sample "
                f"({500 * data.sample_time:.3g} ms), and a filter or an average before the recording adds its own lag to the "
                "delay and the time constant; say what it is with --chain, or record the position.",
                parameters=("time_constant", "delay"),
            )
        )
    return found


DOUBTS.member("chain_unknown")(Doubt(codes=("chain-unknown",), about_data=_of_each))
