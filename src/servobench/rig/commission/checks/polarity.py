"""A negative voltage turns the motor the other way."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

from servobench.core.rounding import plain
from servobench.rig.commission.bench import LEAD
from servobench.rig.commission.checks.base import CHECKS, Figure, Outcome, no_outcome
from servobench.rig.commission.checks.sign import DURATION, FIRST

if TYPE_CHECKING:
    from servobench.rig.commission.bench import Bench

UNEVEN = 2.0  # times as fast one way as the other, at a voltage that is a few times friction


@CHECKS.member("polarity")
class Polarity:
    """Both directions: a bridge whose direction pin is dead turns one way under either sign."""

    title: ClassVar[str] = "Polarity: both directions"
    place: ClassVar[int] = 65
    needs: ClassVar[tuple[str, ...]] = ("stop", "watchdog")
    halts: ClassVar[bool] = False
    picture: ClassVar[str] = ""

    def carry_out(self, bench: Bench) -> Outcome:
        """Put the voltage of the check of the sign out with the other sign, and compare the speeds."""
        voltage = -bench.value_of("speed_voltage")
        if not math.isfinite(voltage):
            return no_outcome("the speed forwards isn't known")
        run = bench.drive((voltage, DURATION))
        forward, back = bench.value_of("speed"), run.speed(LEAD + FIRST, LEAD + DURATION)
        factor, unit = bench.speed_unit
        ratio = -back / forward if forward else math.nan
        even = 1 / UNEVEN <= ratio <= UNEVEN
        if even:
            sentence = f"The motor turned the other way, as fast to within {max(1, math.ceil(abs(100 * (ratio - 1))))} %."
        elif ratio > 0:
            sentence = f"The motor turned the other way, but {plain(ratio, 3)} times as fast."
        else:
            sentence = "The motor didn't turn the other way."
        return Outcome(
            state="verified" if even else "failed",
            did=f"{plain(voltage, 3)} V for {DURATION:g} s; the speed was compared with that under {plain(-voltage, 3)} V.",
            expected=f"The motor turns the other way, and about as fast: within a factor of {UNEVEN:g}.",
            found=sentence,
            figures=(
                Figure(name="speed forwards", value=forward / factor, unit=unit),
                Figure(name="speed backwards", value=back / factor, unit=unit),
            ),
            remedy=""
            if even
            else "Check the direction pin and both halves of the bridge; an offset of the amplifier, or a load that pulls, "
            "makes it uneven.",
        )
