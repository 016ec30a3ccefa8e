"""The pages of exercises as a browser, a screen reader and a student see them."""

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import pytest

from servobench.lab.exercise import Exercise
from servobench.lab.exercise_file import exercises, read_exercise
from servobench.lab.expression import Expression
from servobench.lab.page import INDEX, PAPERS, Block, InPart, exercise_page, page_of, papers_page, write_lab
from servobench.lab.stand import stand_on_the_twin
from servobench.lab.table_text import TextColumn, text_columns
from servobench.lab.worked_exercise import WorkedExercise
from servobench.report.tables import capital
from tests.report.test_page import Page

ALL = exercises()
LARGEST = 1_000_000  # bytes, as of a report's page
CORRECTED = """+++
title = "Corrected <b>"
sentence = "What the paper says & what comes out."

[experiment]
duration = "1 s"
nominal = "qube_servo_2"

[signal]
type = "step"
final = "2 V"

[studies.inertias]
type = "values"
title = "Time constants <i>"

[[studies.inertias.rows]]
label = "τ with the rotor"
answer = "sheet_resistance * sheet_inertia / sheet_motor_constant ** 2"
unit = "s"
paper = 0.13

[[blanks]]
id = "gain"
label = "The gain <u>"
unit = "rad/(s·V)"
answer = "sheet_gain"
tolerance = "1 %"

[[corrections]]
where = "II.E"
paper = "1/0.13 is −7.69"
ours = "the pole is at {}"
answer = "-1 / inertias_value_1"
unit = "rad/s"
why = "A sign was lost. It isn't lost here."
+++

# To do

Look <script>alert(1)</script> at it.

{{ inertias }}

Then think.
"""


def worked(exercise: Exercise, **given: str) -> WorkedExercise:
    return WorkedExercise(exercise=exercise, stand=stand_on_the_twin(exercise), given=given)


@lru_cache(maxsize=64)
def text_of(exercise: Exercise, solution: bool) -> str:
    return exercise_page(worked(exercise), solution=solution)


def page(exercise: Exercise, solution: bool = False) -> Page:
    return Page(text_of(exercise, solution))


def corrected() -> Exercise:
    return read_exercise(CORRECTED, "corrected", "corrected.md")


@pytest.mark.parametrize("found", ALL, ids=lambda e: e.name)
def test_a_page_of_an_exercise_is_whole_and_needs_nothing_else(found: Exercise) -> None:
    shown = page(found)

    forbidden = {"script", "iframe", "img", "object", "embed", "form", "input", "base"}
    assert {tag for tag, _ in shown.elements} & forbidden == set()
    for tag, attributes in shown.elements:
        assert [name for name in attributes if name.startswith("on")] == [], tag
        for name in ("href", "src"):
            assert attributes.get(name, "#").startswith(("#", "data:,", "https:", "http:")), tag
    ids = Counter(attributes["id"] for _, attributes in shown.elements if "id" in attributes)
    assert [name for name, times in ids.items() if times > 1] == []
    assert shown.text("h1") == [found.title]
    levels = [int(tag[1]) for tag, _ in shown.elements if re.fullmatch(r"h[1-6]", tag)]
    assert max(b - a for a, b in pairwise(levels)) <= 1
    assert len(text_of(found, False).encode()) < LARGEST


@pytest.mark.parametrize("found", ALL, ids=lambda e: e.name)
def test_a_page_shows_all_that_its_exercise_has(found: Exercise) -> None:
    words = "".join(page(found).words.split())
    stand = stand_on_the_twin(found)

    def shows(text: str) -> bool:
        """Whether the text contains it; an index, as in ω_n, is shown by its position and not by a sign."""
        return "".join(re.sub(r"(?<![A-Za-z]{2})_(?=[a-z])", "", text).split()) in words

    assert all(shows(blank.label) for blank in found.blanks)
    assert all(shows(each.where) and shows(each.why.rstrip(".")) for each in found.corrections)
    for piece in found.pieces:
        if not piece.study:
            continue
        shown = stand.study_result(piece.study)
        for table in shown.tables:
            assert shows(table.title)
            assert all(shows(text) for column in text_columns(table) for text in column.texts)
        assert all(shows(figure.caption) for figure in shown.figures)


