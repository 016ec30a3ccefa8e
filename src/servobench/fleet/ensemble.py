"""Identify the simulated motors of an ensemble from their recordings, and hold the intervals against the truth."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from servobench.core.errors import ServobenchError
from servobench.core.processors import processors
from servobench.fleet.pool import Died, Processes
from servobench.rig.devices.twin import TwinSettings
from servobench.rig.ensemble.ensemble import Ensemble
from servobench.rig.ensemble.records import recording_of
from servobench.rig.experiment import Experiment

JUDGED = ("gain", "time_constant", "coulomb_voltage")
"""The parameters of a result whose truth an ensemble knows."""
UNITS: Mapping[str, str] = {"gain": "rad/(s·V)", "time_constant": "s", "coulomb_voltage": "V"}
"""Their units."""


@dataclass(frozen=True, kw_only=True)
class IdentifiedMotor:
    """The estimator's answer for one motor: its verdict, or the `reason` why there is none.

    `number` is the motor's in the ensemble, `values` has (value, sd, low, high) of each parameter that is known.
    """

    number: int
    verdict: str
    reason: str
    values: Mapping[str, tuple[float, float, float, float]]


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """How often the 95 % intervals of a parameter contain the true value, among results that aren't refused.

    `known` results have an interval, `covered` of them hold the truth. `scatter` is the standard deviation of estimate less truth
    over the stated standard deviation, which is 1 where that is right, and `bias` its mean.
    """

    parameter: str
    known: int
    covered: int
    scatter: float
    bias: float

    @property
    def share(self) -> float:
        """The share of the intervals that hold the truth."""
        return self.covered / self.known if self.known else math.nan

    @property
    def sd(self) -> float:
        """The standard deviation of the share: √(p (1 - p)/n) with p = 0.95."""
        return math.sqrt(0.95 * 0.05 / self.known) if self.known else math.nan


def identify_ensemble(ensemble: Ensemble, workers: int | None = None) -> Iterator[IdentifiedMotor]:
    """Yield what the estimator finds of each motor, in their order; each is run by itself where it is identified.

    `workers` is the number of processes, by default one for each processor; what is found doesn't depend on it. A script that
    calls this has to do it below `if __name__ == "__main__":`.
    """
    work = partial(_identify, ensemble.experiment, ensemble.motor, ensemble.seed)
    items = (
        (number, {name: float(values[number]) for name, values in ensemble.parameters.items()})
        for number in range(len(ensemble))
    )
    with Processes(work, min(workers or processors(), len(ensemble))) as pool:
        for (number, _), outcome in pool.results(items):
            if isinstance(outcome, Died):
                yield IdentifiedMotor(number=number, verdict="", reason=outcome.reason, values={})
            else:
                yield outcome


def _identify(
    experiment: Experiment, twin: TwinSettings, seed: int, item: tuple[int, dict[str, float]]
) -> IdentifiedMotor:
    from servobench.identification.identify import identify

    number, parameters = item
    try:
        result = identify(recording_of(parameters, number, experiment, twin, seed))
    except ServobenchError as error:
        return IdentifiedMotor(number=number, verdict="", reason=" ".join(str(error).split()), values={})
    document = result.to_dict(derived=False)
    values = {
        name: (each["value"], each["sd"], *each["interval"])
        for name, each in document["parameters"].items()
        if name in JUDGED and (each.get("state") or "known") == "known" and None not in each["interval"]
    }
    return IdentifiedMotor(number=number, verdict=document["verdict"], reason="", values=values)


def truths_of(ensemble: Ensemble) -> dict[str, np.ndarray]:
    """Return the truth of each of `JUDGED` (n,): K, τ, and the Coulomb voltage T_c R/k."""
    p = ensemble.parameters
    resistance = p["resistance"] + ensemble.motor.amplifier_resistance
    return {
        "gain": ensemble.outcomes["gain"],
        "time_constant": ensemble.outcomes["time_constant"],
        "coulomb_voltage": p["coulomb_torque"] * resistance / p["motor_constant"],
    }


def coverages(ensemble: Ensemble, motors: Sequence[IdentifiedMotor]) -> tuple[Coverage, ...]:
    """Return how the intervals of each parameter do, for those that any motor has."""
    coverage_rows = []
    for name, truth in truths_of(ensemble).items():
        rows = [
            (each.values[name], float(truth[each.number]))
            for each in motors
            if each.verdict in ("trusted", "doubtful") and name in each.values
        ]
        if not rows:
            continue
        off = np.array([(value - true) / sd for (value, sd, _, _), true in rows if sd > 0])
        coverage_rows.append(
            Coverage(
                parameter=name,
                known=len(rows),
                covered=sum(low <= true <= high for (_, _, low, high), true in rows),
                scatter=float(off.std()) if len(off) else math.nan,
                bias=float(off.mean()) if len(off) else math.nan,
            )
        )
    return tuple(coverage_rows)
