"""`servobench lab`: exercises listed, done, checked, and written as pages."""

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from servobench.lab.exercise_file import exercise, exercises
from servobench.lab.page import exercise_page
from servobench.lab.worked_exercise import WorkedExercise
from tests.cli.conftest import Command, Ended

MINE = """+++
title = "Mine"
sentence = "One of my own."
order = 7

[experiment]
duration = "2 s"
chain = "derivative | lowpass 50 rad/s"

[signal]
type = "step"
final = "2 V"

[studies.twice]
type = "values"
title = "Worked out from the encoder"

[[studies.twice.rows]]
label = "two turns"
answer = "2 * counts_per_rev"
unit = "counts"
paper = 4000

[[blanks]]
id = "turns"
label = "Counts in two turns"
unit = "counts"
answer = "twice_value_1"
tolerance = "exact"

[[corrections]]
where = "II.B"
paper = "4000 counts"
ours = "{}"
answer = "twice_value_1"
unit = "counts"
digits = 6
why = "A turn has 2048. Two have twice as many."
+++

## To do

1. Count.

{{ twice }}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "mine"
    made.mkdir()
    (made / "mine.md").write_text(MINE, encoding="utf-8")
    return made


def told(ended: Ended) -> dict[str, Any]:
    """The answer as JSON, which holds nothing else; checked against the packaged schema."""
    found: dict[str, Any] = json.loads(ended.out)
    schema = json.loads(files("servobench").joinpath("lab/schemas/lab-1.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.Draft202012Validator(schema).validate(found)
    return found


def test_the_exercises_are_listed_in_their_order(servobench: Command) -> None:
    ended = servobench("lab", "list")

    names = [line.split()[0] for line in ended.out.splitlines()[1:] if not line.startswith("   ")]
    assert ended.status == 0
    assert names == [each.name for each in exercises()]


def test_a_folder_of_ones_own_is_listed_and_a_mistake_is_reported_with_its_line(
    servobench: Command, folder: Path
) -> None:
    (folder / "bad.md").write_text(MINE.replace('"2 s"', '"2 V"'), encoding="utf-8")

    ended = servobench("lab", "list", "--folder", folder)

    assert ended.status == 2
    assert "mine  Mine. One of my own." in ended.out
    assert f"{folder / 'bad.md'}:7: experiment.duration: '2 V' is a voltage" in ended.err


def test_a_device_that_is_not_here_is_reported_with_the_file_that_names_it(
    servobench: Command, folder: Path
) -> None:
    text = MINE.replace("[signal]", '[device]\nname = "twn"\n\n[signal]', 1)
    (folder / "mine.md").write_text(text, encoding="utf-8")

    ended = servobench("lab", "do", "mine", "--folder", folder)

    assert ended.status == 2
    assert (
        f"{folder / 'mine.md'}: the table [device]: no device called 'twn' (did you mean 'twin'?)"
        in ended.err
    )
    assert servobench("lab", "list", "--folder", folder).status == 0  # another computer may have it


def test_what_comes_out_is_not_reported_before_it_is_asked_for(servobench: Command, folder: Path) -> None:
    ended = servobench("lab", "do", folder / "mine.md")

    assert ended.status == 0
    assert "(--studies shows the results)" in ended.out.splitlines()
    assert "4096" not in ended.out
    assert "II.B" not in ended.out


def test_an_exercise_shows_text_study_blanks_and_corrections_without_the_answers(
    servobench: Command, folder: Path
) -> None:
    ended = servobench("lab", "do", folder / "mine.md", "--studies")

    assert ended.status == 0
    lines = ended.out.splitlines()
    assert not any(line != line.rstrip() for line in lines)
    assert [line for line in lines if line in ("Mine", "To do", " 1 Count.")] == [
        "Mine",
        "To do",
        " 1 Count.",
    ]
    in_words = [" ".join(line.split()) for line in lines]
    assert "two turns 4096 4000 -2.3 % counts" in in_words  # 4000/4096 - 1 = -0.0234
    assert "turns counts Counts in two turns" in in_words
    assert "II.B: 4000 counts" in in_words
    assert "here: 4096 counts" in in_words


def test_the_solution_is_reported_when_it_is_asked_for(servobench: Command) -> None:
    without, with_it = servobench("lab", "do", "encoder"), servobench("lab", "do", "encoder", "--solution")

    assert "2048" not in without.out
    assert "2048 counts" in with_it.out.replace("\u00a0", " ")


def test_answers_are_checked(servobench: Command) -> None:
    ended = servobench("lab", "do", "encoder", "--answer", "counts=2048", "--answer", "degrees = 0.3 deg")

    assert ended.status == 0
    assert [line[2:] for line in ended.out.splitlines() if line.startswith("  ✓")] == [
        "✓ counts = 2048: Right."
    ]
    assert "✗ degrees = 0.3 deg: It is too large" in ended.out
    assert "What to do" not in ended.out


def test_json_is_what_its_schema_says(servobench: Command, folder: Path) -> None:
    asked = ("lab", "do", "mine", "--folder", folder, "--answer", "turns=4095", "--json")
    (found,) = told(servobench(*asked))["exercises"]

    assert found["blanks"][0] | {"sentence": ""} == {
        "id": "turns",
        "label": "Counts in two turns",
        "unit": "counts",
        "right_answer": None,
        "given": "4095",
        "right": False,
        "sentence": "",
    }
    (column,) = [c for c in found["studies"]["twice"]["tables"][0]["columns"] if c["name"] == "value"]
    assert (column["values"], column["paper"]) == ([4096], [4000])
    assert (found["corrections"][0]["value"], found["device"]) == (4096, "twin")
    (solved,) = told(servobench(*asked, "--solution"))["exercises"]
    assert solved["blanks"][0]["right_answer"].replace("\u00a0", " ") == "4096 counts"


def test_a_recording_of_ones_own_is_what_answers_are_held_against(
    servobench: Command, folder: Path, tmp_path: Path
) -> None:
    file = tmp_path / "asked.toml"
    text = """
