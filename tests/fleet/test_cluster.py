"""Workers of a Dask cluster make the rows that processes of this machine make, also where one of them is killed."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from servobench.core.errors import UsageError
from servobench.fleet.identification import Progress, identify_fleet
from servobench.fleet.pool import Cluster, Died
from tests.fleet.motors import SETTINGS, comparable, write_fleet
from tests.fleet.works import double

distributed: Any = pytest.importorskip("distributed")

pytestmark = pytest.mark.filterwarnings("default")  # Dask's own, about ports, files and time


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two workers, each a process with one thread."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as found:
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
        found = dict(Cluster(double, client.get_executor(pure=False), ahead=4).results(range(10, 18)))

    assert isinstance(found.pop(13), Died)
    assert found == {number: 2 * number for number in (10, 11, 12, 14, 15, 16, 17)}


def test_a_cluster_without_workers_is_reported(tmp_path: Path) -> None:
    write_fleet(tmp_path / "stand", 1)
    with (
        distributed.LocalCluster(n_workers=0, processes=True, dashboard_address=None) as empty,
        pytest.raises(UsageError, match="has no workers"),
    ):
        identify_fleet(
            tmp_path / "stand", tmp_path / "out", settings=SETTINGS, scheduler=empty.scheduler_address
        )
