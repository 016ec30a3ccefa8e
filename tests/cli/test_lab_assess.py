"""`servobench lab assess` and `lab mark`: a class gets its motors and its marks."""

import csv
import json
import os
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from tests.cli.conftest import Command, Ended

MINE = """+++
title = "Mine"
order = 7

[experiment]
duration = "2 s"
chain = "derivative | lowpass 50 rad/s"

[signal]
type = "square"
low = "-2 V"
high = "2 V"
frequency = "1 Hz"

[[blanks]]
id = "tau"
label = "The time constant"
unit = "s"
answer = "time_constant"
tolerance = "interval + 3 %"

[[blanks]]
id = "turns"
label = "Counts in two turns"
unit = "counts"
answer = "2 * counts_per_rev"
tolerance = "exact"
+++

Identify your recording.
"""


@pytest.fixture
def given(tmp_path: Path) -> Path:
    (tmp_path / "mine.md").write_text(MINE, encoding="utf-8")
    (tmp_path / "roster.csv").write_text("student,mail\nada,a@x\n=blaise,b@x\n", encoding="utf-8")
    return tmp_path


def told(ended: Ended, schema: str) -> dict[str, Any]:
    """The answer as JSON, which holds nothing else; checked against the packaged schema."""
    found: dict[str, Any] = json.loads(ended.out)
    described = json.loads(
        files("servobench").joinpath(f"cli/schemas/{schema}.json").read_text(encoding="utf-8")
    )
    jsonschema.Draft202012Validator.check_schema(described)
    jsonschema.Draft202012Validator(described).validate(found)
    return found


def to_class(command: str, given: Path) -> tuple[object, ...]:
    roster, secret = given / "roster.csv", given / "secret"
    return "lab", command, given / "mine.md", roster, "--secret", secret


def test_a_class_gets_its_folders_and_its_marks(servobench: Command, given: Path) -> None:
    hand, marks = given / "hand", given / "marks.csv"

    handed = servobench(*to_class("assess", given), "--out", hand)

    assert handed.status == 0, handed.err
    assert f"a new secret: {given / 'secret'}" in handed.out
    if os.name == "posix":
        assert (given / "secret").stat().st_mode & 0o777 == 0o600
    ada, blaise = sorted(hand.iterdir(), key=lambda path: path.name != "ada")
    for folder in (ada, blaise):
        assert {path.name for path in folder.iterdir()} == {
            "answers.csv",
            "mine.csv",
            "mine.html",
            "mine.mcap",
        }

    # A student measures, and fills the form in.
    identified = servobench("identify", ada / "mine.mcap", "--json")
    tau = identified.result["parameters"]["time_constant"]["value"]
    form = (ada / "answers.csv").read_text(encoding="utf-8")
    filled = form.replace("tau,,", f"tau,{1000 * tau:.5g} ms,").replace("turns,,", "turns,2048,")
    (ada / "answers.csv").write_text(filled, encoding="utf-8")

    done = servobench(*to_class("mark", given), "--forms", hand, "--marks", marks)

    assert done.status == 0, done.err
    with marks.open(encoding="utf-8-sig", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["student"], row["points"], row["of"]) for row in rows] == [
        ("ada", "1", "2"),
        ("'=blaise", "0", "2"),
    ]
    assert rows[0]["tau"] == "right"
    assert rows[0]["turns: feedback"] == "It is too small: it is half of it."
    assert rows[1]["tau"] == "missing"


def test_what_comes_out_is_reported_as_json(servobench: Command, given: Path) -> None:
    hand, marks = given / "hand", given / "marks.csv"

    handed = told(servobench(*to_class("assess", given), "--out", hand, "--json"), "handed-out-1")
    found = told(servobench(*to_class("mark", given), "--forms", hand, "--marks", marks, "--json"), "marks-1")

    assert [each["student"] for each in handed["students"]] == ["ada", "=blaise"]
    assert [(b["id"], b["asked_of"]) for b in handed["blanks"]] == [("tau", 2), ("turns", 2)]
    assert handed["blanks"][1]["passed_by_others"] == 1.0
    assert [b["same_for_all"] for b in handed["blanks"]] == [False, True]
    assert [each["student"] for each in found["students"]] == ["ada", "=blaise"]
    assert {b["verdict"] for each in found["students"] for b in each["blanks"]} == {"missing"}
    assert found["stray"] == []


