"""Columns with the time from one row to the next."""

from pathlib import Path

import numpy as np
import pytest

from servobench.core.channels import Channel
from servobench.core.errors import MissingInformation, UsageError
from servobench.recordings.formats.mapping import assign
from servobench.recordings.formats.time_steps import is_named_step, step_unit
from servobench.recordings.recording import Recording, Series
from tests.recordings.formats.tables import codes, loaded

JITTER = np.random.default_rng(2).normal(0, 0.02, 200)
STEPS = 0.01 * (1 + JITTER)


def column(values: np.ndarray, name: str = "dt", unit: str | None = None) -> Series:
    return Series(channel=Channel(name=name, unit=unit), values=values, t=None)


def log(folder: Path, header: str = "dt", factor: float = 1.0) -> Recording:
    rows = (f"{factor * step:.7g},{k % 7},{3 * k}\n" for k, step in enumerate(STEPS))
    return loaded(folder, f"{header},u [V],angle [deg]\n" + "".join(rows))


@pytest.mark.parametrize(("factor", "unit"), [(1, "s"), (1e3, "ms"), (1e6, "us")])
def test_steps_without_a_unit_are_in_the_one_that_suits_a_motor(factor: float, unit: str) -> None:
    assert step_unit(column(factor * STEPS)) == unit


@pytest.mark.parametrize(
    "values",
    [
        np.cumsum(STEPS),
        np.repeat(4.0 + np.cumsum(STEPS), 2),
        -STEPS,
        np.full(200, 0.01),
        1.7e9 + 0.01 * np.random.default_rng(3).permutation(200),  # dates, out of order
        np.random.default_rng(4).permutation(0.01 * np.arange(200.0)),
    ],
    ids=["times", "times of rows written twice", "negative", "constant", "dates", "shuffled times"],
)
def test_what_grows_or_varies_is_no_column_of_steps(values: np.ndarray) -> None:
    assert step_unit(column(values, unit="s")) is None


def test_an_ambiguous_name_needs_a_unit_of_time() -> None:
    assert is_named_step(column(STEPS, "period", "us"))
    assert not is_named_step(column(STEPS, "period"))
    assert not is_named_step(column(STEPS, "dt", "V"))


@pytest.mark.parametrize(("header", "factor"), [("dt", 1.0), ("timestep [us]", 1e6), ("period_ms", 1e3)])
def test_the_mean_of_the_steps_is_proposed_as_the_sample_time(
    header: str, factor: float, tmp_path: Path
) -> None:
    with pytest.raises(
        MissingInformation, match=r"looks like the time from one row .* say `sample_time=0\.009998` \(in s\)"
    ):
        assign(log(tmp_path, header, factor))


def test_steps_named_as_the_time_are_not_to_be_sorted(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="add a column with the running sum"):
        assign(log(tmp_path), time="dt:s")


@pytest.mark.parametrize(("header", "factor"), [("dt", 1.0), ("dt", 1e3), ("dt_us", 1e6)])
def test_a_sample_time_is_compared_with_the_steps(header: str, factor: float, tmp_path: Path) -> None:
    recording = log(tmp_path, header, factor)

    assert "sample-time-contradicts" in codes(assign(recording, sample_time=0.02).findings)
    assert "sample-time-contradicts" not in codes(assign(recording, sample_time=0.01).findings)
