"""`servobench identify --each`: many files, each by itself."""

import json
from importlib.resources import files
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from tests.cli.conftest import Command, checked
from tests.fleet.motors import write_motor


@pytest.fixture
def fleet(tmp_path: Path) -> list[Path]:
    """Two motors and a file in between that is none."""
    found = [tmp_path / name for name in ("one.csv", "torn.csv", "two.csv")]
    write_motor(found[0], 20.0)
    found[1].write_text("voltage,speed\n1,2\n", encoding="utf-8")
    write_motor(found[2], 30.0)
    return found


COLUMNS = ("--output", "speed:rad/s", "--chain", "none")


def test_each_file_has_a_line_and_a_bad_one_does_not_stop_the_others(
    servobench: Command, fleet: list[Path]
) -> None:
    ended = servobench("identify", *fleet, *COLUMNS, "--each", "--json")
    schema = json.loads(files("servobench").joinpath("cli/schemas/each-1.json").read_text(encoding="utf-8"))
    lines = [json.loads(line) for line in ended.out.splitlines()]

    assert ended.status == 2
    jsonschema.Draft202012Validator.check_schema(schema)
    for line in lines:
        jsonschema.Draft202012Validator(schema).validate(line)
    assert [line["file"] for line in lines] == [str(file) for file in fleet]
    gains = [checked(line["result"])["parameters"]["gain"]["value"] for line in (lines[0], lines[2])]
    assert gains == pytest.approx([20.0, 30.0], rel=1e-3)
    assert lines[1]["result"] is None
    assert lines[1]["error"] in ended.err


def test_each_file_has_a_folder(servobench: Command, fleet: list[Path], tmp_path: Path) -> None:
    other = tmp_path / "elsewhere"
    other.mkdir()
    write_motor(other / "one.csv", 10.0)
    out = tmp_path / "out"

    ended = servobench("identify", fleet[0], other / "one.csv", *COLUMNS, "--each", "--out", out)

    assert ended.status == 0, ended.err
    assert sorted(path.name for path in out.iterdir()) == ["one-1", "one-2"]
    for folder, gain in (("one-1", 20.0), ("one-2", 10.0)):
        assert {path.name for path in (out / folder).iterdir()} == {"result.json", "report.html"}
        result = checked(json.loads((out / folder / "result.json").read_text(encoding="utf-8")))
        assert result["parameters"]["gain"]["value"] == pytest.approx(gain, rel=1e-3)
    assert len(ended.out.splitlines()) == 2
    again = servobench("identify", *fleet, *COLUMNS, "--each", "--out", out)
    assert again.status == 2
    assert "isn't an empty folder" in again.err


def test_several_files_are_said_to_be_fitted_jointly(servobench: Command, fleet: list[Path]) -> None:
    both = servobench("identify", fleet[0], fleet[2], *COLUMNS)
    alone = servobench("identify", fleet[0], *COLUMNS)

    assert "2 recordings from 2 files, fitted jointly; --each fits each file by itself" in both.out
    assert "jointly" not in alone.out


@pytest.mark.parametrize(
    ("words", "because"),
    [
        (("--out", "results"), "--out results needs --each"),
        (("--each", "--report", "report.html"), "--report and --each don't go together"),
        (("--each", "--validate-with", "other.csv"), "--validate-with and --each don't go together"),
    ],
)
def test_what_does_not_go_together_is_reported(
    servobench: Command, fleet: list[Path], words: tuple[str, ...], because: str
) -> None:
    ended = servobench("identify", fleet[0], *words)

    assert ended.status == 2
    assert because in ended.err


def test_what_was_done_before_an_interrupt_is_kept_and_said(
    servobench: Command, fleet: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from servobench.report.document import Report

    write, reports = Report.write, []

    def interrupted(report: Report, path: Path) -> None:
        reports.append(path)
        if len(reports) == 2:
            raise KeyboardInterrupt
        write(report, path)

    monkeypatch.setattr(Report, "write", interrupted)
    ended = servobench("identify", *fleet, *COLUMNS, "--each", "--out", tmp_path / "out")

    assert ended.status == 130
    assert "interrupted: " in ended.err
    (whole,) = (tmp_path / "out").iterdir()
    assert (whole / "result.json").exists()
    assert (whole / "report.html").exists()


def test_a_line_says_what_is_known_and_prints_no_number_for_what_is_not(
    servobench: Command, tmp_path: Path
) -> None:
    """One step from rest: the speed at its level, and not how gain and friction share it."""
    t = np.arange(0, 2, 0.005)
    speed = np.round(20.0 * -np.expm1(-t / 0.1), 2)
    rows = "".join(f"{x:.3f},1,{w:.2f}\n" for x, w in zip(t, speed, strict=True))
    (tmp_path / "step.csv").write_text(f"t,voltage,speed\n{rows}", encoding="utf-8")

    ended = servobench("identify", tmp_path / "step.csv", *COLUMNS, "--starts-at-rest", "--each")

    assert ended.status == 0, ended.err
    assert "gain known together only" in ended.out
    assert "speed at 1 V 20.00\N{NO-BREAK SPACE}±" in ended.out


def test_a_copy_is_named_with_what_it_is_a_copy_of(
    servobench: Command, fleet: list[Path], tmp_path: Path
) -> None:
    copy = tmp_path / "copy.csv"
    copy.write_bytes(fleet[0].read_bytes())

    files_given = (fleet[0], fleet[2], copy, fleet[2])
    first, other, third, again = servobench("identify", *files_given, *COLUMNS, "--each").out.splitlines()

    assert third.endswith(f"; a copy of {fleet[0]}")
    assert again.endswith(f"; a copy of {fleet[2]}")
    assert "copy of" not in first + other


def test_a_reason_names_options_and_no_keywords_of_python(servobench: Command, tmp_path: Path) -> None:
    """The input is another motor's: the sentence says which column to name."""
    file = tmp_path / "other.csv"
    write_motor(file, 20.0)
    head, *rows = file.read_text(encoding="utf-8").splitlines()
    cells = [row.split(",") for row in rows]
    shuffled = np.random.default_rng(1).permutation(len(cells))
    mixed = [f"{t},{cells[k][1]},{speed}" for (t, _, speed), k in zip(cells, shuffled, strict=True)]
    file.write_text("\n".join([head, *mixed]) + "\n", encoding="utf-8")

    said = servobench("identify", file, *COLUMNS, "--each").out
    explained = " ".join(servobench("why", file, *COLUMNS, "--claimed", "tau=0.2").out.split())

    assert "with --input COL:UNIT" in said
    assert "with --input COL:UNIT" in explained
