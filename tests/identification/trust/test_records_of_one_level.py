"""A test of one level among others, as SysId's dynamic ones: it can't tell its gain from its friction."""

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.trust.explanations.base import EXPLANATIONS, Case, explain
from servobench.identification.trust.explanations.equation import motion
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset
from tests.rig.motor.reference import Truth

T = 0.002 * np.arange(3000)


def ramp() -> Dataset:
    return dataset(seed=1, samples=len(T), u=np.minimum(T, 6.0))


@pytest.mark.parametrize("level", [2.0, 3.0])
@pytest.mark.parametrize("friction", [2.4e-3, 4e-3])  # N·m, three and five times the ramp's
def test_other_friction_in_a_step_is_not_taken_for_another_motor(level: float, friction: float) -> None:
    step = dataset(seed=2, samples=len(T), u=np.full(len(T), level), truth=Truth(coulomb_torque=friction))

    assert "records-disagree" not in [each.code for each in explain([ramp(), step])]


def test_a_step_with_half_of_its_voltage_is_still_reported() -> None:
    half = dataset(seed=2, samples=len(T), u=np.full(len(T), 3.0))
    labelled = dataset(seed=2, samples=len(T), u=np.full(len(T), 6.0), y=half.y)
    square = dataset(seed=1, samples=len(T))

    assert "records-disagree" in [each.code for each in explain([square, square, labelled])]


def of_one_level(level: float, acts_like: float) -> Dataset:
    step = dataset(seed=int(level), samples=len(T), u=np.full(len(T), acts_like))
    return replace(step, u=np.full(len(T), level), name=f"{level:g} V")


@pytest.mark.parametrize("first", range(4))
def test_where_each_has_one_level_the_one_that_stands_out_is_named_in_any_order(first: int) -> None:
    """With a gain for each nothing would tell the friction, and any of them could be the odd one."""
    steps = [of_one_level(2.0, 2.0), of_one_level(4.0, 4.0), of_one_level(8.0, 8.0), of_one_level(6.0, 4.2)]
    records = steps[first:] + steps[:first]
    (cause,) = explain(records)
    motions = [grid_motion for grid_motion in map(motion, records) if grid_motion is not None]

    assert cause.code == "level-disagrees"
    assert "recorded as 6 V" in cause.sentence
    assert len(motions) == len(records)
    assert EXPLANATIONS["records"](Case(tuple(motions))) is None


@pytest.mark.parametrize(("level", "may_bend"), [(2.0, True), (6.0, False), (8.0, True)])
def test_a_level_at_an_end_of_the_range_may_lie_on_a_bend(level: float, may_bend: bool) -> None:
    steps = [of_one_level(each, 0.7 * each if each == level else each) for each in (2.0, 4.0, 6.0, 8.0, 5.0)]
    motions = tuple(filter(None, map(motion, steps)))
    cause = EXPLANATIONS["level"](Case(motions))

    assert cause is not None
    assert f"recorded as {level:g} V" in cause.finding.sentence
    assert ("bends there" in cause.finding.sentence) is may_bend