def test_a_form_that_can_t_be_read_is_reported_and_the_others_get_their_marks(
    servobench: Command, given: Path
) -> None:
    hand = given / "hand"
    servobench(*to_class("assess", given), "--out", hand)
    (hand / "ada" / "answers.csv").write_bytes(b"PK\x03\x04")

    ended = servobench(*to_class("mark", given), "--forms", hand, "--marks", given / "marks.csv")

    assert ended.status == 0
    assert "answers.csv: is a spreadsheet's own file; save it as CSV" in " ".join(ended.out.split())
    assert "There is no form." in ended.out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["lab", "assess", "step", "--secret", "s"], "Missing argument 'ROSTER.csv'"),
        (["lab", "assess", "step", "r.csv"], "Missing option '--secret'"),
        (["lab", "assess", "step", "r.csv", "--secret", "s"], "r.csv: can't be read"),
        (["lab", "assess", "stip", "r.csv", "--secret", "s"], "no exercise called 'stip'"),
        (["lab", "mark", "step", "r.csv", "--secret", "s", "--marks", "m.csv"], "Missing option '--forms'"),
        (["lab", "mark", "step", "r.csv", "--secret", "s", "--forms", "."], "Missing option '--marks'"),
        (["panel", "--secret", "s"], "--secret needs --assess STUDENT"),
        (["panel", "--assess", "ada"], "--assess needs --secret FILE and --exercise NAME"),
        (["panel", "--assess", "ada", "--secret", "s", "--exercise", "step"], "there is no secret"),
        (
            ["panel", "--assess", "ada", "--secret", "s", "--exercise", "step", "--device", "twin"],
            "--assess and --device don't go together",
        ),
    ],
)
def test_what_doesn_t_go_together_is_reported(
    servobench: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], said: str
) -> None:
    monkeypatch.chdir(tmp_path)

    ended = servobench(*words)

    assert ended.status == 2
    assert said in ended.err
    assert list(tmp_path.iterdir()) == []  # no secret, no folder


def test_marks_take_the_secret_that_the_motors_were_made_with(servobench: Command, given: Path) -> None:
    hand = given / "hand"
    servobench(*to_class("assess", given), "--out", hand)
    marking = ("lab", "mark", given / "mine.md", given / "roster.csv", "--forms", hand, "--marks")

    missing = servobench(*marking, given / "m.csv", "--secret", given / "gone")
    (given / "other").write_bytes(bytes(32))
    (given / "other").chmod(0o600)
    other = servobench(*marking, given / "m.csv", "--secret", given / "other")
    among = servobench(*marking, hand / "m.csv", "--secret", given / "secret")
    nowhere = servobench(*to_class("mark", given), "--forms", given / "no", "--marks", given / "m.csv")

    assert (missing.status, other.status, among.status, nowhere.status) == (2, 2, 2, 2)
    assert "isn't a folder; expected the one with the forms" in nowhere.err
    assert "there is no secret" in missing.err
    assert not (given / "gone").exists()
    assert "none of the 2 forms has a code of this class" in other.err
    assert "is among the forms" in among.err
    assert not (given / "m.csv").exists()


def test_what_is_handed_out_goes_into_a_new_folder(servobench: Command, given: Path) -> None:
    (given / "hand").mkdir()
    (given / "hand" / "old").touch()

    ended = servobench(*to_class("assess", given), "--out", given / "hand")

    assert ended.status == 2
    assert "isn't an empty folder" in ended.err
    assert not (given / "secret").exists()
