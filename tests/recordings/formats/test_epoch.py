"""The unit of times that count from 1970."""

import numpy as np
import pytest

from servobench.recordings.formats.epoch import epoch_unit
from tests.recordings.formats.tables import finding, loaded

IN_2024 = 1709642096.1 + 0.01 * np.arange(50)


@pytest.mark.parametrize(("factor", "unit"), [(1, "s"), (1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_the_size_of_a_date_gives_its_unit(factor: float, unit: str) -> None:
    assert epoch_unit(np.floor(IN_2024 * factor)) == unit


@pytest.mark.parametrize(
    "values",
    [
        0.01 * np.arange(50),
        IN_2024 * 1e9 / 1000 / 60,  # 2.8e13: no unit makes it a date
        2e12 + 1e7 * np.arange(50),  # ns since the computer was started; ms would put the samples hours apart
        np.array([]),
    ],
)
def test_other_times_are_no_dates(values: np.ndarray) -> None:
    assert epoch_unit(values) is None


def test_a_time_in_nanoseconds_is_not_said_to_be_milliseconds(tmp_path) -> None:  # type: ignore[no-untyped-def]
    rows = "".join(f"{1709642096000000000 + 10000000 * k},1,{k}\n" for k in range(30))

    recording = loaded(tmp_path, "time,u,y\n" + rows)

    assert (
        "in ns the times would be dates: say `time=time:ns`"
        in finding(recording.findings, "time-recognised").sentence
    )
