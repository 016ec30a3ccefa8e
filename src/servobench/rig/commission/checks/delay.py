"""The delay from a voltage to the shaft."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from servobench.core.rounding import milliseconds, plain
from servobench.rig.commission.checks.base import CHECKS, Figure, Outcome

if TYPE_CHECKING:
    from servobench.core.channels import Array
    from servobench.rig.commission.bench import Bench
    from servobench.rig.commission.check_run import CheckRun

STEPS, LENGTH = 20, 0.15  # steps from rest, and the mean time of each [s]
UNLIKE, GOLDEN = 0.4, 0.618  # by how much their times differ, and the ratio that spreads them evenly
PART, STRONGER = (
    0.3,
    3.0,
)  # of the voltage limit; or times the voltage that turns the motor slowly, where that is more
MOST = 0.5  # of the voltage limit
TOLERANCE = 1.0  # sample times
PAUSE, REST_SPARE = (
    0.8,
    0.7,
)  # s between steps: less than a run ends with, as a step that doesn't begin at rest is left out
BEFORE = 0.05  # s at rest before a step
LOW, HIGH = 3.0, 80.0  # counts of motion between which the beginning of a motion is examined
FEWEST_SAMPLES, FEWEST_STEPS = 5, 4
BEND = 0.01  # of the length of that part of the motion: what a parabola of the root misses of a shaft with friction and winding


@CHECKS.member("delay")
class Delay:
    """Steps from rest, one way and the other: when does the shaft begin to move?

    A motor at rest moves by e = ½ a (t - d)² after a step, and a little less later. So √e is nearly a straight line, which a
    parabola follows; its zero is the delay d. The steps begin anywhere between two lines of the encoder, so that their scatter
    tells what rounding does, by Student's t.
    """

    title: ClassVar[str] = "Delay"
    place: ClassVar[int] = 90
    needs: ClassVar[tuple[str, ...]] = ("stop", "watchdog")
    halts: ClassVar[bool] = False
    picture: ClassVar[str] = ""

    def carry_out(self, bench: Bench) -> Outcome:
        """Step from rest to and fro, and see when the counts follow."""
        voltage = min(max(STRONGER * bench.spin_voltage, PART * bench.limit), MOST * bench.limit)
        steps: list[tuple[float, float]] = []
        for number in range(STEPS):
            # Steps of one length would take the shaft to and fro between the same two places, with the same rounding.
            length = LENGTH * (1 + UNLIKE * (number * GOLDEN % 1 - 0.5))
            steps += [((-1) ** number * voltage, length), (0.0, max(bench.tail - REST_SPARE, PAUSE))]
        run = bench.drive(*steps)
        stated, most = bench.info.delay, TOLERANCE * bench.sample_time
        did = f"{STEPS} steps from rest of ±{plain(voltage, 3)} V and {1000 * LENGTH:g} ms; the first counts were timed."
        expected = f"The delay is {milliseconds(stated)} ms, as the device says, within a sample time of {milliseconds(most)} ms."
        delays, length = onsets(run)
        if len(delays) < FEWEST_STEPS:
            return Outcome(
                state="unknown", did=did, expected=expected,
                found=f"Only {len(delays)} of the steps began at rest and could be timed.",
                remedy="Allow a larger voltage (`voltage_limit=...`), or take a load off that coasts.",
            )  # fmt: skip
        mean, half = _interval(delays, length)
        figure = Figure(name="delay", value=mean, unit="s", interval=(mean - half, mean + half))
        beyond = abs(mean - stated) > most + half
        sure = abs(mean - stated) + half <= most
        remedy = ""
        if beyond:
            remedy = (
                f"Find the cause: the bus, the driver, a filter. If the delay can't be avoided, state "
                f"{milliseconds(mean)} ms in the device's info, so that control and identification know it."
            )
        elif not sure:
            remedy = (
                "The interval reaches beyond what is expected: allow a larger voltage (`voltage_limit=...`)."
            )
        return Outcome(
            state="failed" if beyond else "verified" if sure else "unknown",
            did=did,
            expected=expected,
            found=f"The delay is {figure}.",
            figures=(figure,),
            remedy=remedy,
        )


def onsets(run: CheckRun) -> tuple[Array, float]:
    """Return the delay of each step from rest (N,) [s], and the mean length of the motion that they were read off [s]."""
    commanded = run.recording["commanded"].values[: len(run.t)]
    edges = np.flatnonzero((commanded[1:] != 0) & (commanded[:-1] == 0)) + 1
    pairs = [pair for edge in edges if (pair := _onset(run, commanded, int(edge))) is not None]
    lengths = [length for _, length in pairs]
    return np.array([delay for delay, _ in pairs]), float(np.mean(lengths)) if lengths else 0.0


def _onset(run: CheckRun, commanded: Array, edge: int) -> tuple[float, float] | None:
    """The delay of one step, and the length of the motion that it was read off [s]; None where it didn't begin at rest."""
    begin = float(run.t[edge])
    rest = run.counts[(run.t > begin - BEFORE) & (run.t <= begin)]
    over = np.flatnonzero(commanded[edge:] == 0)
    end = edge + int(over[0]) if len(over) else len(run.t) - 1
    moved = np.abs(run.counts[edge : end + 1] - rest.mean())
    fast = np.flatnonzero(moved > HIGH)
    last = int(fast[0]) if len(fast) else len(moved) - 1
    slow = np.flatnonzero(moved[: last + 1] < LOW)
    first = int(slow[-1]) + 1 if len(slow) else 0
    if np.ptp(rest) > 1 or last - first + 1 < FEWEST_SAMPLES:
        return None
    t = run.t[edge + first : edge + last + 1] - begin
    roots = np.roots(np.polyfit(t, np.sqrt(moved[first : last + 1]), 2))
    real = roots[np.isreal(roots)].real
    if not len(real):
        return None
    return float(real[np.argmin(np.abs(real - t[0]))]), float(t[-1] - t[0])


def _interval(delays: Array, length: float) -> tuple[float, float]:
    """The mean delay, and half of its 95 % interval [s]."""
    from scipy.special import stdtrit

    error = float(delays.std(ddof=1)) / len(delays) ** 0.5
    return float(delays.mean()), float(stdtrit(len(delays) - 1, 0.975)) * error + BEND * length
