"""Motors that differ from a data sheet in one thing, and questions about them, for the tests of causes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.rig.motor.parameters import data_sheet
from tests.datasets import dataset
from tests.rig.motor.reference import Truth

SHEET = data_sheet("qube_servo_2").motor
BEHIND = "derivative | lowpass 50 rad/s"


@cache
def identified(
    truth: Truth | None = None, kind: str = "square", chain: str = "", scale: float = 1.0
) -> Result:
    """Return the result for the paper's experiment, or a PRBS, on a finely stepped motor; all positions times a scale."""
    data = dataset(seed=1, truth=truth or Truth(), kind=kind, chain=chain)  # type: ignore[arg-type]
    return identify(scaled(data, scale))


def scaled(data: Dataset, factor: float) -> Dataset:
    """Return the data as an encoder of a wrong scale gives them."""
    return replace(data, y=factor * data.y, quantum=None if data.quantum is None else factor * data.quantum)


def undeclared(data: Dataset) -> Dataset:
    """Return the data without a word of the chain that they came through."""
    return replace(data, declared=Chain(), applied=Chain())
