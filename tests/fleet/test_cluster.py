"""Workers of a Dask cluster make the rows that processes of this machine make, also where one of them is killed."""

import os
import signal
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from servobench.core.errors import UsageError
from servobench.fleet.identification import Progress, identify_fleet
from servobench.fleet.pool import Cluster, Died
from tests.fleet.motors import SETTINGS, comparable, write_fleet
from tests.fleet.works import double

distributed: Any = pytest.importorskip("distributed")
dask: Any = pytest.importorskip("dask")

pytestmark = pytest.mark.filterwarnings("default")  # Dask's own, about ports, files and time


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two workers, each a process with one thread.

    A local cluster gives up the place of a worker that isn't there a while after its death, which on a busy computer may be the
    moment of another death: then both places were gone, and the rest waited for ever.
    """
    with (
        dask.config.set({"distributed.deploy.lost-worker-timeout": "1 hour"}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as found,
    ):
        yield found


def test_a_killed_worker_changes_no_row(cluster: Any, tmp_path: Path) -> None:
    names = write_fleet(tmp_path / "stand", 12)
    identify_fleet(tmp_path / "stand", tmp_path / "here", settings=SETTINGS, workers=2)
    killed = []

    def kill_one(now: Progress) -> None:
        if now.done == 4:
            killed.append(cluster.workers[0].pid)
            os.kill(killed[0], signal.SIGKILL)

    identify_fleet(
        tmp_path / "stand", tmp_path / "there", settings=SETTINGS, scheduler=cluster.scheduler_address, progress=kill_one
    )  # fmt: skip

    assert killed
    assert sorted(comparable(tmp_path / "there")) == names
    assert comparable(tmp_path / "there") == comparable(tmp_path / "here")


def test_what_kills_worker_after_worker_is_one_row(cluster: Any) -> None:
    with distributed.Client(cluster.scheduler_address, set_as_default=False) as client:
        found = dict(Cluster(double, partial(client.submit, pure=False), ahead=4).results(range(10, 18)))

    assert isinstance(found.pop(13), Died)
    assert found == {number: 2 * number for number in (10, 11, 12, 14, 15, 16, 17)}


def test_what_was_beside_one_that_kills_workers_is_tried_again() -> None:
    """A client without processes, whose workers die the first time that they get an odd number, and each time for 13."""
    deaths: list[int] = []

    class KilledWorker(Exception):
        pass

    def submit(work: Callable[[int], int], number: int) -> Any:
        def result() -> int:
            if number == 13 or (number % 2 and number not in deaths):
                deaths.append(number)
                raise KilledWorker
            return work(number)

        return SimpleNamespace(result=result)

    results = dict(Cluster(double, submit, ahead=3).results(range(10, 18)))

    assert isinstance(results.pop(13), Died)
    assert results == {number: 2 * number for number in (10, 11, 12, 14, 15, 16, 17)}
    assert deaths == [11, 13, 13, 15, 17]


def test_a_cluster_without_workers_is_reported(tmp_path: Path) -> None:
    write_fleet(tmp_path / "stand", 1)
    with (
        distributed.LocalCluster(n_workers=0, processes=True, dashboard_address=None) as empty,
        pytest.raises(UsageError, match="has no workers"),
    ):
        identify_fleet(
            tmp_path / "stand", tmp_path / "out", settings=SETTINGS, scheduler=empty.scheduler_address
        )
