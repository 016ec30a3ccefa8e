"""What speeds were is kept, and a thing that takes twice as long as at its last entry is said so."""

from pathlib import Path

import cost  # type: ignore[import-not-found]
import history  # type: ignore[import-not-found]
import pytest


def timing(ratio: float) -> history.Timing:
    return history.Timing(times=(ratio,) * 3, references=(1.0,) * 3)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A history whose last entry for a fit is a ratio of 4, after one of 9."""
    path = tmp_path / "history.csv"
    history.keep({"a fit": timing(9.0)}, path)
    history.keep({"a fit": timing(4.0)}, path)
    return path


@pytest.mark.parametrize(("ratio", "kept"), [(4.0, True), (7.9, True), (8.1, False)])
def test_twice_as_slow_as_the_last_entry_keeps_to_no_limit(ratio: float, kept: bool, file: Path) -> None:
    (figure,) = history.against_history({"a fit": timing(ratio)}, file)

    assert figure.is_kept is kept
    assert figure.value == pytest.approx(ratio / 4.0)


def test_what_has_no_entry_yet_is_compared_with_nothing(file: Path) -> None:
    assert history.against_history({"another": timing(1.0)}, file) == []


def test_the_ratio_is_formed_within_the_pairs() -> None:
    # A machine that is three times as slow in one pair is so for both of it.
    found = history.Timing(times=(2.0, 6.0, 2.0), references=(1.0, 3.0, 1.0))

    assert found.ratio == 2.0


def test_the_history_has_an_entry_of_all_that_is_timed() -> None:
    assert {task.what for task in cost.calls()} <= set(history.last_entries())


def test_no_fit_takes_twice_as_long_as_at_its_last_entry() -> None:
    """The ratio to the workload is formed within each pair, so that a busy machine slows both down."""
    timings = {task.what: history.timed(task.call, 9) for task in cost.calls()}

    slower = [
        f"{each.what}: {each.value:.2f}" for each in history.against_history(timings) if not each.is_kept
    ]

    assert not slower, f"{slower}; mend it, or append an entry by `python bench/cost.py --keep` and say why"
