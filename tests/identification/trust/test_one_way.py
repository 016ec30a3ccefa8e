"""The one voltage that is lost by a motor that turned one way: found whichever way that was, and never a help."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.identification.estimators.base import ESTIMATORS
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.doubts.base import DOUBTS
from tests.datasets import dataset

T = 0.002 * np.arange(4000)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_friction_that_holds_the_shaft_brakes_it_whichever_way_it_turns(way: float) -> None:
    data = dataset(seed=1, samples=len(T), u=way * np.where(T % 2.0 < 1.0, 3.0, 0.0))
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way_rest"], [data])

    assert [each.code for each in DOUBTS["one_way"].about_fit(fit)] == [
        "friction-and-offset-together",
        "offset-found",
    ]
