"""The delay from a voltage to the shaft."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from servobench.core.rounding import milliseconds, plain, with_unit
from servobench.identification.commission.checks.base import CHECKS, Figure, Outcome
from servobench.identification.identify import identify
from servobench.identification.uncertainty.identifiability import State as Answer

if TYPE_CHECKING:
    from servobench.identification.commission.bench import Bench

PERIODS, HALF = 8, 0.4  # of the square wave, and half of its period [s]
STRONGER = 3.0  # times the voltage that turns the motor slowly
PART = 0.5  # of the voltage limit
TOLERANCE = 1.0  # sample times


@CHECKS.member("delay")
class Delay:
    """A square wave, identified: its result has the delay with an interval, which is compared with what the device says."""

    title: ClassVar[str] = "Delay"
    place: ClassVar[int] = 90
    needs: ClassVar[tuple[str, ...]] = ("stop", "watchdog")
    halts: ClassVar[bool] = False
    picture: ClassVar[str] = ""

    def carry_out(self, bench: Bench) -> Outcome:
        """Turn the motor to and fro, and identify it."""
        voltage = min(STRONGER * bench.spin_voltage, PART * bench.limit)
        steps = [(sign * voltage, HALF) for _ in range(PERIODS) for sign in (1.0, -1.0)]
        seen = bench.drive(*steps)
        stated, most = bench.info.delay, TOLERANCE * bench.sample_time
        did = f"A square wave of ±{plain(voltage, 3)} V, {PERIODS} periods of {2 * HALF:g} s, identified."
        expected = f"The delay is {milliseconds(stated)} ms, as the device says, within a sample time of {milliseconds(most)} ms."
        result = identify(seen.recording)
        answer = result.answers.get("delay")
        estimate = result.fit.estimates.get("delay") if result.fit else None
        if estimate is None or (
            answer is not None and answer.state is not Answer.KNOWN and not _narrow(estimate.half_width, most)
        ):
            return Outcome(
                state="unknown", did=did, expected=expected,
                found=f"The recording only tells that the delay is {with_unit(estimate.interval[1], 's', 2)} at most."
                if estimate
                else "The motor couldn't be identified, and so the delay isn't known.",
                remedy="Look at the recording with `servobench identify`, which says why.",
            )  # fmt: skip
        low, high = estimate.interval
        figure = Figure(name="delay", value=estimate.value, unit="s", interval=(low, high))
        beyond = low > stated + most or high < stated - most
        sure = high <= stated + most and low >= stated - most
        state = "failed" if beyond else "verified" if sure else "unknown"
        remedies = {
            "failed": f"Set the device's delay to {milliseconds(estimate.value)} ms, or find what delays: the bus, the driver, "
            "a filter.",
            "unknown": "The interval is wider than what is expected. Allow a larger voltage: `voltage_limit=...`.",
        }
        return Outcome(
            state="failed" if beyond else "verified" if sure else "unknown",
            did=did,
            expected=expected,
            found=f"The delay is {figure}.",
            figures=(figure,),
            remedy=remedies.get(state, ""),
        )


def _narrow(half: float, most: float) -> bool:
    """Whether an interval is narrow enough to say something, whatever else is said of it."""
    return half <= most