[experiment]
duration = "3.5 s"
[signal]
type = "step"
final = "1 V"
start = "1 s"
[device.settings]
disc_inertia = "6e-5 kg*m^2"
"""
    file.write_text(text, encoding="utf-8")
    assert servobench("run", file, "--out", tmp_path / "run").status == 0

    given = ("--answer", "time_constant=0.0991")
    own = servobench("lab", "do", "step", "--recorded", tmp_path / "run" / "recording.mcap", *given)
    twin = servobench("lab", "do", "step", *given)

    assert "✓ time_constant" in twin.out
    assert "✗ time_constant" in own.out


def test_a_recording_of_another_experiment_is_not_held_against_an_exercise(
    servobench: Command, tmp_path: Path
) -> None:
    file = tmp_path / "wave.toml"
    text = '[experiment]\nduration = "2 s"\nsample_time = "1 ms"\n[signal]\ntype = "square"\nhigh = "3 V"\nfrequency = "1 Hz"\n'
    file.write_text(text, encoding="utf-8")
    assert servobench("run", file, "--out", tmp_path / "run").status == 0

    ended = servobench("lab", "do", "step", "--recorded", tmp_path / "run" / "recording.mcap", "--solution")

    assert ended.status == 2
    assert "its signal and sample time are not the exercise's" in ended.err
    assert "servobench lab do step --page PAGE.html" in ended.err
    assert ended.err.startswith(f"Error: {tmp_path / 'run' / 'recording.mcap'} comes from another experiment")


def test_answers_to_a_recording_that_was_cut_short_are_reported_that_it_was(
    servobench: Command, tmp_path: Path
) -> None:
    file = tmp_path / "step.toml"
    file.write_text(exercise("step").experiment.to_toml(), encoding="utf-8")
    assert servobench("run", file, "--out", tmp_path / "run").status == 0
    whole = (tmp_path / "run" / "recording.mcap").read_bytes()
    (tmp_path / "torn.mcap").write_bytes(whole[: len(whole) // 3])  # its end, and how the run ended, are lost

    told = {
        name: servobench("lab", "do", "step", "--recorded", path, "--answer", "level=63.2 %").out
        for name, path in (("whole", tmp_path / "run" / "recording.mcap"), ("torn", tmp_path / "torn.mcap"))
    }

    assert "ended early" not in told["whole"]
    assert "ended early" in told["torn"]
    assert all("✓ level" in said for said in told.values())


def test_a_table_from_elsewhere_is_not_held_against_an_exercise_and_reported_where_it_belongs(
    servobench: Command, tmp_path: Path
) -> None:
    file = tmp_path / "own.csv"
    rows = "".join(f"{0.002 * k:.3f},{float(k > 20)},{k * k}\n" for k in range(200))
    file.write_text(f"time [s],voltage [V],position [counts]\n{rows}", encoding="utf-8")

    ended = servobench("lab", "do", "step", "--recorded", file)

    assert ended.status == 2
    assert "doesn't name its device" in ended.err
    assert f"`servobench identify {file}` finds" in ended.err


def test_a_page_is_written_where_it_is_asked_for(servobench: Command, folder: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"

    ended = servobench("lab", "do", "mine", "--folder", folder, "--page", page)

    assert ended.status == 0
    assert f"page: {page}" in ended.out
    assert "Worked out from the encoder" in page.read_text(encoding="utf-8")


def test_all_exercises_are_pages_in_a_folder(servobench: Command, folder: Path, tmp_path: Path) -> None:
    (folder / "other.md").write_text(MINE.replace('"Mine"', '"Other"'), encoding="utf-8")

    ended = servobench("lab", "page", "--folder", folder, "--out", tmp_path / "pages", "--json")

    assert ended.status == 0, ended.err
    assert [each["name"] for each in told(ended)["exercises"]] == ["mine", "other"]
    names = sorted(path.name for path in (tmp_path / "pages").iterdir())
    assert names == ["index.html", "mine.html", "other.html", "paper.html"]
    again = servobench("lab", "page", "--folder", folder, "--out", tmp_path / "pages")
    assert (again.status, "isn't an empty folder" in again.err) == (2, True)


def test_pages_are_of_the_exercises_that_are_named_each_once(
    servobench: Command, folder: Path, tmp_path: Path
) -> None:
    (folder / "other.md").write_text(MINE.replace('"Mine"', '"Other"'), encoding="utf-8")

    words = ("other", "other", "--folder", folder, "--out", tmp_path / "pages", "--json")
    ended = servobench("lab", "page", *words)

    assert [each["name"] for each in told(ended)["exercises"]] == ["other"]
    assert not (tmp_path / "pages" / "mine.html").exists()
    assert (tmp_path / "pages" / "other.html").exists()


@pytest.mark.parametrize(
    ("done", "said"),
    [
        (0, "interrupted before the first of 2 exercises was done; there is no page in {}"),
        (1, "interrupted: 1 of 2 exercises are in {}, and its index.html lists the missing ones"),
    ],
)
def test_who_interrupts_all_exercises_is_reported_what_is_kept_and_where(
    servobench: Command, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, done: int, said: str
) -> None:
    (folder / "other.md").write_text(MINE.replace('"Mine"', '"Other"'), encoding="utf-8")
    written = []

    def page(worked: WorkedExercise, **settings: Any) -> str:
        written.append(worked)
        if len(written) == done + 1:
            raise KeyboardInterrupt
        return exercise_page(worked, **settings)

    monkeypatch.setattr("servobench.lab.page.exercise_page", page)
    pages = tmp_path / "pages"
    ended = servobench("lab", "page", "--folder", folder, "--out", pages)

    assert ended.status == 130
    assert said.format(pages) in ended.err
    kept = sorted(path.name for path in pages.glob("*"))  # a folder that nothing came into is taken away
    assert kept == (["index.html", "mine.html", "paper.html"] if done else [])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("do", "nothing"), "no exercise called 'nothing'"),
        (("do", "encodr"), "did you mean 'encoder'?"),
        (("page", "encoder", "nothing"), "no exercise called 'nothing'"),
        (("do", "encoder", "--recorded", "a.mcap", "--device", "twin"), "don't go together"),
        (("do", "--json"), "Missing argument"),
        (("do", "encoder", "--answer", "2048"), "'2048' is no answer"),
        (
            ("do", "encoder", "--answer", "counts=2048", "--answer", "counts = 512"),
            "--answer gives two values for 'counts', '2048' and '512'",
        ),
        (("do", "encoder", "--answer", "cuonts=2048"), "no blank called 'cuonts' (did you mean 'counts'?)"),
        (("do", "encoder", "--device", "nothing"), "no device called 'nothing'"),
        (("do", "encoder", "--device", "replay"), "--device replay: its setting 'file' is missing: a native"),
        (("do", "encoder", "--device", "replay"), "--recorded FILE"),
        (("do", "encoder", "--device", "assigned"), "its setting 'student' is missing: whose motor"),
        (("page", "--device", "replay"), "--device replay: its setting 'file' is missing"),
        (("do", "encoder", "--recorded", "nowhere.mcap"), "nowhere.mcap"),
        (("do", "encoder", "--page", "nowhere/page.html"), "--page nowhere"),
        (("list", "--folder", "nowhere"), "--folder nowhere isn't a folder"),
        (("page", "--folder", "nowhere"), "--folder nowhere isn't a folder"),
        (("do", "nowhere.md"), "nowhere.md: can't be read"),
    ],
)
def test_a_mistake_is_reported(
    servobench: Command,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)

    ended = servobench("lab", *words)

    assert ended.status == 2
    assert said in ended.err
    assert "Traceback" not in ended.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "new"),
    [
        ("", "list"),
        ("--folder DIR", "list"),
        ("step", "do step"),
        ("step --solution", "do step"),
        ("step --answers gain=3 --out page.html", "do step --answer BLANK=VALUE --page PAGE.html"),
        ("--all --out pages", "page"),
        ("step --assess r.csv --secret s --out d", "assess step ROSTER.csv --secret FILE"),
        (
            "mine.md --assess=r.csv --secret=s --answers=d --marks=m.csv",
            "mark mine.md ROSTER.csv --secret FILE --forms DIR --marks MARKS.csv",
        ),
    ],
)
def test_a_form_from_when_lab_was_one_command_is_answered_by_the_new_one(
    servobench: Command, words: str, new: str
) -> None:
    ended = servobench("lab", *words.split())

    assert ended.status == 2
    assert ended.err.startswith("Error: `servobench lab` is followed by list, do, page, assess, mark;")
    assert ended.err.endswith(f"is now written `servobench lab {new}`\n")
    assert len(ended.err.splitlines()) == 1


def test_a_run_that_a_fault_ended_is_reported_and_ends_as_a_run_does(
    servobench: Command, folder: Path
) -> None:
    """5 V turn the motor beyond 50 rad/s, the limit of its speed: 5 V / 0.042 V·s/rad is 119 rad/s."""
    text = MINE.replace('final = "2 V"', 'final = "5 V"\n\n[limits]\nspeed = "50 rad/s"')
    (folder / "mine.md").write_text(text, encoding="utf-8")

    ended = servobench("lab", "do", "mine", "--folder", folder)

    assert ended.status == 4
    assert "! the run ended early: " in ended.out


def test_an_empty_folder_is_reported(servobench: Command, tmp_path: Path) -> None:
    for words in (("list",), ("page", "--out", tmp_path / "pages")):
        ended = servobench("lab", *words, "--folder", tmp_path)
        assert (ended.status, "there are no exercises" in ended.err) == (2, True)
    assert not (tmp_path / "pages").exists()
