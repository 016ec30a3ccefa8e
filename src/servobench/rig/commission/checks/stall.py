"""A shaft that is held is noticed: tried at a voltage so low that friction holds it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

from servobench.core.rounding import plain, with_unit
from servobench.rig.commission.bench import LEAD
from servobench.rig.commission.checks.base import CHECKS, Figure, Outcome, no_outcome

if TYPE_CHECKING:
    from servobench.rig.commission.bench import Bench

PART, THRESHOLD = (
    0.7,
    0.35,
)  # of the dead band: the voltage, and the voltage beyond which a standstill is a stall
AFTER = 3.0  # s, as Quanser's amplifiers have it, and the firmware of the open rig
TOLERANCE = 0.1  # s
PATIENCE = 4.0  # s


@CHECKS.member("stall")
class Stall:
    """Below the dead band the shaft stands as if it were blocked, at a current that hurts no winding.

    Where the device has a stall monitor of its own (a setting `stall_voltage`) that one is tried, otherwise the guard's.
    """

    title: ClassVar[str] = "Stall at low voltage"
    place: ClassVar[int] = 80
    needs: ClassVar[tuple[str, ...]] = ("stop", "watchdog")
    halts: ClassVar[bool] = False
    picture: ClassVar[str] = ""

    def carry_out(self, bench: Bench) -> Outcome:
        """Lower the threshold below a voltage that friction holds, and wait for the cut."""
        if not math.isfinite(bench.value_of("dead_band")):
            return no_outcome("the dead band isn't known")
        voltage = PART * bench.value_of("dead_band")
        threshold = THRESHOLD * bench.value_of("dead_band")
        whose = "the device's own stall monitor" if bench.own_stall else "the guard's stall monitor"
        did = (
            f"{plain(voltage, 3)} V, at which friction holds the shaft, for up to {PATIENCE:g} s, with {whose} set to "
            f"{plain(threshold, 3)} V."
        )
        expected = f"The motor is cut off after {AFTER:g} ± {TOLERANCE:g} s."
        channel = bench.info.channel("voltage")
        if threshold <= 2 * ((channel.resolution if channel else None) or 1e-3):
            return Outcome(
                state="unknown", did="Nothing: there is hardly any dead band.", expected=expected,
                found="Friction is so small that no voltage leaves the shaft at rest.",
                remedy="Hold the shaft with a clamp, run an experiment with a constant voltage, and see it cut off.",
            )  # fmt: skip
        run = bench.drive(
            (voltage, PATIENCE),
            limits={"stall": None if bench.own_stall else {"voltage": threshold}, "plausibility": None},
            settings={"stall_voltage": threshold} if bench.own_stall else None,
            may_end=True,
        )
        stopped = run.recording.stopped
        if stopped.reason != "fault":
            moved = run.range(LEAD, LEAD + PATIENCE)
            turned = moved > bench.quiet + 3
            return Outcome(
                state="unknown" if turned else "failed", did=did, expected=expected,
                found=f"The shaft crept by {plain(moved)} counts, so it wasn't stalled."
                if turned
                else f"The shaft stood for {PATIENCE:g} s, and nothing cut the motor off.",
                figures=(Figure(name="motion", value=moved, unit="counts"),),
                remedy="Hold the shaft with a clamp, and run it again."
                if turned
                else "Check the stall monitor in the device's settings and firmware; don't leave the motor alone.",
            )  # fmt: skip
        time = run.duration - LEAD
        step = bench.sample_time
        in_time = abs(time - AFTER) <= TOLERANCE
        return Outcome(
            state="verified" if in_time else "failed",
            did=did,
            expected=expected,
            found=f"The motor was cut off after {with_unit(time, 's', 3)}, by {whose}."
            if in_time
            else f"The run ended after {with_unit(time, 's', 3)}: {stopped.sentence}.",
            figures=(
                Figure(name="voltage", value=voltage, unit="V"),
                Figure(name="time until the cut", value=time, unit="s", interval=(time - step, time + step)),
            ),
            remedy=""
            if in_time
            else "Something else ended the run, or the monitor's time differs: read why it ended.",
        )
