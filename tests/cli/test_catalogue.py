"""`servobench signals`, `servobench controllers` and `servobench devices` list what there is, as the registries know it."""

import json
import re
from importlib.resources import files
from typing import Annotated, Any, Literal

import jsonschema
import pytest
from pydantic import Field

from servobench.cli.catalogue import default_text, meaning
from servobench.core.registry import Registry
from servobench.core.settings import In, Settings, Time, Voltage
from servobench.rig.devices.base import DEVICES
from servobench.systems.control.base import CONTROLLERS
from servobench.systems.signals.base import SIGNALS
from tests.cli.conftest import Command


class Example(Settings):
    """Settings of all kinds."""

    needed: Voltage
    """What has to be given [V]."""
    level: Voltage = 1.5
    """A value [V]."""
    left_out: Time | None = None
    """A time [s]."""
    levels: tuple[Annotated[float, In("V")], ...] = (0.0, 1.0)
    """Some values, each held [V]."""
    number: int = Field(default=8, ge=2)
    """A number, from 2 on."""
    flag: bool = True
    """Whether it is so."""
    choice: Literal["one", "two"] = "one"
    """One of two."""
    told: Literal["left", "right"] = "left"
    """On the left or on the right."""
    bare: str = ""


@pytest.mark.parametrize(
    ("name", "default", "said"),
    [
        ("needed", "required", "What has to be given."),
        ("level", "1.5 V", "A value."),
        ("left_out", "not set [s]", "A time."),
        ("levels", "0, 1 V", "Some values, each held."),
        ("number", "8", "A number, from 2 on."),
        ("flag", "true", "Whether it is so."),
        ("choice", "one", "One of two: one, two."),
        ("told", "left", "On the left or on the right."),
        ("bare", "", ""),
    ],
)
def test_a_setting_has_its_default_with_its_unit_and_its_meaning(name: str, default: str, said: str) -> None:
    field = Example.model_fields[name]

    assert (default_text(field), meaning(field)) == (default, said)


@pytest.mark.parametrize(("command", "kind"), [("signals", SIGNALS), ("controllers", CONTROLLERS)])
def test_all_of_a_kind_and_all_their_settings_are_listed(
    servobench: Command, command: str, kind: Registry[Any]
) -> None:
    said = servobench(command).out

    for name in kind.names():
        block = re.search(rf"^{name}  .*?^$", said, re.MULTILINE | re.DOTALL)
        assert block is not None, name
        for setting in kind[name].model_fields:
            assert re.search(rf"^  {setting} ", block[0], re.MULTILINE), (name, setting)


def test_all_devices_and_all_their_settings_are_listed(servobench: Command) -> None:
    said = servobench("devices").out

    for name in DEVICES.names():
        assert re.search(rf"^{name}  ", said, re.MULTILINE)
        for setting in DEVICES[name].Settings.model_fields:
            assert re.search(rf"^  {setting} ", said, re.MULTILINE), (name, setting)


@pytest.mark.parametrize(
    "command",
    [
        "chains", "controllers", "devices", "estimators", "exports", "faults", "formats", "signals", "structures", "studies",
    ],
)  # fmt: skip
def test_a_list_is_the_same_as_json(servobench: Command, command: str) -> None:
    told = json.loads(servobench(command, "--json").out)
    schema = json.loads(
        files("servobench").joinpath("cli/schemas/catalogue-1.json").read_text(encoding="utf-8")
    )

    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.Draft202012Validator(schema).validate(told)
    words = servobench(command).out
    for member in told["members"]:
        assert re.search(rf"^{re.escape(member['name'])}  ", words, re.MULTILINE), member["name"]
        assert member["sentence"]
    first = told["members"][0]["name"]
    assert [each["name"] for each in json.loads(servobench(command, first, "--json").out)["members"]] == [
        first
    ]


def test_a_structure_that_is_made_from_its_name_can_be_asked_for(servobench: Command) -> None:
    ended = servobench("structures", "rational_2_1", "--json")

    (member,) = json.loads(ended.out)["members"]
    assert member["name"] == "rational_2_1"
    assert len(member["parameters"]) >= 4


@pytest.mark.parametrize("command", ["signals", "structures", "estimators", "formats", "exports", "studies"])
def test_a_name_that_is_not_there_is_reported_with_the_nearest(servobench: Command, command: str) -> None:
    ended = servobench(command, "nothing-like-it")

    assert ended.status == 2
    assert "known: " in ended.err
    assert ended.out == ""


def test_one_can_be_asked_for(servobench: Command) -> None:
    ended = servobench("signals", "square")

    assert ended.out.startswith("square  A square wave.\n")
    assert re.search(r"frequency +0\.4 Hz +Periods in a second\.", ended.out)
    assert "chirp" not in ended.out


def test_the_exercises_are_a_list_too(servobench: Command) -> None:
    told = json.loads(servobench("lab", "list", "--json").out)

    assert told["kind"] == "exercise"
    words = servobench("lab", "list").out
    assert all(member["name"] in words and member["sentence"] for member in told["members"])
