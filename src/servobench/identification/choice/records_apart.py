"""Do the records of a joint fit agree on its parameters? Each record is left out in turn, and the results are compared.

A joint fit has one value for all records. If the structure lacks something that shows more in one record than in another, the
residuals have a pattern, but the value still looks well known: it is a mean that depends on the choice of records. Leaving each
record out in turn shows this (the jackknife, Tukey 1958). Two selections share most of their records, so if their 95 %
intervals don't overlap, they differ by more than chance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.core.estimate import Estimate
from servobench.core.finding import Finding, info, warning
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import rounded_interval
from servobench.identification.choice.structure_ladder.trial import is_certain
from servobench.identification.estimators.base import ESTIMATORS, Estimator, Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.estimators.misfit_covariance import allow_for_misfit
from servobench.identification.models.motion import is_ramp, turns_both_ways
from servobench.identification.trust.doubts.single_level import widen_for_single_level
from servobench.identification.trust.validation import explains_the_colour
from servobench.recordings.measurement.dataset import Dataset

_MOST = 8  # fits, spread evenly over the records
# It belongs to the times of each file more than to the motor, and takes up what is wrong with them.
_OF_THE_FILE = "delay"
_FALL = frozenset({"stribeck_voltage", "stribeck_speed"})
# Percent of the output: records of which the model explains so little together, and so much without one, have no common motor.
_TOGETHER, _APART_ONLY = 80.0, 90.0
_DRIVES = 0.1  # of the largest input: a smaller one is how it got there
_RARE = 10.0  # % of the inputs that drive the motor, for the same reason
_ALIKE = 0.7  # of the largest: inputs that are all nearer to it are as good as one
_FAR, _TELLS = 1.5, 0.5  # times, and of a value: an interval that is wider doesn't tell it


@dataclass(frozen=True, kw_only=True, eq=False)
class _Without:
    """The fit of all records but one, and which those are, in words; it says nothing of the parameters `undetermined`."""

    which: str
    fit: Fit
    undetermined: frozenset[str] = frozenset()

    def tells(self, name: str) -> bool:
        """Whether it has an interval for that parameter."""
        return name not in self.undetermined and bool(np.isfinite(self.fit.sd(name)))


def widen_for_disagreement(fit: Fit, method: Estimator, allow: Callable[[Fit], Fit]) -> Fit:
    """Return the fit, with a finding and wider intervals where its records disagree on parameters.

    If the residuals are white nothing is fitted again, because records that differ leave a colour; but beside a random torque,
    which takes up what differs, they say nothing. Otherwise each record is left out in turn (at most 8 of them), with `method`
    and `allow` as for the whole fit. If two of the intervals don't overlap, that of the whole is widened to hold them all, and
    the standard deviation is at least the jackknife's,

        s² = (n - 1)/n Σ (θ_i - θ̄)²,   θ_i without record i of n.

    One odd record among several makes all intervals wide in which it is, so that they meet: that one is found by what the
    others foretell of it (`held_out`). A selection in which the motor turned one way only, or under one level only, says nothing
    of friction that it could be held to.
    """
    if len(fit.records) < 2 or (fit.disturbance is None and explains_the_colour(fit)):
        return fit
    selections = _selections(fit, method, allow)
    if len(selections) < 2:
        return fit
    left_out = {_OF_THE_FILE} if _is_fall_certain(fit) else {_OF_THE_FILE, *_FALL}
    apart = [name for name in fit.model.names if name not in left_out and _apart(name, selections)]
    if not apart:
        return fit
    added = np.zeros_like(fit.covariance)
    holding = {}
    for name in apart:
        estimates = [each.fit[name] for each in selections if each.tells(name)]
        at = fit.model.names.index(name)
        added += _beyond_stated(fit[name], estimates, len(fit.records)) * _joint_factor(fit, at, selections)
        holding[name] = _hull([fit[name], *estimates])
    line = Contribution(
        source="disagreement between records",
        covariance=added,
        reason="the parameters change when a record is left out",
        freedom=len(fit.records) - 1,
    )
    wider = fit.widen(line)
    findings = (*fit.findings, _finding(fit, apart, selections))
    return replace(wider, intervals={**wider.intervals, **holding}, findings=findings)


def _is_fall_certain(fit: Fit) -> bool:
    """Whether friction that falls with the speed, where the model has it, is certain: about none, records can't disagree."""
    return not set(fit.model.names) >= _FALL or is_certain("stribeck", fit)


def _selections(fit: Fit, method: Estimator, allow: Callable[[Fit], Fit]) -> list[_Without]:
    """The fits without one record each, where the rest moves as the whole does and determines the parameters."""
    count = len(fit.records)
    reverses = turns_both_ways([record.data for record in fit.records])
    selections = []
    for number in sorted({int(k) for k in np.linspace(0, count - 1, min(_MOST, count))}):
        rest = [record for n, record in enumerate(fit.records) if n != number]
        data = [record.data for record in rest]
        if method.supports(fit.model.structure, data) is not None:
            continue
        start = np.concatenate([fit.model.theta, *(record.nuisance for record in rest)])
        try:
            other = widen_for_single_level(
                _under_the_same_noise(fit, method.fit(fit.model.structure, data, (start,)), allow)
            )
        except NotIdentifiable:
            continue
        if other.converged and other.estimator == fit.estimator:
            which = f"in {data[0].name}" if len(data) == 1 else f"without {fit.records[number].data.name}"
            undetermined = frozenset() if turns_both_ways(data) == reverses else _open_parameters(fit, data)
            if all(map(is_ramp, data)):  # where it sets off says more of friction at rest than of a lag
                undetermined |= {"time_constant"}
            selections.append(_Without(which=which, fit=other, undetermined=undetermined))
    return selections


