"""A positive voltage counts upwards."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from servobench.core.rounding import plain
from servobench.rig.commission.bench import LEAD
from servobench.rig.commission.checks.base import CHECKS, Figure, Outcome

if TYPE_CHECKING:
    from servobench.rig.commission.bench import Bench

DURATION, FIRST = 0.6, 0.3  # s; and the part before the speed is examined
CLEARLY = 5.0  # counts


@CHECKS.member("sign")
class Sign:
    """The direction of the counts under a positive voltage: a loop around a wrong sign runs away."""

    title: ClassVar[str] = "Sign convention"
    place: ClassVar[int] = 60
    needs: ClassVar[tuple[str, ...]] = ("stop", "watchdog")
    halts: ClassVar[bool] = False
    picture: ClassVar[str] = ""

    def carry_out(self, bench: Bench) -> Outcome:
        """Put a small positive voltage out."""
        voltage = bench.spin_voltage
        run = bench.drive((voltage, DURATION))
        went = run.at(LEAD + DURATION) - run.at(LEAD)
        speed = run.speed(LEAD + FIRST, LEAD + DURATION)
        factor, unit = bench.speed_unit
        clear = abs(went) >= CLEARLY + bench.quiet
        rises = went > 0
        return Outcome(
            state="unknown" if not clear else "verified" if rises else "failed",
            did=f"{plain(voltage, 3)} V for {DURATION:g} s.",
            expected="The counts rise.",
            found=f"The counts {'rose' if rises else 'fell'} by {plain(abs(went))}."
            if clear
            else f"The shaft moved by {plain(abs(went))} counts only.",
            figures=(
                Figure(name="motion", value=went, unit="counts"),
                Figure(name="speed", value=speed / factor, unit=unit),
            ),
            remedy="Find what holds the shaft." if not clear else ""
            if rises
            else "Swap the motor's leads, or the encoder's channels A and B, or set the sign in the device's settings. Don't "
            "close a loop before that: it would run away.",
            learned={"speed": speed, "speed_voltage": voltage},
        )  # fmt: skip
