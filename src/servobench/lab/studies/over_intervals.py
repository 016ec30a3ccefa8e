"""The study `over_intervals`: whether what is said of stability holds for all parameters that the data leave open."""

from __future__ import annotations

import numpy as np

from servobench.core.errors import NotIdentifiable
from servobench.core.estimate import Estimate
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import TWO_SIDED, rounded_interval
from servobench.identification.estimators.base import Fit
from servobench.identification.uncertainty.propagation import LEVEL, propagate
from servobench.identification.uncertainty.stability import loop_over_intervals, stability_over_intervals
from servobench.lab.expression import Fact
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.rig.experiment import Experiment
from servobench.rig.experiment.experiment import PAPER
from servobench.systems.transfer_function import TransferFunction


@STUDIES.member("over_intervals")
class OverIntervals(StudySettings):
    """Identifies the motor from a square wave, and asks whether the verdict on poles and loop holds over the intervals."""

    kp: float = 1.0
    """Gain of the position loop that is asked about [V/rad]."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the parameters with their intervals, and the verdicts; raises `NotIdentifiable` where nothing is identified."""
        from servobench.identification.identify import identify
        from servobench.recordings.measurement.measure import measure

        result = identify(measure(stand.run(_experiment(stand.experiment))))
        if result.fit is None:
            why = "; ".join(finding.sentence for finding in result.findings)
            raise NotIdentifiable(f"the square wave doesn't identify the motor: {why}")
        known = {**result.fit.estimates, **_poles(result.fit)}
        feedback = TransferFunction(numerator=(self.kp,), denominator=(1.0,), output="input", unit="1")
        values = {
            "speed": stability_over_intervals(result.fit, "speed"),
            "position": stability_over_intervals(result.fit, "position"),
            "loop": loop_over_intervals(result.fit, feedback),
        }
        columns = (
            Column(
                name="parameter",
                heading="",
                values=tuple(parameter_in_words(name, e.unit) for name, e in known.items()),
            ),
            Column(
                name="interval",
                heading="identified",
                values=tuple(str(rounded_interval(e.value, e.interval, e.unit)) for e in known.values()),
            ),
        )
        table = Table(title="The motor from a square wave of 1 to 3 V, 95 % intervals", columns=columns)
        facts = {
            name: Fact(value=e.value, half=0.5 * (e.interval[1] - e.interval[0])) for name, e in known.items()
        }
        return StudyResult(
            tables=(table,),
            sentences=tuple(
                f"{what} {each.sentence}"
                for what, each in zip(
                    ("To the speed:", "To the position:", f"The position loop with {self.kp:g} V/rad:"),
                    values.values(),
                    strict=True,
                )
            ),
            facts=facts | {f"{name}_share": Fact(value=each.share) for name, each in values.items()},
        )


def _poles(fit: Fit) -> dict[str, Estimate]:
    """The real parts of the poles to the speed, with their intervals."""
    poles = propagate(fit, lambda model: np.sort(model.transfer_function("speed").poles.real)[::-1])
    names = ["pole"] if len(poles.value) == 1 else [f"pole_{n + 1}" for n in range(len(poles.value))]
    return {
        name: Estimate(
            value=float(value),
            sd=float(high - low) / (2 * TWO_SIDED),
            interval=(float(low), float(high)),
            level=LEVEL,
            unit="1/s",
        )
        for name, value, low, high in zip(names, poles.value, poles.low, poles.high, strict=True)
    }


def _experiment(own: Experiment) -> Experiment:
    """The square wave, on the exercise's own device."""
    return PAPER.model_copy(update={"device": own.device, "limits": own.limits})
