"""Workers that die cost what they died of, and nothing else."""

import itertools
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from servobench.fleet.pool import Died, Processes
from tests.fleet.works import double, double_once_killed, threads


def test_results_come_in_the_order_of_the_things_and_the_deadly_one_is_reported() -> None:
    with Processes(double, 2) as pool:
        found = dict(pool.results(range(30)))

    assert list(found) == list(range(30))
    died = found.pop(13)
    assert isinstance(died, Died)
    assert "ended, twice" in died.reason
    assert found == {number: 2 * number for number in range(30) if number != 13}


def test_a_process_that_somebody_killed_costs_nothing(tmp_path: Path) -> None:
    with Processes(partial(double_once_killed, tmp_path), 2) as pool:
        found = list(pool.results(range(20)))

    assert found == [(number, 2 * number) for number in range(20)]
    assert (tmp_path / "killed").exists()


def test_only_a_few_things_are_taken_ahead() -> None:
    taken = []

    def things() -> Iterator[int]:
        for number in itertools.count():
            taken.append(number)
            yield number

    with Processes(double, 1) as pool:
        results = pool.results(things())
        for _ in range(5):
            next(results)

    assert len(taken) <= 5 + 4


def test_each_process_has_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    with Processes(threads, 1) as pool:
        assert list(pool.results([0])) == [(0, "1")]
