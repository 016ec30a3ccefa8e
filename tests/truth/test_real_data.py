"""Recordings that other people made, against what they published about the same motors."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from servobench.core.finding import Verdict
from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.recordings.formats.base import load
from servobench.recordings.formats.mapping import assign
from servobench.recordings.measurement.measure import measure


def identified(path: Path, *, input: str | None = None, output: str) -> Result:
    recordings = [assign(recording, input=input, output=output) for recording in load(path)]
    return identify([measure(recording) for recording in recordings])


def codes(result: Result) -> set[str]:
    return {finding.code for finding in result.findings}


def test_the_und_motor_is_found_as_published_and_its_gain_is_called_local(
    real_data: Callable[[str], Path],
) -> None:
    result = identified(real_data("undcmotor/und_DCmotor_prbs_open_exp.csv"), output="y:deg/s")
    assert result.fit is not None
    assert math.degrees(result.fit["gain"].value) == pytest.approx(1748.9, rel=0.10)
    assert 0.42 < result.fit["time_constant"].value < 0.54
    assert {"offset-found", "gain-local", "counts-restored"} <= codes(result)
    # 2800 counts in a turn, as its authors say; the digits of the file leave a quantum open by a millionth at most.
    assert result.data[0].quantum == pytest.approx(2 * math.pi / 2800, rel=1e-6)
    assert result.verdict == Verdict.TRUSTED


@pytest.mark.parametrize("name", ["DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"])
def test_emps_is_found_as_published_with_the_friction_that_it_needs(
    name: str, real_data: Callable[[str], Path]
) -> None:
    result = identified(real_data(f"emps/{name}"), input="vir:V", output="qm:m")
    assert result.fit is not None
    assert result.fit["gain"].value == pytest.approx(0.1727, rel=0.15)
    assert result.fit["time_constant"].value == pytest.approx(0.467, rel=0.15)
    assert result.fit["gain"].unit == "m/(s·V)"
    assert "friction-found" in codes(result)
    # A residual that stays coloured for seconds: an interval of 0.1 % of the gain would be meaningless.
    assert result.fit["gain"].sd > 0.01 * result.fit["gain"].value


@pytest.mark.parametrize("side", ["left", "right"])
def test_romi_is_found_as_published_from_four_tests_jointly(
    side: str, real_data: Callable[[str], Path]
) -> None:
    path = real_data("romi_sysid/romi_sysid_data20221106-174834.json")
    result = identified(path, input=side, output=side)
    assert result.fit is not None
    assert len(result.fit.records) == 4
    assert result.fit["gain"].value / (2 * math.pi) == pytest.approx(0.431, rel=0.10)
