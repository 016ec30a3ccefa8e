"""The choice of the next test: the one with the most information about kA, by a second calculation."""

import math

import numpy as np
import pytest

from servobench.identification.design.assumed_motor import AssumedMotor
from servobench.identification.design.next_tests import best_next_tests
from servobench.identification.models.base import STRUCTURES

NAMES = ("gain", "time_constant", "coulomb_voltage", "offset_voltage", "delay")
COUNT = 2 * math.pi / 4096
DRIVE = AssumedMotor(
    name="drive", gain=9.2, time_constant=0.13, tolerance=0.0, quantum=COUNT, noise=COUNT / math.sqrt(12),
    coulomb_voltage=0.24, delay=0.005,
)  # fmt: skip
LITTLE = np.diag([0.3, 0.2, 0.1, 0.05, 0.05]) ** 2


def test_three_different_kinds_come_in_the_order_of_what_they_tell() -> None:
    found = best_next_tests(DRIVE, NAMES, LITTLE, 7.0, 0.02)

    assert len({each.sentence.partition(",")[0].partition(":")[0] for each in found}) == 3
    halves = [each.half for each in found]
    assert halves == sorted(halves)
    assert halves[-1] < 1.96 * math.hypot(0.2 / 0.13, 0.3 / 9.2)  # what is known now


def test_nothing_is_proposed_where_a_test_would_tell_nothing_new() -> None:
    assert best_next_tests(DRIVE, NAMES, 1e-12 * LITTLE, 7.0, 0.02) == ()


def test_no_test_goes_beyond_the_voltage_that_was_seen() -> None:
    for each in best_next_tests(DRIVE, NAMES, LITTLE, 3.0, 0.02):
        assert "3 V" in each.sentence


def test_a_parameter_that_nobody_knows_is_no_hindrance() -> None:
    unknown = LITTLE.copy()
    unknown[3, :] = unknown[:, 3] = np.nan
    unknown[0, 0] = np.inf

    assert len(best_next_tests(DRIVE, NAMES, unknown, 7.0, 0.02)) == 3


def test_the_half_is_that_of_the_posterior_of_a_linear_fit() -> None:
    """The same number by stacking the test's rows on the knowledge from before, as one least-squares problem."""
    found = next(
        e for e in best_next_tests(DRIVE, NAMES, LITTLE, 7.0, 0.02) if e.sentence.startswith("dynamic")
    )

    halves = []
    for length in (2.0, 5.0):
        count = round(length * 0.13 / 0.02) if length * 0.13 / 0.02 > 20 else 20
        u = np.repeat([7.0, -7.0], count)
        t = 0.02 * np.arange(len(u))
        structure = STRUCTURES["first_order_coulomb"]
        rows = structure.predict(DRIVE.theta(structure), DRIVE.dataset(t, u)).jacobian[:, :6] / DRIVE.noise
        before = np.column_stack([np.diag(1 / np.sqrt(np.diag(LITTLE))), np.zeros(5)])
        outset = np.column_stack([np.diag(1 / (10 * np.array([9.2, 0.13, 7.0, 7.0, 0.13]))), np.zeros(5)])
        order = [[p.name for p in structure.parameters].index(name) for name in NAMES] + [5]
        stacked = np.vstack([rows[:, order], before, outset])
        posterior = np.linalg.inv(stacked.T @ stacked)[:2, :2]
        slope = np.array([-1 / 9.2, 1 / 0.13])
        halves.append(1.959964 * math.sqrt(slope @ posterior @ slope))
    assert found.half == pytest.approx(min(halves), rel=1e-6)
