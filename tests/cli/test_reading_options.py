"""A recording is described with the same options in every command that takes one."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Command

COLUMNS = ("--time", "clock:ms", "--input", "a:V", "--output", "b:deg", "--chain", "none")
WISH = ("--damping", "0.8", "--bandwidth", "8")
COMMANDS = {
    "identify": (),
    "inspect": (),
    "why": ("--claimed", "tau=0.13"),
    "tune": WISH,
    "stability": ("--kp", "2"),
    "design": ("--voltage-limit", "5", "--duration", "1"),
    "export": ("--as", "json", "--overwrite", "--out"),
    "convert": (),
}


@pytest.fixture
def logger(tmp_path: Path) -> Path:
    """A file whose names and units say nothing: a motor of 20 rad/(s·V) and 0.1 s, every 5 ms."""
    t = np.arange(0, 6, 0.005)
    u = np.where(t % 1.3 < 0.6, 2.0, -1.5)
    speed, angle = np.zeros(len(t)), np.zeros(len(t))
    decay = np.exp(-0.05)
    for k in range(len(t) - 1):
        speed[k + 1] = decay * speed[k] + (1 - decay) * 20 * u[k]
        angle[k + 1] = angle[k] + 20 * u[k] * 0.005 + (speed[k] - 20 * u[k]) * 0.1 * (1 - decay)
    degrees = np.round(np.degrees(angle), 2)
    rows = "".join(f"{1000 * x:.0f},{v:g},{d:.2f}\n" for x, v, d in zip(t, u, degrees, strict=True))
    file = tmp_path / "logger.csv"
    file.write_text(f"clock,a,b\n{rows}", encoding="utf-8")
    return file


def words(command: str, file: Path, *said: str) -> list[object]:
    """A command line about a file."""
    if command == "design":
        return [command, *COMMANDS[command], "--from", file, *said]
    own = [*COMMANDS[command], file.with_name("out.json")] if command == "export" else COMMANDS[command]
    target = [file.with_name("out.csv"), "--overwrite"] if command == "convert" else []
    return [command, file, *target, *own, *said]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_recording_that_says_nothing_is_used_by_every_command_once_its_columns_are_named(
    servobench: Command, logger: Path, command: str
) -> None:
    told = servobench(*words(command, logger, *COLUMNS))

    assert told.status == 0, told.err
    if command not in ("inspect", "convert"):  # which need nothing to be told
        asked = servobench(*words(command, logger))
        assert asked.status == 2
        assert "--input" in asked.err


@pytest.mark.parametrize("command", COMMANDS)
def test_a_column_that_is_not_there_is_reported_with_those_that_are(
    servobench: Command, logger: Path, command: str
) -> None:
    ended = servobench(*words(command, logger, "--input", "c:V", "--output", "b:deg"))

    assert ended.status == 2
    assert "'c'" in ended.err
    assert "Traceback" not in ended.err


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("said", "because"),
    [
        (("--sample-time", "soon"), "--sample-time: "),
        (("--counts-per-rev", "-3"), "--counts-per-rev -3"),
        (("--recording", "other"), "no recording called 'other'"),
        (("--mapping", "nowhere.toml"), "nowhere.toml"),
        (("--chain", "lowpas 3 Hz"), "lowpas"),
    ],
)
def test_a_mistake_in_an_option_is_reported_in_its_name(
    servobench: Command, logger: Path, command: str, said: tuple[str, ...], because: str
) -> None:
    ended = servobench(*words(command, logger, *COLUMNS[:-2], *said))

    assert ended.status == 2
    assert because in ended.err
    assert "Traceback" not in ended.err


def test_a_mapping_says_the_same_as_the_options(servobench: Command, logger: Path) -> None:
    mapping = logger.with_name("map.toml")
    mapping.write_text(
        'time = "clock:ms"\ninput = "a:V"\noutput = "b:deg"\nchain = "none"\n', encoding="utf-8"
    )

    for command in ("identify", "tune", "stability", "inspect"):
        by_mapping = servobench(*words(command, logger, "--mapping", str(mapping)))
        by_options = servobench(*words(command, logger, *COLUMNS))
        assert by_mapping.out == by_options.out
        assert by_mapping.status == 0


def test_gains_margins_and_exports_of_a_recording_are_those_of_its_result(
    servobench: Command, logger: Path
) -> None:
    result = logger.with_name("result.json")
    result.write_text(servobench(*words("identify", logger, *COLUMNS, "--json")).out, encoding="utf-8")

    for command in ("tune",):
        assert servobench(*words(command, logger, *COLUMNS)).out == servobench(*words(command, result)).out
    exported = logger.with_name("out.json")
    servobench(*words("export", logger, *COLUMNS))
    of_file = json.loads(exported.read_text(encoding="utf-8"))
    assert of_file["parameters"] == json.loads(result.read_text(encoding="utf-8"))["parameters"]


@pytest.mark.parametrize("command", ["tune", "stability", "export", "design"])
def test_a_result_has_no_columns(
    servobench: Command, finished_run: Path, tmp_path: Path, command: str
) -> None:
    file = tmp_path / "result.json"
    file.write_text((finished_run / "result.json").read_text(encoding="utf-8"), encoding="utf-8")

    ended = servobench(*words(command, file, "--input", "u:V", "--starts-at-rest"))

    assert ended.status == 2
    assert "which has no columns to read: leave --input and --starts-at-rest out" in ended.err


def test_the_time_between_ticks_is_the_controllers_and_that_between_samples_the_datas(
    servobench: Command, logger: Path
) -> None:
    table = logger.with_name("no_times.csv")
    rows = logger.read_text(encoding="utf-8").splitlines()
    table.write_text("\n".join(row.partition(",")[2] for row in rows), encoding="utf-8")
    said = ("--input", "a:V", "--output", "b:deg", "--chain", "none", "--sample-time", "5 ms")

    own = json.loads(servobench(*words("tune", table, *said, "--json")).out)
    other = json.loads(
        servobench(*words("tune", table, *said, "--controller-sample-time", "2 ms", "--json")).out
    )

    assert own["sample_time"] == 0.005
    assert other["sample_time"] == 0.002
    loops = [
        json.loads(servobench(*words("stability", table, *said, *ticks, "--json")).out)["loop"]
        for ticks in ((), ("--controller-sample-time", "2 ms"))
    ]
    assert [loop["sample_time"] for loop in loops] == [0.005, 0.002]


def test_an_experiments_runs_need_no_columns(servobench: Command) -> None:
    ended = servobench("honest", "--runs", "2", "--input", "u:V")

    assert ended.status == 2
    assert "--input: an experiment's runs need no columns" in ended.err


def test_recordings_of_one_name_are_called_after_their_files(servobench: Command, logger: Path) -> None:
    for name in ("first", "second"):
        copied = servobench("convert", logger, logger.with_name(f"{name}.mcap"), *COLUMNS)
        assert copied.status == 0, copied.err

    both = servobench(
        "identify", logger.with_name("first.mcap"), logger.with_name("second.mcap"), "--json"
    ).result

    assert [each["name"] for each in both["records"]] == ["first logger", "second logger"]


def test_a_jump_is_told_by_its_row_in_the_file_although_the_first_rows_are_not_used(
    servobench: Command, logger: Path
) -> None:
    """The motor is driven from the first row on, so its first answers are left out; the row to cut at is the file's."""
    header, *rows = logger.read_text(encoding="utf-8").splitlines()
    slipped = [
        f"{head},{float(angle) + 300.0 * (k >= 700):.2f}"
        for k, (head, angle) in enumerate(row.rsplit(",", 1) for row in rows)
    ]
    logger.write_text("\n".join([header, *slipped]) + "\n", encoding="utf-8")

    told = " ".join(servobench("identify", logger, *COLUMNS).out.split())
    assert "the position jumps in sample 701 (3.5 s)" in told
    logger.write_text("\n".join([header, *slipped[700:]]) + "\n", encoding="utf-8")
    assert "the position jumps" not in servobench("identify", logger, *COLUMNS).out


@pytest.mark.parametrize("command", ["identify", "inspect", "why", "stability"])
def test_the_name_of_a_second_column_says_that_whole_numbers_behind_commas_are_two(
    servobench: Command, tmp_path: Path, command: str
) -> None:
    """A file that could as well hold one column of numbers with decimal commas."""
    file = tmp_path / "counter.csv"
    rows = (f"{round(1e4 * -np.expm1(-0.05 * k))},{5 * k}\n" for k in range(200))
    file.write_text("".join(rows), encoding="utf-8")
    stated = ("--output", "1:rpm", "--time", "2:ms", "--chain", "none", "--starts-at-rest")
    if command == "inspect":
        stated = stated[:-1]

    ended = servobench(command, file, *COMMANDS[command], "--input-value", "6:V", *stated)

    assert ended.status in (0, 3), ended.err  # one level doesn't tell the gain
    assert "decimal comma" not in ended.err
