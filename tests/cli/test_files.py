"""`inspect`, `convert` and `recover`: what is in files, and other files of it."""

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import servobench as sb
from servobench.identification.watch import Watch
from servobench.recordings.formats.mapping import Mapping
from servobench.recordings.streams.base import Rows
from servobench.rig.experiment import load_experiment
from tests.cli.conftest import Command


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    file = tmp_path / "foreign.csv"
    speed = angle = 0.0
    rows = []
    for k in range(100):
        volts = 3 if k % 20 < 10 else 1
        rows.append(f"{0.01 * k:.2f},{volts},{angle:.0f}")
        speed += 0.3 * (volts - speed)  # a motor of 28 ms
        angle += 2 * speed
    rows[50] = rows[50].rpartition(",")[0] + ",nan"
    file.write_text("\n".join(["t [s],u [V],theta [deg]", *rows]) + "\n")
    return file


def test_inspect_tells_channels_times_and_what_it_can_support(servobench: Command, foreign: Path) -> None:
    ended = servobench("inspect", foreign)

    assert (ended.status, ended.err) == (0, "")
    assert f"{foreign}: csv, 1 recording\n" in ended.out
    assert re.search(r"theta +deg +100 +0 +393 +1 not finite", ended.out)
    assert "every 0.01 s" in ended.out
    assert "`servobench identify` can use it as it is: the output is a position in deg" in ended.out


def test_inspect_says_of_data_that_identify_refuses_that_they_cannot_be_used(
    servobench: Command, tmp_path: Path
) -> None:
    file = tmp_path / "grouped.csv"
    rows = [f'"{0.01 * k:.2f}","{k % 20}","{7 * k:,}.5"\n' for k in range(400)]
    file.write_text('"t [s]","u [V]","rpm"\n' + "".join(rows))

    ended = servobench("inspect", file)

    assert "can use it as it is" not in ended.out
    assert (
        "It can't be identified as it is: the column `rpm` has 257 cells of 400 that aren't numbers"
        in ended.out
    )


def test_inspect_does_not_call_an_input_usable_that_never_changes(
    servobench: Command, tmp_path: Path
) -> None:
    file = tmp_path / "steady.csv"
    rows = [f"{0.01 * k:.2f},5,{50 + 0.1 * (k % 3):.1f}\n" for k in range(200)]
    file.write_text("t [s],u [V],speed [rad/s]\n" + "".join(rows))

    ended = servobench("inspect", file)

    assert "can use it as it is" not in ended.out
    assert "1.99 s long, the input 5 V.\nThat can't be identified:\n  ✗ The input stays at 5 V" in ended.out
    assert "the motor turns at 50.1 rad/s" in " ".join(ended.out.split())


def test_inspect_says_what_has_to_be_said(servobench: Command, tmp_path: Path) -> None:
    file = tmp_path / "bare.csv"
    file.write_text("a,b\n" + "1,2\n2,4\n3,9\n" * 5)

    ended = servobench("inspect", file)

    assert ended.status == 0
    assert "no times were recognised" in ended.out
    for option in ("--input", "--output", "--sample-time"):
        assert option in ended.out


def test_inspect_sees_that_the_input_never_changes(servobench: Command, foreign: Path) -> None:
    foreign.write_text(foreign.read_text().replace(",3,", ",1,"))

    assert "The input stays at 1 V throughout" in servobench("inspect", foreign).out


def test_inspect_shows_a_run_of_ours_with_its_roles_and_how_it_ended(
    servobench: Command, finished_run: Path
) -> None:
    said = servobench("inspect", finished_run / "recording.mcap").out

    assert re.search(r"applied +V .* input", said)
    assert re.search(r"counts +counts .* output; 24-bit counter; 2048 counts/rev", said)
    assert "ended: ran for 10 s, as asked" in said


@pytest.mark.parametrize("ending", ["csv", "mcap", "mat", "tsv"])
def test_converted_there_and_back_a_recording_is_the_same(
    servobench: Command, finished_run: Path, tmp_path: Path, ending: str
) -> None:
    there, back = tmp_path / f"there.{ending}", tmp_path / "back.mcap"

    assert servobench("convert", finished_run / "recording.mcap", there).status == 0
    assert servobench("convert", there, back).status == 0

    (first,), (second,) = sb.load(finished_run / "recording.mcap"), sb.load(back)
    assert second.series == first.series
    assert replace(second, series=(), input=None, output=None, source=first.source) == replace(
        first, series=(), input=None, output=None
    )


