"""`servobench ensemble`: what is typed, printed, written and returned."""

import csv
import json
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from servobench.fleet import ensemble as fleet_ensemble
from servobench.fleet.ensemble import IdentifiedMotor
from tests.cli.conftest import Command

FEW = ("--spread", "resistance=10%", "--count", "20", "--threads", "1")

LOOP = """
[experiment]
duration = "300 ms"
[signal]
type = "step"
final = "90 deg"
[controller]
type = "pid"
kp = 3.0
kd = 0.06
"""


def document(text: str) -> dict[str, Any]:
    """The one JSON object in a text, held against its schema."""
    found: dict[str, Any] = json.loads(text)
    schema = json.loads(
        files("servobench").joinpath("cli/schemas/ensemble-1.json").read_text(encoding="utf-8")
    )
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.Draft202012Validator(schema).validate(found)
    return found


def test_the_folder_gets_report_table_json_and_experiment(servobench: Command, tmp_path: Path) -> None:
    out = tmp_path / "out"
    ended = servobench("ensemble", *FEW, "--out", out)

    assert ended.status == 0
    assert "±10\u00a0% of the resistance moves the time constant by ±10\u00a0%." in ended.out
    assert {each.name for each in out.iterdir()} == {
        "report.html",
        "motors.csv",
        "ensemble.json",
        "experiment.toml",
    }
    assert len(list(csv.reader((out / "motors.csv").read_text(encoding="utf-8").splitlines()))) == 21
    document((out / "ensemble.json").read_text(encoding="utf-8"))
    again = servobench("ensemble", *FEW, "--out", out)
    assert again.status == 2
    assert "isn't an empty folder" in again.err


def test_json_is_all_that_stands_on_standard_output(servobench: Command, tmp_path: Path) -> None:
    file = tmp_path / "loop.toml"
    file.write_text(LOOP, encoding="utf-8")
    ended = servobench("ensemble", file, *FEW, "--seed", "3", "--json", "--out", tmp_path / "out")

    told = document(ended.out)
    assert told["motors"] == 20
    assert told["seed"] == 3
    assert set(told["outcomes"]) == {"gain", "time_constant", "overshoot", "settling_time", "phase_margin"}
    assert told["identified"] == {"motors": 0, "verdicts": {}, "coverage": {}}


def test_motors_of_a_random_seed_can_be_drawn_again(servobench: Command, tmp_path: Path) -> None:
    file = tmp_path / "loop.toml"
    file.write_text(LOOP.replace("[experiment]", '[experiment]\nseed = "random"'), encoding="utf-8")
    servobench("ensemble", file, *FEW, "--out", tmp_path / "one")
    servobench("ensemble", tmp_path / "one" / "experiment.toml", *FEW, "--out", tmp_path / "other")

    one, other = ((tmp_path / name / "motors.csv").read_bytes() for name in ("one", "other"))
    assert one == other


def test_every_motor_is_identified(servobench: Command, tmp_path: Path) -> None:
    words = ("--spread", "inertia=10%", "--count", "3", "--threads", "1", "--identify", "--json")
    told = document(servobench("ensemble", *words, "--out", tmp_path / "out").out)

    assert told["identified"]["motors"] == sum(told["identified"]["verdicts"].values()) == 3
    assert told["identified"]["coverage"]["gain"]["known"] == 3


def test_ctrl_c_keeps_what_was_identified(
    servobench: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> Iterator[IdentifiedMotor]:
        yield IdentifiedMotor(
            number=0, verdict="trusted", reason="", values={"gain": (23.0, 0.1, 22.8, 23.2)}
        )
        raise KeyboardInterrupt

    monkeypatch.setattr(fleet_ensemble, "identify_ensemble", interrupted)
    ended = servobench("ensemble", *FEW, "--identify", "--out", tmp_path / "out")

    assert ended.status == 130
    assert "interrupted: 1 of 20 motors identified" in ended.err
    rows = list(csv.DictReader((tmp_path / "out" / "motors.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["verdict"] for row in rows] == ["trusted", *[""] * 19]
    assert (tmp_path / "out" / "report.html").exists()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ((), "--spread resistance=10%"),
        (("--spread", "resistance"), "expected NAME=TOLERANCE"),
        (("--spread", "resistance=5"), "percentage such as 10%"),
        (("--spread", "resistance=150%"), "less than 100%"),
        (("--spread", "resistence=5%"), "did you mean 'resistance'"),
        (("--spread", "inertia=5%", "--spread", "inertia=6%"), "given before"),
        (("--spread", "inertia=5%", "--count", "0"), "'--count': Input should be greater than or equal to 1"),
        (("--spread", "inertia=5%", "--count", "1000000"), "less than or equal to 200000"),
        (("nowhere.toml", "--spread", "inertia=5%"), "no such file"),
    ],
)
def test_a_mistake_is_reported_and_leaves_no_folder(
    servobench: Command, tmp_path: Path, words: tuple[str, ...], told: str
) -> None:
    ended = servobench("ensemble", *words, "--out", tmp_path / "out")

    assert ended.status == 2
    assert told in " ".join(ended.err.split())
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("device", "told"),
    [
        ('name = "rig"', "an ensemble is simulated"),
        ('[device.settings]\ndelay = "1 ms"', "the twin's delay is 0.001"),
        ("[device.settings]\nresistence = 1", "loop.toml:13"),
        ('faults = [{ name = "blocked_shaft" }]', "injects faults"),
    ],
)
def test_a_device_that_cannot_be_simulated_so_is_reported(
    servobench: Command, tmp_path: Path, device: str, told: str
) -> None:
    file = tmp_path / "loop.toml"
    file.write_text(f"{LOOP}[device]\n{device}\n", encoding="utf-8")
    ended = servobench("ensemble", file, *FEW, "--out", tmp_path / "out")

    assert ended.status == 2
    assert told in " ".join(ended.err.split())