@pytest.mark.parametrize("found", ALL, ids=lambda e: e.name)
def test_right_answers_stand_there_only_with_the_solution(found: Exercise) -> None:
    filled, empty = page(found, solution=True), page(found)
    boxes = [sum(a.get("class") == "box" for _, a in shown.elements) for shown in (filled, empty)]

    assert boxes == [0, len(found.blanks)]
    for answer in worked(found).answers:
        assert answer.text or answer.why_not
        assert " ".join(answer.text.split()) in filled.words


def test_the_papers_number_stands_beside_ours_and_the_correction_has_its_figure() -> None:
    """R J/k² with the rotor is 0.0998 s, as paper.md has it; 0.13 s is 30 % off."""
    words = page(corrected()).words

    tau = 8.4 * (4e-6 + 0.5 * 0.0106 * 0.0111**2 + 0.5 * 0.053 * 0.0248**2) / 0.042**2
    assert f"τ with the rotor {tau:.4g} 0.13 +30 % s" in words
    assert f"The pole is at −{1 / tau:.3g} rad/s." in words
    assert "inertias_value_1" not in words  # a name of the exercise's own means nothing to who reads the page


def test_what_comes_out_is_folded_up_until_it_is_asked_for() -> None:
    def open_folds(html: str) -> list[bool]:
        folds = [
            attributes
            for tag, attributes in Page(html).elements
            if attributes.get("class", "").startswith("fold")
        ]
        return ["open" in attributes for attributes in folds]

    found = worked(corrected())

    # One study and the corrections.
    assert open_folds(exercise_page(found, solution=False)) == [False, False]
    assert open_folds(exercise_page(found, solution=False, studies=True)) == [True, True]
    assert open_folds(exercise_page(found, solution=True)) == [True, True]


def test_a_symbol_at_the_beginning_of_a_sentence_keeps_its_size() -> None:
    """τ and Τ, s and S are different quantities."""
    assert capital("τ = 0.006 s") == "τ = 0.006 s"
    assert capital("s = -1/τ") == "s = -1/τ"
    assert capital("a random noise") == "A random noise"


def test_what_is_typed_is_text_and_no_markup() -> None:
    shown = page(corrected())

    assert "Corrected <b>" in shown.text("h1")
    assert "Time constants <i>" in shown.words
    assert "Look <script>alert(1)</script> at it." in shown.words
    assert "The gain <u>" in shown.words


def test_answers_that_were_given_are_marked() -> None:
    found = corrected()

    words = Page(exercise_page(worked(found, gain="1"), solution=False)).words
    assert "about 20 times too small" in words  # 23.7
    sheet = Expression("sheet_gain").evaluate(stand_on_the_twin(found).facts).value
    assert "Right." in Page(exercise_page(worked(found, gain=f"{sheet}"), solution=False)).words


def test_the_pages_of_a_folder_lead_to_each_other_and_nowhere_else(tmp_path: Path) -> None:
    texts = {f"{name}.md": CORRECTED.replace("Corrected <b>", name) for name in ("first", "second", "third")}
    for number, (name, text) in enumerate(texts.items()):
        ordered = text.replace("sentence", f"order = {number}\nsentence", 1)
        (tmp_path / name).write_text(ordered, encoding="utf-8")
    lab = [worked(each) for each in exercises(tmp_path)]
    told_of: list[int] = []

    write_lab(tmp_path / "pages", lab, solution=False, begun=lambda number, _: told_of.append(number))

    assert told_of == [0, 1, 2]
    pages = {path.name: Page(path.read_text(encoding="utf-8")) for path in (tmp_path / "pages").iterdir()}
    assert sorted(pages) == ["first.html", "index.html", "paper.html", "second.html", "third.html"]
    links = {
        name: [a["href"] for _, a in each.all("a") if not a["href"].startswith("#")]
        for name, each in pages.items()
    }
    assert {link.partition("#")[0] for found in links.values() for link in found} <= set(pages)
    assert links["second.html"] == [INDEX, PAPERS, "first.html", "third.html"]
    assert links["first.html"] == [INDEX, PAPERS, "second.html"]
    assert [link for link in links[INDEX] if link != PAPERS] == [page_of(each.exercise) for each in lab]


