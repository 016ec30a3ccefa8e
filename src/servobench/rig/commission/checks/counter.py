"""The width of the counter, and its wrap both ways."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from servobench.core.channels import SHORTEST_STEP
from servobench.core.rounding import plain, with_unit
from servobench.rig.commission.checks.base import CHECKS, Figure, Outcome, no_outcome

if TYPE_CHECKING:
    from servobench.rig.commission.bench import Bench
    from servobench.rig.commission.check_run import CheckRun

FAR = 70_000.0  # counts: beyond what 16 bits hold, whatever the counter began with
STEP = 60.0  # counts a sample that the motor turns at most: half of what 8 bits can tell apart
PART = 0.5  # of the voltage limit
LONGEST, LONGEST_WRAP = 15.0, 600.0  # s one way; with --until-wrap
SPIN_UP = 1.0  # s
FEWEST_BITS, MOST_BITS = 6, 32


@CHECKS.member("counter")
class Counter:
    """Turn far enough one way, then back: a wrap is a jump by 2^n from one sample to the next.

    The jumps are looked for in the raw counts, whatever the device says of its counter, and are compared with that afterwards.
    """

    title: ClassVar[str] = "Counter width and wrap"
    place: ClassVar[int] = 100
    needs: ClassVar[tuple[str, ...]] = ("stop", "watchdog")
    halts: ClassVar[bool] = False
    picture: ClassVar[str] = "The voltage, and the counts as the counter shows them."

    def carry_out(self, bench: Bench) -> Outcome:
        """Turn one way and back, and look for jumps."""
        channel = bench.info.channel("counts")
        claimed = channel.counter_bits if channel else None
        gain = abs(bench.value_of("speed", 0.0) / bench.value_of("speed_voltage"))
        if not gain > 0:
            return no_outcome("the speed isn't known")
        voltage = min(PART * bench.limit, STEP / bench.sample_time / gain)
        speed = gain * voltage
        far = max(FAR, 1.1 * 2.0 ** ((claimed or 16) - 1)) if bench.until_wrap else FAR
        time = SPIN_UP + far / speed
        longest = LONGEST_WRAP if bench.until_wrap else LONGEST
        too_far = time > longest
        time = min(time, longest)
        run = bench.drive(
            (voltage, time),
            (0.0, bench.tail),
            (-voltage, time + SPIN_UP),
            limits={"possible_speed": _permissive(bench, claimed)},
        )
        jumps, bits = wraps(run)
        went = float(np.ptp(_without(run.raw, bits)))
        did = (
            f"{plain(voltage, 3)} V for {plain(time, 3)} s, then {plain(-voltage, 3)} V: "
            f"{plain(went, 3)} counts one way and back."
        )
        expected = (
            f"The counter wraps at {claimed} bits and nowhere else, both ways." if claimed else "No jump."
        )
        figures: tuple[Figure, ...] = (
            Figure(name="turned one way", value=went, unit="counts"),
            Figure(name="wraps upwards", value=float(np.count_nonzero(jumps < 0)), unit="1"),
            Figure(name="wraps downwards", value=float(np.count_nonzero(jumps > 0)), unit="1"),
        )
        if bits is not None:
            figures = (*figures, Figure(name="width", value=float(bits), unit="bits"))
            return _outcome_of_wraps(did, expected, figures, bits, claimed, jumps)
        if claimed is not None and went > 2.0**claimed:
            return Outcome(
                state="failed", did=did, expected=expected, figures=figures,
                found=f"The counter didn't wrap at {claimed} bits, as it should have done.",
                remedy="Correct counter_bits in the device's info: wraps are removed that aren't there.",
            )  # fmt: skip
        held = math.floor(math.log2(max(went, 2.0)))
        if claimed is None:
            return Outcome(
                state="unknown", did=did, expected=expected, figures=figures,
                found=f"The counter didn't wrap; it has more than {held} bits.",
                remedy="The device states no width. If you know it, state it in the device's info.",
            )  # fmt: skip
        needed = 2.0 ** (claimed - 1) / speed
        return Outcome(
            state="unknown", did=did, expected=expected, figures=figures,
            found=f"The counter didn't wrap, and one of {claimed} bits shouldn't have by then; it has more than {held} bits.",
            remedy=f"The wrap at {claimed} bits is {with_unit(needed, 's', 2)} away at this speed."
            + (
                " That is too long to try."
                if too_far or needed > LONGEST_WRAP
                else " `until_wrap=...` turns the motor for that long."
            ),
        )  # fmt: skip


def _permissive(bench: Bench, claimed: int | None) -> float:
    """A speed so high that the guard lets jumps pass that the claimed width doesn't explain, as they are looked for [rad/s]."""
    half = 2.0 ** ((claimed or MOST_BITS) - 1)
    return 0.4 * half / bench.sample_time / bench.speed_unit[0]


def wraps(run: CheckRun) -> tuple[np.ndarray[tuple[int], np.dtype[np.float64]], int | None]:
    """Return the jumps in the raw counts, and the width that explains them [bits]; None without a jump.

    A jump is a step that differs by more than half of the smallest width from what the median speed of its neighbours makes of
    the time that it took, as samples may be missing.
    """
    steps, times = np.diff(run.raw), np.maximum(np.diff(run.t), SHORTEST_STEP)
    if len(steps) < 5:
        return np.empty(0), None
    speeds = np.pad(steps / times, 4, mode="reflect")
    around = times * np.median(np.lib.stride_tricks.sliding_window_view(speeds, 9), axis=1)
    off = steps - around
    jumps = off[np.abs(off) > 2.0 ** (FEWEST_BITS - 1) + np.abs(around)]
    if not len(jumps):
        return jumps, None
    bits = round(math.log2(float(np.median(np.abs(jumps)))))
    return jumps, bits if FEWEST_BITS <= bits <= MOST_BITS else MOST_BITS


def _without(
    raw: np.ndarray[tuple[int], np.dtype[np.float64]], bits: int | None
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Counts without the wraps of a counter of that width."""
    from servobench.recordings.measurement.unwrap import unwrap

    return raw if bits is None else unwrap(raw, 2.0**bits).count


def _outcome_of_wraps(
    did: str,
    expected: str,
    figures: tuple[Figure, ...],
    bits: int,
    claimed: int | None,
    jumps: np.ndarray[tuple[int], np.dtype[np.float64]],
) -> Outcome:
    both = bool((jumps > 0).any() and (jumps < 0).any())
    alike = bool((np.abs(np.abs(jumps) / 2.0**bits - 1) < 0.25).all())
    if bits == claimed and alike:
        return Outcome(
            state="verified" if both else "unknown", did=did, expected=expected, figures=figures,
            found=f"The counter wraps at {bits} bits{', both ways.' if both else '; only one way was seen.'}",
            remedy="" if both else "Run it again: the shaft stopped before the wrap on its way back.",
        )  # fmt: skip
    return Outcome(
        state="failed", did=did, expected=expected, figures=figures,
        found=f"The counts jump by about 2^{bits} = {2**bits}; the device says {claimed or 'no'} bits."
        if alike
        else f"The counts jump, by {plain(float(np.abs(jumps).min()))} to {plain(float(np.abs(jumps).max()))}: that is no wrap.",
        remedy="Set counter_bits to the width of the counter."
        if alike
        else "Check the encoder's cable, and how its counts are read.",
    )  # fmt: skip
