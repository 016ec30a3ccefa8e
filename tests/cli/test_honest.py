"""`servobench honest`: an experiment repeated, recordings held together, and mistakes told."""

import json
from importlib.resources import files
from pathlib import Path

import jsonschema

from tests.cli.conftest import Command

EXPERIMENT = """
[experiment]
duration = "2 s"
[signal]
type = "prbs"
low = "1 V"
high = "6 V"
bit_time = "0.106 s"
[device]
name = "twin"
[device.settings]
torque_noise = 1e-6
"""


def test_an_experiment_is_repeated_and_its_recordings_say_the_same_again(
    servobench: Command, tmp_path: Path
) -> None:
    file, folder = tmp_path / "asked.toml", tmp_path / "runs"
    file.write_text(EXPERIMENT, encoding="utf-8")

    first = servobench("honest", file, "--runs", "3", "--out", folder, "--json")
    assert first.status == 0
    told = json.loads(first.out)
    schema = json.loads(
        files("servobench").joinpath("identification/schemas/honest-1.json").read_text(encoding="utf-8")
    )
    jsonschema.Draft202012Validator(schema).validate(told)
    assert told["runs"] == ["run 1", "run 2", "run 3"]
    values = told["parameters"]["gain"]["values"]
    assert len(set(values)) == 3
    assert sorted(path.name for path in folder.iterdir()) == [
        "experiment.toml",
        "run-1.mcap",
        "run-2.mcap",
        "run-3.mcap",
    ]

    again = servobench("honest", *sorted(folder.glob("*.mcap")), "--json")
    assert again.status == 0
    assert json.loads(again.out)["parameters"]["gain"]["values"] == values


def test_words_and_pictures(servobench: Command, tmp_path: Path) -> None:
    file = tmp_path / "asked.toml"
    file.write_text(EXPERIMENT, encoding="utf-8")
    shown = servobench("honest", file, "--runs", "2", "--out", tmp_path / "runs")

    assert shown.status == 0
    assert "2 runs, structure first_order_one_way" in shown.out
    assert "over all runs" in shown.out
    assert shown.out.count("o-") >= 6  # two runs and both together, of gain and of time constant


def test_a_folder_with_something_in_it_is_not_written_over(servobench: Command, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    ended = servobench("honest", "--runs", "2", "--out", tmp_path)

    assert ended.status == 2
    assert "isn't an empty folder" in ended.err


def test_one_run_is_too_few_and_the_same_one_twice_shows_nothing(
    servobench: Command, finished_run: Path
) -> None:
    file = finished_run / "recording.mcap"
    alone = servobench("honest", file)
    assert alone.status == 2
    assert "a comparison needs at least two" in alone.err

    twice = servobench("honest", file, file)
    assert "All runs are identical to the last count" in twice.out
    assert "no sign" not in twice.out
