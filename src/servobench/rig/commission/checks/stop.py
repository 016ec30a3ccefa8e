"""A short pulse moves the shaft, and zero volts stop it."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from servobench.core.rounding import plain, with_unit
from servobench.rig.commission.bench import LEAD, PULSE_PART, PULSE_TIME, REST
from servobench.rig.commission.checks.base import CHECKS, Figure, Outcome

if TYPE_CHECKING:
    from servobench.rig.commission.bench import Bench
    from servobench.rig.commission.check_run import CheckRun

FIRST, FACTOR = 0.02, 1.5  # of the voltage limit; each pulse is larger than the one before by the factor
PATIENCE = 2.0  # s after the pulse
CLEARLY = 5.0  # counts that a shaft has moved at least, beyond what it flickers by


@CHECKS.member("stop")
class Stop:
    """Pulses of a tenth of a second, each in a run of its own, until one moves the shaft; it has to stop by itself afterwards."""

    title: ClassVar[str] = "0 V stops the motor"
    place: ClassVar[int] = 30
    needs: ClassVar[tuple[str, ...]] = ("rest",)
    halts: ClassVar[bool] = True
    picture: ClassVar[str] = "The last pulse: the voltage, and the counts."

    def carry_out(self, bench: Bench) -> Outcome:
        """Raise the pulse until the shaft moves, and see it stop."""
        voltage = FIRST * bench.limit
        most = PULSE_PART * bench.limit
        while True:
            run = bench.drive((voltage, PULSE_TIME), tail=PATIENCE)
            moved = abs(run.at(run.duration) - run.at(LEAD))
            farthest = float(np.abs(run.counts - run.at(LEAD)).max())
            if farthest >= CLEARLY + bench.quiet:
                return _outcome_of_stop(voltage, farthest, moved, run)
            if voltage >= most:
                return _outcome_without_motion(voltage, farthest)
            voltage = min(FACTOR * voltage, most)


def _did(voltage: float) -> str:
    return (
        f"Pulses of {1000 * PULSE_TIME:g} ms, from small to {plain(voltage, 3)} V, each followed by 0 V for {PATIENCE:g} s; "
        "the next only after the last one had ended at rest."
    )


_EXPECTED = f"The shaft moves, and is at rest for the last {REST:g} s."


def _outcome_of_stop(voltage: float, farthest: float, moved: float, run: CheckRun) -> Outcome:
    """The shaft moved, and came to rest, or the run would have raised an error."""
    end = LEAD + PULSE_TIME
    final = run.between(run.duration - REST, np.inf)
    low, high = float(final.min()), float(final.max())
    moving = run.t[(run.counts < low) | (run.counts > high)]
    time = max(float(moving[-1]) - end, 0.0) if len(moving) else 0.0
    step = float(np.median(np.diff(run.t)))
    return Outcome(
        state="verified",
        did=_did(voltage),
        expected=_EXPECTED,
        found=f"A pulse of {plain(voltage, 3)} V moved the shaft by {plain(moved)} counts; it was at rest "
        f"{with_unit(time, 's', 2)} after 0 V.",
        figures=(
            Figure(name="voltage of the pulse", value=voltage, unit="V"),
            Figure(name="farthest from the start", value=farthest, unit="counts"),
            Figure(name="time to rest", value=time, unit="s", interval=(max(time - step, 0.0), time + step)),
        ),
        learned={"moving_voltage": voltage, "rest_time": time},
    )


def _outcome_without_motion(voltage: float, farthest: float) -> Outcome:
    return Outcome(
        state="failed",
        did=_did(voltage),
        expected=_EXPECTED,
        found=f"No pulse up to {plain(voltage, 3)} V moved the encoder by more than {plain(farthest)} counts, so stopping "
        "can't be proved.",
        figures=(
            Figure(name="voltage of the pulse", value=voltage, unit="V"),
            Figure(name="farthest from the start", value=farthest, unit="counts"),
        ),
        remedy="Check the motor's supply and leads, the encoder's plug, the enable line, and whether something holds the shaft; "
        "if the motor needs more voltage to move, allow a larger one (`voltage_limit=...`).",
    )
