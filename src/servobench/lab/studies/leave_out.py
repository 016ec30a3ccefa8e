"""The study `leave_out`: structures tried on what they weren't fitted to, and what each leaves over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from servobench.core.errors import NotIdentifiable
from servobench.core.rounding import TWO_SIDED, plain
from servobench.core.settings import PositiveTime
from servobench.lab.studies.base import STUDIES, Cell, Column, Stand, StudyResult, StudySettings, Table
from servobench.systems.signals.base import AnySignal
from servobench.systems.signals.square import Square

if TYPE_CHECKING:
    from servobench.core.channels import Array
    from servobench.identification.estimators.base import Fit
    from servobench.identification.result import Validation
    from servobench.recordings.measurement.dataset import Dataset
    from servobench.report.illustrations import Illustration

_LAGS = 30
_HARDLY_MORE = 1.05


@dataclass(frozen=True, kw_only=True, eq=False)
class _Trial:
    """A structure fitted to the recording, and what came of it on parts left out and on another run."""

    structure: str
    fit: Fit
    left_out: Validation
    other: Validation


@STUDIES.member("leave_out")
class LeaveOut(StudySettings):
    """Each structure fitted to the whole recording, to all but one part in turn, and compared with a second run.

    `trained` is what the model misses of the data that it was fitted to, 100 - fit percent; `left_out` the same on the parts
    that weren't there when it was fitted, `other` on a run with another signal. `residual` is in counts: the rounding of an
    encoder alone makes 1/√12 = 0.289 (Widrow and Kollár 2008). `outside` is how many of 30 autocorrelations of the residual
    leave the band that white noise keeps within at 95 of 100 lags.
    """

    structures: Annotated[tuple[str, ...], Field(min_length=1)] = ("first_order", "first_order_coulomb")
    """Names of the structures."""
    second: AnySignal = Square(low=-2.0, high=2.0, frequency=0.4)
    """Signal of the second run."""
    duration: PositiveTime = 5.0
    """Duration of the second run [s]."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the tables, and the residuals of the first structure and of the one to take.

        Raises `UnknownName` for a structure that isn't known, `NotIdentifiable` where nothing can be left out of the recording.
        """
        from servobench.recordings.measurement.measure import measure

        made = stand.experiment.model_copy(update={"signal": self.second, "duration": self.duration})
        own, second = measure(stand.recording), measure(stand.run(made))
        tried = [_try_structure(name, own, second) for name in self.structures]
        shown = dict.fromkeys((tried[0].structure, _choose(tried).structure))
        return StudyResult(
            tables=(_summary(tried), _parts(tried)),
            figures=tuple(
                figure for each in tried if each.structure in shown for figure in _residual_figures(each)
            ),
            sentences=_sentences(tried),
        )


def _try_structure(name: str, own: Dataset, second: Dataset) -> _Trial:
    from servobench.identification.estimators.base import ESTIMATORS
    from servobench.identification.models.base import STRUCTURES
    from servobench.identification.trust.held_out import cross_validate, validate_with

    method = ESTIMATORS["output_error"]
    fit = method.fit(STRUCTURES[name], [own])
    left_out = cross_validate(method, [own], fit)
    if left_out is None:
        raise NotIdentifiable(
            f"nothing can be left out of {own.name}: its input must change both in the part left out and in the rest"
        )
    return _Trial(structure=name, fit=fit, left_out=left_out, other=validate_with(fit, [second]))


def _counts(fit: Fit) -> float:
    quantum = fit.records[0].data.quantum
    return fit.residual_sd / quantum if quantum else float("nan")


def _autocorrelation(fit: Fit) -> Array:
    """Of the residual, at the lags 1 to 30."""
    record = fit.records[0]
    e = record.residual[record.valid] - record.residual[record.valid].mean()
    return np.array([float(e[lag:] @ e[:-lag]) for lag in range(1, _LAGS + 1)]) / float(e @ e)


def _outside(fit: Fit) -> int:
    band = TWO_SIDED / np.sqrt(np.count_nonzero(fit.records[0].valid))
    return int(np.count_nonzero(np.abs(_autocorrelation(fit)) > band))


def _summary(tried: Sequence[_Trial]) -> Table:
    def column(name: str, heading: str, unit: str, values: Sequence[Cell], digits: int = 3) -> Column:
        return Column(name=name, heading=heading, unit=unit, values=tuple(values), digits=digits)

    return Table(
        title="What each model misses",
        columns=(
            column("structure", "structure", "", [each.structure for each in tried]),
            column("parameters", "parameters", "", [len(each.fit.model.names) for each in tried]),
            column("trained", "of what it was fitted to", "%", [100 - each.fit.fit_percent for each in tried]),
            column("left_out", "of the parts left out", "%", [100 - each.left_out.fit_percent for each in tried]),
            column("other", "of the second run", "%", [100 - each.other.fit_percent for each in tried]),
            column("residual", "residual", "counts", [_counts(each.fit) for each in tried]),
            column("outside", f"of {_LAGS} lags outside the band", "", [_outside(each.fit) for each in tried]),
        ),
        note="An encoder's rounding alone leaves 1/√12 = 0.289 counts.",
    )  # fmt: skip


def _parts(tried: Sequence[_Trial]) -> Table:
    rows = [(each.structure, part) for each in tried for part in each.left_out.records]
    return Table(
        title="Part by part",
        columns=(
            Column(name="tried", heading="structure", values=tuple(name for name, _ in rows)),
            Column(name="part", heading="left out", values=tuple(part.name for _, part in rows)),
            Column(
                name="missed",
                heading="missed",
                unit="%",
                digits=2,
                values=tuple(100 - part.fit_percent for _, part in rows),
            ),
            Column(
                name="beyond",
                heading="times what the rest foretells",
                digits=2,
                values=tuple(part.beyond for _, part in rows),
            ),
        ),
    )


def _residual_figures(each: _Trial) -> list[Illustration]:
    """The residual over time and its autocorrelation, as a report shows them."""
    from servobench.report.illustrations import residuals

    figures = [figure for row in residuals(each.fit) for figure in row if figure.name != "distribution"]
    return [
        replace(figure, name=f"{figure.name}_{each.structure}", title=f"{figure.title}: {each.structure}")
        for figure in figures
    ]


def _choose(tried: Sequence[_Trial]) -> _Trial:
    """The structure with the fewest parameters of those that miss hardly more of the parts left out than the best does."""
    least = min(100 - each.left_out.fit_percent for each in tried)
    good = [each for each in tried if 100 - each.left_out.fit_percent <= _HARDLY_MORE * least]
    return min(good, key=lambda each: len(each.fit.model.names))


def _sentences(tried: Sequence[_Trial]) -> tuple[str, ...]:
    best = _choose(tried)
    return (
        f"{best.structure} misses {plain(100 - best.left_out.fit_percent, 2)} % of the parts left out "
        f"({best.left_out.how}). No other model misses over a twentieth less, or as little with fewer parameters.",
    )
