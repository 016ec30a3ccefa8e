"""The lock of a file that is being written."""

import subprocess
import sys
from pathlib import Path

import pytest

from servobench.core.errors import UsageError
from servobench.recordings.native.lease import is_held
from servobench.recordings.native.recover import make_whole
from servobench.recordings.native.writer import RecordingWriter
from tests.recordings.native.samples import TOGETHER, opening

WRITER = """
import sys, time
from servobench.recordings.native.writer import RecordingWriter
from tests.recordings.native.samples import TOGETHER, opening
writer = RecordingWriter(sys.argv[1])
writer.begin(opening(), TOGETHER)
print("begun", flush=True)
time.sleep(60)
"""


@pytest.mark.promise("S28")
def test_a_part_is_held_as_long_as_it_is_written_and_no_longer(tmp_path: Path) -> None:
    path, part = tmp_path / "a.mcap", tmp_path / "a.mcap.part"
    assert not is_held(part)
    writer = RecordingWriter(path)
    writer.begin(opening(), TOGETHER)
    assert is_held(part)
    assert is_held(part)  # to ask takes nothing away
    with pytest.raises(UsageError, match="is being written by a running experiment"):
        make_whole(path)
    with pytest.raises(UsageError, match="is being written by a running experiment"):
        RecordingWriter(path)
    writer.abandon()
    assert not is_held(part)
    with pytest.raises(UsageError, match="the unfinished recording of an earlier run"):
        RecordingWriter(path)
    assert len(make_whole(path)) == 1


@pytest.mark.promise("S28")
def test_a_writer_that_is_killed_leaves_no_lock(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, tmp_path / "a.mcap"], stdout=subprocess.PIPE, text=True
    ) as writer:
        assert writer.stdout is not None
        writer.stdout.readline()
        held = is_held(tmp_path / "a.mcap.part")
        writer.kill()
        writer.wait()
    assert held
    assert not is_held(tmp_path / "a.mcap.part")
