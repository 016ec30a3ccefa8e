"""The study `methods`: one recording, identified by every method there is, each with its bias."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.core.rounding import plain
from servobench.lab.expression import Fact
from servobench.lab.studies.base import STUDIES, Cell, Column, Stand, StudyResult, StudySettings, Table
from servobench.lab.truth import Truth, truth_of

if TYPE_CHECKING:
    from servobench.identification.estimators.base import Fit
    from servobench.recordings.measurement.dataset import Dataset
    from servobench.report.illustrations import Illustration

_FAIR = 4.0  # standard deviations; a method that is further off than that has a bias that it doesn't know of
_LEFT = 186.0  # pixels for the methods' names, in two lines


@dataclass(frozen=True, kw_only=True)
class _Estimate:
    """Gain [rad/(s·V)] and time constant [s], and the standard deviations that the method states."""

    gain: float
    gain_sd: float
    time_constant: float
    time_constant_sd: float

    def sds_off(self, truth: Truth) -> float:
        """The error of the time constant in its standard deviations; NaN where there is none."""
        return abs(self.time_constant - truth.time_constant) / self.time_constant_sd


@dataclass(frozen=True, kw_only=True)
class _Views:
    """The same recording as a position, as its plain derivative, and as a speed behind a chain."""

    position: Dataset
    derivative: Dataset
    chained: Dataset


@dataclass(frozen=True, kw_only=True)
class _Method:
    """A row's name, its data, and its way to estimate."""

    label: str
    sees: str
    estimate: Callable[[_Views], _Estimate]


@STUDIES.member("methods")
class Methods(StudySettings):
    """Gain and time constant of the exercise's recording by every method, compared with the simulated motor's own.

    `error` is that of the time constant, `sds` the same in standard deviations that the method states for itself: far above 3 is
    a bias that it doesn't know of. `cost` is the computing time here and now [ms], which depends on the machine.
    """

    chain: str = "derivative | lowpass 50 rad/s"
    """The measurement chain that makes a speed of the counts."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table of methods; one that can't has no figures, and a sentence says why.

        Raises `NotIdentifiable` where the motor isn't simulated, as then nobody knows its true parameters, and where no
        method gives anything.
        """
        from servobench.recordings.measurement.measure import measure

        truth = truth_of(stand.recording)
        views = _Views(
            position=measure(stand.recording),
            derivative=measure(stand.recording, "derivative"),
            chained=measure(stand.recording, self.chain),
        )
        timed = [_time_method(method, views) for method in _METHODS]
        estimates, costs = [each.estimate for each in timed], [each.cost for each in timed]
        if not any(math.isfinite(each.time_constant) for each in estimates):
            raise NotIdentifiable(
                f"no method finds a time constant in {stand.recording.name}; {timed[-1].why_not}"
            )
        facts = {
            "true_gain": Fact(value=truth.gain),
            "true_time_constant": Fact(value=truth.time_constant),
        }
        return StudyResult(
            tables=(_table(estimates, costs, truth),),
            figures=(_figure(estimates, truth),),
            sentences=(*_sentences(estimates, truth), *(each.why_not for each in timed if each.why_not)),
            facts=facts,
        )


@dataclass(frozen=True, kw_only=True)
class _TimedMethod:
    """A method's result and how long it took [ms], or why it found nothing, as a sentence."""

    estimate: _Estimate
    cost: float = math.nan
    why_not: str = ""


_NOTHING = _Estimate(gain=math.nan, gain_sd=math.nan, time_constant=math.nan, time_constant_sd=math.nan)


def _time_method(method: _Method, views: _Views) -> _TimedMethod:
    """A method's result and time; its first call is thrown away, as it may compile or load what it needs."""
    try:
        method.estimate(views)
        before = time.perf_counter()
        estimate = method.estimate(views)
    except NotIdentifiable as error:
        return _TimedMethod(
            estimate=_NOTHING,
            why_not=f"{method.label} on the {method.sees} gives nothing: {f'{error}'.rstrip('.')}.",
        )
    return _TimedMethod(estimate=estimate, cost=1e3 * (time.perf_counter() - before))


