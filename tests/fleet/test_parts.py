"""Parts are whole or absent, and the folder is one command's at a time."""

from pathlib import Path
from typing import Any

import pytest

from servobench.core.errors import FormatError, StorageError, UsageError
from servobench.fleet import parts
from servobench.fleet.parts import Results, part_files, rows_in

SETTINGS = {"source": "/stand", "structure": "auto"}


def row(name: str, **more: Any) -> dict[str, Any]:
    return {"file": name, "outcome": "identified", "reason": "", "stamp": "1-1", **more}


def test_rows_come_back_as_they_were(tmp_path: Path) -> None:
    rows = [row("a", gain=1.5, gain_unit="s", findings=["x", "y"], samples=3), row("ä/b", serial="007")]
    with Results(tmp_path / "out", SETTINGS) as results:
        for each in rows:
            results.add(each)

    assert list(rows_in(tmp_path / "out")) == rows


def test_a_part_is_written_when_the_first_row_has_waited(tmp_path: Path) -> None:
    clock = iter([10.0, 12.0, 15.0])
    with Results(tmp_path / "out", SETTINGS, now=lambda: next(clock)) as results:
        counts = []
        for name in "abc":
            results.add(row(name))
            counts.append(len(part_files(tmp_path / "out")))

    assert counts == [0, 0, 1]  # the first has waited for 0, 2 and 5 s


@pytest.mark.parametrize("most", [2, 500], ids=["a part is full", "a part isn't full"])
def test_ctrl_c_just_after_a_part_was_written_makes_no_row_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    monkeypatch.setattr(parts, "_MOST_ROWS", most)
    write, interrupted = parts._write, iter([True])

    def write_and_stop(path: Path, rows: list[Any]) -> None:
        write(path, rows)
        if next(interrupted, False):
            raise KeyboardInterrupt

    monkeypatch.setattr(parts, "_write", write_and_stop)

    def identify_two() -> None:
        with Results(tmp_path / "out", SETTINGS) as results:
            for name in "ab":
                results.add(row(name))
            results.flush()

    with pytest.raises(KeyboardInterrupt):
        identify_two()

    assert [each["file"] for each in rows_in(tmp_path / "out")] == ["a", "b"]


def test_small_parts_are_filled_before_another_is_begun(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parts, "_MOST_ROWS", 3)
    with Results(tmp_path / "out", SETTINGS) as results:
        for name in "abcde":
            results.replace(row(name), has_one=False)
        results.replace(row("b", gain=2.0), has_one=True)

    assert [each["file"] for each in rows_in(tmp_path / "out")] == ["a", "c", "d", "e", "b"]
    assert [path.name for path in part_files(tmp_path / "out")] == [
        "part-000001.parquet",
        "part-000002.parquet",
    ]


def test_rows_are_removed_from_their_parts_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "_MOST_ROWS", 2)
    with Results(tmp_path / "out", SETTINGS) as results:
        for name in "abcde":
            results.add(row(name))
        results.flush()
        results.remove({"a", "b", "c"})

    assert [each["file"] for each in rows_in(tmp_path / "out")] == ["d", "e"]
    assert [path.name for path in part_files(tmp_path / "out")] == [
        "part-000002.parquet",
        "part-000003.parquet",
    ]


def test_what_was_left_unfinished_is_no_part_and_goes(tmp_path: Path) -> None:
    with Results(tmp_path / "out", SETTINGS) as results:
        results.add(row("a"))
    (tmp_path / "new").mkdir()
    (tmp_path / "new" / "settings.json.unfinished").write_text("{", encoding="utf-8")
    torn = tmp_path / "out" / "parts" / "part-000002.parquet.unfinished"
    torn.write_bytes(b"PAR1")

    assert [each["file"] for each in rows_in(tmp_path / "out")] == ["a"]
    with Results(tmp_path / "out", SETTINGS):
        assert not torn.exists()
    with Results(tmp_path / "new", SETTINGS):
        pass


def test_a_part_that_can_t_be_written_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = Results(tmp_path / "out", SETTINGS)
    results.__enter__()
    results.add(row("a"))

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(parts.os, "fsync", full)
    with pytest.raises(StorageError, match="No space left"):
        results.__exit__()
    assert list((tmp_path / "out" / "parts").iterdir()) == []


def test_other_settings_are_refused_and_named(tmp_path: Path) -> None:
    with Results(tmp_path / "out", SETTINGS) as results:
        results.add(row("a"))
    with pytest.raises(UsageError, match="structure was auto and is now first_order"):
        Results(tmp_path / "out", {**SETTINGS, "structure": "first_order"}).__enter__()
    with Results(tmp_path / "out", SETTINGS) as results:
        assert results.stamps() == {"a": "1-1"}


def test_settings_that_gave_no_result_at_all_are_put_right(tmp_path: Path) -> None:
    with Results(tmp_path / "out", SETTINGS) as results:
        results.add(row("a", outcome="unusable"))
    right = {**SETTINGS, "structure": "first_order"}
    with Results(tmp_path / "out", right) as results:
        assert results.stamps() == {}
    with Results(tmp_path / "out", right) as results:
        results.add(row("a"))
    with pytest.raises(UsageError, match="holds results of other settings"):
        Results(tmp_path / "out", SETTINGS).__enter__()


def test_a_place_that_can_t_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").touch()

    with pytest.raises(StorageError, match="can't be written"):
        Results(tmp_path / "file" / "out", SETTINGS).__enter__()


def test_two_commands_don_t_write_into_one_folder(tmp_path: Path) -> None:
    with (
        Results(tmp_path / "out", SETTINGS),
        pytest.raises(UsageError, match="another command is writing there"),
    ):
        Results(tmp_path / "out", SETTINGS).__enter__()


def test_a_folder_with_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").touch()

    with pytest.raises(UsageError, match="holds something other than"):
        Results(tmp_path, SETTINGS).__enter__()
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(UsageError, match="is a file"):
        Results(tmp_path / "thesis.tex", SETTINGS).__enter__()


def test_a_damaged_part_is_named(tmp_path: Path) -> None:
    with Results(tmp_path / "out", SETTINGS) as results:
        results.add(row("a"))
    (part,) = part_files(tmp_path / "out")
    part.write_bytes(part.read_bytes()[:-9])

    with pytest.raises(FormatError, match=r"part-000001.parquet is damaged: .*Delete it"):
        list(rows_in(tmp_path / "out"))
