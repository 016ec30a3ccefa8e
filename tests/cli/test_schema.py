"""The packaged schema says what a result is, no less and no more."""

import json
from copy import deepcopy
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from servobench.core.finding import Severity, Verdict
from servobench.identification.result import SCHEMA
from tests.cli.conftest import checked

SCHEMA_TEXT = files("servobench").joinpath("identification/schemas/result-2.json").read_text(encoding="utf-8")


def objects(schema: Any) -> list[dict[str, Any]]:
    """Return all schemas of objects within a schema."""
    inner = schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ()
    found = [each for part in inner for each in objects(part)]
    return [schema, *found] if isinstance(schema, dict) and schema.get("type") == "object" else found


@pytest.fixture
def result(finished_run: Path) -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads((finished_run / "result.json").read_text(encoding="utf-8"))
    return loaded


def test_the_schema_is_one() -> None:
    schema = json.loads(SCHEMA_TEXT)

    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["properties"]["schema"] == {"const": SCHEMA}


def test_no_object_may_have_or_lack_a_key_that_the_schema_doesn_t_say() -> None:
    described = [each for each in objects(json.loads(SCHEMA_TEXT)) if "properties" in each]

    assert len(described) > 10
    for each in described:
        assert each["additionalProperties"] is False
        assert sorted(each["required"]) == sorted(each["properties"])


def test_verdicts_and_severities_are_those_that_there_are() -> None:
    schema = json.loads(SCHEMA_TEXT)

    assert schema["properties"]["verdict"]["enum"] == [str(each) for each in Verdict]
    assert schema["$defs"]["finding"]["properties"]["severity"]["enum"] == [str(each) for each in Severity]


def test_a_result_is_allowed(result: dict[str, Any]) -> None:
    checked(result)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("verdict",), "certain"),
        (("schema",), "servobench.result/1"),
        (("extra",), 1),
        (("findings", 0, "severity"), "error"),
        (("findings", 0, "rows"), [1]),
        (("findings", 0, "rows"), [0, 1]),
        (("parameters", "gain", "value"), "23.8"),
        (("parameters", "gain", "level"), 95),
        (("parameters", "gain", "interval"), [1.0]),
        (("parameters", "Gain"), {}),
        (("transfer_function", "output"), "torque"),
        (("transfer_function", "delay"), None),
        (("records", 0, "samples"), 1.5),
        (("provenance", "created"), "yesterday"),
        (("provenance", "inputs_sha256"), ["abc"]),
    ],
    ids=lambda value: ".".join(map(str, value)) if isinstance(value, tuple) else repr(value),
)
def test_what_is_no_result_isn_t_allowed(
    result: dict[str, Any], path: tuple[str | int, ...], value: object
) -> None:
    changed: Any = deepcopy(result)
    place = changed
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value

    with pytest.raises(jsonschema.ValidationError):
        checked(changed)
