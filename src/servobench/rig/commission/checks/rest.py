"""Zero volts hold the shaft."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from servobench.core.rounding import plain
from servobench.rig.commission.checks.base import CHECKS, Figure, Outcome

if TYPE_CHECKING:
    from servobench.rig.commission.bench import Bench

DURATION, PART = 2.0, 0.5  # s
DRIFT = 2.0  # counts
PART_OF_A_TURN = 0.01  # that an encoder may flicker by; more is motion


@CHECKS.member("rest")
class Rest:
    """At zero volts nothing may move: neither a drift from the first half second to the last, nor a swing in between."""

    title: ClassVar[str] = "0 V holds the shaft"
    place: ClassVar[int] = 10
    needs: ClassVar[tuple[str, ...]] = ()
    halts: ClassVar[bool] = True
    picture: ClassVar[str] = ""

    def carry_out(self, bench: Bench) -> Outcome:
        """Record at zero volts."""
        run = bench.wait(DURATION)
        channel = bench.info.channel("counts")
        turn = channel.counts_per_rev if channel else None
        most = max(8.0, round(PART_OF_A_TURN * (turn or 0.0)))
        drift = float(np.mean(run.between(DURATION - PART, DURATION)) - np.mean(run.between(0.0, PART)))
        swing = run.range(0.0, DURATION)
        still = abs(drift) <= DRIFT and swing <= most
        return Outcome(
            state="verified" if still else "failed",
            did=f"0 V for {DURATION:g} s; the counts were watched.",
            expected=f"The counts drift by at most {DRIFT:g} and swing by at most {plain(most)}.",
            found="The shaft stayed where it was." if still else "The shaft moved although 0 V were put out.",
            figures=(
                Figure(name="drift", value=drift, unit="counts"),
                Figure(name="swing", value=swing, unit="counts"),
            ),
            remedy=""
            if still
            else "Cut the supply. Look for an amplifier with an offset, a command that means another voltage than 0 V, a load "
            "that pulls, or an encoder that picks up noise.",
        )
