"""The chains of known devices: what their names stand for, and that they lag by what their sources say."""

from __future__ import annotations

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest

from servobench.core.channels import Channel
from servobench.core.errors import UnknownName, UsageError
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.lag import lag_of
from servobench.recordings.measurement.measure import measure
from servobench.recordings.measurement.presets import PRESETS
from servobench.recordings.recording import Recording, Series, Source

TOOL = Path(__file__).resolve().parents[3] / "tools" / "write_chains.py"
NAMES = pytest.mark.parametrize("name", PRESETS)


@NAMES
def test_a_device_stands_for_its_stages_and_its_speed_comes_out(name: str) -> None:
    chain = Chain.parse(name)

    assert chain == Chain.parse(PRESETS[name].chain)
    assert chain.linear == chain
    assert chain.yields(chain.takes or "speed") == "speed"


@NAMES
def test_a_device_lags_by_what_its_sources_say(name: str) -> None:
    """The lag is stated; that of the chain is measured on a ramp of the speed, which every chain follows late by its lag."""
    preset = PRESETS[name]
    chain = Chain.parse(name)
    t = np.linspace(0.0, 2.0, 200_001)
    ramp = 0.5 * t**2 if chain.takes == "position" else t

    late = float(t[-1] - chain(ramp, t)[-1])

    # The low-pass of two time constants has settled to e^-40; the difference of the samples, 10 µs apart, adds half of that.
    assert late == pytest.approx(preset.lag, abs=2e-5)
    assert lag_of(chain, 0.1) == pytest.approx(preset.lag, rel=0.02, abs=5e-4)


@NAMES
def test_a_device_has_a_source_and_says_what_is_uncertain(name: str) -> None:
    preset = PRESETS[name]

    assert preset.name == name
    assert preset.sources
    assert preset.uncertain.endswith(".")


def test_a_device_is_a_part_of_a_longer_chain() -> None:
    assert str(Chain.parse("talon-srx | delay 20 ms")) == "tachometer 0.1 s | average 0.063 s | delay 0.02 s"


def test_a_device_takes_no_settings_and_its_stages_are_named_instead() -> None:
    with pytest.raises(UsageError, match=r"`talon-srx 20 ms`.*tachometer 100 ms \| average 63 ms"):
        Chain.parse("talon-srx 20 ms")


def test_a_device_that_is_not_known_is_told_the_nearest() -> None:
    with pytest.raises(UnknownName, match="did you mean 'talon-srx'"):
        Chain.parse("talon-srz")


def test_none_is_a_chain_without_stages_and_stands_alone() -> None:
    assert Chain.parse("none") == Chain()
    with pytest.raises(UsageError, match="use it alone"):
        Chain.parse("none | lowpass 5 Hz")


def test_the_page_of_chains_is_what_the_data_say() -> None:
    spec = spec_from_file_location("write_chains", TOOL)
    assert spec is not None
    assert spec.loader is not None
    tool = module_from_spec(spec)
    spec.loader.exec_module(tool)

    assert tool.PAGE.read_text(encoding="utf-8") == tool.page(), "run make generate"


@pytest.mark.parametrize(
    ("chain", "known"), [("", False), ("none", True), ("odrive", True), ("lowpass 50 rad/s", True)]
)
def test_a_dataset_says_whether_anybody_said_what_its_chain_is(chain: str, known: bool) -> None:
    t = 0.01 * np.arange(20)
    series = tuple(
        Series(channel=Channel(name=name, unit=unit), values=np.sin(t), t=t)
        for name, unit in (("u", "V"), ("w", "rad/s"))
    )
    recording = Recording(
        name="speed", series=series, source=Source(name="made"), input="u", output="w", chain=chain
    )

    data = measure(recording)

    assert data.chain_known is known
    assert data.part(0.05, 0.15).chain_known is known
    assert bool(data.chain) is (known and chain != "none")
