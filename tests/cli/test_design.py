"""`servobench design`: an experiment that can be run, its figures as JSON, and mistakes told."""

import json
from importlib.resources import files
from pathlib import Path

import jsonschema
import pytest

from tests.cli.conftest import Command


def test_the_design_can_be_run_and_is_what_the_json_says(servobench: Command, tmp_path: Path) -> None:
    file = tmp_path / "designed.toml"
    made = servobench("design", "--voltage-limit", "8 V", "--duration", "2", "--out", file, "--json")

    assert made.status == 0
    told = json.loads(made.out)
    schema = json.loads(
        files("servobench").joinpath("identification/schemas/design-1.json").read_text(encoding="utf-8")
    )
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.Draft202012Validator(schema).validate(told)
    assert told["experiment"] == file.read_text(encoding="utf-8")
    assert "limited by: voltage and time" in made.err

    ran = servobench("run", file, "--out", tmp_path / "run", "--json")
    assert ran.status == 0
    for name in ("gain", "time_constant"):
        # Another friction than assumed, and one draw of the rounding: the same within a half.
        assert ran.result["parameters"][name]["sd"] == pytest.approx(told["chosen"]["sd"][name], rel=0.5)


def test_a_result_says_what_is_known_once_the_encoder_is_known(
    servobench: Command, finished_run: Path
) -> None:
    words = ("design", "--voltage-limit", "5", "--duration", "1", "--from", finished_run / "result.json")
    without = servobench(*words)
    assert without.status == 2
    assert "--counts-per-rev" in without.err

    told = servobench(*words, "--counts-per-rev", "2048")
    assert told.status == 0
    assert "the motor is that of" in told.out


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--for", "speed"), "known: both, gain, time_constant"),
        (("--nominal", "qube_servo_2", "--from", "x.csv"), "give one of them"),
        (("--nominal", "nothing"), "qube_servo_2"),
        (("--travel-limit", "4 V"), "--travel-limit"),
        (("--from", "nowhere.json"), "there is no result nowhere.json"),
        (("--duration", "100000"), "a duration of 100000 s at a sample time of 0.002 s is 5e+07 samples"),
        (("--counts-per-rev", "2048"), "--counts-per-rev can't be used with a data sheet"),
        (("--starts-at-rest",), "give a recording with --from FILE"),
        (("--from", "x.csv", "--counts-per-rev", "2048"), "there is no file x.csv"),
    ],
)
def test_mistakes_are_reported(servobench: Command, words: tuple[str, ...], expected: str) -> None:
    ended = servobench("design", "--voltage-limit", "10", *words)

    assert ended.status == 2
    assert expected in ended.err
