"""An input that never changes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.doubts.base import DOUBTS, Doubt
from servobench.finding import Finding, refusal
from servobench.measurement.dataset import Dataset


def _input_constant(records: Sequence[Dataset]) -> list[Finding]:
    """Whether the input ever changes: from one record to the next is enough."""
    levels = np.concatenate([np.append(record.u, record.input_before) for record in records])
    if np.ptp(levels) > 0:
        return []
    return [
        refusal(
            "input-constant",
            f"The input stays at {levels[0]:g} {records[0].input_unit} throughout, so nothing tells gain and friction apart; "
            "record steps between at least two levels.",
            parameters=("gain", "coulomb_voltage"),
        )
    ]


DOUBTS.member("input_constant")(Doubt(codes=("input-constant",), about_data=_input_constant))
