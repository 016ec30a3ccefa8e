import errno
import os
from dataclasses import replace
from pathlib import Path

import pytest

from servobench.core.errors import StorageError
from servobench.identification.result import Result
from servobench.report.document import Report


def test_a_report_is_written_whole_and_replaces_an_earlier_one(good: Result, tmp_path: Path) -> None:
    target = tmp_path / "report.html"
    target.write_text("an earlier one", encoding="utf-8")
    report = Report(None, good)

    report.write(target)

    assert target.read_text(encoding="utf-8") == report.html()
    assert list(tmp_path.iterdir()) == [target]


def test_a_full_disk_leaves_the_earlier_report_and_no_part_of_the_new_one(
    refused: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "report.html"
    target.write_text("an earlier one", encoding="utf-8")

    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StorageError, match=r"report\.html can't be written: No space left on device"):
        Report(None, refused).write(target)

    assert target.read_text(encoding="utf-8") == "an earlier one"
    assert list(tmp_path.iterdir()) == [target]


def test_a_missing_folder_is_reported_before_anything_is_drawn(good: Result, tmp_path: Path) -> None:
    with pytest.raises(StorageError, match=r"there is no folder .*missing; make it first"):
        Report(None, good).write(tmp_path / "missing" / "report.html")


def test_a_folder_in_place_of_a_file_is_reported_with_a_better_name(good: Result, tmp_path: Path) -> None:
    with pytest.raises(StorageError, match=r"is a folder; .* such as .*report\.html"):
        Report(None, good).write(tmp_path)


def test_a_report_can_be_read_by_those_who_may_read_other_new_files(refused: Result, tmp_path: Path) -> None:
    (tmp_path / "other").write_text("", encoding="utf-8")

    Report(None, refused).write(tmp_path / "report.html")

    assert (tmp_path / "report.html").stat().st_mode == (tmp_path / "other").stat().st_mode


def test_the_same_report_gives_the_same_page(several: Result) -> None:
    assert Report(None, several).html() == Report(None, several).html()


def test_a_result_without_data_still_has_a_page(refused: Result) -> None:
    assert "Refused" in Report((), replace(refused, data=())).html()
