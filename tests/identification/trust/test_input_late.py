"""An input that changed before the row that shows it, as of a log that keeps every n-th row of its controller."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.core.finding import Finding
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.doubts.base import DOUBTS
from servobench.identification.trust.doubts.input_late import _around_changes, _differs_at_changes
from servobench.recordings.measurement.base import Kind
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset
from tests.rig.motor.odd_motor import OddMotor, marched

ROWS = 20000  # of a controller, 2 ms apart
EVERY = 100  # of them one is kept, 0.2 s: twice the time constant


def sparse_log(late: int, sense: float = 1.0, chain: str = "") -> Dataset:
    """Every hundredth row of a motor under ±3 V, whose input changes some rows before one that is kept.

    `sense` -1 turns the wires.
    """
    random = np.random.default_rng(3)
    lengths = EVERY * random.integers(2, 5, ROWS // EVERY)
    lengths[0] -= late
    return _every_nth(lengths, random, sense=sense, chain=chain)


def log_of_a_free_input(every: int = EVERY, kind: Kind = "position") -> Dataset:
    """Rows of a motor under ±3 V, whose input changes in any row of its controller: a different time before one that is kept."""
    random = np.random.default_rng(3)
    lengths = random.integers(2 * EVERY, 5 * EVERY, ROWS // (2 * EVERY))
    return _every_nth(lengths, random, every=every, kind=kind)


def _every_nth(
    lengths: NDArray[np.int64],
    random: np.random.Generator,
    *,
    sense: float = 1.0,
    chain: str = "",
    every: int = EVERY,
    kind: Kind = "position",
) -> Dataset:
    u = np.repeat(random.choice([-3.0, 3.0], len(lengths)), lengths)[:ROWS]
    data = dataset(seed=1, samples=ROWS, u=u, chain=chain)
    if kind == "speed":
        speed = np.gradient(data.y, data.sample_time)
        data = replace(data, y=speed, kind="speed", output_unit="rad/s", quantum=None)
    kept = slice(None, None, every)
    t, y = data.t_output[kept], data.y[kept]
    return replace(data, t_input=t, u=sense * data.u[kept], t_output=t, y=y, rows=None)


def fit_with_usual_delay(late: int, sense: float = 1.0) -> Fit:
    """The fit of such a log, and what it leaves over with a delay that is none, as is usual."""
    data = sparse_log(late, sense)
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [data])
    theta = np.where([name == "delay" for name in fit.model.names], 0.0, fit.model.theta)
    record = fit.records[0]
    prediction = fit.model.structure.predict(np.append(theta, record.nuisance), data).y
    held = replace(record, prediction=prediction, residual=data.y - prediction)
    return replace(fit, model=replace(fit.model, theta=theta), records=(held,))


def doubts(fit: Fit) -> list[Finding]:
    return list(DOUBTS["input_late"].about_fit(fit))


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_an_input_that_changed_half_a_row_earlier_is_shown_late(sense: float) -> None:
    (doubt,) = doubts(fit_with_usual_delay(50, sense))
    assert doubt.code == "input-late"
    assert "before the row that shows them" in doubt.sentence
    assert f"{with_unit(0.2, 's', 2)} apart" in doubt.sentence


def test_one_that_changes_in_its_own_rows_is_not() -> None:
    assert doubts(fit_with_usual_delay(0)) == []


def best_fit(data: Dataset) -> Fit:
    return ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [data])


@pytest.mark.parametrize("kind", ["position", "speed"])
def test_an_input_that_changes_in_any_row_of_the_controller_is_shown_late_by_its_best_fit(kind: Kind) -> None:
    """No delay fits all changes: what the best one leaves lies around them."""
    (doubt,) = doubts(best_fit(log_of_a_free_input(kind=kind)))
    assert doubt.code == "input-late"
    assert "no two changes of the input after the same time" in doubt.sentence
    assert f"{with_unit(0.2, 's', 2)} apart" in doubt.sentence


@pytest.mark.parametrize("late", [0, 50])
def test_one_that_changes_as_long_before_each_row_has_a_fit_that_leaves_nothing_of_that_kind(
    late: int,
) -> None:
    assert doubts(best_fit(sparse_log(late))) == []


def test_between_rows_of_the_output_the_input_may_be_known() -> None:
    """An output that is renewed in every other row of the file: what it leaves around changes is no fault of the input's rows."""
    data = log_of_a_free_input()
    fit = best_fit(data)
    between = np.sort(np.concatenate([data.t_input, data.t_input + 0.4 * data.sample_time]))
    finer = replace(data, t_input=between, u=np.repeat(data.u, 2))
    records = tuple(replace(each, data=finer) for each in fit.records)

    assert doubts(replace(fit, records=records)) == []


def test_rows_that_are_near_for_the_motor_are_not_doubted() -> None:
    """10 rows of the controller are 20 ms, a fifth of the time constant: what is left around changes moves no result."""
    fit = best_fit(log_of_a_free_input(every=10, kind="speed"))
    around = _around_changes(fit.records[0])

    assert around is not None
    assert _differs_at_changes(around)
    assert doubts(fit) == []


def test_a_speed_shows_it_as_well_as_a_position() -> None:
    fit = fit_with_usual_delay(50)
    record, step = fit.records[0], fit.records[0].data.sample_time
    speed = np.gradient(record.residual, step)
    data = replace(record.data, kind="speed", output_unit="rad/s", quantum=None)
    assert [
        each.code for each in doubts(replace(fit, records=(replace(record, data=data, residual=speed),)))
    ] == ["input-late"]


def test_of_a_loop_whose_input_answers_to_the_output_nothing_is_said() -> None:
    fit = fit_with_usual_delay(50)
    in_a_loop = tuple(
        replace(
            record, data=replace(record.data, reference=np.zeros(len(record.data.u)), reference_unit="rad")
        )
        for record in fit.records
    )
    assert in_a_loop[0].data.closed_loop
    assert doubts(replace(fit, records=in_a_loop)) == []


def test_what_follows_a_change_against_its_direction_is_not_ahead_of_it() -> None:
    """A controller that nobody named makes the input from the output: what is left of that turns against the input."""
    fit = fit_with_usual_delay(50)
    against = tuple(replace(record, residual=-record.residual) for record in fit.records)
    assert doubts(replace(fit, records=against)) == []


@pytest.mark.parametrize("bits", [0, 8])
def test_an_input_that_changes_gradually_has_no_times_of_change(bits: int) -> None:
    """A sine, exact or in the steps of a PWM: it changes most where the shaft turns back, and there the model misses most."""
    t = 0.01 * np.arange(1500)
    u = 3.0 * np.sin(2 * np.pi * 0.4 * t)
    u = np.round(u / 6.0 * 2**bits) * 6.0 / 2**bits if bits else u
    truth = OddMotor(stribeck=0.2, stribeck_speed=2.0, gaussian=1.0)
    data = dataset(seed=1, u=u, samples=len(u), sample_time=0.01, y=marched(truth, u, 0.01)[:, 0])
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [data])

    assert _around_changes(fit.records[0]) is None
