"""Files are taken once they are whole, by any clock."""

from pathlib import Path

import pytest

from servobench.fleet.name_pattern import NamePattern
from servobench.fleet.source import Folder, stamp_of
from servobench.fleet.watch import SETTLED, Arrivals


def names(arrivals: Arrivals, now: float) -> list[str]:
    return [item.name for item in arrivals.look(now)]


def test_a_file_is_taken_once_it_stays_as_it_is(tmp_path: Path) -> None:
    arrivals = Arrivals(Folder(tmp_path), None, {})
    (tmp_path / "a.csv").write_text("t", encoding="utf-8")
    assert names(arrivals, 0.0) == []
    (tmp_path / "a.csv").write_text("t,u\n", encoding="utf-8")  # still being written
    assert names(arrivals, SETTLED) == []
    assert names(arrivals, 1.9 * SETTLED) == []
    assert names(arrivals, 2 * SETTLED) == ["a.csv"]
    assert names(arrivals, 9.0) == []


def test_a_file_that_goes_on_is_taken_again(tmp_path: Path) -> None:
    arrivals = Arrivals(Folder(tmp_path), None, {})
    (tmp_path / "a.csv").write_text("t", encoding="utf-8")
    arrivals.look(0.0)
    assert names(arrivals, 1.0) == ["a.csv"]
    (tmp_path / "a.csv").write_text("t,u\n", encoding="utf-8")
    arrivals.look(2.0)
    assert names(arrivals, 3.0) == ["a.csv"]


@pytest.mark.parametrize("name", ["a.csv.part", ".a.csv", "a.csv.tmp", "empty.csv", "out/old.csv"])
def test_what_is_no_whole_recording_is_left(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("" if name == "empty.csv" else "t,u\n", encoding="utf-8")
    arrivals = Arrivals(Folder(tmp_path, without=tmp_path / "out"), None, {})
    arrivals.look(0.0)

    assert names(arrivals, 10.0) == []


def test_files_that_have_a_row_are_not_taken_again(tmp_path: Path) -> None:
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text("t,u\n", encoding="utf-8")
    arrivals = Arrivals(Folder(tmp_path), None, {"a.csv": stamp_of(tmp_path / "a.csv")})
    arrivals.look(0.0)

    assert names(arrivals, 1.0) == ["b.csv"]


def test_the_pattern_says_which_files_are_meant(tmp_path: Path) -> None:
    for name in ("1_x.csv", "other.csv"):
        (tmp_path / name).write_text("t,u\n", encoding="utf-8")
    arrivals = Arrivals(Folder(tmp_path), NamePattern("{serial}_{stand}.csv"), {})
    arrivals.look(0.0)

    assert names(arrivals, 1.0) == ["1_x.csv"]
