"""The page of the JSON Schemas is what the schemas say, and they say what each key means."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from tests.docs.pages import DOCS
from tests.test_house import tool

SCHEMAS = sorted(each.name for each in tool("write_schemas").schema_files())


def objects(schema: Any, where: str = "") -> Iterator[tuple[str, Any]]:
    """Every key of every object in a schema, with what is said of it."""
    for key, value in schema.get("properties", {}).items():
        yield f"{where}{key}", value
        yield from objects(value, f"{where}{key}.")
    for word in ("items", "additionalProperties"):
        if isinstance(schema.get(word), dict):
            yield from objects(schema[word], f"{where}*.")
    for name, value in schema.get("$defs", {}).items():
        yield from objects(value, f"{name}: ")


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_key_says_what_it_means(name: str) -> None:
    (found,) = [each for each in tool("write_schemas").schema_files() if each.name == name]
    schema = json.loads(found.read_text(encoding="utf-8"))

    silent = [where for where, value in objects(schema) if not {"description", "const"} & set(value)]

    assert silent == []


def test_the_page_is_that_of_the_schemas() -> None:
    page = (DOCS / "reference" / "schemas.md").read_text(encoding="utf-8")

    assert tool("write_schemas").page() == page, "run make generate"


@pytest.mark.parametrize("name", SCHEMAS)
def test_the_page_says_which_command_prints_it(name: str) -> None:
    assert name.removesuffix(".json") in tool("write_schemas").FROM
