"""What speaks against a rung of the ladder."""

from __future__ import annotations

import pytest

from servobench.identification.choice.structure_ladder.trial import friction_drives
from tests.contracts.finding_examples.base import fitted, with_values
from tests.datasets import dataset


@pytest.mark.parametrize(
    ("forward", "backward", "drives"), [(0.2, 0.2, False), (-3.0, 3.5, False), (-3.0, -0.5, True)]
)
def test_friction_that_would_drive_the_motor_is_none(forward: float, backward: float, drives: bool) -> None:
    """An offset makes the one larger by what the other is smaller, so that it is the sum which has a sign."""
    fit = fitted(dataset(seed=3, kind="prbs", hold=20, samples=2000), "first_order_asymmetric")

    changed = with_values(fit, coulomb_voltage_forward=forward, coulomb_voltage_backward=backward)

    assert friction_drives(changed) == drives
