"""The appearance of results and findings."""

import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest
from rich.console import Console

from servobench.cli.layout import show_table
from servobench.cli.result_text import show_findings, show_result
from servobench.cli.terminal import printable
from servobench.core.finding import Finding, Verdict, info, refusal, warning
from servobench.core.parameter_names import parameter_in_words
from servobench.identification.identify import identify
from tests.cli.conftest import Command
from tests.datasets import dataset

if TYPE_CHECKING:
    from servobench.identification.result import Result


def shown(*findings: Finding) -> list[str]:
    console = Console(width=40, markup=False, highlight=False)
    with console.capture() as capture:
        show_findings(console, findings)
    return capture.get().splitlines()


def test_the_weightiest_findings_come_first_each_with_its_mark() -> None:
    assert shown(info("a", "One."), warning("b", "Two."), refusal("c", "Three.")) == [
        "  ✗ Three.",
        "  ! Two.",
        "  • One.",
    ]


def test_long_findings_are_wrapped_behind_their_mark_and_names_stay_whole() -> None:
    name = "a_name_that_is_longer_than_any_line_could_be"

    assert shown(info("a", f"The column {name} [V] isn't there at all.")) == [
        "  • The column",
        f"    {name}",
        "    [V] isn't there at all.",
    ]


def test_of_many_findings_of_one_kind_three_are_shown_and_the_others_counted() -> None:
    lines = shown(*(info("gap", f"A gap number {k}.") for k in range(7)), info("other", "Another."))

    assert lines == [
        "  • A gap number 0.",
        "  • A gap number 1.",
        "  • A gap number 2.",
        "    and 4 more of this kind",
        "  • Another.",
    ]


def test_a_single_finding_that_is_left_out_is_one() -> None:
    console = Console(width=60, markup=False, highlight=False)
    with console.capture() as capture:
        show_findings(console, [info("a", "One."), info("b", "Two.")], most=1)

    assert capture.get().splitlines()[-1].strip() == "and 1 less important one (--all-findings)"


def test_what_refuses_a_result_comes_before_its_causes() -> None:
    console = Console(width=60, markup=False, highlight=False)
    cause = warning("gain-falls", "Large inputs act less.")
    result = SimpleNamespace(
        verdict=Verdict.REFUSED, fit=None, findings=(cause, refusal("misfit", "The model is wrong."))
    )
    with console.capture() as capture:
        show_result(console, cast("Result", result))

    marks = [line.strip() for line in capture.get().splitlines() if line.startswith("  ")]
    assert marks == ["✗ The model is wrong.", "! Large inputs act less."]


@pytest.mark.parametrize(
    ("sentence", "rows", "line"),
    [
        ("A jump.", (7, 7), "  • A jump. (row 7)"),
        ("A jump.", (7, 9), "  • A jump. (rows 7 to 9)"),
        ("A jump in row 7.", (7, 7), "  • A jump in row 7."),
        ("An arrow.", None, "  • An arrow."),
    ],
)
def test_rows_are_reported_once(sentence: str, rows: tuple[int, int] | None, line: str) -> None:
    assert shown(info("a", sentence, rows=rows)) == [line]


def test_a_table_wraps_its_last_column_and_leaves_no_blanks_at_the_end() -> None:
    console = Console(width=36, markup=False, highlight=False)
    with console.capture() as capture:
        show_table(
            console,
            ("name", "value", ""),
            [("a", "1", "some words that are too many"), ("b", "23", "")],
            right=("value",),
        )

    assert capture.get().splitlines() == [
        "  name  value",
        "  a         1  some words that are",
        "               too many",
        "  b        23",
    ]


def test_the_figures_of_a_run_are_rounded_to_what_is_known(servobench: Command, finished_run: Path) -> None:
    said = servobench("identify", finished_run / "recording.mcap").out
    gain = json.loads((finished_run / "result.json").read_text(encoding="utf-8"))["parameters"]["gain"]

    found = re.search(r"^  gain +(\S+) +(\S+) +(\S+) to (\S+)  rad/\(s·V\)$", said, re.MULTILINE)
    assert found is not None
    value, half, low, high = found.groups()
    # Two significant digits of half the interval, and as many decimals everywhere.
    assert len(half.replace(".", "").lstrip("0")) == 2
    decimals = len(half.partition(".")[2])
    assert value == f"{gain['value']:.{decimals}f}"
    assert (low, high) == tuple(f"{end:.{decimals}f}" for end in gain["interval"])


def test_no_line_of_words_ends_with_blanks(servobench: Command, finished_run: Path) -> None:
    for words in (
        ("identify", finished_run / "data.csv"),
        ("inspect", finished_run / "data.csv"),
        ("signals",),
    ):
        assert [line for line in servobench(*words).out.splitlines() if line != line.rstrip()] == []


def test_parameters_are_named_as_people_do() -> None:
    assert [parameter_in_words(name) for name in ("gain", "time_constant", "coulomb_voltage")] == [
        "gain",
        "time constant",
        "Coulomb voltage",
    ]


def test_control_characters_are_spelled_and_blanks_are_kept() -> None:
    assert printable("a\x1b[1m\tb\u202fc\nd\u202e") == "a\\x1b[1m\\tb\u202fc\nd\\u202e"


def verdict_line(*levels: float) -> str:
    """The line of the verdict of a motor that rests, and then is at each of these levels [V] for 2 s."""
    u = np.concatenate([np.zeros(500), np.repeat(levels, 1000)])
    console = Console(width=200, markup=False, highlight=False)
    with console.capture() as capture:
        show_result(console, identify(dataset(seed=1, samples=len(u), u=u)))
    (line,) = (each for each in capture.get().splitlines() if each.startswith("trusted"))
    return line


def test_a_trusted_result_without_a_gain_says_what_it_leaves_open() -> None:
    """One level tells the speed there, but not how much of it friction takes."""
    assert verdict_line(2.0, 4.0) == "trusted: nothing was found that goes beyond the intervals above"
    assert verdict_line(3.0).endswith("beyond the intervals above, which leave the gain open")
