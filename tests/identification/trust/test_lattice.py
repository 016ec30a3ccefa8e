"""The step of values that only come in multiples of it."""

import numpy as np
import pytest

from servobench.identification.trust.doubts.lattice import lattice_step

COUNTS = np.unique(np.random.default_rng(3).integers(0, 400, 300))


@pytest.mark.parametrize("digits", [3, 4, 6, 12])
def test_the_step_is_found_although_few_digits_were_printed(digits: int) -> None:
    """0.054782 printed with three digits: over 400 steps the smallest one alone is off by many."""
    values = np.round(0.054782 * np.repeat(COUNTS, 3), digits)

    assert lattice_step(values) == pytest.approx(0.054782, rel=5e-3)


def test_values_between_any_steps_have_none() -> None:
    assert lattice_step(np.repeat(np.random.default_rng(1).random(300), 3)) is None
