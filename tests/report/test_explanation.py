"""The page of an explanation: whole, harmless, and saying what the explanation says."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from servobench.core.errors import StorageError
from servobench.core.finding import warning
from servobench.identification.reconciliation.explanation import Explanation
from servobench.identification.result import Result
from servobench.identification.why import why
from servobench.recordings.recording import Recording
from servobench.report.explanation import ExplanationReport
from servobench.rig.experiment import read_experiment
from tests.report.conftest import HOSTILE
from tests.report.test_page import Page


@pytest.fixture(scope="module")
def claimed(good: Result) -> Explanation:
    return why(good, ["tau=0.13", "gain=23.8"], nominal="qube_servo_2")


def test_the_page_is_whole_needs_no_network_and_runs_nothing(claimed: Explanation, run: Recording) -> None:
    text = ExplanationReport([run], claimed, command="servobench why run.mcap").html()

    page = Page(text)
    assert not {"script", "iframe", "object"} & {tag for tag, _ in page.elements}
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert not re.search(r"(?:src|href)=\\?\"https?:", text)
    assert text == ExplanationReport([run], claimed, command="servobench why run.mcap").html()


def test_answer_causes_readings_and_command_are_on_it(claimed: Explanation, run: Recording) -> None:
    page = Page(ExplanationReport([run], claimed, command="servobench why run.mcap").html())

    words = page.words.replace("\u00a0", " ")
    assert page.text("h1")[0].replace("\u00a0", " ").startswith("Why 0.13 s and 23.8 rad/(s·V) and not ")
    for each in claimed.causes:
        assert each.label in words
        assert each.law in words
    assert f"{claimed.readings[0].time_constant:.4f} s" in words
    assert "servobench why run.mcap" in words
    assert len(page.all("figure")) == 2


def test_the_experiment_that_decides_is_one_that_can_be_run(good: Result) -> None:
    found = why(good, ["tau=0.0900"], nominal="qube_servo_2")
    assert found.decision is not None
    assert found.decision.experiment is not None
    page = Page(ExplanationReport([], found).html())

    said = page.words
    assert "The experiment that decides" in said
    assert read_experiment(found.decision.experiment.to_toml()) == found.decision.experiment


def test_one_that_agrees_or_is_refused_has_a_page_without_figures(good: Result, refused: Result) -> None:
    for result in (good, refused):
        page = Page(ExplanationReport([], why(result, ["tau=0.0992"])).html())

        assert page.all("figure") == []
    assert "can't support a model" in page.words


def test_what_comes_from_files_is_harmless(claimed: Explanation, run: Recording) -> None:
    hostile = replace(claimed, findings=(warning("bad", HOSTILE),), sentences=(HOSTILE,))

    page = Page(ExplanationReport([replace(run, name=HOSTILE)], hostile, command=HOSTILE).html())

    assert not {"script", "img"} & {tag for tag, _ in page.elements}


def test_a_page_that_can_t_be_written_says_why(claimed: Explanation, tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="folder"):
        ExplanationReport([], claimed).write(tmp_path)
