"""When an output first responds: the delay is no longer than that, so what only flickers has not moved."""

import numpy as np
import pytest

from servobench.recordings.measurement.first_motion import first_motion
from tests.datasets import QUANTUM, dataset

T = 0.002 * np.arange(1000)
U = np.where(T < 0.5, 0.0, 3.0)


@pytest.mark.parametrize(("counts", "moves"), [(5, False), (200, True)])
def test_a_shaft_that_creeps_by_a_few_counts_has_not_begun_to_move(counts: int, moves: bool) -> None:
    y = QUANTUM * np.floor(counts * np.clip(T - 0.6, 0.0, 0.1) / 0.1)

    found = first_motion(dataset(seed=1, samples=len(T), u=U, y=y))

    assert (found is not None) == moves
    if found is not None:
        assert found.cause == pytest.approx(0.5)
        # Three counts are clear of the rounding; at 200 counts in 0.1 s that is within two samples of the begin.
        assert 0.6 <= found.effect <= 0.6 + 3 * 0.002
