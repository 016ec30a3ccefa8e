"""Sensors that give a voltage or a bare number."""

import numpy as np
import pytest

from servobench.core.channels import Channel
from servobench.core.errors import UsageError
from servobench.recordings.formats.mapping import assign
from servobench.recordings.formats.sensitivity import sensitivity
from servobench.recordings.recording import Recording, Series, Source

T = 0.01 * np.arange(5)


def log(unit: str | None) -> Recording:
    voltage = Series(channel=Channel(name="u", unit="V"), values=T, t=T)
    tacho = Series(channel=Channel(name="tacho", unit=unit), values=100 * T, t=T)
    return Recording(
        name="log.csv",
        series=(voltage, tacho),
        source=Source(name="log.csv", sha256="ab", format="csv"),
        input="u",
    )


@pytest.mark.parametrize(
    ("text", "number", "unit", "per"),
    [
        ("142.9 rpm/V", 142.9, "rpm", "V"),
        ("7 V/krpm", 1000 / 7, "rpm", "V"),
        ("0.02 V/rpm", 50.0, "rpm", "V"),
        ("34 deg/V", 34.0, "deg", "V"),
        ("0.5 V/(rad/s)", 2.0, "rad/s", "V"),
        ("2 rad/s/V", 2.0, "rad/s", "V"),
        ("3 mV/rpm", 1 / 3, "rpm", "mV"),
    ],
)
def test_a_sensitivity_is_read_either_way_up(text: str, number: float, unit: str, per: str) -> None:
    read = sensitivity(text)

    assert read is not None
    assert (read.number, read.unit, read.per) == (pytest.approx(number), unit, per)


@pytest.mark.parametrize(
    "text", [None, "", "V", "rpm", "0 rpm/V", "5 V/A", "3 rad/deg", "1..2 rpm/V", "PWM/255", "rpm/V"]
)
def test_anything_else_is_none(text: str | None) -> None:
    assert sensitivity(text) is None


@pytest.mark.parametrize(("unit", "factor"), [(None, 100.0), ("V", 100.0), ("mV", 0.1)])
def test_the_output_is_what_the_sensor_stands_for(unit: str | None, factor: float) -> None:
    recording = assign(log(unit), output="tacho:100 rpm/V")

    assert recording["tacho"].values == pytest.approx(factor * 100 * T)
    assert recording["tacho"].channel.unit == "rpm"
    assert "output-scaled" in [each.code for each in recording.findings]


def test_a_sensitivity_for_something_else_is_refused() -> None:
    with pytest.raises(UsageError, match=r"`tacho` is in A, and `100 rpm/V` is for something in V"):
        assign(log("A"), output="tacho:100 rpm/V")


def test_an_output_in_volts_is_refused_with_the_way_out() -> None:
    with pytest.raises(UsageError, match=r'sensitivity, such as `output="tacho:142\.9 rpm/V"`'):
        assign(log("V"), output="tacho")
