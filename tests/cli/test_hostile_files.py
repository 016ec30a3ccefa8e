"""Files that cost or say more than they should: refused in one sentence, at the price of their size; none forges a line."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from tests.cli.conftest import Command, environment
from tests.recordings.formats import bags

LOGGER = Path(__file__).parents[2] / "examples" / "logger.csv"
WRONG_USAGE = 2
# What a file may cost: a row of text becomes a string, a list's entry and floats, about 15 bytes for each of its own. The
# rest is Python with NumPy and ours (about 150 MB); libraries read what isn't text in a process of their own.
FACTOR, BASE = 20, 300e6
MOST_SECONDS = 30  # of CPU, for files that take one or two; it was a minute, or for ever

_CHILD = """
import json, resource, sys
from servobench.cli import main
status = main(sys.argv[1:])
with open("/proc/self/status") as file:
    peak = next(int(line.split()[1]) for line in file if line.startswith("VmHWM"))
used = resource.getrusage(resource.RUSAGE_SELF)
print(json.dumps([status, 1024 * peak, used.ru_utime + used.ru_stime]), file=sys.stderr)
"""


def refused(*words: object, size: int) -> str:
    """Return the one sentence with which a command refuses a file of that size [bytes], at a price that its size accounts for."""
    ended = subprocess.run(
        [sys.executable, "-W", "error", "-c", _CHILD, *map(str, words)],
        env=environment(),
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    *said, last = [line for line in ended.stderr.splitlines() if "so far" not in line]
    status, peak, seconds = json.loads(last)
    assert status == WRONG_USAGE, ended.stderr
    assert len(said) == 1, ended.stderr
    assert said[0].startswith("Error: ")
    assert peak < FACTOR * size + BASE
    assert seconds < MOST_SECONDS
    return said[0]


needs_linux = pytest.mark.skipif(
    not os.path.exists("/proc/self/status"), reason="only Linux tells the most memory"
)


def dotted(path: Path) -> None:
    path.write_text("a" + 20_000 * ".a" + " = 1\n")


@needs_linux
@pytest.mark.promise("S58")
def test_a_key_of_20_000_parts_costs_no_memory(tmp_path: Path) -> None:
    dotted(tmp_path / "a.toml")

    experiment = refused("run", tmp_path / "a.toml", "--out", tmp_path / "out", size=40_000)
    mapping = refused("identify", LOGGER, "--mapping", tmp_path / "a.toml", size=40_000)

    assert "a.toml:1" in experiment
    assert "more than 16 parts" in experiment
    assert "more than 16 parts" in mapping


def mat_5(path: Path) -> None:
    scipy.io.savemat(path, {"u": np.zeros(120_000_000)}, do_compression=True)


def mat_7(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        made = file.create_dataset(
            "u", shape=(120_000_000,), dtype="f8", chunks=(1_000_000,), compression="gzip"
        )
        made.attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


@needs_linux
@pytest.mark.promise("S58")
@pytest.mark.parametrize("make", [pytest.param(mat_5, marks=pytest.mark.long), mat_7])
def test_a_mat_file_that_unpacks_to_a_gigabyte_is_refused(
    make: Callable[[Path], None], tmp_path: Path
) -> None:
    path = tmp_path / "a.mat"
    make(path)

    assert "of its size" in refused("inspect", path, size=path.stat().st_size) or make is mat_5


ROWS = "0.001,1.0,2.0,3.0\n"


@needs_linux
@pytest.mark.promise("S58")
def test_quotes_that_stay_open_are_refused_at_the_first_look(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,u,y,z\n" + 800_000 * '0.001,1.0,"2.0,3.0\n')

    said = refused("inspect", path, size=path.stat().st_size)

    assert "a quote isn't closed in rows 2 to 800001" in said


@needs_linux
@pytest.mark.promise("S58")
@pytest.mark.parametrize("line", ["1" * 30_000_000, 15_000_000 * "1,", '"' * 30_000_000])
def test_a_line_that_no_table_has_is_refused(line: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,u,y,z\n" + 100 * ROWS + line + "\n")

    assert "row 102 has more than 1048576 characters" in refused("inspect", path, size=path.stat().st_size)


@needs_linux
@pytest.mark.promise("S58")
def test_ten_million_blank_rows_cost_what_their_bytes_account_for(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,u,y,z\n" + 10_000_000 * "\n")

    assert "no rows of numbers" in refused("inspect", path, size=path.stat().st_size)


def test_a_few_quotes_that_stay_open_cost_only_their_rows(servobench: Command, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = [f"{k / 100},{k % 7},{k}\n" for k in range(2000)]
    rows[1000] = '10.0,"5,1000\n'
    path.write_text("t,u,y\n" + "".join(rows))

    said = servobench("inspect", path)

    assert said.status == 0
    assert "Fewer than 3 cells, left out: row 1002" in said.out


@needs_linux
@pytest.mark.promise("S58")
def test_a_chain_of_5_001_stages_is_refused_at_once(tmp_path: Path) -> None:
    chain = " | ".join(5001 * ["lowpass 50 rad/s"])

    assert "5001 stages" in refused(
        "identify", LOGGER, "--output", "angle:deg", "--chain", chain, size=LOGGER.stat().st_size
    )


FORGED = "/m\nError: the motor is driven\x1b[31m\u202e"


@pytest.mark.promise("S59")
@pytest.mark.parametrize("words", [["inspect"], ["identify"], ["identify", "--output", "nothing"]])
def test_a_topic_can_t_forge_a_line_of_ours(words: list[str], servobench: Command, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    bags.of_json(path, [{"u": k % 3, "y": k} for k in range(40)], topic=FORGED)

    said = servobench(words[0], path, *words[1:])

    for stream in (said.out, said.err):
        assert "\x1b" not in stream
        assert "\u202e" not in stream
        assert not any(line.lstrip().startswith("Error: the motor") for line in stream.splitlines())
    assert "the motor is driven" in said.out + said.err


@pytest.mark.promise("S59")
def test_a_name_in_a_recording_of_ours_can_t_either(servobench: Command, tmp_path: Path) -> None:
    from servobench.core.channels import Channel
    from servobench.recordings.formats.base import save
    from servobench.recordings.recording import Recording, Series, Source

    t = np.arange(50) / 100
    series = tuple(
        Series(channel=Channel(name=f"{name}\nError: forged", unit=unit), values=np.sin(t), t=t)
        for name, unit in (("u", "V"), ("y", "rad"), ("y2", "rad"))
    )
    recording = Recording(name="run\nError: forged", series=series, source=Source(name="a"))
    save(recording, tmp_path / "a.mcap")

    for words in (["inspect"], ["identify"], ["identify", "--output", "nothing"]):
        said = servobench(words[0], tmp_path / "a.mcap", *words[1:])

        lines = [*said.out.splitlines(), *said.err.splitlines()]
        assert not any(line.startswith("Error: forged") for line in lines), words
        assert "forged" in "".join(lines)
