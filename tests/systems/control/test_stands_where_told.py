"""A shaft that stands where its loop was told to bring it isn't a sensor at the end of its range."""

from dataclasses import replace

import numpy as np
import pytest

import servobench as sb
from servobench.core.channels import Channel
from servobench.identification.trust.doubts.base import DOUBTS
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.measure import measure
from servobench.recordings.recording import Series
from servobench.rig.experiment import Experiment
from servobench.systems.control.pid import Pid
from servobench.systems.signals.square import Square


@pytest.fixture(scope="module")
def followed() -> Dataset:
    asked = Experiment(
        signal=Square(low=-1, high=1, frequency=0.5),
        duration=8,
        controller=Pid(kp=5, ki=40, kd=0.18, b=0, cutoff=200),
    )
    with sb.connect("twin") as motor:
        recording = sb.run(asked, motor)
    t = recording["applied"].t
    assert t is not None
    wished = Series(
        channel=Channel(name="reference", unit="rad"),
        values=asked.signal(np.arange(len(t)) * asked.sample_time),
        t=t,
    )
    others = tuple(series for series in recording.series if series.channel.name != "reference")
    return measure(replace(recording, series=(*others, wished), reference="reference"))


def codes(data: Dataset) -> set[str]:
    about = DOUBTS["flats"].about_data
    assert about is not None
    return {finding.code for finding in about([data])}


def test_a_shaft_that_stands_at_its_reference_is_no_clipped_sensor(followed: Dataset) -> None:
    assert "output-clipped" not in codes(followed)


def test_a_sensor_that_ends_before_the_reference_is_reported_in_a_loop_too(followed: Dataset) -> None:
    """±0.5 rad of ±1: half of the way is missing, which no friction holds a shaft from."""
    assert "output-clipped" in codes(replace(followed, y=np.clip(followed.y, -0.5, 0.5)))


def test_a_shaft_that_creeps_to_where_friction_holds_it_is_no_clipped_sensor() -> None:
    """A weak integral has it creep for most of the record: what is fast beside that is a tenth of full speed."""
    asked = Experiment(
        signal=Square(low=-1, high=1, frequency=0.49),
        controller=Pid(output="position", kp=1, ki=1, kd=0.03, cutoff=100),
    )
    with sb.connect("twin") as motor:
        data = measure(sb.run(asked, motor))

    assert "output-clipped" not in codes(data)
