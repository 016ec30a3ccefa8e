"""The kind `estimators`: from data and a structure to a model with its uncertainty.

A member is an object passed to `ESTIMATORS.member(name)`. `hindrance` returns the refusal if an ability is missing, and
`output_error.simulate_record` a `FittedRecord` for parameters from another source.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Protocol, runtime_checkable

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.core.estimate import Estimate
from servobench.core.finding import Finding, refusal
from servobench.core.registry import Registry
from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.budget import Contribution
from servobench.identification.estimators.disturbance import Disturbance
from servobench.identification.models.base import Model, Structure
from servobench.identification.models.first_motion import changes_of_input, latest_delay
from servobench.identification.models.motion import smooth_speed
from servobench.recordings.measurement.dataset import Dataset

_LONG = 0.5  # of the longest delay that the first motion allows: a shorter estimate, however vague, doesn't speak against that


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedRecord:
    """One record behind a fit: its data, the nuisance parameters (Q,), the prediction and the residual y - prediction (M,).

    `innovations` (M,) are what the estimator minimised, of unit variance: white where its noise model is right.
    `valid` (M,) is False where the chain still looks back before the record; those samples carry no weight.
    """

    data: Dataset
    nuisance: Array
    prediction: Array
    residual: Array
    innovations: Array
    valid: np.ndarray[tuple[int], np.dtype[np.bool_]]


@dataclass(frozen=True, eq=False)
class IntervalsOnDemand(Mapping[str, tuple[float, float]]):
    """Intervals each of which is searched for when it is read: most fits of a choice are dropped before that.

    `search` is called once at most, and returns for each name what finds its interval, which is called once at most as well.
    """

    search: Callable[[], Mapping[str, Callable[[], tuple[float, float]]]]
    _ends: dict[str, tuple[float, float]] = field(default_factory=dict, init=False)

    @cached_property
    def _searches(self) -> Mapping[str, Callable[[], tuple[float, float]]]:
        return self.search()

    def __getitem__(self, name: str) -> tuple[float, float]:
        """Return the interval of a parameter; raises `KeyError` where value ± 1.96 sd will do."""
        if name not in self._ends:
            self._ends[name] = self._searches[name]()
        return self._ends[name]

    def __contains__(self, name: object) -> bool:
        """Return whether a parameter has such an interval, without looking for it."""
        return name in self._searches

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names."""
        return iter(self._searches)

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._searches)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Fit:
    """An estimator's answer: a model, and how well it is known.

    `covariance` (P, P) belongs to the model's parameters; `status` says in one sentence how the search ended, `converged` whether
    it did. `residual_sd` is in the unit of the output;
    `disturbance` is the noise model, None for white measurement noise alone. `intervals` holds the 95 % intervals of those
    parameters for which value ± 1.96 sd wouldn't do, such as one near a bound. `budget` holds what was added to the estimator's
    own covariance, line by line.
    """

    model: Model
    covariance: Array
    estimator: str
    structure: str
    """Name of the model structure."""
    converged: bool
    status: str
    residual_sd: float
    records: tuple[FittedRecord, ...]
    """The residual of each record."""
    disturbance: Disturbance | None = None
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    """Remarks on the search and its outcome."""
    budget: tuple[Contribution, ...] = ()
    """The reasons why the intervals are wider than the estimator's own."""

    def __repr__(self) -> str:
        """The structure, the estimator and each parameter with half of its interval."""
        parts = ", ".join(f"{name} {estimate}" for name, estimate in self.estimates.items())
        return f"<Fit {self.structure} by {self.estimator}: {parts}>"

    def widen(self, line: Contribution) -> Fit:
        """Return the fit with a line more in its budget: the covariance grows by that of the line, and the intervals with it.

        An interval that lies unevenly about its value keeps its shape: each side grows as √(half² + (1.96 sd)²) does.
        """
        return replace(
            self,
            covariance=self.covariance + line.covariance,
            intervals=self._widen_sides(TWO_SIDED**2 * np.diag(line.covariance)),
            budget=(*self.budget, line),
        )

    def without(self, source: str) -> Fit:
        """Return the fit as it would be without the lines of a source in its budget."""
        taken = sum((each.covariance for each in self.budget if each.source == source), np.zeros((1, 1)))
        return replace(
            self,
            covariance=self.covariance - taken,
            intervals=self._widen_sides(-(TWO_SIDED**2) * np.diag(taken)) if taken.any() else self.intervals,
            budget=tuple(each for each in self.budget if each.source != source),
        )

    def _widen_sides(self, squares: Array) -> IntervalsOnDemand:
        """The uneven intervals with so much more (P,) in the square of each side."""
        return IntervalsOnDemand(partial(self._wider_sides, squares))

    def _wider_sides(self, squares: Array) -> dict[str, Callable[[], tuple[float, float]]]:
        return {name: partial(self._wider_interval, name, squares) for name in self.intervals}

    def _wider_interval(self, name: str, squares: Array) -> tuple[float, float]:
        """The uneven interval of a parameter with so much more (P,) in the square of each side."""
        low, high = self.intervals[name]
        at = self.model.names.index(name)
        value = float(self.model.theta[at])
        below, above = (
            (side**2 + squares[at]) if squares[at] else side**2 for side in (value - low, high - value)
        )
        return value - max(below, 0.0) ** 0.5, value + max(above, 0.0) ** 0.5

    def __getitem__(self, name: str) -> Estimate:
        """Return the estimate of a parameter, with its 95 % interval; raises `KeyError` for one that the model hasn't."""
        if name not in self.model.names:
            raise KeyError(name)
        return self._estimate(self.model.names.index(name))

    def sd(self, name: str) -> float:
        """Return the standard deviation of a parameter, in its unit, without looking for its interval."""
        at = self.model.names.index(name)
        return float(np.sqrt(self.covariance[at, at]))

    def unit(self, name: str) -> str:
        """Return the unit of a parameter, without looking for its interval."""
        return self.model.structure.parameters[self.model.names.index(name)].unit_in(self.model.data)

    @property
    def estimates(self) -> dict[str, Estimate]:
        """The estimates by name, each with its 95 % interval: value ± 1.96 sd, or that in `intervals`, within what can be.

        A friction or a time constant isn't below zero, and a delay doesn't end after the first motion, unless the estimate lies
        at that end and the input changes again. Friction that falls with the speed takes no more than all of the input, and has
        fallen at the largest speed.
        """
        return {name: self._estimate(at) for at, name in enumerate(self.model.names)}

    def _estimate(self, at: int) -> Estimate:
        """The estimate of parameter number `at`, of which alone the interval is looked for."""
        parameter, value = self.model.structure.parameters[at], float(self.model.theta[at])
        name, sd = parameter.name, float(np.sqrt(self.covariance[at, at]))
        low, high = self.intervals.get(name, (value - TWO_SIDED * sd, value + TWO_SIDED * sd))
        if name == "delay" and self.delays_differ:
            high = max(high, 2.0 * value - low)
        most = self._most(name, parameter.upper)
        interval = float(max(low, min(parameter.lower, value))), float(min(high, max(most, value)))
        return Estimate(value=value, sd=sd, interval=interval, level=0.95, unit=self.unit(name))

    def _most(self, name: str, nature: float) -> float:
        """The largest value of a parameter that nature and the records allow."""
        if name == "delay":
            return np.inf if self.delays_differ else self._latest_delay
        if name == "stribeck_voltage":
            return max(float(np.abs(record.data.u).max(initial=0.0)) for record in self.records)
        if name == "stribeck_speed":
            return max(float(np.abs(smooth_speed(record.data)).max(initial=0.0)) for record in self.records)
        return nature

    @cached_property
    def delays_differ(self) -> bool:
        """Whether the estimate lies at the longest delay that the first motion allows, and that of other changes may be longer.

        That is a bound on the delay of one change. A lag that isn't modelled leads there, too; its interval is the wider for it.
        """
        if "delay" not in self.model.names or not np.isfinite(self._latest_delay):
            return False
        delay, latest = self.model["delay"], self._latest_delay
        capped = delay > _LONG * latest and delay + self.sd("delay") >= latest
        return bool(capped and changes_of_input([record.data for record in self.records]) > len(self.records))

    @cached_property
    def _latest_delay(self) -> float:
        """The delay [s] that the first motion of the records allows at most."""
        return latest_delay([record.data for record in self.records])

    @property
    def vector(self) -> Array:
        """The joint vector (P + ΣQ,): the parameters, then the nuisance parameters of each record in turn."""
        return np.concatenate([self.model.theta, *(record.nuisance for record in self.records)])

    @property
    def fit_percent(self) -> float:
        """The share of the output's variation that the simulation explains, 100 (1 - |y - ŷ| / |y - mean|), over all records."""
        return fit_percent(self.records)


