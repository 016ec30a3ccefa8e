from pathlib import Path

import pytest

from servobench.core.errors import FormatError, UsageError
from servobench.recordings.formats.base import FORMATS
from servobench.recordings.formats.native import Native
from tests.recordings.native.samples import small


def test_recordings_come_back_equal(tmp_path: Path) -> None:
    originals = (small("one"), small("two", samples=0))
    path = tmp_path / "a.mcap"

    Native().write(originals, path)

    assert Native().read(path) == originals


def test_it_is_found_by_its_name_and_knows_its_files() -> None:
    assert FORMATS["mcap"] is Native
    assert Native().recognises(Path("a.bin"), b"\x89MCAP0\r\n\x01")
    assert not Native().recognises(Path("a.mcap"), b"t,u,y\n")
    assert not Native().recognises(Path("a.mcap"), b"")


def test_a_part_that_was_left_behind_is_a_native_file_too(tmp_path: Path) -> None:
    Native().write((small(),), tmp_path / "a.mcap")
    part = (tmp_path / "a.mcap").rename(tmp_path / "a.mcap.part")

    assert part.suffix in Native.suffixes
    assert Native().read(part) == (small(),)


def test_no_recordings_and_no_mcap_file_are_errors_of_ours(tmp_path: Path) -> None:
    with pytest.raises(UsageError):
        Native().write((), tmp_path / "a.mcap")
    (tmp_path / "b.mcap").write_bytes(b"t,u,y\n")
    with pytest.raises(FormatError):
        Native().read(tmp_path / "b.mcap")
