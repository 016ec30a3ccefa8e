"""The study `estimate_noise`: how far gain and time constant scatter by the encoder's rounding, as the experiment changes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.rounding import plain
from servobench.core.settings import CountsPerRev, PositiveTime, PositiveVoltage
from servobench.lab.expression import Fact
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.lab.truth import Truth, truth_of
from servobench.rig.experiment.experiment import DeviceChoice, Experiment
from servobench.systems.signals.square import Square

if TYPE_CHECKING:
    from servobench.recordings.measurement.dataset import Dataset

_FINE = (
    2.0**22
)  # counts a turn of the encoder that stands for the shaft itself: 2000 times finer than any to be studied
_ESTIMATOR, _STRUCTURE = "output_error", "first_order_one_way"


@dataclass(frozen=True, kw_only=True)
class _Case:
    """One experiment: what is varied, and its sample time [s], counts a turn and amplitude [V]."""

    varied: str
    value: str
    sample_time: float
    counts: float
    amplitude: float


@dataclass(frozen=True, kw_only=True)
class _Scatter:
    """Relative standard deviations of gain and time constant [1]: the bound, what the estimator states, and over the runs."""

    bound: tuple[float, float]
    stated: tuple[float, float]
    scatter: tuple[float, float]


@STUDIES.member("estimate_noise")
class EstimateNoise(StudySettings):
    """Standard deviations of K and τ against sample time, counts a turn and amplitude, by the bound and over many encoders.

    The exercise's square wave is run with one thing changed at a time. Each motion is counted by `runs` encoders that stand
    differently on the shaft, and identified by output error. `bound` is that of Cramér 1946 and Rao 1945 for white noise of
    Q/√12, with offset, delay and start state unknown: σ² (J'J)⁻¹. An encoder's rounding isn't white where the motion repeats,
    so that the scatter may be above it.
    """

    sample_times: tuple[PositiveTime, ...] = (0.001, 0.002, 0.005, 0.01)
    """Sample times [s]."""
    counts: tuple[CountsPerRev, ...] = (512.0, 2048.0, 8192.0)
    """Counts of the encoder in a turn."""
    amplitudes: tuple[PositiveVoltage, ...] = (0.25, 0.5, 1.0)
    """Amplitudes of the square wave around its mean [V]."""
    runs: Annotated[int, Field(ge=5, le=200)] = 20
    """Encoders; a standard deviation over N of them is itself uncertain by a part 1/√(2N - 2)."""
    seed: Annotated[int, Field(ge=0)] = 7
    """Seed of how the encoders stand."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table; raises `UsageError` where the exercise's signal is no square wave that turns the motor one way."""
        square = _square(stand.experiment)
        truth = truth_of(stand.recording)
        counts = stand.facts["counts_per_rev"].value
        cases = list(self._cases(square, stand.experiment.sample_time, counts))
        motions: dict[tuple[float, float], Dataset] = {}
        scatters = []
        for number, case in enumerate(cases):
            key = (case.sample_time, case.amplitude)
            if key not in motions:
                motions[key] = _motion(stand, square, case)
            random = np.random.default_rng([self.seed, number])
            scatters.append(_scatter(motions[key], case, truth, random.uniform(size=self.runs)))
        return StudyResult(
            tables=(_table(cases, scatters, self.runs),), facts={"runs": Fact(value=self.runs)}
        )

    def _cases(self, square: Square, sample_time: float, counts: float) -> Iterator[_Case]:
        amplitude = 0.5 * (square.high - square.low)
        own = _Case(varied="", value="", sample_time=sample_time, counts=counts, amplitude=amplitude)
        for step in self.sample_times:
            yield replace(own, varied="sample time", value=f"{plain(1e3 * step)} ms", sample_time=step)
        for each in self.counts:
            yield replace(own, varied="counts a turn", value=plain(each), counts=each)
        for volts in self.amplitudes:
            yield replace(own, varied="amplitude", value=f"{plain(volts)} V", amplitude=volts)


def _square(experiment: Experiment) -> Square:
    signal = experiment.signal
    if not isinstance(signal, Square) or signal.low <= 0:
        raise UsageError(
            f"the signal is {signal!r}; this study changes the amplitude of a square wave that turns the motor one way, so "
            "expected a square wave with both levels above 0 V"
        )
    return signal


def _motion(stand: Stand, square: Square, case: _Case) -> Dataset:
    """The run of a case, counted so finely that its positions are the shaft's own."""
    from servobench.recordings.measurement.measure import measure

    middle = 0.5 * (square.low + square.high)
    signal = square.model_copy(update={"low": middle - case.amplitude, "high": middle + case.amplitude})
    device = stand.experiment.device
    fine = DeviceChoice(
        name=device.name, settings={**device.settings, "counts_per_rev": _FINE, "counter_bits": 32}
    )
    update = {"signal": signal, "sample_time": case.sample_time, "device": fine}
    return measure(stand.run(stand.experiment.model_copy(update=update)))


def _scatter(motion: Dataset, case: _Case, truth: Truth, places: Array) -> _Scatter:
    """The scatter of a motion seen by encoders at `places` (N,), parts of a count."""
    from servobench.identification.estimators.base import ESTIMATORS
    from servobench.identification.estimators.covariance import inverse
    from servobench.identification.models.base import STRUCTURES

    method, structure = ESTIMATORS[_ESTIMATOR], STRUCTURES[_STRUCTURE]
    best = method.fit(structure, [motion])
    quantum = 2 * math.pi / case.counts
    prediction = structure.predict(best.vector, motion)
    jacobian = prediction.jacobian[prediction.valid]
    bound = np.sqrt(np.diag(inverse(jacobian.T @ jacobian)) * quantum**2 / 12)
    fits = [method.fit(structure, [_count_motion(motion, quantum, float(p))], [best.vector]) for p in places]
    values = np.array([each.model.theta[:2] for each in fits])
    stated = np.sqrt(np.mean([np.diag(each.covariance)[:2] for each in fits], axis=0))
    size = np.array([truth.gain, truth.time_constant])
    return _Scatter(
        bound=_pair(bound[:2] / size),
        stated=_pair(stated / size),
        scatter=_pair(values.std(axis=0, ddof=1) / size),
    )


def _count_motion(motion: Dataset, quantum: float, place: float) -> Dataset:
    """An encoder's record of a motion, the middle of each count, for a quantum [rad] and a distance from the edge of one."""
    y = (np.floor(motion.y / quantum + place) + 0.5) * quantum
    return replace(motion, y=y, quantum=quantum)


def _pair(values: Array) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _table(cases: Sequence[_Case], scatters: Sequence[_Scatter], runs: int) -> Table:
    def column(name: str, heading: str, values: Sequence[float]) -> Column:
        return Column(name=name, heading=heading, unit="ppm", digits=2, values=tuple(1e6 * v for v in values))

    return Table(
        title="Standard deviations of the estimate",
        columns=(
            Column(name="varied", heading="varied", values=tuple(case.varied for case in cases)),
            Column(name="value", heading="to", values=tuple(case.value for case in cases)),
            column("gain_bound", "K: bound", [each.bound[0] for each in scatters]),
            column("gain_stated", "K: stated", [each.stated[0] for each in scatters]),
            column("gain_scatter", f"K: over {runs} encoders", [each.scatter[0] for each in scatters]),
            column("tau_bound", "τ: bound", [each.bound[1] for each in scatters]),
            column("tau_stated", "τ: stated", [each.stated[1] for each in scatters]),
            column("tau_scatter", f"τ: over {runs} encoders", [each.scatter[1] for each in scatters]),
        ),
        note="In millionths of the value (ppm). Everything else is as in the exercise's own experiment.",
    )
