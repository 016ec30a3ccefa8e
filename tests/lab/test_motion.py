"""A motion, and what is read off it, on one that is short enough to be worked out in the head."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.lab.motion import Motion

MOTION = Motion(
    t=np.array([0.0, 0.1, 0.2, 0.4, 0.5]),
    voltage=np.array([0.0, 2.0, 2.0, -1.0, 5.0]),
    angle=np.array([0.0, 0.0, 0.3, 0.9, 1.0]),
    count=0.1,
)


def test_each_voltage_holds_from_its_sample_on() -> None:
    """0 V for 0.1 s, 2 V for 0.1 s and 0.2 s, -1 V for 0.1 s; the last one begins where the record ends."""
    assert MOTION.area == pytest.approx(0.2 + 0.4 - 0.1, rel=1e-14)
    assert MOTION.starts == (0, 1, 3, 4)


def test_a_part_of_a_motion_keeps_its_times_and_angles() -> None:
    part = MOTION.between(0.1, 0.4)

    assert part.t.tolist() == [0.1, 0.2, 0.4]
    assert part.mean_speed == pytest.approx(0.9 / 0.3, rel=1e-14)
    assert part.count == MOTION.count
