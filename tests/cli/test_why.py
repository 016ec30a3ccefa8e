"""`servobench why`: a claim or a data sheet against a file, as tables, sentences and JSON."""

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from servobench.identification.reconciliation.explanation import SCHEMA
from tests.cli.conftest import Command, Ended
from tests.cli.test_identify import motor, noisy, table
from tests.cli.test_schema import objects

SCHEMA_TEXT = files("servobench").joinpath("identification/schemas/why-1.json").read_text(encoding="utf-8")
BEHIND = "derivative | lowpass 50 rad/s"


def explanation(ended: Ended) -> dict[str, Any]:
    """Return the explanation on standard output, which holds nothing else; checked against the packaged schema."""
    found: dict[str, Any] = json.loads(ended.out)
    jsonschema.Draft202012Validator(json.loads(SCHEMA_TEXT)).validate(found)
    return found


@pytest.fixture
def position(tmp_path: Path) -> Path:
    columns = noisy(motor())
    return table(
        tmp_path / "position.csv",
        {"t [s]": columns["t"], "u [V]": columns["u"], "theta [rad]": columns["theta"]},
    )


def test_no_object_of_the_schema_may_have_or_lack_a_key_that_it_doesn_t_say() -> None:
    schema = json.loads(SCHEMA_TEXT)
    jsonschema.Draft202012Validator.check_schema(schema)
    described = [each for each in objects(schema) if "properties" in each]

    assert schema["properties"]["schema"] == {"const": SCHEMA}
    assert len(described) > 8
    for each in described:
        assert each["additionalProperties"] is False
        assert sorted(each["required"]) == sorted(each["properties"])


def test_the_paper_s_run_behind_its_filter_names_the_lag_and_how_much_it_explains(
    servobench: Command, finished_run: Path
) -> None:
    file = finished_run / "recording.mcap"
    ended = servobench("why", file, "--chain", BEHIND, "--claimed", "tau=0.13", "--json")

    found = explanation(ended)
    first = found["causes"][0]
    assert (ended.status, first["name"]) == (0, "measurement_lag")
    assert first["explains"][0]["share"] == pytest.approx(0.75, abs=0.02)
    assert sum(each["probability"] for each in found["hypotheses"]) == pytest.approx(1.0)
    assert found["nearest_reading"] == "step_63"
    assert "most likely cause is the lag" in ended.err


def test_people_get_the_causes_the_readings_and_the_answer_in_words(
    servobench: Command, finished_run: Path
) -> None:
    file = finished_run / "recording.mcap"
    ended = servobench("why", file, "--chain", BEHIND, "--claimed", "tau=0.13", "--nominal", "qube_servo_2")

    assert ended.status == 0
    assert ended.out.splitlines()[1].split()[:2] == ["measurement", "lag"]
    said = " ".join(ended.out.split())
    for words in (
        "0.1223 s",
        "(nearest)",
        "75 %",
        "11 Ω instead of 8.4 Ω",
        "raw counts",
        "probabilities rest on",
    ):
        assert words in said


def test_a_sheet_alone_is_held_against_the_data(servobench: Command, finished_run: Path) -> None:
    ended = servobench("why", finished_run / "recording.mcap", "--nominal", "qube_servo_2", "--json")

    found = explanation(ended)
    assert (ended.status, found["origin"], found["agrees"]) == (0, "data sheet", True)
    assert found["readings"] == []


def test_a_gain_is_claimed_in_the_unit_of_the_data(servobench: Command, position: Path) -> None:
    """K is 20 rad/(s·V), so that 191 rpm/V, to half a unit, agree, and 382 are twice that."""
    agreed = explanation(servobench("why", position, "--claimed", "gain=191rpm/V", "--json"))
    doubled = explanation(servobench("why", position, "--claimed", "gain=382rpm/V", "--json"))

    assert agreed["agrees"] is True
    assert doubled["causes"][0]["name"] == "encoder_scale"
    assert doubled["causes"][0]["needed"]["text"] == "all speeds 2 times"


def test_data_that_can_t_support_a_model_end_with_3(servobench: Command, tmp_path: Path) -> None:
    columns = motor(samples=400)
    file = table(
        tmp_path / "still.csv",
        {"t [s]": columns["t"], "u [V]": 0 * columns["u"] + 1.0, "theta [rad]": columns["theta"]},
    )

    ended = servobench("why", file, "--claimed", "tau=0.13", "--json")

    found = explanation(ended)
    assert (ended.status, found["verdict"], found["causes"]) == (3, "refused", [])
    assert "can't support a model" in found["sentences"][0]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "nothing to explain"),
        (("--claimed", "0.13"), "NAME=VALUE"),
        (("--claimed", "tua=0.13"), "did you mean 'tau'"),
        (("--claimed", "tau=0.13", "--method", "step_36"), "step_63"),
        (("--claimed", "tau=0.13", "--nominal", "qube"), "qube_servo_2"),
        (("--claimed", "tau=0.13", "--claimed", "tau=0.14"), "once"),
    ],
)
def test_a_mistake_ends_with_2_and_says_what_can_be(
    servobench: Command, position: Path, words: tuple[str, ...], said: str
) -> None:
    ended = servobench("why", position, *words)

    assert ended.status == 2
    assert said in ended.err
    assert "Traceback" not in ended.err


def test_a_report_is_written_where_one_can_be(
    servobench: Command, finished_run: Path, tmp_path: Path
) -> None:
    file = finished_run / "recording.mcap"
    page = tmp_path / "why.html"
    ended = servobench("why", file, "--chain", BEHIND, "--claimed", "tau=0.13", "--report", page)

    assert ended.status == 0
    assert f"report: {page}" in ended.out
    assert "Why 0.13" in page.read_text(encoding="utf-8")
    for nowhere, said in (
        (tmp_path, "is a folder"),
        (tmp_path / "no" / "x.html", "no folder"),
        (file, "overwritten"),
    ):
        refused = servobench("why", file, "--claimed", "tau=0.13", "--report", nowhere)
        assert (refused.status, said in refused.err) == (2, True)


def test_the_folder_of_a_run_is_its_recording(servobench: Command, finished_run: Path) -> None:
    folder, file = (
        servobench("why", path, "--claimed", "tau=0.13", "--json")
        for path in (finished_run, finished_run / "recording.mcap")
    )

    assert folder.status == file.status == 0
    assert folder.out == file.out
