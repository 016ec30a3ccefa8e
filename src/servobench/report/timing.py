"""The lateness of a run's samples: in a table, over the run, and as a share of all."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from servobench.core.rounding import count_text, group_digits, with_unit
from servobench.recordings.recording import Recording
from servobench.report import figures
from servobench.report.figures import Course, Curve, Panel
from servobench.report.illustrations import MOST_RECORDS, Illustration
from servobench.report.tables import Fact
from servobench.rig.lateness import Lateness, lateness

_MISSED = {"discard": "left out", "process": "done late"}
_PHASE = {"keep": "back to the schedule", "lose": "a new schedule from the late one"}


def latenesses(recordings: Sequence[Recording]) -> tuple[Lateness, ...]:
    """Return the lateness of each recording in which time passed and was noted."""
    return tuple(
        recording_lateness
        for recording in recordings
        if (recording_lateness := lateness(recording)) is not None
    )


def timing_facts(runs: Sequence[Lateness]) -> tuple[tuple[str, tuple[Fact, ...]], ...]:
    """Return the percentiles and the counts of each run, under its name."""
    return tuple((run.name, _facts(run)) for run in runs)


def timing_figures(runs: Sequence[Lateness]) -> tuple[Illustration, ...]:
    """Return lateness over time, and which share of the samples was how late; nothing where there is no run."""
    if not runs:
        return ()
    shown = runs[:MOST_RECORDS]
    more = f" {MOST_RECORDS} of {len(runs)} runs are shown." if len(runs) > MOST_RECORDS else ""
    words = " ".join(f"{run.name}: {run.sentence}." for run in shown)
    over_time = Illustration(
        name="lateness",
        title="Lateness over time",
        caption=f"How late each sample was taken; a spike is a moment when the computer was busy.{more}",
        description=f"Lateness of the samples over time. {words}",
        draw=partial(figures.time_courses, tuple(_course(run, len(runs) > 1) for run in shown)),
    )
    share = Illustration(
        name="later-than",
        title="Share of samples later than that",
        caption=(
            "Read at 1 %: 99 of 100 samples were no later than that. Both scales are logarithmic; samples within "
            f"{with_unit(figures.SOONEST, 's')} are at the left end.{more}"
        ),
        description=f"The share of the samples later than a given time, over that time. {words}",
        draw=partial(figures.later_than, tuple(run.by for run in shown)),
    )
    return over_time, share


def _facts(run: Lateness) -> tuple[Fact, ...]:
    rest = f"{count_text(run.samples, 'sample')}, {with_unit(run.sample_time, 's')} apart"
    quantiles = (("median", run.p50), ("99 %", run.p99), ("99.9 %", run.p999), ("latest", run.largest))
    return (
        Fact(heading="Schedule", text=rest),
        *(Fact(heading=f"Lateness, {name}", text=with_unit(value, "s", 3)) for name, value in quantiles),
        Fact(
            heading="Late by more than a tenth",
            text=f"{group_digits(run.late)} of {count_text(run.samples, 'sample')}",
        ),
        Fact(heading="Missed", text=count_text(run.missed, "tick")),
        Fact(
            heading="Ticks that had gone by",
            text=f"{_MISSED[run.missed_rule]}; then {_PHASE[run.phase_rule]}",
        ),
    )


def _course(run: Lateness, several: bool) -> Course:
    curve = Curve(t=run.t - run.t[0], y=np.asarray(run.by), look="residual")
    return Course(
        panels=(Panel(title="Lateness", unit="s", curves=(curve,), height=110.0),),
        title=run.name[:40] if several else "",
    )
