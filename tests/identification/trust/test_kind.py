"""A position that was said to be a speed is told, and the other way round."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.core.finding import Verdict
from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.identification.trust.doubts import kind
from servobench.identification.trust.doubts.kind import _goes_on_at_every_level, _is_proportional
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset


def told(result: Result) -> list[str]:
    return [each.sentence for each in result.findings if each.code == "kind-mistaken"]


def as_speed(data: Dataset) -> Dataset:
    return replace(data, kind="speed", output_unit="rad/s", quantum=None)


@pytest.mark.parametrize("kind", ["square", "prbs"])
def test_a_position_that_is_said_to_be_a_speed_is_reported_with_the_unit_to_give(
    kind: Literal["square", "prbs"],
) -> None:
    result = identify(as_speed(dataset(seed=1, samples=2000, kind=kind)))

    (sentence,) = told(result)
    assert "behaves like a position" in sentence
    assert "`output=COL:rad`" in sentence
    assert result.verdict is Verdict.REFUSED
    assert not {"nothing-known", "input-unrelated"} & {each.code for each in result.findings}


def test_a_speed_that_is_said_to_be_a_position_is_reported() -> None:
    position = dataset(seed=1, samples=2000)
    speed = np.gradient(position.y, position.t_output)
    result = identify(replace(position, y=np.convolve(speed, np.full(9, 1 / 9), "same"), quantum=None))

    (sentence,) = told(result)
    assert "behaves like a speed" in sentence


def test_a_record_of_the_kind_that_it_is_said_to_be_is_left_alone() -> None:
    position = dataset(seed=1, samples=2000)

    assert not told(identify(position))


@pytest.mark.parametrize("cut", [20, 40])
def test_a_speed_wrongly_said_to_start_at_rest_is_not_called_a_position(cut: int) -> None:
    """Held to zero at a start where it was 60 or 86 rad/s, a motor explained less of it than the integral of a motor did."""
    t = 0.005 * np.arange(200 - cut)
    speed = 100.0 * -np.expm1(-(t + 0.005 * cut) / 0.1)
    speed += 0.1 * np.random.default_rng(5).standard_normal(len(t))
    record = as_speed(dataset(seed=1, sample_time=0.005, samples=len(t), u=np.full(len(t), 5.0)))
    result = identify(replace(record, y=speed, starts_at_rest=True))

    assert not told(result)
    assert "not-at-rest" in {each.code for each in result.findings}


def test_what_no_guess_comes_near_is_not_searched_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Under one level gain and friction aren't known apart, so the kind is in question; a search for a speed would take long."""
    from servobench.identification.trust.doubts import kind

    def search(*_: object) -> None:
        raise AssertionError("it searched")

    monkeypatch.setattr(kind, "lowest", search)
    one_level = dataset(seed=1, samples=1000, u=np.full(1000, 3.0))

    result = identify(one_level)

    assert result.answers["gain"].state.value != "known"
    assert not told(result)


def test_a_speed_that_has_settled_is_no_position_although_no_motor_of_one_time_constant_rises_so() -> None:
    """Two time constants, 12 and 60 ms: the position of a motor that is slowed down explained more of it than a speed."""
    t = 0.0011 * np.arange(171)
    speed = 1450.0 * (1.0 - 0.7 * np.exp(-(t + 0.0022) / 0.012) - 0.3 * np.exp(-(t + 0.0022) / 0.06))
    speed += 5.0 * np.random.default_rng(5).standard_normal(len(t))
    record = as_speed(dataset(seed=1, sample_time=0.0011, samples=len(t), u=np.full(len(t), 10.0)))

    result = identify(replace(record, y=speed, input_before=10.0))

    assert not told(result)
    assert result.verdict is not Verdict.REFUSED


@pytest.mark.parametrize(
    "inputs", [[-5.0] * 40 + [0.0] * 5 + [5.0] * 80, [0.0] * 20 + [2.5] * 50 + [5.0] * 60 + [0.0]]
)
def test_a_speed_that_only_grows_is_still_no_position(inputs: list[float]) -> None:
    """A reversal, and a last row in which the logger has stopped the motor: the speed doesn't fall in either."""
    u = np.array(inputs)
    speed = np.zeros(len(u))
    speed[0] = 20.0 * u[0]
    for n in range(1, len(u)):
        speed[n] = speed[n - 1] + (20.0 * u[n - 1] - speed[n - 1]) * (1 - np.exp(-0.02 / 0.3))
    result = identify(
        {"u": u, "position": np.round(speed)}, input="u:V", output="position:counts", sample_time=0.02
    )

    assert told(result)


def _of_speed(u: NDArray[np.float64], speed: NDArray[np.float64]) -> Dataset:
    noise = 0.2 * np.random.default_rng(3).standard_normal(len(u))
    record = as_speed(dataset(seed=1, sample_time=0.01, samples=len(u), u=u))
    return replace(record, y=speed + noise)


def test_a_speed_that_bends_while_its_input_climbs_is_no_position() -> None:
    """A ramp to 70 %, of which the speed makes less and less: a position would grow faster and faster."""
    u = np.linspace(0.0, 70.0, 700)
    assert not told(identify(_of_speed(u, np.where(u < 3.0, 0.0, 50.0 * (1.0 - ((70.0 - u) / 67.0) ** 2)))))


