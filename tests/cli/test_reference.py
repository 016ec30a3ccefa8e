"""docs/reference/commands.md lists the commands and options that there are, the statuses, and the keys of a result."""

import json
import re
from collections.abc import Iterator
from dataclasses import fields
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
import typer.main

from servobench.cli import failures
from servobench.cli.app import app
from servobench.cli.options import Reading

PAGE = Path(__file__).resolve().parent.parent.parent / "docs" / "reference" / "commands.md"
COMMANDS: dict[str, Any] = typer.main.get_command(app).commands  # type: ignore[attr-defined]


def section(heading: str) -> str:
    """Return the text below a heading, up to the next one; that of a command of a group has a lower heading."""
    text = PAGE.read_text(encoding="utf-8")
    match = re.search(rf"^##+ {re.escape(heading)}$(.*?)(?=^##+ |\Z)", text, re.MULTILINE | re.DOTALL)
    assert match is not None, heading
    return match[1]


def leaves(commands: dict[str, Any], group: str = "") -> Iterator[tuple[str, Any]]:
    """Each command that is no group, by what is typed for it."""
    for name, command in commands.items():
        if hasattr(command, "commands"):
            yield from leaves(command.commands, f"{name} ")
        else:
            yield f"{group}{name}", command


def options(command: Any) -> set[str]:
    return {word for each in command.params for word in each.opts if word.startswith("--")} - {"--help"}


def test_every_command_is_described() -> None:
    listed = re.findall(r"^\|.*?\|", section_before_first(), re.MULTILINE)

    assert set(re.findall(r"\[`(\w+)`\]", " ".join(listed))) == set(COMMANDS)


def section_before_first() -> str:
    return PAGE.read_text(encoding="utf-8").partition("\n## ")[0]


READING = {f"--{field.name.replace('_', '-')}" for field in fields(Reading)}
"""The options of every command that takes a recording; described once for all of them."""


LISTS = ("devices", "signals", "controllers", "structures", "estimators", "formats", "exports", "studies")
"""The options that one section describes together."""


@pytest.mark.parametrize("name", LISTS)
def test_every_list_is_described_with_its_option(name: str) -> None:
    assert f"servobench {name} [NAME]" in section("lists")
    assert options(COMMANDS[name]) == {"--json"}


def test_the_options_of_reading_are_described() -> None:
    items = [item for item in section("reading a recording").split("\n") if item.startswith("- `--")]

    assert {option for item in items for option in re.findall(r"`(--[a-z-]+) [A-Z]", item)} == READING


@pytest.mark.parametrize(
    ("name", "command"),
    [each for each in leaves(COMMANDS) if each[0] not in LISTS],
)
def test_every_option_of_a_command_is_described_and_no_other(name: str, command: Any) -> None:
    items = [item for item in section(name).split("\n") if item.startswith("- `--")]
    described = {
        option for item in items for option in re.findall(r"`(--[a-z-]+)", item.partition(" names")[0])
    }

    if "[options of reading](#reading-a-recording)" in section(name):
        described |= READING

    assert described == options(command)


def test_the_options_without_a_command_are_described() -> None:
    described = set(re.findall(r"^- `(--[a-z]+)`", section_before_first(), re.MULTILINE)) - {"--help"}

    assert described == {"--version", "--debug"}


def test_the_statuses_are_those_of_the_code() -> None:
    described = {int(row) for row in re.findall(r"^\| (\d+) \|", section("Exit status"), re.MULTILINE)}

    assert described == {
        value for name, value in vars(failures).items() if name.isupper() and isinstance(value, int)
    }


def test_the_keys_of_a_result_are_those_of_the_schema() -> None:
    schema = json.loads(
        files("servobench").joinpath("identification/schemas/result-2.json").read_text(encoding="utf-8")
    )
    rows = re.findall(r"^\| (`.*?) \|", section("JSON"), re.MULTILINE)

    assert {key for row in rows for key in re.findall(r"`(\w+)`", row)} == set(schema["properties"])
