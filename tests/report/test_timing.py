"""The punctuality of a run in a report and on the terminal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from servobench.cli.conclusion import deliver
from servobench.core.palette import LIGHT
from servobench.identification.result import Result
from servobench.recordings.recording import Recording
from servobench.report.document import Report
from servobench.report.figures import later_than
from servobench.report.palette import Style
from servobench.report.timing import latenesses as lateness_of
from servobench.report.timing import timing_facts, timing_figures
from tests.report.test_page import Page

STYLE = Style(width=720.0, palette=LIGHT)


def punctual(recording: Recording) -> Recording:
    """The same with each sample at its time, as all are in virtual time."""
    series = {each.channel.name: each for each in recording.series}
    scheduled = replace(series["scheduled"], values=np.asarray(series["scheduled"].t))
    late = replace(series["late"], values=0 * series["late"].values)
    others = tuple(each for name, each in series.items() if name not in ("scheduled", "late"))
    return replace(recording, series=(*others, scheduled, late))


def test_the_report_of_a_run_by_the_computer_s_clock_tells_lateness_and_counts(
    good: Result, timed: Recording
) -> None:
    """7 of its 1,500 samples were late, by 0.4 ms each: 5 in a thousand."""
    words = Page(Report(timed, good).html()).words.replace("\u00a0", " ")

    for told in (
        "Timing",
        "Lateness, median 0 s",
        "Lateness, 99 % 0 s",
        "Lateness, 99.9 % 0.4 ms",
        "Lateness, latest 0.4 ms",
        "Late by more than a tenth 7 of 1500 samples",
        "Missed 0 ticks",
        "left out; then back to the schedule",
    ):
        assert told in words


def test_a_run_in_virtual_time_has_no_such_section(good: Result, run: Recording) -> None:
    assert "Timing" not in Page(Report(punctual(run), good).html()).words


@pytest.mark.parametrize("name", ["timed", "file"])
def test_the_terminal_says_it_where_time_passed_and_nothing_elsewhere(
    name: str, good: Result, request: pytest.FixtureRequest
) -> None:
    console = Console(record=True, width=400, quiet=False)

    deliver(good, [request.getfixturevalue(name)], console=console, as_json=False, report=None, command="")

    line = "timing: samples were late by 0 µs (median), 0 µs (99th percentile), 400 µs (99.9th)"
    assert (line in console.export_text()) == (name == "timed")


def test_of_two_runs_each_has_its_own_facts_and_place_in_the_figures(timed: Recording) -> None:
    runs = lateness_of([timed, replace(timed, name="another")])

    assert [name for name, _ in timing_facts(runs)] == ["run", "another"]
    over_time, share = timing_figures(runs)
    assert len(over_time.draw(STYLE).axes) == 2
    assert len(share.draw(STYLE).axes[0].lines) == 2
    assert "another: samples were" in share.description


def test_the_share_of_later_samples_is_read_off_at_the_right_places() -> None:
    """Lateness of 1 to 1,000 µs: 50 % of the samples are 501 µs late or more, 1 % are 991 µs or more."""
    figure = later_than((1e-6 * np.arange(1, 1001),), STYLE)

    late, share = (np.asarray(values) for values in figure.axes[0].lines[0].get_data())
    for percent, expected in ((100.0, 1.0), (50.0, 501.0), (1.0, 991.0), (0.1, 1000.0)):
        # The points lie 1.7 % apart, for 400 of them in three decades.
        assert late[np.argmin(np.abs(share - percent))] == pytest.approx(expected, rel=0.02)


def test_a_run_that_was_never_late_is_drawn_all_the_same(timed: Recording) -> None:
    for figure in timing_figures(lateness_of([punctual(timed)])):
        figure.draw(STYLE).canvas.draw()
