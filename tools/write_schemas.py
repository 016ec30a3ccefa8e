"""Write docs/reference/schemas.md from the JSON Schemas that are part of the package; a test holds the page equal to this."""

import json
from collections.abc import Iterator
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

PAGE = Path(__file__).resolve().parent.parent / "docs" / "reference" / "schemas.md"

HEAD = """# What the commands print as JSON

<!-- Written by tools/write_schemas.py from src/servobench/*/schemas: change those, run `make generate`. -->

With `--json` a command prints one object on standard output. Its key `schema` says which of these it is, and in which version.
The schemas are JSON Schema 2020-12 and part of the package, in the folder `schemas` of the room that prints
them. `a.b` is the key `b` of the object `a`, and `a.*.b` that of each object in `a`.
"""

FROM = {
    "catalogue-1": "[`servobench signals --json`](commands.md#lists) and the other lists",
    "commission-1": "[`servobench commission --json`](commands.md#commission)",
    "design-1": "[`servobench design --json`](commands.md#design)",
    "handed-out-1": "[`servobench lab assess --json`](commands.md#lab-assess)",
    "each-1": "[`servobench identify --each --json`](commands.md#identify), a line for each file",
    "ensemble-1": "[`servobench ensemble --json`](commands.md#ensemble)",
    "fleet-1": "[`servobench fleet SOURCE --json`](commands.md#fleet-identify)",
    "repeatability-1": "[`servobench fleet repeatability --json`](commands.md#fleet-repeatability)",
    "honest-1": "[`servobench honest --json`](commands.md#honest)",
    "inspection-1": "[`servobench inspect --json`](commands.md#inspect)",
    "lab-1": "[`servobench lab do --json`](commands.md#lab-do)",
    "marks-1": "[`servobench lab mark --json`](commands.md#lab-mark)",
    "result-1": "results of earlier versions, which are still read",
    "result-2": "[`servobench run --json`](commands.md#run), [`identify --json`](commands.md#identify) and a run's `result.json`",
    "stability-1": "[`servobench stability --json`](commands.md#stability)",
    "tuning-1": "[`servobench tune --json`](commands.md#tune)",
    "why-1": "[`servobench why --json`](commands.md#why)",
    "written-1": "[`servobench convert --json`](commands.md#convert), `export --json` and `recover --json`",
}


def schema_files() -> list[Traversable]:
    """Return the files of all schemas, in whatever room they are."""
    folders = [room.joinpath("schemas") for room in files("servobench").iterdir() if room.is_dir()]
    return [each for folder in folders if folder.is_dir() for each in folder.iterdir()]


def page() -> str:
    """Return the page."""
    schemas = {
        each.name.removesuffix(".json"): json.loads(each.read_text(encoding="utf-8"))
        for each in schema_files()
    }
    lines = [HEAD]
    for name in sorted(schemas):
        schema = schemas[name]
        source = f"From {FROM[name]}. " if name in FROM else ""
        title = schema["properties"]["schema"]["const"]
        lines += [f"## {title}", "", f"{source}{_text(schema.get('description', ''))}", "", *_table(schema)]
        for part, inner in sorted(schema.get("$defs", {}).items()):
            if "properties" in inner:
                lines += [f"### {part} of {title}", ""]
                lines += [_text(inner["description"]), ""] if "description" in inner else []
                lines += _table(inner)
    return "\n".join(lines).rstrip() + "\n"


def _table(schema: dict[str, Any]) -> list[str]:
    """A row for each key of an object, those of objects within it after their own."""
    return ["| key | type | meaning |", "| --- | --- | --- |", *_rows(schema, ""), ""]


def _rows(schema: dict[str, Any], inside: str) -> Iterator[str]:
    required = set(schema.get("required", ()))
    for key, value in schema["properties"].items():
        absent = "" if key in required else "may be left out; "
        meaning = f"{absent}{value.get('description', '')}".rstrip("; ")
        yield f"| `{inside}{key}` | {_type(value)} | {_text(meaning)} |".replace("|  |", "| |")
        if "properties" in value:
            yield from _rows(value, f"{inside}{key}.")
        for each in (value.get("items"), value.get("additionalProperties")):
            if isinstance(each, dict) and "properties" in each:
                yield from _rows(each, f"{inside}{key}.*.")


def _type(schema: dict[str, Any]) -> str:
    """The type of a value, in a few words."""
    if "$ref" in schema:
        return schema["$ref"].rpartition("/")[2].replace("_", " ")
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return ", ".join(f"`{json.dumps(choice)}`".replace('"', "") for choice in schema["enum"])
    for word in ("anyOf", "oneOf"):
        if word in schema:
            return " or ".join(_type(each) for each in schema[word])
    kinds = schema.get("type", "anything")
    told = " or ".join([kinds] if isinstance(kinds, str) else kinds)
    if "items" in schema:
        told += f" of {_type(schema['items'])}"
    if isinstance(schema.get("additionalProperties"), dict):
        told += f", each {_type(schema['additionalProperties'])}"
    return told


def _text(sentence: str) -> str:
    """A sentence as it may stand in a cell of a table."""
    return sentence.replace("|", "\\|").replace("_", "\\_").replace("<", "&lt;")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