def test_a_speed_that_creeps_on_after_its_step_is_no_position() -> None:
    """Two thirds of the way within 40 ms, the rest in a second, as beside a bearing that warms up; from rest."""
    t = 0.01 * np.arange(100)
    speed = 60.0 * -np.expm1(-t / 0.02) + 30.0 * t
    record = replace(_of_speed(np.full(100, 60.0), speed), input_before=0.0, starts_at_rest=True)

    assert not told(identify(record))


def test_a_position_that_turns_when_its_record_begins_may_slow_down() -> None:
    """2 V and then 3 V of a motor that has 60 rad/s at first, far more than either makes of it."""
    t = 0.01 * np.arange(300)
    u = np.where(t < 1.5, 2.0, 3.0)
    speed = np.where(t < 1.5, 6.0 + 54.0 * np.exp(-t / 0.3), 9.0 - 3.0 * np.exp(-(t - 1.5) / 0.3))
    record = as_speed(dataset(seed=1, sample_time=0.01, samples=300, u=u))

    assert told(identify(replace(record, y=np.cumsum(speed) * 0.01)))


def _sagging() -> Dataset:
    """A speed that grows to its end while the input, which is large all the time, falls by a third."""
    t = 0.02 * np.arange(150)
    speed = 300.0 - 100.0 * np.exp(-t / 0.4) + np.random.default_rng(1).standard_normal(len(t))
    like = dataset(seed=1, samples=len(t), sample_time=0.02, u=196.0 - 24.0 * t, y=speed)
    return replace(like, kind="speed", output_unit="rad/s", quantum=None)


def test_nothing_that_stays_under_a_large_input_or_is_in_rpm_is_called_a_position() -> None:
    stays = _sagging()
    position = as_speed(dataset(seed=1, samples=2000))

    assert told(identify(stays)) == []
    for unit in ("rpm", "1/min", "U/min"):
        assert told(identify(replace(position, recorded_unit=unit))) == []
    assert told(identify(replace(position, recorded_unit="rad/s")))
    assert told(identify(position))


def test_three_rows_of_a_period_are_neither_kind() -> None:
    """A servo's setpoints, which come again after three rows, and its angle: it settles in between, for all that they show."""
    setpoint = np.resize([-68.3, -77.7, -61.2], 120)
    angle = 0.7 * setpoint + 0.3 * np.roll(setpoint, 1)
    joint = replace(
        dataset(seed=1, samples=120, sample_time=0.2, u=setpoint, y=np.radians(angle)), input_unit="1"
    )
    result = identify(replace(joint, quantum=None))

    assert told(result) == []
    assert "period-short" in {finding.code for finding in result.findings}
    assert result.verdict is not Verdict.TRUSTED


def test_a_position_goes_on_at_every_level_and_a_speed_settles() -> None:
    """A staircase of a motor whose supply gives way: its way bends as a slow speed does, but it goes on under each level."""
    speeds = np.repeat([0.0, 2000.0, 3600.0, 4800.0, 5400.0, 5700.0, 5900.0, 6000.0], 25)
    u = np.repeat(np.arange(8.0) * 1.5, 25)
    log = dataset(seed=1, samples=200, sample_time=0.2, u=u, y=np.floor(np.cumsum(0.2 * speeds)))
    settling = replace(log, y=np.repeat(speeds[::25], 25) - 900.0 * np.tile(np.exp(-np.arange(25) / 4.0), 8))

    assert _goes_on_at_every_level(log)
    assert not _goes_on_at_every_level(settling)


def test_a_position_that_a_limited_proportional_controller_brings_to_its_goal_is_none_of_a_speed() -> None:
    """Its input falls in proportion, wherever it isn't at its limit: a speed that follows its input would look alike."""
    t = 0.01 * np.arange(100)
    angle = 6.0 + np.exp(-3.0 * t) * np.cos(25.0 * t)  # rad
    loop = dataset(seed=1, samples=100, sample_time=0.01, u=np.clip(20.0 * (6.0 - angle), -8.0, 8.0), y=angle)

    assert np.count_nonzero(np.abs(loop.u) == 8.0) > 10
    assert _is_proportional(loop)
    assert _is_proportional(replace(loop, u=np.clip(loop.u, -6.0, 8.0)))
    noise = np.random.default_rng(1).normal(scale=1e-3, size=100)
    assert _is_proportional(replace(loop, u=loop.u + np.where(np.abs(loop.u) == 8.0, noise, 0.0)))
    assert not _is_proportional(replace(loop, u=np.where(t % 0.2 < 0.1, 8.0, 0.0)))
    assert not _is_proportional(dataset(seed=1, kind="prbs"))


def test_where_the_input_is_a_line_in_the_output_no_other_kind_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mistaken = as_speed(dataset(seed=1))
    assert told(identify(mistaken))
    monkeypatch.setattr(kind, "_is_proportional", lambda _: True)

    assert told(identify(mistaken)) == []
