"""`servobench chains`: the devices whose chains are known."""

from __future__ import annotations

from servobench.recordings.measurement.presets import PRESETS
from tests.cli.conftest import Command


def test_all_devices_are_listed_with_chain_lag_and_source(servobench: Command) -> None:
    said = servobench("chains").out

    for preset in PRESETS.values():
        assert f"{preset.name}  {preset.device[:20]}" in said
        assert preset.chain in said
    assert said.count("source: ") == sum(len(preset.sources) for preset in PRESETS.values())


def test_one_device_is_reported_alone_and_an_unknown_one_is_an_error(servobench: Command) -> None:
    said = servobench("chains", "odrive").out
    wrong = servobench("chains", "odriv")

    assert said.startswith("odrive  ")
    assert "talon" not in said
    assert wrong.status == 2
    assert "did you mean 'odrive'" in wrong.err
