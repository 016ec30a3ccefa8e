"""If a position doesn't determine the time constant, the finding names the speed in the same file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.finding import refusal
from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.identification.trust.other_output import with_other_output
from servobench.recordings.recording import Channel, Recording, Series, Source
from tests.datasets import dataset


def recording(output: str, **units: str) -> Recording:
    """A recording of channels by name with their units, all zero."""
    t = np.arange(3.0)
    series = tuple(
        Series(channel=Channel(name=name, unit=unit), values=np.zeros(3), t=t) for name, unit in units.items()
    )
    return Recording(name="run", series=series, source=Source(name="run.csv"), input="u", output=output)


@pytest.fixture(scope="module")
def refused() -> Result:
    untold = refusal("parameter-unknown", "The data don't tell it.", parameters=("time_constant",))
    return replace(identify(dataset(seed=0)), findings=(untold,))


CHANNELS = {
    "u": "V",
    "left_position": "rev",
    "gyro": "rad/s",
    "left_velocity": "rev/s",
    "right_velocity": "rev/s",
}


def test_the_speed_of_the_same_side_is_named(refused: Result) -> None:
    (told,) = with_other_output(refused, [recording("left_position", **CHANNELS)]).findings

    assert told.sentence.endswith("try `output=left_velocity`.")
    assert told.code == "parameter-unknown"


@pytest.mark.parametrize(
    "recordings",
    [
        [recording("left_velocity", **CHANNELS)],
        [recording("angle", u="V", angle="rad", speed="V")],
        [recording("left_position", **CHANNELS), recording("left_position", u="V", left_position="rev")],
        [recording("left_position", **CHANNELS), recording("gyro", **CHANNELS)],
    ],
    ids=["a speed already", "no speed", "not in all", "several outputs"],
)
def test_nothing_is_named_where_there_is_nothing_to_name(
    refused: Result, recordings: list[Recording]
) -> None:
    assert with_other_output(refused, recordings).findings == refused.findings


def test_a_result_that_tells_the_time_constant_is_left_alone(refused: Result) -> None:
    other = replace(refused, findings=())

    assert with_other_output(other, [recording("left_position", **CHANNELS)]) is other
