"""Every command that says something says it as JSON too, and nothing else on standard output."""

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import typer.main

from servobench.cli.app import app
from tests.cli.conftest import Command

WITHOUT = {
    "completion": "a script for a shell",
    "panel": "a server that goes on until it is stopped",
    "lab": "a group, whose commands have it",
    "fleet": "a group, whose commands have it but `watch`, which goes on until it is stopped",
}


def told(name: str, text: str) -> dict[str, Any]:
    """The only object in a text, which keeps to its schema."""
    schema = json.loads(
        files("servobench").joinpath(f"cli/schemas/{name}-1.json").read_text(encoding="utf-8")
    )
    jsonschema.Draft202012Validator.check_schema(schema)
    found: dict[str, Any] = json.loads(text)
    jsonschema.Draft202012Validator(schema).validate(found)
    return found


def test_every_command_has_it_but_those_that_answer_nothing() -> None:
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    lacking = {
        name
        for name, each in commands.items()
        if "--json" not in {word for p in each.params for word in p.opts}
    }

    assert lacking == set(WITHOUT)


def test_what_is_in_a_file(servobench: Command, finished_run: Path) -> None:
    ended = servobench("inspect", finished_run / "recording.mcap", "--json")
    found = told("inspection", ended.out)

    assert found["source"]["format"] == "mcap"
    (recording,) = found["recordings"]
    assert {"applied", "counts"} <= {each["name"] for each in recording["channels"]}
    assert recording["missing"] == []
    assert recording["mapping"]["input"] == "applied:V"
    assert "applied" in ended.err


def test_what_is_missing_is_asked_for_by_options_and_gone_once_it_is_said(
    servobench: Command, tmp_path: Path
) -> None:
    file = tmp_path / "a.csv"
    file.write_text("clock,a,b\n" + "".join(f"{10 * k},{k % 3},{k}\n" for k in range(50)), encoding="utf-8")

    asked = told("inspection", servobench("inspect", file, "--json").out)["recordings"][0]
    said = ("--time", "clock:ms", "--input", "a:V", "--output", "b:rad")
    answered = told("inspection", servobench("inspect", file, *said, "--json").out)["recordings"][0]

    assert any("--input" in each for each in asked["missing"])
    assert answered["missing"] == []
    assert answered["mapping"]["output"] == "b:rad"


@pytest.mark.parametrize("command", ["convert", "export"])
def test_which_files_were_written(
    servobench: Command, finished_run: Path, tmp_path: Path, command: str
) -> None:
    target = tmp_path / "out.csv"
    words: tuple[object, ...] = (finished_run / "recording.mcap", target)
    if command == "export":
        words = (finished_run, "--as", "csv", "--out", target)

    found = told("written", servobench(command, *words, "--json").out)

    assert found["files"] == [str(target)]
    assert target.exists()
    if command == "convert":
        assert found["recordings"][0]["samples"] == 5000