def as_predicted(fit: Fit) -> Fit:
    """Return a fit whose outputs are its own predictions, in counts where there are any: what the model shows by itself."""
    return replace(fit, records=tuple(_as_predicted(record) for record in fit.records))


def _as_predicted(record: FittedRecord) -> FittedRecord:
    y, quantum = record.prediction, record.data.quantum
    if quantum is not None and record.data.kind == "position":
        y = quantum * (np.floor(y / quantum) + 0.5)
    return replace(record, data=replace(record.data, y=y), residual=y - record.prediction)


def fit_percent(records: Sequence[FittedRecord]) -> float:
    """Return 100 (1 - |y - ŷ| / |y - mean(y)|) over all records, each with its own mean; NaN where nothing varies."""
    misfit = sum(float(np.sum(r.residual[r.valid] ** 2)) for r in records)
    total = sum(float(np.sum((r.data.y[r.valid] - r.data.y[r.valid].mean()) ** 2)) for r in records)
    return percent_explained(misfit, total)


def percent_explained(misfit: float, total: float) -> float:
    """Return 100 (1 - √(misfit/total)) for the sum of squares that is left and the one there was; NaN where nothing varies."""
    return 100.0 * (1.0 - float(np.sqrt(misfit / total))) if total > 0 else float("nan")


