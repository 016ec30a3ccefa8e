"""A value that jumps away and back is a spike; the tip of a reversal isn't one."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.identification.trust.doubts.spikes import spikes

TRIANGLE = np.abs((np.arange(1000) / 250 + 0.5) % 2 - 1)  # four sharp reversals
STEP = 1 / 250


@pytest.mark.parametrize("quantum", [0.0, STEP / 100])
def test_a_sharp_reversal_is_no_spike(quantum: float) -> None:
    assert spikes(TRIANGLE, quantum).tolist() == []


@pytest.mark.parametrize("size", [20 * STEP, -20 * STEP])
def test_a_value_off_a_straight_course_is_one(size: float) -> None:
    y = TRIANGLE.copy()
    y[300] += size

    assert spikes(y, STEP / 100).tolist() == [300]