@pytest.mark.parametrize("done", [1, 2, 3])
def test_pages_that_are_interrupted_lead_to_each_other_and_say_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, done: int
) -> None:
    """Interrupted where an exercise begins; with all three done it is where the page on the paper would be written."""
    lab = [replaced_name(worked(corrected()), name) for name in ("first", "second", "third")]

    def begun(number: int, _: object) -> None:
        if number == done:
            raise KeyboardInterrupt

    if done == len(lab):
        monkeypatch.setattr("servobench.lab.page.papers_page", interrupted_once(papers_page))
    with pytest.raises(InPart) as ended:
        write_lab(tmp_path, lab, solution=False, begun=begun)

    assert (ended.value.folder, ended.value.done, ended.value.of) == (tmp_path, done, 3)
    pages = {path.name: Page(path.read_text(encoding="utf-8")) for path in tmp_path.iterdir()}
    assert len(pages) == done + 2
    links = [a["href"].partition("#")[0] for each in pages.values() for _, a in each.all("a")]
    assert set(filter(None, links)) <= set(pages)
    assert pages[INDEX].words.count(" missing") == 3 - done + (done < 3)  # each of them, and the note
    assert (f"Only {done} of 3 are here" in pages[INDEX].words) == (done < 3)
    assert ("This page is incomplete" in pages[PAPERS].words) == (done < 3)
    assert "1 of 3" in pages["first.html"].words


def test_pages_that_are_interrupted_before_the_first_is_done_leave_an_empty_folder(tmp_path: Path) -> None:
    def begun(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(InPart) as ended:
        write_lab(tmp_path / "pages", [worked(corrected())], solution=False, begun=begun)

    assert (ended.value.done, ended.value.of) == (0, 1)
    assert list((tmp_path / "pages").iterdir()) == []


def replaced_name(made: WorkedExercise, name: str) -> WorkedExercise:
    return replace(made, exercise=replace(made.exercise, name=name, title=name))


def interrupted_once(write: Callable[..., str]) -> Callable[..., str]:
    """Return a writer of a page that is interrupted at the first call, as by Ctrl-C."""
    calls = []

    def again(*given: object) -> str:
        calls.append(given)
        if len(calls) == 1:
            raise KeyboardInterrupt
        return write(*given)

    return again


def test_the_page_on_the_paper_has_all_corrections_and_each_of_its_numbers(tmp_path: Path) -> None:
    lab = [worked(corrected())]
    write_lab(tmp_path, lab, solution=False, begun=lambda *_: None)
    words = Page((tmp_path / PAPERS).read_text(encoding="utf-8")).words
    assert "by Meshari J. Al Jandal, Khaled S. Al Rasheed and Muhammad R. Jamal" in words
    assert "names neither a year nor a publisher" in words
    assert "worked out from what is found there" in words

    assert "II.E The paper 1/0.13 is −7.69. Here The pole is at −10 rad/s." in words
    assert "Corrected <b> · Time constants <i> τ with the rotor 0.09977 s 0.13 +30 %" in words


def test_a_recording_alone_has_a_page_that_says_what_it_cannot_show() -> None:
    from dataclasses import replace

    from servobench.lab.stand import stand_of
    from servobench.lab.studies.base import Stand, StudyResult

    class Runs:
        paper: dict[str, tuple[float, ...]] = {}  # noqa: RUF012

        def __call__(self, stand: Stand) -> StudyResult:
            stand.run(stand.experiment)
            return StudyResult()

    found = replace(corrected(), studies={"inertias": Runs()}, corrections=(), correction_lines=())
    stand = stand_of(found, stand_on_the_twin(corrected()).recording)

    words = Page(exercise_page(WorkedExercise(exercise=found, stand=stand, given={}), solution=False)).words

    assert "Nothing can be shown here: the study 'inertias': this takes further runs of the motor" in words


@pytest.mark.parametrize(
    ("columns", "width", "broad"),
    [
        (7, 6, False),
        (8, 1, True),
        (2, 29, False),
        (2, 30, True),
    ],  # with 2 between columns, 62 is the width of the text
)
def test_a_table_is_broad_by_its_columns_or_by_its_numbers(columns: int, width: int, broad: bool) -> None:
    table = tuple(
        TextColumn(heading="x", unit="", kind="number", texts=("9" * width,)) for _ in range(columns)
    )
    assert Block(tables=(("", table, ""),)).is_broad is broad
