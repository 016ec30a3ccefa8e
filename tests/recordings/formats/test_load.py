"""The verbs `load` and `save`."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

import pytest

from servobench.core.errors import FormatError, StorageError, UsageError
from servobench.recordings.formats.base import load, save
from servobench.recordings.formats.csv import Csv
from servobench.recordings.recording import Recording
from tests.recordings.formats.tables import codes
from tests.recordings.native.samples import small

TABLE = "t,u,y\n0,1,2\n0.1,1,3\n"


def test_the_source_is_the_name_as_given_the_checksum_and_the_format(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("log.csv").write_text(TABLE)

    (recording,) = load("log.csv")

    assert recording.source.name == "log.csv"
    assert recording.source.sha256 == hashlib.sha256(TABLE.encode()).hexdigest()
    assert recording.source.format == "csv"
    assert recording.name == "log"


@pytest.mark.parametrize("name", ["log.csv", "log.txt", "LOG.TSV", "log.dat"])
def test_the_ending_says_the_format(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(TABLE)

    assert codes(load(tmp_path / name)[0].findings) == ["time-recognised"]


@pytest.mark.parametrize("name", ["log", "log.log", "log.mat", "log.json", "log.mcap"])
def test_where_ending_and_content_differ_the_content_decides_and_a_finding_says_so(
    name: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(TABLE)

    (recording,) = load(tmp_path / name)

    assert recording.source.format == "csv"
    assert "format-by-content" in codes(recording.findings)


def test_a_missing_file_is_an_error_that_names_a_similar_one(tmp_path: Path) -> None:
    (tmp_path / "motor_log.csv").write_text(TABLE)

    with pytest.raises(UsageError) as caught:
        load(tmp_path / "moter_log.csv")
    meant = str(tmp_path / "motor_log.csv")
    assert str(caught.value) == f"there is no file {tmp_path / 'moter_log.csv'}; did you mean {meant!r}?"
    with pytest.raises(UsageError, match="there is no file"):
        load(tmp_path / "nowhere" / "moter_log.csv")


def test_a_link_to_nothing_is_called_that(tmp_path: Path) -> None:
    link = tmp_path / "log.csv"
    link.symlink_to("gone.csv")

    with pytest.raises(UsageError) as caught:
        load(link)
    assert str(caught.value) == f"{link} is a link to gone.csv, which isn't there; name the file itself"


@pytest.mark.parametrize("name", ["a" * 5000, "nul\0.csv"])
def test_a_name_that_no_file_can_have_is_an_error_of_ours(name: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError):
        load(tmp_path / name)


def test_a_folder_and_an_empty_file_are_errors_that_say_so(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="is a folder"):
        load(tmp_path)
    (tmp_path / "log.csv").touch()
    with pytest.raises(FormatError, match=r"log.csv is empty"):
        load(tmp_path / "log.csv")


def test_a_pipe_or_the_like_is_an_error_and_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "pipe.csv").touch()
    monkeypatch.setattr(Path, "is_file", lambda _: False)

    with pytest.raises(UsageError, match="isn't a regular file"):
        load(tmp_path / "pipe.csv")


def test_an_unknown_format_is_an_error_that_lists_the_known_ones(tmp_path: Path) -> None:
    (tmp_path / "photo.jpg").write_bytes(b"\xff\xd8\xff\xe0\x00\x10JFIF\x00\x01\x01")

    with pytest.raises(
        FormatError, match=r"known: arrow .*csv \(\.csv .*mat \(\.mat\).*mcap.*sysid_json \(\.json\)"
    ):
        load(tmp_path / "photo.jpg")


def test_a_file_that_may_not_be_read_is_an_error_that_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.csv"
    path.write_text(TABLE)

    def refuse(
        *_: object, **__: object
    ) -> None:  # root may read everything, so the system's refusal is played
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)

    with pytest.raises(FormatError, match=r"log.csv can't be read: Permission denied"):
        load(path)


def test_json_of_another_program_is_an_error_that_says_which_json_is_read(tmp_path: Path) -> None:
    file = tmp_path / "settings.json"
    file.write_text('{"mass": 0.5, "colour": "red"}')

    with pytest.raises(
        FormatError, match=r"not a table: it has `mass`, `colour`. .* a file of SysId or a servo bench"
    ):
        load(file)


def test_the_ending_says_what_is_written(tmp_path: Path) -> None:
    save(small(), tmp_path / "a.csv")
    save([small(), small()], tmp_path / "a.mcap")

    assert (tmp_path / "a.csv").read_text().startswith("# servobench")
    assert len(load(tmp_path / "a.mcap")) == 2
    for ending in ("xls", "part"):  # a run writes .part while it goes on
        expected = (
            rf"no format that can be written ends in '.{ending}'; known: arrow .*, csv .*, mcap \(.mcap\)"
        )
        with pytest.raises(UsageError, match=expected) as caught:
            save(small(), tmp_path / f"a.{ending}")
        assert "lvm" not in str(caught.value)  # it is only read
    with pytest.raises(UsageError, match="no recording to write"):
        save([], tmp_path / "a.csv")


def test_a_file_stays_until_the_new_one_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.csv"
    path.write_text(TABLE)

    def full(_: Csv, several: Sequence[Recording], to: Path) -> None:
        to.write_text("# half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Csv, "write", full)

    with pytest.raises(StorageError, match=r"a.csv can't be written: No space left on device"):
        save(small(), path)
    assert path.read_text() == TABLE
    assert list(tmp_path.iterdir()) == [path]
