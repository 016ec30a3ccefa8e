"""A shaft that sets off before its input changes is told by how much; noise, a push and a latch of a row are not that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.trust.doubts.base import DOUBTS
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import QUANTUM, dataset

STEP, ROWS, AT = 0.002, 1000, 200


def stepped(late: int, kind: str = "position", level: float = 3.0) -> Dataset:
    """A step at row 200, which the input shows so many rows late."""
    rows = np.arange(ROWS)
    true, told = (np.where(rows < row, 0.0, level) for row in (AT, AT + late))
    record = replace(dataset(seed=1, samples=ROWS, sample_time=STEP, u=true), u=told)
    if kind == "position":
        return record
    speed = 70.0 * (1.0 - np.exp(-np.clip(rows - AT, 0, None) * STEP / 0.1))
    noisy = speed + 0.3 * np.random.default_rng(2).standard_normal(ROWS)
    return replace(record, y=noisy, kind="speed", output_unit="rad/s", quantum=None)


def said(record: Dataset) -> list[str]:
    return [each.sentence for each in DOUBTS["moves_early"].about_data([record])]


@pytest.mark.parametrize("kind", ["position", "speed"])
@pytest.mark.parametrize("late", [20, 100])
@pytest.mark.parametrize("level", [3.0, -3.0])
def test_an_input_that_comes_late_is_told(kind: str, late: int, level: float) -> None:
    record = stepped(late, kind, level)
    if kind == "speed" and level < 0:
        record = replace(record, y=-record.y)

    [sentence] = said(record)

    # The first counts, and the first speeds beyond the noise, come some milliseconds after the voltage.
    early = float(sentence.split(" s, ")[1].split("\u00a0")[0].split(" ")[0])
    in_ms = early if "ms before" in sentence else 1000 * early
    assert 1000 * STEP * late - 16 <= in_ms <= 1000 * STEP * late
    assert f"changes, at {STEP * (AT + late):g} s" in sentence


@pytest.mark.parametrize("kind", ["position", "speed"])
@pytest.mark.parametrize("late", [0, 1, -20])
def test_columns_in_step_and_delays_are_not(kind: str, late: int) -> None:
    assert said(stepped(late, kind)) == []


def test_a_shaft_that_is_touched_or_creeps_before_the_step_is_not() -> None:
    record = stepped(0)
    touched = record.y + np.where((np.arange(ROWS) > 50) & (np.arange(ROWS) < 60), 40 * QUANTUM, 0.0)
    creeping = record.y + np.floor(np.clip(np.arange(ROWS) - 50, 0, AT) * 0.1) * QUANTUM

    assert said(replace(record, y=touched)) == []
    assert said(replace(record, y=creeping)) == []


def test_a_motor_that_runs_already_is_not() -> None:
    rows = np.arange(ROWS)
    running = np.where(rows < AT, 1.0, 3.0)

    assert said(replace(stepped(0), u=running, y=dataset(seed=1, samples=ROWS, u=running).y)) == []


def test_an_input_that_is_logged_more_rarely_comes_within_its_own_step() -> None:
    """Every fiftieth input, in each of which the step may have come."""
    record = stepped(0)
    rows = np.arange(ROWS)
    rare = np.where((rows[::50] > AT), 3.0, 0.0)

    assert said(replace(record, t_input=STEP * rows[::50], u=rare)) == []


def test_a_controller_answers_to_what_moves_the_shaft() -> None:
    record = stepped(20)

    assert said(record)
    assert said(replace(record, reference=np.zeros(ROWS), reference_unit="rad")) == []


def test_a_reading_that_flickers_once_long_before_the_start_is_no_start() -> None:
    """One count and a half up at row 50, and there it stays until the motor is driven."""
    record = stepped(0)
    flickered = record.y + np.where(np.arange(ROWS) >= 50, 1.5 * QUANTUM, 0.0)

    assert said(replace(record, y=flickered)) == []
    (sentence,) = said(replace(stepped(40), y=flickered))
    assert float(sentence.split("sets off at ")[1].split(" s")[0].split("\u00a0")[0]) >= STEP * AT
