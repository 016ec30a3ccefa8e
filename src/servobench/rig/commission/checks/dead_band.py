"""The breakaway voltage, of dead band and friction together, either way."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from servobench.core.rounding import plain
from servobench.rig.commission.bench import LEAD
from servobench.rig.commission.checks.base import CHECKS, Figure, Outcome

if TYPE_CHECKING:
    from servobench.rig.commission.bench import Bench
    from servobench.rig.commission.check_run import CheckRun

STEPS, DWELL = 24, 0.2  # steps of the staircase, and the time of each [s]
TOP = 1.5  # times the voltage that moved the shaft within a short pulse
PART = 0.2  # of the voltage limit: what a dead band may be at most


@CHECKS.member("dead_band")
class DeadBand:
    """A staircase upwards from zero, one way and then the other, until the shaft turns.

    It surely turned at the step at which the counts first moved. That motion may have begun in the step before without a count,
    so the last step that surely didn't move it is the one before that.
    """

    title: ClassVar[str] = "Dead band and friction"
    place: ClassVar[int] = 70
    needs: ClassVar[tuple[str, ...]] = ("stop", "watchdog")
    halts: ClassVar[bool] = False
    picture: ClassVar[str] = "Both staircases: the voltage, and the counts."

    def carry_out(self, bench: Bench) -> Outcome:
        """Climb both staircases, with zero volts in between."""
        top = min(TOP * bench.value_of("moving_voltage"), bench.allowed)
        levels = top * np.arange(1, STEPS + 1) / STEPS
        pause = bench.tail
        up = [(float(level), DWELL) for level in levels]
        run = bench.drive(*up, (0.0, pause), *((-level, duration) for level, duration in up))
        climb = STEPS * DWELL
        intervals = {
            "forwards": _breakaway(run, LEAD, levels, bench.quiet),
            "backwards": _breakaway(run, LEAD + climb + pause, levels, bench.quiet),
        }
        did = f"A staircase to {plain(top, 3)} V in {STEPS} steps of {1000 * DWELL:g} ms, and one to {plain(-top, 3)} V."
        most = PART * bench.limit
        expected = f"The shaft turns either way below {plain(most, 3)} V, {100 * PART:g} % of the range."
        held = [way for way, interval in intervals.items() if interval is None]
        if held:
            return Outcome(
                state="failed", did=did, expected=expected,
                found=f"The shaft didn't turn {' or '.join(held)} up to {plain(top, 3)} V, although a pulse of "
                f"{plain(bench.value_of('moving_voltage'), 3)} V had moved it.",
                remedy="Look for a shaft that sticks in places: a brake, a bent shaft, a tight belt, a bearing.",
            )  # fmt: skip
        figures = tuple(
            Figure(name=f"breakaway voltage {way}", value=0.5 * sum(interval), unit="V", interval=interval)
            for way, interval in intervals.items()
            if interval is not None
        )
        largest = max(figure.value for figure in figures)
        small = largest <= most
        return Outcome(
            state="verified" if small else "failed",
            did=did,
            expected=expected,
            found=f"The breakaway voltage is {figures[0]} forwards and {figures[1]} backwards.",
            figures=figures,
            remedy=""
            if small
            else "Friction takes a large part of the voltage. Look for a brake, a bent shaft or a tight belt, and check the "
            "supply's voltage.",
            learned={"dead_band": min(figure.interval[0] for figure in figures if figure.interval)},
        )


def _breakaway(
    run: CheckRun, begin: float, levels: np.ndarray[tuple[int], np.dtype[np.float64]], quiet: float
) -> tuple[float, float] | None:
    """The largest level that surely didn't move the shaft, and the smallest that surely did [V]; None where none did."""
    inside = (run.t >= begin) & (run.t < begin + len(levels) * DWELL)
    moved = np.flatnonzero(np.abs(run.counts[inside] - run.at(begin)) > quiet)
    if not len(moved):
        return None
    step = min(int((run.t[inside][moved[0]] - begin) / DWELL), len(levels) - 1)
    return float(levels[step - 2]) if step >= 2 else 0.0, float(levels[step])
