"""What is said of a recording before it is measured."""

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.channels import Channel
from servobench.core.finding import Finding
from servobench.recordings.evidence import with_chain
from servobench.recordings.recording import Recording, Series, Source

T = 0.01 * np.arange(200)


def recording(*outputs: str) -> Recording:
    """A recording with speeds of those names, the first of which is the output."""
    speeds = [Series(channel=Channel(name=name, unit="rpm"), values=T, t=T) for name in outputs]
    return Recording(
        name="log.csv",
        series=(Series(channel=Channel(name="u", unit="V"), values=T, t=T), *speeds),
        source=Source(name="log.csv", sha256="ab", format="csv"),
        input="u",
        output=outputs[0],
    )


def about_filters(log: Recording, chain: str = "") -> list[Finding]:
    return [each for each in with_chain(log, chain).recording.findings if each.code == "output-filtered"]


@pytest.mark.parametrize("name", ["rpm_filt", "rpmFiltered", "avg_speed", "vel-ema"])
def test_a_filter_in_the_name_of_the_output_is_doubted(name: str) -> None:
    (doubt,) = about_filters(recording(name))

    assert f"the output `{name}` says that it was filtered, but nothing says how" in doubt.sentence
    assert doubt.severity == "warning"


def test_the_same_before_the_filter_is_named() -> None:
    (doubt,) = about_filters(recording("rpm_filt", "rpm"))

    assert "or use `rpm`" in doubt.sentence


@pytest.mark.parametrize("chain", ["none", "lowpass 50 rad/s"])
def test_a_filter_that_is_described_is_not_doubted(chain: str) -> None:
    assert about_filters(recording("rpm_filt"), chain) == []
    assert about_filters(replace(recording("rpm_filt"), chain=chain)) == []


@pytest.mark.parametrize("name", ["rpm", "meander", "avgas", "filter_coefficients_rpm"])
def test_another_name_is_not_doubted(name: str) -> None:
    assert about_filters(recording(name)) == []
