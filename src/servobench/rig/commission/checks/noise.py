"""The sensors' noise while the shaft doesn't move."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from servobench.core.rounding import TWO_SIDED
from servobench.rig.commission.checks.base import CHECKS, Figure, Outcome

if TYPE_CHECKING:
    from servobench.rig.commission.bench import Bench

DURATION = 2.0  # s
FLICKER = 2.0  # counts; the encoder may stand on a line
PART_OF_RANGE = 0.05  # for scatter and offset of the current


@CHECKS.member("noise")
class Noise:
    """The range of the counts at rest, and scatter and offset of current and tachometer where the device has them."""

    title: ClassVar[str] = "Noise floor"
    place: ClassVar[int] = 20
    needs: ClassVar[tuple[str, ...]] = ("rest",)
    halts: ClassVar[bool] = False
    picture: ClassVar[str] = ""

    def carry_out(self, bench: Bench) -> Outcome:
        """Record at zero volts."""
        run = bench.wait(DURATION)
        swing = run.range(0.0, DURATION)
        figures = [Figure(name="counts, largest less smallest", value=swing, unit="counts")]
        wrong = ["the counts"] if swing > FLICKER else []
        for name, values in run.sensors.items():
            channel = bench.info.channel(name)
            unit = (channel.unit if channel else None) or ""
            figures += _figures(name, values, unit)
            most = channel.maximum if channel else None
            if most and max(abs(float(values.mean())), float(values.std())) > PART_OF_RANGE * most:
                wrong.append(f"the {name}")
        quiet = not wrong
        return Outcome(
            state="verified" if quiet else "failed",
            did=f"0 V for {DURATION:g} s; every sensor was recorded.",
            expected=f"The counts flicker by at most {FLICKER:g}; offset and scatter of a sensor with a known range stay below "
            f"{100 * PART_OF_RANGE:g} % of it.",
            found="The sensors are quiet at rest."
            if quiet
            else f"At rest {' and '.join(wrong)} aren't quiet.",
            figures=tuple(figures),
            remedy=""
            if quiet
            else "Keep the encoder's cable away from the motor's, shield or shorten it, and check the sensor's supply and scale.",
            learned={"noise": swing},
        )


def _figures(name: str, values: np.ndarray[tuple[int], np.dtype[np.float64]], unit: str) -> list[Figure]:
    mean, sd = float(values.mean()), float(values.std())
    half = TWO_SIDED * sd / len(values) ** 0.5
    return [
        Figure(name=f"{name}, offset", value=mean, unit=unit, interval=(mean - half, mean + half)),
        Figure(name=f"{name}, standard deviation", value=sd, unit=unit),
    ]
