"""A shaft that goes back without an input, and one that only runs on the way that its last pulse turned it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.trust.doubts.base import about_fit
from tests.contracts.finding_examples.base import fitted, sprung
from tests.datasets import dataset
from tests.rig.motor.reference import Truth


def codes(data: object) -> set[str]:
    return {finding.code for finding in about_fit(fitted(data, "first_order"))}  # type: ignore[arg-type]


@pytest.mark.parametrize("late", [0, 2])
def test_a_pulse_one_way_and_one_the_other_way_leave_no_spring(late: int) -> None:
    """The second pulse turns the shaft round, which runs on that way when the voltage ends, or some samples later."""
    u = np.concatenate([np.repeat([0.0, 8.0, -8.0], [40, 5, 5])] * 4 + [np.zeros(60)])
    acting = np.append(np.zeros(late), u[: len(u) - late])
    data = dataset(seed=1, samples=len(u), sample_time=0.01, u=acting, truth=Truth(coulomb_torque=2e-3))

    assert "shaft-runs-back" not in codes(replace(data, u=u))


def test_a_spring_is_seen_where_its_record_ends_on_the_way_back() -> None:
    data = sprung(0.5)

    assert "shaft-runs-back" in codes(data)
    assert "shaft-runs-back" in codes(data.part(0.0, 1.1))