@dataclass(frozen=True, kw_only=True)
class Abilities:
    """The abilities of a method of identification; `hindrance` compares data and structure with them.

    `method` says in a few words what it does, `noise` what noise it is right for, `interval` what its intervals are worth, each
    without a full stop: docs/which-estimator.md is written from them (`make generate`). Data that need what isn't declared are
    refused, or a finding names what was left out.
    """

    method: str
    noise: str
    interval: str
    position: bool
    """The output may be a position."""
    speed: bool
    """The output may be a speed."""
    chain: bool
    """A chain between shaft and data is part of the prediction."""
    irregular_times: bool
    """Samples need not be equally far apart."""
    several_records: bool
    """Several records are fitted jointly."""
    closed_loop: bool
    """The data may come from a feedback loop."""
    delay: bool
    """A delay is found; otherwise it is held at zero with an infinite variance, and a finding of the fit names it."""
    friction: bool
    """Coulomb friction is found."""
    disturbance: bool
    """A random torque is allowed for."""


@runtime_checkable
class Estimator(Protocol):
    """A method of identification."""

    @property
    def abilities(self) -> Abilities:
        """The method's abilities."""
        ...

    def supports(self, structure: Structure, data: Sequence[Dataset]) -> Finding | None:
        """Return None where the method can do this, or a refusal that says why it can't."""
        ...

    def fit(
        self, structure: Structure, data: Sequence[Dataset], starts: Sequence[Array] | None = None
    ) -> Fit:
        """Return the fit of a structure to several datasets jointly.

        `starts` are vectors to begin from, in place of the structure's own guesses: the parameters, then the nuisance
        parameters of each record. Raises `NotIdentifiable` where the data don't determine the parameters, or `supports` refuses.
        """
        ...


def hindrance(name: str, can: Abilities, structure: Structure, data: Sequence[Dataset]) -> Finding | None:
    """Return a refusal that names what data or structure need and the estimator of that name can't do; None where it can all."""
    needs = {
        "a position": any(record.kind == "position" for record in data) and not can.position,
        "a speed": any(record.kind == "speed" for record in data) and not can.speed,
        "data behind a measurement chain": any(record.chain.linear for record in data) and not can.chain,
        "irregular times": not can.irregular_times and not all(is_regular(record) for record in data),
        "several records at once": len(data) > 1 and not can.several_records,
        "friction with rest and reversals": structure.friction and not can.friction,
    }
    lacking = [what for what, lacks in needs.items() if lacks]
    if not lacking:
        return None
    return refusal(
        "estimator-unsuited",
        f"{name} can't work on {' or '.join(lacking)}; output_error can (docs/which-estimator.md lists what each one can do).",
    )


def too_few(used: int, unknowns: int, data: Sequence[Dataset]) -> NotIdentifiable:
    """Return the error that says how many samples count, and of how many, where they are no more than the unknowns."""
    sample_count = sum(len(record.y) for record in data)
    if used == sample_count:
        return NotIdentifiable(f"{used} samples for {unknowns} unknowns: record for longer")
    return NotIdentifiable(
        f"{sample_count} samples that count as {used}, for {unknowns} unknowns: closely spaced samples are averaged where a "
        "random torque seems to act, and samples whose filter reaches back before the record aren't used. Record "
        "for longer"
    )


def is_regular(data: Dataset) -> bool:
    """Return whether input and output come at the same times, evenly spaced to a thousandth of the sample time.

    What of the input comes before the first sample of the output doesn't count.
    """
    data = from_first_output(data)
    if len(data.t_input) != len(data.t_output) or len(data.t_output) < 2:
        return False
    step = data.duration / (len(data.t_output) - 1)
    even = data.t_output[0] + step * np.arange(len(data.t_output))
    late = np.abs(np.concatenate([data.t_output - even, data.t_input - even]))
    return bool(late.max() <= 1e-3 * step)


def from_first_output(data: Dataset) -> Dataset:
    """Return the record without what of its input lies before its first output, where the shaft was on its way already."""
    first = int(np.searchsorted(data.t_input, data.t_output[0] - 1e-9 * data.duration))
    if first in (0, len(data.t_input)):
        return data
    return replace(
        data,
        t_input=data.t_input[first:],
        u=data.u[first:],
        input_before=float(data.u[first - 1]),
        reference=None if data.reference is None else data.reference[first:],
    )


ESTIMATORS: Registry[Estimator] = Registry(
    "estimator", "servobench.identification.estimators", "servobench.estimators"
)
