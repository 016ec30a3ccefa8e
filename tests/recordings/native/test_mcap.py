import numpy as np
import pytest

from servobench.recordings.native import mcap
from servobench.recordings.native.mcap import Damaged

ROWS = np.arange(6.0).reshape(3, 2)


def messages(first: int = 0) -> np.ndarray:
    return mcap.messages(1, first, np.zeros(3, np.uint64), ROWS)


def test_running_numbers_wrap_after_four_bytes() -> None:
    first = 2**32 - 2

    rows = messages(first)

    assert rows["sequence"].tolist() == [2**32 - 2, 2**32 - 1, 0]
    assert np.array_equal(mcap.read_messages(rows.tobytes(), 1, first, 2), ROWS)


@pytest.mark.parametrize("field", ["op", "length", "channel", "sequence", "cdr"])
def test_what_is_no_sample_is_damage_even_with_a_right_checksum(field: str) -> None:
    rows = messages()
    rows[field][1] += 1

    with pytest.raises(Damaged):
        mcap.read_messages(rows.tobytes(), 1, 0, 2)


@pytest.mark.parametrize("data", [b"", b"\x05", messages().tobytes()[:-1]])
def test_parts_of_samples_are_damage(data: bytes) -> None:
    with pytest.raises(Damaged):
        mcap.read_messages(data, 1, 0, 2)


def test_log_times_stay_in_the_range_of_other_readers() -> None:
    t = np.array([0.0, 1e-9, -1.0, 1e300, np.inf, -np.inf, np.nan])

    # 2**63 is where a signed number of eight bytes ends.
    assert mcap.log_time(t, 0.0).tolist() == [0, 1, 0, 2**63 - 1024, 2**63 - 1024, 0, 0]
