"""Tables in JSON, as scripts write them."""

import json
from pathlib import Path
from typing import Any

import pytest

from servobench.core.errors import FormatError, UsageError
from servobench.recordings.formats.base import save
from tests.recordings.formats.tables import codes, columns, finding, loaded
from tests.recordings.native.samples import small

NUMBERS = {"t": [0.0, 0.1, 0.2], "u": [1.0, 2.5, 2.5], "y": [0.0, 3.0, 7.0]}
OBJECTS = [dict(zip(NUMBERS, row, strict=True)) for row in zip(*NUMBERS.values(), strict=True)]


@pytest.mark.parametrize(
    "text",
    [
        json.dumps(OBJECTS),
        json.dumps(OBJECTS, indent=2),
        json.dumps(NUMBERS),
        json.dumps({"motor": "small", "counts": 2048, **NUMBERS}),
        "\n".join(map(json.dumps, OBJECTS)),
    ],
)
@pytest.mark.parametrize("name", ["log.json", "log.txt"])
def test_a_table_in_json_is_read_however_it_is_nested(text: str, name: str, tmp_path: Path) -> None:
    recording = loaded(tmp_path, text, name)

    assert columns(recording) == NUMBERS
    assert recording["u"].t is not None
    assert recording.source.format == "json_table"


@pytest.mark.parametrize("samples", [OBJECTS * 4, {name: values * 4 for name, values in NUMBERS.items()}])
def test_the_only_table_within_an_object_is_read(samples: Any, tmp_path: Path) -> None:
    recording = loaded(tmp_path, json.dumps({"title": "run 3", "samples": samples}), "log.json")

    assert columns(recording)["y"] == NUMBERS["y"] * 4
    assert "`title`" in finding(recording.findings, "columns-not-numbers").sentence


def test_a_missing_value_is_nan_and_a_text_is_reported(tmp_path: Path) -> None:
    rows: list[dict[str, Any]] = [*OBJECTS, {"t": 0.3, "u": None, "y": "off"}, {"t": 0.4, "y": 9.0}]

    recording = loaded(tmp_path, json.dumps(rows), "log.json")

    assert str(columns(recording)["u"]) == "[1.0, 2.5, 2.5, nan, nan]"
    assert "'off', read as NaN: sample 4" in finding(recording.findings, "cell-not-a-number").sentence


def test_a_column_of_words_is_left_out_and_named(tmp_path: Path) -> None:
    recording = loaded(tmp_path, json.dumps([{**each, "state": "run"} for each in OBJECTS]), "log.json")

    assert columns(recording) == NUMBERS
    assert codes(recording.findings)[0] == "columns-not-numbers"


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ({"a": OBJECTS * 4, "b": OBJECTS * 4}, "not a table: it has `a`, `b`. Expected a list of objects"),
        ({"t": [1, 2, 3], "u": [1, 2]}, "not a table: it has `t`, `u`"),
        ({"parameters": OBJECTS}, "not a table: it has `parameters`"),
        ([], "an empty list"),
        ([1, OBJECTS[0]], r"a list of 2 \(an object, int\)"),
        ("run", "a single str"),
        ([{"state": "on"}, {"state": "off"}], "no column of numbers, only `state`"),
    ],
)
def test_json_without_one_table_is_an_error_that_says_what_can_be_read(
    content: Any, why: str, tmp_path: Path
) -> None:
    with pytest.raises(FormatError, match=why):
        loaded(tmp_path, json.dumps(content), "log.json")


def test_a_table_in_json_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="can't be written"):
        save(small(), tmp_path / "log.jsonl")