def _fit(estimator: str, structure: str, data: Dataset) -> Fit:
    from servobench.identification.estimators.base import ESTIMATORS
    from servobench.identification.models.base import STRUCTURES

    return ESTIMATORS[estimator].fit(STRUCTURES[structure], [data])


def _by(
    estimator: str, view: Callable[[_Views], Dataset], structure: str = "first_order_one_way"
) -> Callable[[_Views], _Estimate]:
    """One of servobench's estimators, by name."""

    def estimate(views: _Views) -> _Estimate:
        fit = _fit(estimator, structure, view(views))
        gain, tau = fit["gain"], fit["time_constant"]
        return _Estimate(gain=gain.value, gain_sd=gain.sd, time_constant=tau.value, time_constant_sd=tau.sd)

    return estimate


def _arx(view: Callable[[_Views], Dataset]) -> Callable[[_Views], _Estimate]:
    def estimate(views: _Views) -> _Estimate:
        from servobench.identification.reconciliation.reenactment import arx

        regression = arx([view(views)])
        gain_sd, tau_sd = np.sqrt(np.diag(regression.covariance))
        return _Estimate(
            gain=regression.gain,
            gain_sd=float(gain_sd),
            time_constant=regression.time_constant,
            time_constant_sd=float(tau_sd),
        )

    return estimate


def _without_chain(views: _Views) -> _Estimate:
    """K/(τs + 1) fitted to the speed as it stands, and s² (J'J)⁻¹ for its covariance, as a curve fit gives it."""
    from servobench.identification.estimators.covariance import inverse
    from servobench.recordings.measurement.base import Chain

    bare = replace(views.chained, declared=Chain(), applied=Chain())
    fit = _fit("output_error", "rational_1_0", bare)
    prediction = fit.model.structure.predict(fit.vector, bare)
    jacobian = prediction.jacobian[prediction.valid]
    return _of_pole(fit, fit.residual_sd**2 * inverse(jacobian.T @ jacobian)[:2, :2])


def _srivc(structure: str) -> Callable[[_Views], _Estimate]:
    def estimate(views: _Views) -> _Estimate:
        fit = _fit("srivc", structure, views.position)
        return _of_pole(fit, fit.covariance[:2, :2])

    return estimate


def _of_pole(fit: Fit, covariance: Array) -> _Estimate:
    """K = b₀/a₁ and τ = 1/a₁ of a fit of b₀/(s + a₁), with the covariance (2, 2) of a₁ and b₀ carried over."""
    a, b = fit.model["a1"], fit.model["b0"]
    slopes = np.array([[-b / a**2, 1 / a], [-1 / a**2, 0.0]])
    gain_sd, tau_sd = np.sqrt(np.diag(slopes @ covariance @ slopes.T))
    return _Estimate(gain=b / a, gain_sd=float(gain_sd), time_constant=1 / a, time_constant_sd=float(tau_sd))


def _position(views: _Views) -> Dataset:
    return views.position


def _derivative(views: _Views) -> Dataset:
    return views.derivative


def _chain_views(views: _Views) -> Dataset:
    return views.chained


_METHODS = (
    _Method(label="63.2 %", sees="filtered speed", estimate=_by("step_63", _chain_views)),
    _Method(label="63.2 %", sees="plain derivative", estimate=_by("step_63", _derivative)),
    _Method(label="63.2 %, lag allowed for", sees="filtered speed", estimate=_by("step_63_corrected", _chain_views)),
    _Method(label="slope of the logarithm", sees="filtered speed", estimate=_by("log_linear", _chain_views)),
    _Method(label="ARX least squares", sees="plain derivative", estimate=_arx(_derivative)),
    _Method(label="ARX least squares", sees="filtered speed", estimate=_arx(_chain_views)),
    _Method(label="output error, no chain", sees="filtered speed", estimate=_without_chain),
    _Method(label="output error, with chain", sees="filtered speed", estimate=_by("output_error", _chain_views)),
    _Method(label="srivc without a delay", sees="position", estimate=_srivc("rational_1_0_integrator")),
    _Method(label="srivc", sees="position", estimate=_srivc("rational_1_0_integrator_delay")),
    _Method(label="frequency response", sees="position", estimate=_by("frequency_response", _position)),
    _Method(label="prediction error", sees="position", estimate=_by("prediction_error", _position)),
    _Method(label="output error", sees="position", estimate=_by("output_error", _position)),
    _Method(label="interval likelihood", sees="position", estimate=_by("interval_likelihood", _position)),
)  # fmt: skip


