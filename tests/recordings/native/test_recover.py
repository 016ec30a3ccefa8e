from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from servobench.core.errors import FormatError, UsageError
from servobench.recordings.native.reader import read
from servobench.recordings.native.recover import recover
from servobench.recordings.native.writer import RecordingWriter
from tests.recordings.native.samples import TOGETHER, opening


@pytest.fixture
def torn(tmp_path: Path) -> Path:
    """Return the part of a run that ended in the middle of its third chunk."""
    writer = RecordingWriter(tmp_path / "a.mcap")
    writer.begin(opening(), TOGETHER)
    for _ in range(3):
        writer.append(0, np.ones((10, 3)))
    writer.abandon()
    part = tmp_path / "a.mcap.part"
    # The last record is the index of the third chunk: 15 bytes and 16 for each of its rows; 20 more are the chunk's own.
    part.write_bytes(part.read_bytes()[: -(15 + 16 * 10) - 20])
    return part


def test_a_recovered_copy_is_whole_and_the_original_as_it_was(torn: Path, tmp_path: Path) -> None:
    before = torn.read_bytes()

    recovered = recover(torn, tmp_path / "b.mcap")

    assert torn.read_bytes() == before
    assert read(tmp_path / "b.mcap") == recovered == read(torn)
    assert len(recovered[0]["counts"].values) == 20
    assert recovered[0].findings[-1].code == "recording-cut-short"
    with open(tmp_path / "b.mcap", "rb") as file:
        assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) == 20


@pytest.mark.promise("S28")
def test_recovery_overwrites_nothing_not_even_the_original(torn: Path) -> None:
    before = torn.read_bytes()

    with pytest.raises(UsageError, match="exists already; give a new name"):
        recover(torn, torn)
    assert torn.read_bytes() == before


def test_where_nothing_can_be_read_nothing_is_written(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n")

    with pytest.raises(FormatError):
        recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert not (tmp_path / "b.mcap").exists()
