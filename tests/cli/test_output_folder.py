"""The folders that commands make for themselves: no two commands get the same one."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import pytest

from servobench.cli.output_folder import empty_folder, make_folder
from servobench.core.errors import StorageError, UsageError

NOON = datetime(2024, 2, 29, 12, 0, 0)


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.promise("S54")
@pytest.mark.parametrize("prefix", ["honest", "lab", "pd"])
def test_two_commands_in_the_same_second_have_a_folder_each(prefix: str, tmp_path: Path) -> None:
    with empty_folder(None, prefix, NOON) as first, empty_folder(None, prefix, NOON) as second:
        assert [first.name, second.name] == [f"{prefix}-20240229-120000", f"{prefix}-20240229-120000-2"]
        (first / "page.html").touch()

    # The one in which nothing was written is gone.
    assert [each.name for each in tmp_path.iterdir()] == [first.name]


def test_a_folder_that_was_given_has_to_be_empty(tmp_path: Path) -> None:
    with empty_folder(tmp_path / "a" / "b", "lab", NOON) as folder:
        (folder / "page.html").touch()

    for taken in (tmp_path / "a" / "b", tmp_path / "a" / "b" / "page.html"):
        with (
            pytest.raises(UsageError, match="isn't an empty folder; give a new one"),
            empty_folder(taken, "lab", NOON),
        ):
            pass


def test_where_no_folder_can_be_made_it_is_a_storage_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with (
        pytest.raises(StorageError, match="can't be written"),
        empty_folder(tmp_path / "file" / "a", "lab", NOON),
    ):
        pass


def test_a_name_that_is_a_file_is_taken_too(tmp_path: Path) -> None:
    (tmp_path / "lab-20240229-120000").touch()

    assert make_folder("lab", NOON) == Path("lab-20240229-120000-2")