def test_convert_doesn_t_overwrite_unless_it_is_told_to(
    servobench: Command, foreign: Path, tmp_path: Path
) -> None:
    target = tmp_path / "out.mcap"
    target.write_text("mine")

    refused = servobench("convert", foreign, target)
    assert (refused.status, target.read_text()) == (2, "mine")
    assert "--overwrite" in refused.err

    assert servobench("convert", foreign, target, "--overwrite").status == 0
    assert len(sb.load(target)[0].series) == 3


def test_convert_takes_the_recording_that_is_named(
    servobench: Command, foreign: Path, tmp_path: Path
) -> None:
    (one,) = sb.load(foreign)
    sb.save([one, replace(one, name="other")], tmp_path / "both.mcap")

    both = servobench("convert", tmp_path / "both.mcap", tmp_path / "out.csv")
    other = servobench("convert", tmp_path / "both.mcap", tmp_path / "out.csv", "--recording", "other")

    assert both.status == 2
    assert "holds one recording" in both.err
    assert other.status == 0
    assert sb.load(tmp_path / "out.csv")[0].name == "other"


def test_convert_to_an_unknown_ending_ends_with_2(servobench: Command, foreign: Path, tmp_path: Path) -> None:
    ended = servobench("convert", foreign, tmp_path / "out.xyz")

    assert ended.status == 2
    assert ".csv" in ended.err


