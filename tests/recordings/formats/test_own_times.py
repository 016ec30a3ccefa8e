"""Input and output with their own times, of one file or of two, in the formats that have such."""

from pathlib import Path

import numpy as np
import pytest

from servobench.core.errors import UsageError
from servobench.recordings.formats.base import load
from servobench.recordings.formats.mapping import assign
from servobench.recordings.measurement.measure import measure
from tests.recordings.formats import bags, matlab_objects
from tests.recordings.formats.tables import codes
from tests.recordings.formats.wpilogs import HEADER, doubles, start, sysid

STAMPS = np.cumsum(np.random.default_rng(4).integers(4_000, 6_000, 100))
U = np.sign(np.sin(np.arange(100) / 9))
Y = np.cumsum(U)


def log(path: Path) -> Path:
    """A log with a voltage now and then and a position more often, both with stamps of their own."""
    data = HEADER + start(1, "NT:/u", metadata="V") + start(2, "NT:/y", metadata="rad")
    path.write_bytes(
        data + doubles(1, STAMPS[::10].tolist(), U[::10].tolist()) + doubles(2, STAMPS.tolist(), Y.tolist())
    )
    return path


def test_nothing_is_resampled_on_the_way_to_an_identification(tmp_path: Path) -> None:
    (recording,) = load(log(tmp_path / "a.wpilog"))

    data = measure(assign(recording, input="NT:/u", output="NT:/y"))

    assert np.array_equal(data.t_input, STAMPS[::10] / 1e6)
    # The first outputs answer to an input from before the file, and are left out; the others have their own times.
    assert len(data.t_output) >= 0.9 * len(STAMPS)
    assert np.array_equal(data.t_output, STAMPS[-len(data.t_output) :] / 1e6)
    assert np.array_equal(data.u, U[::10])


def test_a_column_comes_out_of_a_file_of_another_format(tmp_path: Path) -> None:
    log(tmp_path / "a.wpilog")
    bags.bag(tmp_path / "b.mcap")
    series = {"u": matlab_objects.timeseries(matlab_objects.T[:, None], unit="V")}
    matlab_objects.save(tmp_path / "c.mat", series)
    (recording,) = load(tmp_path / "b.mcap")

    of_log = assign(recording, input="a.wpilog#NT:/u", output="left.position")
    of_mat = assign(recording, input="c.mat#u", output="left.position")

    assert of_log.input == "a.NT:/u"
    assert np.array_equal(of_log["a.NT:/u"].t, STAMPS[::10] / 1e6)
    assert of_mat.input == "c.u"
    assert np.array_equal(of_mat["c.u"].t, matlab_objects.T)
    assert "column-from-other-file" in codes(of_log.findings)


def test_a_column_out_of_a_file_of_several_recordings_is_refused(tmp_path: Path) -> None:
    (tmp_path / "tests.wpilog").write_bytes(sysid())
    (recording,) = load(log(tmp_path / "a.wpilog"))

    with pytest.raises(UsageError, match="holds 4 recordings"):
        assign(recording, input="tests.wpilog#voltage-motor-arm", output="NT:/y")
