"""`servobench tune`: gains from a run, a result or a recording; its figures as JSON; and what it refuses."""

import json
import re
from importlib.resources import files
from pathlib import Path

import jsonschema
import numpy as np
import pytest

import servobench as sb
from servobench.rig.experiment import read_experiment
from tests.cli.conftest import Command
from tests.export.conftest import known_together

WISH = ("--damping", "0.8", "--bandwidth", "20 rad/s")


def test_the_gains_can_be_pasted_and_are_what_the_json_says(servobench: Command, finished_run: Path) -> None:
    made = servobench("tune", finished_run, *WISH, "--json")

    assert made.status == 0
    told = json.loads(made.out)
    schema = json.loads(
        files("servobench").joinpath("systems/schemas/tuning-1.json").read_text(encoding="utf-8")
    )
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.Draft202012Validator(schema).validate(told)
    assert told["sample_time"] == 0.002  # the data's own
    assert told["controller"]["type"] == "pid"
    assert told["toml"] in made.err
    read = read_experiment(f'[signal]\ntype = "square"\n{told["toml"]}').controller
    assert read.model_dump(exclude_none=True) == {  # type: ignore[attr-defined]
        key: value for key, value in told["controller"].items() if key != "type"
    }


def test_a_run_its_result_and_its_recording_give_the_same_gains(
    servobench: Command, finished_run: Path
) -> None:
    said = [
        servobench("tune", path, "--loop", "speed", "--lambda", "50ms")
        for path in (finished_run, finished_run / "result.json", finished_run / "recording.mcap")
    ]

    assert [each.status for each in said] == [0, 0, 0]
    assert len({each.out for each in said}) == 1
    assert "pid for the speed, every 2 ms, by lambda_tuning" in said[0].out
    assert "phase margin" in said[0].out
    assert re.search(r"time constant +0\.05 +0\.05 +s", said[0].out)  # wished, and obtained


@pytest.mark.parametrize(
    ("words", "because"),
    [
        (("--damping", "0.8", "--bandwidth", "300"), "the fastest possible is about"),
        (("--lambda", "2.1 ms"), "a loop can't be faster than"),
        (("--lambda", "1 m"), "--lambda"),
        (("--poles", "a,b"), "expected numbers separated by commas"),
        (("--loop", "torque", *WISH), "no loop called 'torque'"),
        (("--as", "pdi", *WISH), "did you mean 'pid'"),
        (("--bandwidth", "-3", "--damping", "1"), "expected more than 0 rad/s"),
        (("--method", "ziegler"), "no method called 'ziegler'; known: lambda_tuning, pole_placement"),
        ((), "needs --damping and --bandwidth"),
    ],
)  # fmt: skip
def test_what_cannot_be_had_is_reported_without_a_traceback(
    servobench: Command, finished_run: Path, words: tuple[str, ...], because: str
) -> None:
    ended = servobench("tune", finished_run, *words)

    assert ended.status == 2
    assert because in ended.err
    assert "Traceback" not in ended.err


def test_a_result_that_is_not_there_is_reported(servobench: Command, tmp_path: Path) -> None:
    ended = servobench("tune", tmp_path / "nothing.json", *WISH)

    assert ended.status == 2
    assert "there is no result" in ended.err


def test_the_direction_of_a_gain_margin_is_printed(servobench: Command, finished_run: Path) -> None:
    both = servobench("tune", finished_run, "--poles=-40,-35+26j").out
    one = servobench("tune", finished_run, *WISH).out

    assert re.search(r"gain margin downwards \(factor\) +[\d.]+ ", both)
    assert "gain margin (factor)" in both
    assert "downwards" not in one


@pytest.mark.parametrize("command", [("tune",), ("design", "--voltage-limit", "5", "--from")], ids=" ".join)
def test_a_table_is_asked_for_what_identify_asks_for(
    servobench: Command, tmp_path: Path, command: tuple[str, ...]
) -> None:
    """The columns go by their names as in `identify`; the input was asked for."""
    table = tmp_path / "logger.csv"
    rows = "".join(f"{0.01 * k:.2f},{k // 50 % 2},{k}\n" for k in range(200))
    table.write_text(f"time,voltage,angle\n{rows}", encoding="utf-8")

    asked, identified = (
        servobench(*command, table, *(WISH if command == ("tune",) else ())),
        servobench("identify", table),
    )

    assert "the unit of the output `angle`" in identified.err
    assert "the unit of the output `angle`" in asked.err
    assert "which channel is the input" not in asked.err


def test_gains_for_what_the_data_leave_open_say_so(servobench: Command, tmp_path: Path) -> None:
    file = tmp_path / "result.json"
    file.write_text(json.dumps(known_together()), encoding="utf-8")
    wish = ("--damping", 0.8, "--bandwidth", 20, "--controller-sample-time", "2ms")

    ended = servobench("tune", file, *wish, "--json")

    said = [
        each["sentence"] for each in json.loads(ended.out)["findings"] if each["code"] == "motor-not-known"
    ]
    assert said[0] == "The Coulomb voltage isn't known, only that it is at most 0.41 V."
    assert "The time constant isn't known by itself" in said[1]
    assert said[-1].endswith("record other levels for a wider range.")


def test_an_axis_that_moves_in_metres_is_none_of_its_loops(servobench: Command, tmp_path: Path) -> None:
    file = tmp_path / "axis.csv"
    with sb.connect("twin") as motor:
        run = sb.run(sb.Experiment(duration="3 s"), motor)
    angle = run["counts"].values * 2 * np.pi / 2048
    rows = zip(run["applied"].values, 0.01 * angle, strict=True)
    lines = [f"{0.002 * k:.3f},{u:.6f},{x:.8f}" for k, (u, x) in enumerate(rows)]
    file.write_text("\n".join(["t [s],u [V],x [m]", *lines]) + "\n")

    ended = servobench("tune", file, "--input", "u", "--output", "x", "--bandwidth", "10", "--damping", "0.8")

    assert ended.status == 2
    assert "moves in m" in ended.err
    assert "--unit" not in ended.err