def _table(estimates: Sequence[_Estimate], costs: Sequence[float], truth: Truth) -> Table:
    def column(name: str, heading: str, unit: str, values: Sequence[Cell], digits: int = 4) -> Column:
        return Column(name=name, heading=heading, unit=unit, values=tuple(values), digits=digits)

    return Table(
        title="Every method on the same recording",
        columns=(
            column("method", "method", "", [method.label for method in _METHODS]),
            column("sees", "looks at", "", [method.sees for method in _METHODS]),
            column("gain", "K", "rad/(s·V)", [each.gain for each in estimates], 5),
            column("time_constant", "τ", "s", [each.time_constant for each in estimates], 5),
            column(
                "error", "error", "%", [100 * _off(each, truth) / truth.time_constant for each in estimates], 2
            ),
            column("sd", "stated sd", "ms", [1e3 * each.time_constant_sd for each in estimates], 2),
            column("sds", "in sds", "", [each.sds_off(truth) for each in estimates], 2),
            column("cost", "time", "ms", costs, 2),
        ),
        note=(
            "Error and stated standard deviation (sd) are those of τ; time is that of computing. "
            f"The motor's own: K = {plain(truth.gain, 5)} rad/(s·V), τ = {plain(truth.time_constant, 5)} s, from its parameters: "
            "k/(R b + k²), and -1 over the slow pole."
        ),
    )  # fmt: skip


def _off(each: _Estimate, truth: Truth) -> float:
    return each.time_constant - truth.time_constant


def _sentences(estimates: Sequence[_Estimate], truth: Truth) -> list[str]:
    sds = [(each.sds_off(truth), method) for each, method in zip(estimates, _METHODS, strict=True)]
    known_sds = [(z, method) for z, method in sds if math.isfinite(z)]
    wrong = sum(z > _FAIR for z, _ in known_sds)
    worst, method = max(known_sds, key=lambda each: each[0])
    return [
        f"{wrong} of {len(known_sds)} methods are more than {plain(_FAIR)} of their own standard deviations from the "
        "truth: they state the scatter of their result, but not its bias.",
        f"The furthest off by its own measure is {method.label} on the {method.sees}, by {plain(worst, 2)} of its "
        "standard deviations.",
    ]


def _figure(estimates: Sequence[_Estimate], truth: Truth) -> Illustration:
    from servobench.core.rounding import TWO_SIDED
    from servobench.report import figures
    from servobench.report.illustrations import Illustration

    rows = tuple(
        figures.Difference(
            name=f"{method.label}\n{method.sees}",
            percent=100 * _off(each, truth) / truth.time_constant,
            half=100 * TWO_SIDED * each.time_constant_sd / truth.time_constant,
        )
        for method, each in zip(_METHODS, estimates, strict=True)
        if math.isfinite(each.time_constant_sd)
    )
    errors = "; ".join(f"{row.name.replace(chr(10), ', ')}: {plain(row.percent, 2)} %" for row in rows)
    return Illustration(
        name="methods",
        title="The error of τ by method",
        caption="A dot is the estimate, the bar the 95 % interval that the method states; a missing bar is "
        "narrower than the dot. An honest method's bar covers zero.",
        description=f"Errors of the time constant: {errors}.",
        draw=partial(
            figures.differences,
            rows,
            "the motor's own time constant",
            title="Error of the time constant (%)",
            left=_LEFT,
        ),
    )
