"""Counters that overflow and begin again at zero."""

import numpy as np
import pytest

from servobench.core.errors import FormatError
from servobench.recordings.formats.overflow import counter_of_overflow
from tests.recordings.formats.test_mapping import with_times


@pytest.mark.parametrize(
    ("before", "after", "step", "counter"),
    [
        (4294.96, 0.0002, 0.01, "32-bit counter of microseconds"),
        (65.53, 0.004, 0.01, "16-bit counter of milliseconds"),
        (0.0652, 0.0007, 0.001, "16-bit counter of microseconds"),
        (60.0, 0.004, 0.01, None),  # another run
        (65.53, 30.0, 0.01, None),
    ],
)
def test_a_counter_overflows_at_a_power_of_two(
    before: float, after: float, step: float, counter: str | None
) -> None:
    assert counter_of_overflow(before, after, step) == counter


def test_times_that_overflow_ask_for_the_sample_time() -> None:
    micros = (4294.0 + 0.01 * np.arange(200)) % (2**32 / 1e6)

    with pytest.raises(
        FormatError, match=r"32-bit counter of microseconds .* say `sample_time=0\.01` \(in s\)"
    ):
        with_times(micros)
