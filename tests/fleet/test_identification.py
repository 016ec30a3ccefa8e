"""Every recording has one row, whatever happens to the command meanwhile."""

import time
from multiprocessing import get_all_start_methods, get_context
from pathlib import Path

import numpy as np
import pytest

from servobench.core.errors import UsageError
from servobench.fleet.identification import Progress, identify_fleet
from servobench.fleet.parts import part_files
from servobench.fleet.settings import Settings
from servobench.recordings.native.lease import hold
from tests.fleet.killed import identify_row_by_row
from tests.fleet.motors import PATTERN, SETTINGS, comparable, write_fleet, write_motor

pytestmark = pytest.mark.usefixtures("quick_workers")


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight motors, a torn file and a text."""
    folder = tmp_path_factory.mktemp("stand")
    write_fleet(folder, 8)
    (folder / "line0" / "torn_2026-11-01.csv").write_text("voltage,speed\n1,2\n", encoding="utf-8")
    (folder / "notes.md").write_text("hello", encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def by_one(fleet: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results by one worker."""
    out = tmp_path_factory.mktemp("results") / "out"
    identify_fleet(fleet, out, pattern=PATTERN, settings=SETTINGS, workers=1)
    return out


def test_each_recording_has_a_row(fleet: Path, by_one: Path) -> None:
    rows = comparable(by_one)

    assert len(rows) == 9
    torn = rows["line0/torn_2026-11-01.csv"]
    assert torn["outcome"] == "unusable"
    assert "the times: say" in torn["reason"]
    good = rows["line0/0000_2026-11-01.csv"]
    assert (good["line"], good["serial"], good["date"]) == ("line0", "0000", "2026-11-01")
    true = float(np.random.default_rng(1).normal(20, 0.5))  # the first motor of write_fleet
    assert good["gain"] == pytest.approx(true, rel=1e-4)
    assert good["gain_low"] <= good["gain"] <= good["gain_high"]


def test_rows_don_t_depend_on_the_number_of_workers(fleet: Path, by_one: Path, tmp_path: Path) -> None:
    identify_fleet(fleet, tmp_path / "out", pattern=PATTERN, settings=SETTINGS, workers=3)

    assert comparable(tmp_path / "out") == comparable(by_one)


def test_what_is_done_is_left_and_what_changed_is_done_again(tmp_path: Path) -> None:
    stand, out = tmp_path / "stand", tmp_path / "out"
    names = write_fleet(stand, 3)
    steps: list[Progress] = []
    identify_fleet(stand, out, settings=SETTINGS, workers=1)
    first = comparable(out)
    write_motor(stand / names[1], 31.0)
    write_motor(stand / "new.csv", 32.0)
    again = identify_fleet(stand, out, settings=SETTINGS, workers=1, progress=steps.append)
    second = comparable(out)

    assert (again.identified, again.before) == (2, 2)
    assert [(step.done, step.due, step.before) for step in steps] == [(0, 2, 2), (1, 2, 2), (2, 2, 2)]
    assert {name: second[name] for name in (names[0], names[2])} == {
        name: first[name] for name in (names[0], names[2])
    }
    assert second[names[1]]["gain"] == pytest.approx(31.0, rel=1e-3)
    assert second["new.csv"]["gain"] == pytest.approx(32.0, rel=1e-3)


