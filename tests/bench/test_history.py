"""Speeds are kept, and a bench that takes twice as long as before is reported."""

from functools import partial
from pathlib import Path

import cost  # type: ignore[import-not-found]
import history  # type: ignore[import-not-found]
import pytest
import speed  # type: ignore[import-not-found]


def timing(ratio: float) -> history.Timing:
    return history.Timing(times=(ratio,) * 3, references=(1.0,) * 3)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A history of a fit whose last five entries have a median of 4; one of them met a load, and what came before was slower."""
    path = tmp_path / "history.csv"
    for ratio in (90.0, 90.0, 90.0, 3.9, 4.0, 30.0, 4.1, 3.8):
        history.keep({"a fit": timing(ratio)}, path)
    return path


@pytest.mark.parametrize(("ratio", "kept"), [(4.0, True), (7.9, True), (8.1, False)])
def test_twice_as_slow_as_the_median_of_the_last_entries_keeps_to_no_limit(
    ratio: float, kept: bool, file: Path
) -> None:
    (figure,) = history.against_history({"a fit": timing(ratio)}, file)

    assert figure.is_kept is kept
    assert figure.value == pytest.approx(ratio / 4.0)


@pytest.mark.parametrize(("found", "slower"), [([9.0, 9.0], True), ([9.0, 4.0], False), ([4.0], False)])
def test_what_is_twice_as_slow_by_two_measurements_is_slower(
    found: list[float], slower: bool, file: Path
) -> None:
    measurements = iter(found)

    figures = history.slower_twice({"a fit": lambda: timing(next(measurements))}, file)

    assert bool(figures) is slower
    assert next(measurements, None) is None


def test_a_doubled_time_is_found_in_a_measurement() -> None:
    """With the workload itself as what is timed: twice of it takes 2 times, which is more than 1.9."""
    once, twice = (history.timed(call, 15) for call in (history.workload, work_twice))

    assert 0.5 < once.ratio < 1.5
    assert twice.ratio > 1.5 * once.ratio


def work_twice() -> None:
    history.workload()
    history.workload()


def test_what_has_no_entry_yet_is_compared_with_nothing(file: Path) -> None:
    assert history.against_history({"another": timing(1.0)}, file) == []


def test_the_ratio_is_formed_within_the_pairs() -> None:
    # A machine that is three times as slow in one pair is so for both of it.
    found = history.Timing(times=(2.0, 6.0, 2.0), references=(1.0, 3.0, 1.0))

    assert found.ratio == 2.0


def test_the_history_has_an_entry_of_all_that_is_timed() -> None:
    assert {task.what for task in cost.calls()} | set(speed.KEPT) <= set(history.past_ratios())


def test_no_fit_takes_twice_as_long_as_it_did() -> None:
    """The ratio to the workload is formed within each pair, so that a busy machine slows both down."""
    slower = history.slower_twice({task.what: partial(history.timed, task.call, 9) for task in cost.calls()})

    assert not slower, f"{slower}; mend it, or append an entry by `python bench/cost.py --keep` and say why"


def test_no_run_takes_twice_as_long_as_it_did(tmp_path: Path) -> None:
    """Beside the same motor in C."""
    slower = history.slower_twice(speed.measurements(tmp_path))

    assert not slower, f"{slower}; mend it, or append an entry by `python bench/speed.py --write` and say why"
