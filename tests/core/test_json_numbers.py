"""Values that JSON can't hold become null in it, at any depth."""

import math

from servobench.core.json_numbers import finite


def test_numbers_that_are_not_finite_become_null_at_any_depth() -> None:
    told = {
        "interval": [-math.inf, 1.0],
        "inner": {"x": math.nan, "pair": (1, math.inf)},
        "white": True,
        "word": "inf",
    }

    assert finite(told) == {
        "interval": [None, 1.0],
        "inner": {"x": None, "pair": [1, None]},
        "white": True,
        "word": "inf",
    }