def test_recover_makes_a_whole_file_of_a_torn_one(
    servobench: Command, finished_run: Path, tmp_path: Path
) -> None:
    torn = tmp_path / "recording.mcap.part"
    whole = (finished_run / "recording.mcap").read_bytes()
    torn.write_bytes(whole[: len(whole) // 2])

    ended = servobench("recover", torn)

    recovered = tmp_path / "recording-recovered.mcap"
    assert ended.status == 0
    assert str(recovered) in ended.out
    assert "cut short" in ended.out
    assert 0 < len(sb.load(recovered)[0]["counts"].values) < 5000
    assert torn.read_bytes() == whole[: len(whole) // 2]


@pytest.fixture
def killed_run(finished_run: Path, tmp_path: Path) -> Path:
    """Return the folder that a run leaves that is killed half-way."""
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "experiment.toml").write_bytes((finished_run / "experiment.toml").read_bytes())
    whole = (finished_run / "recording.mcap").read_bytes()
    (folder / "recording.mcap.part").write_bytes(whole[: len(whole) // 2])
    return folder


@pytest.mark.promise("S28")
def test_the_folder_of_a_killed_run_says_that_it_is_not_whole(servobench: Command, killed_run: Path) -> None:
    for words in (("identify", killed_run), ("inspect", killed_run), ("run", "--out", killed_run)):
        ended = servobench(*words)
        assert ended.status == 2
        assert f"servobench recover {killed_run}`" in ended.err
    assert "cut short" in servobench("inspect", killed_run / "recording.mcap.part").out


def test_what_is_missing_of_a_file_is_reported_before_what_is_left_of_it(
    servobench: Command, killed_run: Path
) -> None:
    lines = servobench("inspect", killed_run / "recording.mcap.part").out.splitlines()

    (told,) = [number for number, line in enumerate(lines) if "the recording was cut short" in line]
    (table,) = [number for number, line in enumerate(lines) if line.split()[:2] == ["channel", "unit"]]
    assert told < table


@pytest.mark.promise("S28")
@pytest.mark.parametrize("lost", ["nothing", "experiment.toml"])
def test_recover_makes_the_folder_of_a_killed_run_whole(
    servobench: Command, finished_run: Path, killed_run: Path, lost: str
) -> None:
    (killed_run / lost).unlink(missing_ok=True)
    (expected,) = sb.load(killed_run / "recording.mcap.part")

    ended = servobench("recover", killed_run)

    assert (ended.status, ended.err) == (0, "")
    assert "cut short" in ended.out
    assert {file.name for file in killed_run.iterdir()} == {"experiment.toml", "recording.mcap", "data.csv"}
    for name in ("recording.mcap", "data.csv"):
        (recovered,) = sb.load(killed_run / name)
        assert replace(recovered, source=expected.source) == expected
    again = load_experiment(killed_run / "experiment.toml")
    assert again == load_experiment(finished_run / "experiment.toml")
    assert "is whole already" in servobench("recover", killed_run).err


def test_recover_makes_no_experiment_for_a_motor_that_was_watched(
    servobench: Command, tmp_path: Path
) -> None:
    t = 0.002 * np.arange(2000)
    u = np.where(t % 1 < 0.5, 3.0, -3.0)
    watch = Watch(Mapping(counts_per_rev=2048.0), "lines", tmp_path / "recording.mcap")
    watch.take(Rows(names=("t", "u", "counts"), values=np.column_stack([t, u, np.round(100 * np.sin(t))])))
    watch.abandon()

    ended = servobench("recover", tmp_path)

    assert (ended.status, ended.err) == (0, "")
    assert {file.name for file in tmp_path.iterdir()} == {"recording.mcap", "data.csv"}


@pytest.mark.promise("S28")
def test_recover_adds_what_a_killed_command_left_out_where_the_recorder_outlived_it(
    servobench: Command, finished_run: Path, tmp_path: Path
) -> None:
    whole = (finished_run / "recording.mcap").read_bytes()
    (tmp_path / "recording.mcap").write_bytes(whole)

    ended = servobench("recover", tmp_path)

    assert (ended.status, ended.err) == (0, "")
    assert "ended: ran for 10 s, as asked" in ended.out
    assert {file.name for file in tmp_path.iterdir()} == {"experiment.toml", "recording.mcap", "data.csv"}
    assert (tmp_path / "recording.mcap").read_bytes() == whole
    (expected,) = sb.load(finished_run / "data.csv")
    (made,) = sb.load(tmp_path / "data.csv")
    assert made.series == expected.series
    assert "is whole already" in servobench("recover", tmp_path).err


@pytest.mark.promise("S28")
def test_recover_never_replaces_a_recording_in_a_folder(
    servobench: Command, finished_run: Path, killed_run: Path
) -> None:
    whole = (finished_run / "recording.mcap").read_bytes()
    (killed_run / "recording.mcap").write_bytes(whole)

    ended = servobench("recover", killed_run)

    assert ended.status == 2
    assert "exists as well as recording.mcap.part" in ended.err
    assert (killed_run / "recording.mcap").read_bytes() == whole
    assert (killed_run / "recording.mcap.part").exists()


def test_recover_makes_a_folder_whole_where_it_is_and_no_other(
    servobench: Command, killed_run: Path, tmp_path: Path
) -> None:
    assert "repaired in place" in servobench("recover", killed_run, "--to", tmp_path / "b.mcap").err
    assert "is no folder of a run" in servobench("recover", tmp_path).err


def test_recover_writes_where_it_is_reported_and_never_over_another_file(
    servobench: Command, finished_run: Path, tmp_path: Path
) -> None:
    words = ("recover", finished_run / "recording.mcap", "--to", tmp_path / "copy.mcap")

    assert servobench(*words).status == 0
    assert servobench(*words).status == 2


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes with names here")
def test_what_is_no_regular_file_isn_t_replaced(servobench: Command, foreign: Path, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)

    ended = servobench("convert", foreign, pipe, "--overwrite")

    assert ended.status == 2
    assert "isn't a regular file" in ended.err
    assert pipe.is_fifo()


def test_a_text_in_the_first_row_of_numbers_leaves_the_names_above_it(
    servobench: Command, tmp_path: Path
) -> None:
    file = tmp_path / "start.csv"
    rows = [f"{0.01 * k:.2f},{3 if k % 20 < 10 else 1},{k}" for k in range(100)]
    rows[0] = "0.00,3,err"
    file.write_text("\n".join(["t [s],u [V],theta [deg]", *rows]) + "\n")

    ended = servobench("inspect", file)

    assert ended.status == 0
    assert "theta" in ended.out
    assert "column_3" not in ended.out
    assert "such as 'err'" in ended.out