def _open_parameters(fit: Fit, data: Sequence[Dataset]) -> frozenset[str]:
    """What records of a motor that turned one way don't tell: friction and offset, of which only the sum is known.

    Nor do they tell the gain where their inputs lie so near to each other that it looks like friction: a supply that sags makes
    several levels of one.
    """
    constants = {name for name in fit.model.names if name == "offset_voltage" or name.startswith("coulomb")}
    sizes = np.abs(np.concatenate([record.u for record in data]))
    driving = sizes[sizes > _DRIVES * sizes.max(initial=0.0)]
    if not driving.size:
        return frozenset(constants | {"gain"})
    low, high = np.percentile(driving, (_RARE, 100.0 - _RARE))
    return frozenset(constants | ({"gain"} if low > _ALIKE * high else set()))


def _under_the_same_noise(fit: Fit, other: Fit, allow: Callable[[Fit], Fit]) -> Fit:
    """The fit of a selection, allowed for as the whole's: with another noise model the same data say something else.

    Where the whole has a random torque, a selection that shows none is fitted as if it might have one as well. Where the whole
    has none, as what its records leave isn't that of one torque, the intervals of a selection that has hold both noise models.
    """
    allowed = allow(other)
    if allowed.estimator == fit.estimator:
        return allowed
    if fit.estimator == "prediction_error":
        data = [record.data for record in other.records]
        return ESTIMATORS["prediction_error"].fit(fit.model.structure, data, (other.vector,))
    return allow_for_misfit(other) if fit.estimator == "output_error" else allowed


def _apart(name: str, selections: Sequence[_Without]) -> bool:
    """Whether two of the intervals don't meet."""
    if sum(each.tells(name) for each in selections) < 2:
        return False
    low, high = _ends(name, selections)
    return low.fit[name].interval[1] < high.fit[name].interval[0]


def _ends(name: str, selections: Sequence[_Without]) -> tuple[_Without, _Without]:
    """The selection whose interval ends lowest, and that whose interval begins highest."""
    known = [each for each in selections if each.tells(name)]
    low = min(known, key=lambda each: each.fit[name].interval[1])
    return low, max(known, key=lambda each: each.fit[name].interval[0])


def _beyond_stated(whole: Estimate, estimates: Sequence[Estimate], count: int) -> float:
    """The variance that the jackknife has beyond that of the whole; 0 where there is none."""
    values = np.array([each.value for each in estimates])
    jackknife = float(np.sqrt((count - 1) * np.mean((values - values.mean()) ** 2)))
    return max(jackknife**2 - whole.sd**2, 0.0) if np.isfinite(whole.sd) else 0.0


def _joint_factor(fit: Fit, at: int, selections: Sequence[_Without]) -> Array:
    """The covariance (P, P) per unit of a parameter's variance, together with the parameters that no selection determines.

    Those go with it as they do in the fit: of a record shorter than its time constant, gain and time constant in proportion.
    """
    slope = np.zeros(len(fit.model.names))
    slope[at] = 1.0
    for n, name in enumerate(fit.model.names):
        if not any(each.tells(name) for each in selections) and fit.covariance[at, at] > 0:
            slope[n] = fit.covariance[n, at] / fit.covariance[at, at]
    return np.outer(slope, slope)


def _hull(estimates: Sequence[Estimate]) -> tuple[float, float]:
    """The interval that holds all of theirs."""
    return min(each.interval[0] for each in estimates), max(each.interval[1] for each in estimates)


def _finding(whole: Fit, apart: Sequence[str], selections: Sequence[_Without]) -> Finding:
    values = "; ".join(_line(name, selections) for name in apart)
    best = max(selections, key=lambda each: each.fit.fit_percent)
    if whole.fit_percent < _TOGETHER and best.fit.fit_percent > _APART_ONLY:
        sentence = (
            f"The records disagree: fitted to all, the model explains {whole.fit_percent:.0f} % of the output, but {best.which} "
            f"{best.fit.fit_percent:.0f} %; {values}. The motor, its load, its supply or the zero of its input changed between "
            "them. Fit them one by one."
        )
        return warning("records-disagree", sentence, parameters=tuple(apart))
    sentence = (
        f"The records don't agree: {values}. The intervals are widened "
        "to cover each choice of records. The motor changed between them, or it doesn't follow this model over all "
        "their levels, speeds and directions. Fit only the records in which the motor moves as it will in use."
    )
    # Of one motor's recordings time constants scatter by a tenth or so; what is as far apart has another cause.
    severe = any(_ratio(name, selections) > _FAR for name in apart if name in ("gain", "time_constant"))
    return (warning if severe else info)("records-apart", sentence, parameters=tuple(apart))


def _ratio(name: str, selections: Sequence[_Without]) -> float:
    """How many times larger a parameter is in one selection than in another, at least; 1 where one doesn't tell it."""
    two = _ends(name, selections)
    if any(each.fit[name].half_width > _TELLS * abs(each.fit[name].value) for each in two):
        return 1.0
    ends = two[0].fit[name].interval[1], two[1].fit[name].interval[0]
    least, most = sorted(map(abs, ends))
    return most / least if ends[0] * ends[1] > 0.0 else 1.0


def _line(name: str, selections: Sequence[_Without]) -> str:
    low, high = _ends(name, selections)
    words = parameter_in_words(name, low.fit.unit(name))
    return f"the {words} is {_text(low.fit[name])} {low.which}, and {_text(high.fit[name])} {high.which}"


def _text(estimate: Estimate) -> str:
    return str(rounded_interval(estimate.value, estimate.interval, estimate.unit))
