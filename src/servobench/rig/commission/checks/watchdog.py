"""The device's own watchdog: spin, starve, watch the speed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from servobench.core.rounding import milliseconds, plain, with_unit
from servobench.rig.commission.bench import LEAD
from servobench.rig.commission.checks.base import CHECKS, Figure, Outcome, as_sentence

if TYPE_CHECKING:
    from servobench.rig.commission.bench import Bench
    from servobench.rig.commission.check_run import CheckRun

SPUN, BEFORE = 1.0, 0.2  # s at a voltage before it starves, of which the last part gives the speed
PATIENCE = 1.2  # s; 500 ms are the longest time of a watchdog, and the shaft needs some to slow down
MOST_PATIENCE = 6.0  # s
END = 0.2  # s
STOPPED, TURNING = 0.3, 0.8  # of the speed before
LATE = 1.5  # times the promised time, and a few samples
CLEAR = 5.0  # counts that the shaft falls short by, where that is first noticed


@CHECKS.member("watchdog")
class Watchdog:
    """Does the device let the motor go by itself where no voltage comes any more?

    After a cut at t_c the counts fall short of a straight line by e = ½ a (t - t_c)², so that t_c = 2 t₁ - t₂ where t₁ and t₂ are
    the times at which e reaches some counts, and four times as many.
    """

    title: ClassVar[str] = "Watchdog of the device"
    place: ClassVar[int] = 40
    needs: ClassVar[tuple[str, ...]] = ("stop",)
    halts: ClassVar[bool] = True
    picture: ClassVar[str] = (
        "The requested voltage, and the counts; after 1.2 s no voltage reached the device any more."
    )

    def carry_out(self, bench: Bench) -> Outcome:
        """Turn the motor slowly, keep the voltages back, and see what the shaft does."""
        voltage, begin = bench.spin_voltage, LEAD + SPUN
        patience = min(max(PATIENCE, 0.8 + 3 * bench.value_of("rest_time", 0.0)), MOST_PATIENCE)
        run = bench.drive(
            (voltage, SPUN + patience),
            faults=({"name": "starved", "from": begin},),
            # The guard doesn't know that its voltages are kept back.
            limits={"plausibility": None},
            tail=0.0,
            may_lose=True,
        )
        before = run.speed(begin - BEFORE, begin)
        after = run.speed(run.duration - END, math.inf)
        did = (
            f"{plain(voltage, 3)} V for {SPUN:g} s, then no voltage was sent for {plain(patience, 2)} s while the counts were "
            "read on; the stop was sent in the end."
        )
        promised = bench.own_watchdog
        expected = (
            "The shaft slows down by itself."
            if promised is None
            else f"The shaft slows down by itself, {milliseconds(promised)} ms after the last voltage at the latest, give "
            "or take half of that."
        )
        figures = (
            Figure(name="speed before", value=before / bench.speed_unit[0], unit=bench.speed_unit[1]),
            Figure(name="speed in the end", value=after / bench.speed_unit[0], unit=bench.speed_unit[1]),
        )
        still = bench.wait(2 * END)  # the stop came through
        if run.recording.stopped.reason == "device_lost":
            time = run.duration - begin
            return Outcome(
                state="unknown", did=did, expected=expected,
                figures=(figures[0], Figure(name="time until it stopped answering", value=time, unit="s")),
                found=f"The device stopped answering {with_unit(time, 's', 2)} after the last voltage, so the shaft couldn't "
                f"be watched. {as_sentence(run.recording.stopped.sentence)}",
                remedy="Turn the motor with `servobench run`, kill its process (-9), and see if the shaft slows down at once.",
            )  # fmt: skip
        share = after / before if before else math.nan
        if not abs(share) < math.inf or abs(before) * BEFORE < CLEAR:
            return Outcome(
                state="unknown", did=did, expected=expected, figures=figures,
                found=f"At {plain(voltage, 3)} V the shaft didn't turn steadily, so nothing can be concluded.",
                remedy="Find what holds the shaft, or raise the voltage limit.",
            )  # fmt: skip
        if still.range(END, math.inf) > bench.quiet:
            return Outcome(
                state="failed", did=did, expected=expected, figures=figures,
                found="The shaft went on turning after the stop.", remedy="Cut the supply.",
            )  # fmt: skip
        if share > TURNING:
            return _runs_on(did, expected, figures, promised)
        if share > STOPPED:
            return Outcome(
                state="unknown", did=did, expected=expected, figures=figures,
                found=f"The shaft only slowed to {100 * share:.0f} % of its speed, so a cut can't be distinguished from a load.",
                remedy="Take the load off, and run it again.",
            )  # fmt: skip
        return _outcome_of_cut(did, expected, figures, promised, _time_of_cut(run, begin), run)


def _runs_on(did: str, expected: str, figures: tuple[Figure, ...], promised: float | None) -> Outcome:
    if promised is None:
        return Outcome(
            state="unsupported", did=did, expected=expected, figures=figures,
            found="The motor ran on until the stop was sent: the device has no watchdog, and claims none.",
            remedy="The loop's own watchdog (limits.watchdog) ends a run that falls silent, but not one whose computer fails: "
            "have a switch in the motor's supply within reach.",
        )  # fmt: skip
    return Outcome(
        state="failed", did=did, expected=expected, figures=figures,
        found=f"The motor ran on until the stop was sent, although the device promises to cut it off after "
        f"{milliseconds(promised)} ms.",
        remedy="Don't use the device until its watchdog works: check its firmware and its settings.",
    )  # fmt: skip


def _time_of_cut(run: CheckRun, begin: float) -> tuple[float, float]:
    """The time from the last voltage until the motor was let go, and half of its interval [s]."""
    inside = (run.t >= begin - BEFORE) & (run.t < begin)
    slope, level = np.polyfit(run.t[inside] - begin, run.counts[inside], 1)
    short = np.sign(slope) * (level + slope * (run.t - begin) - run.counts)
    times = [float(run.t[int(np.argmax((short >= many) & (run.t >= begin)))]) for many in (CLEAR, 4 * CLEAR)]
    step = float(np.median(np.diff(run.t)))
    # The last voltage was written with the sample before.
    # A count more or less at e = 5 is 10 % of t₁ - t_c, and half of that at t₂: together a quarter, and as much again for a
    # shaft that slows down less and less.
    return max(2 * times[0] - times[1] - begin + step, 0.0), 0.5 * (times[1] - times[0]) + step


def _outcome_of_cut(
    did: str,
    expected: str,
    figures: tuple[Figure, ...],
    promised: float | None,
    cut: tuple[float, float],
    run: CheckRun,
) -> Outcome:
    time, half = cut
    interval = (max(time - half, 0.0), time + half)
    late = promised is not None and interval[0] > LATE * promised + 2 * half
    return Outcome(
        state="failed" if late else "verified",
        did=did,
        expected=expected,
        found=f"The device let the motor go {with_unit(time, 's', 2)} after the last voltage.",
        figures=(*figures, Figure(name="time until the cut", value=time, unit="s", interval=interval)),
        remedy="Check the watchdog's time in the device's settings, and its firmware." if late else "",
    )
