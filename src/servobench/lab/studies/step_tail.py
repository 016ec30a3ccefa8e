"""The study `step_tail`: wrong models compared with the rise and with the tail of a step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from servobench.core.errors import NotIdentifiable
from servobench.core.settings import PositiveTime, PositiveVoltage
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.systems.signals.step import Step

if TYPE_CHECKING:
    from servobench.core.channels import Array
    from servobench.identification.models.base import Structure
    from servobench.recordings.measurement.dataset import Dataset

_START = 0.5  # s at rest before the step
_RISE, _TAIL = 3.0, 8.0  # time constants after the step: where the rise ends, and the tail begins


@dataclass(frozen=True, kw_only=True)
class _Wrong:
    """A model whose gain and time constant are those identified, times a factor each."""

    label: str
    gain: float = 1.0
    time_constant: float = 1.0


@STUDIES.member("step_tail")
class StepTail(StudySettings):
    """Models with a wrong time constant, and one with a wrong gain, on a step of their own, by rise and tail.

    The model is identified from the exercise's recording, and made wrong by each of `factors`. Of what it is tried on, only the
    start state is fitted. `rise` and `tail` are root mean squares of what is left, in counts; rounding alone makes 0.289.
    """

    level: PositiveVoltage = 2.0
    """Voltage of the step [V]."""
    duration: PositiveTime = 3.5
    """Duration of the run; the step comes half a second after its start [s]."""
    factors: Annotated[tuple[Annotated[float, Field(gt=0)], ...], Field(min_length=1)] = (
        0.5,
        0.8,
        1.0,
        1.25,
        2.0,
    )
    """Factors of the time constant."""
    gain: Annotated[float, Field(gt=0)] = 1.02
    """Factor of the gain, in the last row."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table; raises `NotIdentifiable` where the recording supports no model, or the run has no tail."""
        from servobench.identification.identify import identify
        from servobench.recordings.measurement.measure import measure

        fit = identify(measure(stand.recording)).fit
        if fit is None:
            raise NotIdentifiable("the exercise's recording supports no model, so there is none to test")
        signal = Step(final=self.level, start=_START)
        made = stand.experiment.model_copy(update={"signal": signal, "duration": self.duration})
        rise, tail = _parts(measure(stand.run(made)), fit.model["time_constant"])
        wrong = [_Wrong(label=f"τ times {factor:g}", time_constant=factor) for factor in self.factors]
        wrong.append(_Wrong(label=f"K times {self.gain:g}", gain=self.gain))
        structure = fit.model.structure
        thetas = [_move(fit.model.names, fit.model.theta, each) for each in wrong]
        on_rise = [_remaining_rms(structure, theta, rise) for theta in thetas]
        on_tail = [_remaining_rms(structure, theta, tail) for theta in thetas]
        return StudyResult(tables=(_table([each.label for each in wrong], on_rise, on_tail),))


def _parts(data: Dataset, tau: float) -> tuple[Dataset, Dataset]:
    """The rise of a step and its tail."""
    end = float(data.t_output[-1])
    if end < _START + (_TAIL + 1) * tau:
        raise NotIdentifiable(
            f"the run of {end:g} s has no tail, which begins {_TAIL:g} time constants after the step; expected a longer one"
        )
    return data.part(0.0, _START + _RISE * tau), data.part(_START + _TAIL * tau, end)


def _table(labels: Sequence[str], rise: Sequence[float], tail: Sequence[float]) -> Table:
    def column(name: str, values: Sequence[float]) -> Column:
        return Column(name=name, heading=f"of the {name}", unit="counts", digits=3, values=tuple(values))

    return Table(
        title="Wrong models and their residuals",
        columns=(
            Column(name="model", heading="model", values=tuple(labels)),
            column("rise", rise),
            column("tail", tail),
        ),
        note=f"The rise goes to {_RISE:g} time constants after the step, the tail begins at {_TAIL:g}.",
    )


def _move(names: tuple[str, ...], theta: Array, wrong: _Wrong) -> Array:
    factors = {"gain": wrong.gain, "time_constant": wrong.time_constant}
    return np.array([value * factors.get(name, 1.0) for name, value in zip(names, theta, strict=True)])


def _remaining_rms(structure: Structure, theta: Array, part: Dataset) -> float:
    """The root mean square of what a model leaves of a part [counts], its start state fitted."""
    from servobench.identification.estimators.output_error import simulate_record

    record = simulate_record(structure, theta, part)
    return float(np.sqrt(np.mean(record.residual[record.valid] ** 2)) / (part.quantum or np.nan))
