"""The punctuality of the loop."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from servobench.core.rounding import count_text, milliseconds
from servobench.rig.commission.checks.base import CHECKS, Figure, Outcome, as_sentence
from servobench.rig.lateness import lateness

if TYPE_CHECKING:
    from servobench.rig.commission.bench import Bench
    from servobench.rig.commission.check_run import CheckRun

DURATION = 3.0  # s
LATE = 0.5  # of a sample time, for 99 of 100 samples
REMEDY = "Close other programs, allow real-time scheduling, use a longer sample time, or a device that keeps the time itself."


@CHECKS.member("timing")
class Timing:
    """The lateness of the samples of a run at zero volts, and the number of missing ticks."""

    title: ClassVar[str] = "Loop timing"
    place: ClassVar[int] = 25
    needs: ClassVar[tuple[str, ...]] = ("rest",)
    halts: ClassVar[bool] = False
    picture: ClassVar[str] = ""

    def carry_out(self, bench: Bench) -> Outcome:
        """Record at zero volts, and look at the times."""
        run = bench.wait(DURATION, may_end=True)
        did = f"0 V for {DURATION:g} s at {1 / bench.sample_time:g} Hz; each sample's time was compared with its schedule."
        most = LATE * bench.sample_time
        expected = f"No tick is missing, and 99 % of the samples are late by at most {milliseconds(most)} ms."
        stopped = run.recording.stopped
        if stopped.reason == "fault":
            return Outcome(
                state="failed", did=did, expected=expected, found=as_sentence(f"the run was cut short: {stopped.sentence}"),
                figures=(Figure(name="time until then", value=run.duration, unit="s"),), remedy=REMEDY,
            )  # fmt: skip
        late = lateness(run.recording)
        if late is None:
            return _outcome_without_clock(did, expected, run, bench.sample_time)
        punctual = late.missed == 0 and late.p99 <= most
        return Outcome(
            state="verified" if punctual else "failed",
            did=did,
            expected=expected,
            found=f"{late.sentence[0].upper()}{late.sentence[1:]}.",
            figures=(
                Figure(name="lateness, 99th percentile", value=round(late.p99, 9), unit="s"),
                Figure(name="lateness, largest", value=round(late.largest, 9), unit="s"),
                Figure(name="ticks missed", value=late.missed, unit="1"),
            ),
            remedy="" if punctual else REMEDY,
        )


def _outcome_without_clock(did: str, expected: str, run: CheckRun, sample_time: float) -> Outcome:
    """The outcome where no clock ran: nothing can be late, but a tick may be missing."""
    missed = int(np.maximum(np.rint(np.diff(run.t) / sample_time) - 1, 0).sum())
    if missed:
        return Outcome(
            state="failed", did=did, expected=expected, found=f"{count_text(missed, 'tick')} went by without a sample.",
            figures=(Figure(name="ticks missed", value=missed, unit="1"),), remedy=REMEDY,
        )  # fmt: skip
    return Outcome(
        state="unsupported", did=did, expected=expected, found="The device's time is computed, so nothing can be late.",
        remedy="Commission a device that runs in real time.",
    )  # fmt: skip
