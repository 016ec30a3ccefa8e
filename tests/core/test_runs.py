"""Runs of samples."""

import numpy as np
import pytest

from servobench.core.runs import runs


@pytest.mark.parametrize(
    ("which", "expected"),
    [
        ("", []),
        ("0000", []),
        ("1111", [(0, 4)]),
        ("0110", [(1, 3)]),
        ("1001", [(0, 1), (3, 4)]),
        ("10111010", [(0, 1), (2, 5), (6, 7)]),
    ],
)
def test_each_run_has_its_first_sample_and_the_one_behind_its_last(
    which: str, expected: list[tuple[int, int]]
) -> None:
    assert runs(np.array([each == "1" for each in which], dtype=bool)) == expected
