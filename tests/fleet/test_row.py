"""A row's contents for a result."""

import numpy as np
import pytest

from servobench.fleet.row import result_row
from servobench.fleet.source import Item
from servobench.identification.identify import identify
from tests.datasets import dataset


def test_a_speed_that_holds_at_one_level_has_the_level_beside_it() -> None:
    data = dataset(seed=1, samples=400, u=np.where(np.arange(400) < 50, 0.0, 6.0))

    row = result_row(Item("step.csv", "1-1"), {}, identify(data))

    assert row["speed_at_level_state"] == "known"
    assert row["speed_at_level_input"] == pytest.approx(6.0)
    assert row["speed_at_level_input_unit"] == "V"
