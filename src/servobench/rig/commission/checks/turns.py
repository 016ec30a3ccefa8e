"""The number of counts in a turn: somebody turns the shaft by hand."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from servobench.core.rounding import plain
from servobench.rig.commission.checks.base import CHECKS, Figure, Outcome

if TYPE_CHECKING:
    from servobench.rig.commission.bench import Bench

READING = 10.0  # degrees by which the mark may be off at both ends together
END = 0.1  # s
FEWEST = 4.0  # counts of a turn


@CHECKS.member("turns")
class Turns:
    """Counts of a turn by counting what the hand turns: a mark on the shaft goes round and comes back to where it was."""

    title: ClassVar[str] = "Counts per turn"
    place: ClassVar[int] = 50
    needs: ClassVar[tuple[str, ...]] = ("stop", "watchdog")
    halts: ClassVar[bool] = False
    picture: ClassVar[str] = ""

    def carry_out(self, bench: Bench) -> Outcome:
        """Record at zero volts while the shaft is turned."""
        channel = bench.info.channel("counts")
        claimed = channel.counts_per_rev if channel else None
        says = (
            f"{plain(claimed, 6)} counts, as the settings say"
            if claimed
            else "any number of counts, as the settings give none"
        )
        expected = f"A turn is {says}."
        if bench.person is None:
            return Outcome(
                state="unknown", did="Nothing: nobody was there to turn the shaft.", expected=expected,
                found="Only a hand and an eye can count turns.",
                remedy="Run it in a terminal, which asks for it; or give `turns=1`, and turn the shaft by hand when asked.",
            )  # fmt: skip
        turns = bench.person.turns
        patience, look = bench.person.begin()
        run = bench.wait(patience, look)
        went = float(np.mean(run.between(run.duration - END, np.inf)) - np.mean(run.between(0.0, END)))
        did = (
            f"0 V while the shaft was turned {plain(turns)} times by hand."
            if turns != 1
            else "0 V while the shaft was turned once by hand."
        )
        per_turn = abs(went) / turns
        off = READING / 360 / turns
        figure = Figure(
            name="counts per turn",
            value=per_turn,
            unit="counts",
            interval=(per_turn * (1 - off), per_turn * (1 + off)),
        )
        if per_turn < FEWEST:
            return Outcome(
                state="unknown", did=did, expected=expected, found=f"The encoder saw {plain(abs(went))} counts: no turn.",
                figures=(figure,), remedy="Run it again and turn the shaft; use a mark on it.",
            )  # fmt: skip
        if claimed is None:
            return Outcome(
                state="unknown", did=did, expected=expected, found=f"A turn is about {plain(per_turn, 4)} counts.",
                figures=(figure,), remedy="Look up the encoder's number near that, and set counts_per_rev to it.",
            )  # fmt: skip
        agrees = abs(per_turn / claimed - 1) <= off
        return Outcome(
            state="verified" if agrees else "failed",
            did=did,
            expected=expected,
            found=f"A turn is {figure}.",
            figures=(figure,),
            remedy="" if agrees else _remedy(per_turn / claimed, off),
        )


def _remedy(ratio: float, off: float) -> str:
    known = {
        4.0: "The settings give the encoder's lines; four counts belong to each.",
        0.25: "The settings assume four counts for each line, but the counter counts lines only.",
        2.0: "The counter counts twice as much, as if it counted two edges of a line instead of one.",
        0.5: "The counter counts half as much, as if it counted two edges of a line instead of four.",
    }
    near = [text for factor, text in known.items() if abs(ratio / factor - 1) <= off]
    return " ".join(
        [
            *near,
            f"Set counts_per_rev to {plain(ratio, 3)} times what it is, or check the gear's ratio and turn again.",
        ]
    )
