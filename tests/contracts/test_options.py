"""An option means the same in every command that has it: one name, one text, one type, one default."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import pytest
import typer.main

from servobench.cli.app import app
from servobench.cli.options import Reading
from servobench.recordings.reading import ReadingOptions

TAKE_RECORDINGS = (
    "convert", "design", "export", "fleet identify", "fleet watch", "honest", "identify", "inspect", "stability", "tune", "why",
)  # fmt: skip
IDENTIFY = tuple(name for name in TAKE_RECORDINGS if name not in ("convert", "inspect"))
READING = tuple(f"--{field.name.replace('_', '-')}" for field in fields(Reading))

DIFFERENT = {
    "--as": "a controller for tune, a program for export",
    "--folder": "where the panel keeps recordings, and where a lab's exercises are",
    "--method": "how a claim was found for why, how gains are found for tune",
    "--out": "a file for one command, a folder for another, each with a name of its own",
    "--secret": "made by the first command of an assessment, and needed by the others",
}
"""The options of one name that differ, and why they may: what they say is what their command is about."""


def leaves(commands: dict[str, Any], group: str = "") -> Iterator[tuple[str, Any]]:
    """Each command that is no group, by what is typed for it."""
    for name, command in commands.items():
        if hasattr(command, "commands"):
            yield from leaves(command.commands, f"{name} ")
        else:
            yield f"{group}{name}", command


COMMANDS = dict(leaves(typer.main.get_command(app).commands))  # type: ignore[attr-defined]


def options(command: str) -> dict[str, Any]:
    """The options of a command, by name."""
    return {each.opts[-1]: each for each in COMMANDS[command].params if each.param_type_name == "option"}


def meaning(option: Any) -> tuple[object, ...]:
    """All that a user sees of an option, but for whether it has to be given."""
    return option.help, option.metavar, option.default, option.multiple, option.is_flag, option.envvar


MEANINGS: dict[str, dict[str, tuple[object, ...]]] = defaultdict(dict)
for _command in COMMANDS:
    for _name, _option in options(_command).items():
        MEANINGS[_name][_command] = meaning(_option)
SHARED = [name for name, meanings in MEANINGS.items() if len(meanings) > 1]


@pytest.mark.parametrize("name", [name for name in SHARED if name not in DIFFERENT])
def test_an_option_means_the_same_in_every_command(name: str) -> None:
    assert len(set(MEANINGS[name].values())) == 1, MEANINGS[name]


@pytest.mark.parametrize("name", DIFFERENT)
def test_an_option_that_may_differ_does(name: str) -> None:
    assert len(set(MEANINGS[name].values())) > 1


@pytest.mark.parametrize("command", TAKE_RECORDINGS)
def test_every_command_that_takes_a_recording_has_all_options_of_reading(command: str) -> None:
    assert set(READING) <= set(options(command))


@pytest.mark.parametrize("command", IDENTIFY)
def test_every_command_that_identifies_may_be_reported_that_the_motor_rested(command: str) -> None:
    assert "--starts-at-rest" in options(command)


def test_the_options_of_reading_are_pythons() -> None:
    """Arrays can't be given on a command line, and a column brings its unit along."""
    arrays = {"t", "u", "y", "input_unit", "output_unit"}

    assert set(ReadingOptions.__annotations__) - arrays == set(Reading().options)