def test_files_without_a_result_are_tried_again_when_that_is_wanted(fleet: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    identify_fleet(fleet, out, pattern="line0/torn_{date}.csv", settings=SETTINGS, workers=1)
    plain = identify_fleet(fleet, out, pattern="line0/torn_{date}.csv", settings=SETTINGS, workers=1)
    retried = identify_fleet(
        fleet, out, pattern="line0/torn_{date}.csv", settings=SETTINGS, workers=1, retry=True
    )

    assert (plain.identified, retried.identified) == (0, 1)
    assert len(comparable(out)) == 1


def test_results_inside_the_source_are_no_recordings(tmp_path: Path) -> None:
    names = write_fleet(tmp_path, 2)
    out = tmp_path / "line0" / "out"
    for _ in range(2):
        summary = identify_fleet(tmp_path, out, settings=SETTINGS, workers=1)
    assert sorted(comparable(out)) == names
    assert summary.others == ()


@pytest.mark.parametrize("nested", [False, True])
def test_results_among_the_recordings_are_refused(nested: bool, tmp_path: Path) -> None:
    write_fleet(tmp_path / "stand", 1)
    out = tmp_path if nested else tmp_path / "stand"

    with pytest.raises(UsageError, match="give the results a folder of their own"):
        identify_fleet(tmp_path / "stand", out, settings=SETTINGS)


@pytest.mark.parametrize(
    ("files", "pattern", "because"),
    [
        ((), None, "holds no files"),
        (("notes.md",), None, "holds no recordings; files such as notes.md"),
        (
            ("a.csv",),
            "{serial}.tdms",
            "no file matches `pattern={serial}.tdms`; the first file there is a.csv",
        ),
    ],
)
def test_a_source_without_recordings_is_reported(
    files: tuple[str, ...], pattern: str | None, because: str, tmp_path: Path
) -> None:
    (tmp_path / "stand").mkdir()
    for name in files:
        (tmp_path / "stand" / name).touch()

    with pytest.raises(UsageError) as raised:
        identify_fleet(tmp_path / "stand", tmp_path / "out", pattern=pattern)
    assert because in str(raised.value)
    assert not (tmp_path / "out").exists()


def test_a_source_that_isn_t_there_is_reported(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="there is no such folder"):
        identify_fleet(tmp_path / "nowhere", tmp_path / "out")


@pytest.mark.parametrize(
    ("options", "because"),
    [
        ({"chain": "foo | bar"}, "no stage called 'foo'"),
        ({"mapping": "nowhere.toml"}, "nowhere.toml can't be read"),
        ({"inputs": "u:V"}, "no option called 'inputs'"),
    ],
)
def test_what_is_wrong_for_every_file_is_reported_before_the_first(
    options: dict[str, str], because: str, tmp_path: Path
) -> None:
    write_fleet(tmp_path / "stand", 1)

    with pytest.raises(UsageError, match=because):
        identify_fleet(tmp_path / "stand", tmp_path / "out", settings=Settings(options=options))
    assert not (tmp_path / "out").exists()


def test_several_stated_inputs_are_refused() -> None:
    with pytest.raises(UsageError, match="is given 2 times"):
        Settings(options={"input_value": ["1:V", "2:V"]})


def wait_for_the_worker(lock: Path) -> None:
    """Wait until a command's worker has ended, too: unlike one that is started it is a fork, and has the command's lock."""
    if lock.exists():
        with lock.open("ab") as file:
            until = time.monotonic() + 60
            while not hold(file):
                assert time.monotonic() < until
                time.sleep(0.005)


def begin_and_kill(folder: Path, moment: float) -> int:
    """Begin a command in a folder, kill it after a time [s], and return how many rows it has kept."""
    forks = get_context("forkserver" if "forkserver" in get_all_start_methods() else "spawn")
    process = forks.Process(target=identify_row_by_row, args=(folder / "stand", folder / "out"))
    process.start()
    process.join(moment)
    process.kill()
    process.join(60)
    assert process.exitcode is not None
    assert process.exitcode <= 0  # it came to its end, or was killed
    process.close()
    wait_for_the_worker(folder / "out" / ".lock")
    return len(comparable(folder / "out")) if part_files(folder / "out") else 0


@pytest.mark.parametrize(
    ("count", "kills"), [(12, 4), pytest.param(60, 100, marks=[pytest.mark.long])], ids=["few", "many"]
)
def test_a_command_that_is_killed_loses_no_row_and_makes_none_twice(
    count: int, kills: int, tmp_path: Path
) -> None:
    names = write_fleet(tmp_path / "stand", count)
    random = np.random.default_rng(20)
    kept = 0
    for moment in random.uniform(0.02, 0.5, kills):
        now = begin_and_kill(tmp_path, float(moment))
        assert now >= kept  # `comparable` has looked for a second row of any file
        kept = now
    identify_fleet(tmp_path / "stand", tmp_path / "out", settings=SETTINGS, workers=2)

    assert sorted(comparable(tmp_path / "out")) == names
