"""The recordings of a source, on this machine and behind fsspec."""

import io
import zipfile
from pathlib import Path

import pytest

from servobench.core.errors import UsageError
from servobench.fleet.identification import identify_fleet
from servobench.fleet.name_pattern import NamePattern
from servobench.fleet.source import Item, list_items, source_at
from tests.fleet.motors import SETTINGS, comparable, write_fleet

fsspec = pytest.importorskip("fsspec")


@pytest.fixture
def memory() -> str:
    """An object store in this process with two recordings and a text."""
    store = fsspec.filesystem("memory")
    for name in ("a/1.csv", "b/2.csv", "b/notes.md", "b/.hidden.csv"):
        store.pipe(f"/stand/{name}", name.encode())
    return "memory://stand"


def test_a_store_is_listed_and_fetched(memory: str) -> None:
    source = source_at(memory)
    found = list_items(source, None)

    assert [item.name for item in found.items] == ["a/1.csv", "b/2.csv"]
    assert found.others == ("b/notes.md",)
    with source.local(found.items[1]) as path:
        assert (path.name, path.read_bytes()) == ("2.csv", b"b/2.csv")
    assert not path.exists()


def test_a_file_of_a_store_that_changes_has_another_stamp(memory: str) -> None:
    source = source_at(memory)
    before = list_items(source, None).items[0]
    fsspec.filesystem("memory").pipe("/stand/a/1.csv", b"more than before")

    assert list_items(source, None).items[0].stamp != before.stamp


def test_rows_from_an_archive_are_those_from_its_folder(tmp_path: Path) -> None:
    """An archive is a store that worker processes can open, as they can one on a network."""
    names = sorted([*write_fleet(tmp_path / "stand", 2), "torn.csv"])
    (tmp_path / "stand" / "torn.csv").touch()
    archive = tmp_path / "stand.zip"
    with zipfile.ZipFile(archive, "w") as file:
        for name in names:
            file.write(tmp_path / "stand" / name, name)
    for place, out in ((tmp_path / "stand", "folder"), (f"zip://::file://{archive}", "archive")):
        identify_fleet(place, tmp_path / out, settings=SETTINGS, workers=1)
    rows = [comparable(tmp_path / out) for out in ("folder", "archive")]
    for each in (row for found in rows for row in found.values()):
        del each["stamp"]

    assert rows[0] == rows[1]
    assert rows[1]["torn.csv"]["reason"] == "torn.csv is empty"
    assert sorted(rows[1]) == names


@pytest.mark.parametrize(
    ("address", "because"),
    [
        ("nosuch://bucket", "nosuch://bucket can't be opened"),
        ("zip://::file:///nowhere.zip", "can't be opened"),
        ("memory://empty-bucket", "holds no files"),
    ],
)
def test_an_address_that_leads_nowhere_is_reported(address: str, because: str) -> None:
    with pytest.raises(UsageError, match=because):
        list_items(source_at(address), None)


def test_a_file_that_is_gone_is_reported(memory: str) -> None:
    with (
        pytest.raises(UsageError, match=r"3\.csv can't be fetched from memory://stand"),
        source_at(memory).local(Item("a/3.csv", "")),
    ):
        raise AssertionError


def test_hidden_files_and_folders_are_left_alone(tmp_path: Path) -> None:
    for name in ("a.csv", ".b.csv", ".git/c.csv", "out/d.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(io.BytesIO(b"t,u\n").read())

    found = list_items(source_at(tmp_path, without=tmp_path / "out"), None)
    assert [item.name for item in found.items] == ["a.csv"]


def test_a_name_of_strange_bytes_is_read(tmp_path: Path) -> None:
    try:
        (tmp_path / "m\udcff.csv").write_text("x", encoding="utf-8")
    except (OSError, UnicodeError):
        pytest.skip("this file system has no such names")
    source = source_at(tmp_path)
    (item,) = list_items(source, NamePattern("{serial}.csv")).items

    assert item.text == r"m\xff.csv"
    with source.local(item) as path:
        assert path.read_text(encoding="utf-8") == "x"


def test_results_of_a_fleet_among_the_recordings_are_no_recordings(tmp_path: Path) -> None:
    """Neither this one's nor an earlier one's: their tables end as recordings do."""
    stand = tmp_path / "stand"
    names = write_fleet(stand, 2)
    identify_fleet(str(stand), stand / "results", settings=SETTINGS, workers=1)

    assert [item.name for item in list_items(source_at(str(stand)), None).items] == sorted(names)
    with pytest.raises(UsageError, match="is no folder; expected the one with the recordings"):
        list_items(source_at(str(stand / names[0])), None)
