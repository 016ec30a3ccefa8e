"""The choice of a structure: a base that suits the motion, then a rung of the ladder for each term that the data need.

Score tests propose rungs. They need no fit, so simple data cost nothing. A proposed rung is fitted, and kept if

- the simulation explains more by Schwarz's criterion (1978), with as many samples as the colour of the residuals leaves,
- the new term is known to half of its value, or leaving it out would move gain or time constant by more than their own standard
deviation, so that their intervals would be too narrow,
- gain and time constant are still known to half of themselves, and the search has settled.

Then the tests examine the new residual, until they propose nothing, or nothing that the data determine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable, UsageError
from servobench.core.finding import Finding, Severity, info, warning
from servobench.core.rounding import change_text, percent, plain
from servobench.identification.choice.computed_data import about_computed, fit_to_computed
from servobench.identification.choice.structure_ladder.comparison import (
    better,
    clearly_better,
    deviance,
    fit_structure,
    schwarz_criterion,
    shifts_parameters,
)
from servobench.identification.choice.structure_ladder.sentences import rung_finding, stop_finding
from servobench.identification.choice.structure_ladder.trial import (
    Rung,
    embed,
    is_certain,
    try_rung,
    with_added_term,
)
from servobench.identification.estimators.base import ESTIMATORS, Estimator, Fit
from servobench.identification.estimators.delay_prior import cost_beside_zero, is_usual
from servobench.identification.estimators.least_squares import lowest, minimise
from servobench.identification.estimators.one_sine import are_driven_by_one_sine
from servobench.identification.estimators.sizes import friction_spread
from servobench.identification.models.base import STRUCTURES, Structure
from servobench.identification.models.common_parameters import TIME_CONSTANT
from servobench.identification.models.first_motion import rests_at_first, stands_at_first
from servobench.identification.models.level import (
    few_levels,
    has_one_level_each,
    has_one_magnitude,
    single_level,
)
from servobench.identification.models.motion import is_ramp, smooth_speed, stands, turns_both_ways
from servobench.identification.models.nonlinear.structure import NonlinearMotor
from servobench.identification.trust.doubts.base import about_data
from servobench.identification.trust.doubts.one_way import hardly_turns_back, input_hardly_matters
from servobench.identification.trust.doubts.spikes import had_spikes
from servobench.identification.trust.explanations.base import Causes, names_a_cause
from servobench.identification.trust.missing_terms import beside_torque, score_terms
from servobench.identification.trust.validation import explains_the_colour, is_rounding
from servobench.identification.trust.winding import about_winding
from servobench.identification.uncertainty.changes_between_rows import with_changes_between_rows
from servobench.identification.uncertainty.identifiability import drive_level, is_known
from servobench.identification.uncertainty.score_test import ASKED, TermScore
from servobench.recordings.measurement.dataset import Dataset

_RUNGS = 5  # coulomb, asymmetric, stribeck, gravity and load; behind the winding there is none
# Terms that hide the others if they are large come first; an arm may need both of the first two before either is determined.
_BY_TRIAL = ("gravity", "coulomb_gravity", "coulomb", "asymmetric", "load")
_BOTH_WAYS = ("coulomb", "asymmetric")  # frictions of a shaft that turns both ways
_REST = "rest-found"
_STICKS = "first_order_coulomb_stribeck"
_BREAKS_AWAY = 0.5  # of the residual without: what is left where the shaft breaks away
_BY_INPUT = 90.0  # percent of the output: a model that explains so much by the input needs no other cause
_SLOW = 0.05  # of a ramp's time: a longer lag bends it
_BENDS = 1.4  # times the residual of a lag that is as long as the ramp: what it explains may be any bend
_NONE = 0.1  # of a sample time: no lag at all
_FEW = 400  # samples, of which a search for that takes a tenth of a second
_DRIVEN = 0.1  # of the largest input: what drives the motor, and isn't the offset of a measurement
_A_FEW = 0.02  # of the samples
_SEVERAL = 3  # samples
_HARDLY = 0.2  # of the top speed
# Times the residual of the other: the rounding of a rest is one error in all its samples, which a slow drift takes for signal.
_AS_GOOD = 1.1
_LARGE = 10_000  # samples, of all records
_NEARLY_ALL = 90.0  # % of the output
_HIDDEN = 0.05  # of the largest input: with a larger standard deviation, friction may well be a tenth of it


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """The fit of the structure that was chosen, `findings` that say why, and what of terms the score tests have `shown` in it.

    `causes` are what may be wrong with the records, as far as that has been looked into. `computed` says that the output has no
    noise at all, so that there is nothing to allow for. `plain` is the fit before anything is allowed for; `rung` is the last one
    that was climbed, if any, and `below` the choice without it.
    """

    fit: Fit
    plain: Fit
    causes: Causes
    computed: bool = False
    shown: tuple[TermScore, ...] = ()
    findings: tuple[Finding, ...] = ()
    rung: Rung | None = None
    below: Choice | None = None

    def loses(self, widened: Fit) -> bool:
        """Return whether the last rung is better left out once all that widens the intervals is in a fit.

        A rung is climbed by what is known before that. One that turns out to be open, and to leave the gain open as well, stands
        for something else that the model lacks; so does gravity that is open beside a residual that is coloured still, as a dead
        band makes it. Nor is it kept with a second lag that can't be told from a delay: nobody asked for one.
        """
        if self.rung is None or "gain" not in widened.model.names:
            return False
        if any(each.severity is Severity.REFUSAL for each in about_winding(widened)):
            return True
        if is_certain(self.rung.term, widened):
            return False
        return not is_known(widened["gain"]) or (
            "gravity" in self.rung.term and not explains_the_colour(widened)
        )

    def restate(self, widened: Fit) -> tuple[Finding, ...]:
        """Return the findings, in which the last rung is as sure as it is once all that widens the intervals is in a fit."""
        if self.rung is None or self.below is None:
            return self.findings
        below, in_the_end = self.below, replace(self.rung, fit=widened)
        before, now = (rung_finding(each, below.plain, below.fit) for each in (self.rung, in_the_end))
        return tuple(now if each == before else each for each in self.findings)

    @cached_property
    def terms(self) -> tuple[TermScore, ...]:
        """The scores of terms that also show beside a random torque."""
        return beside_torque(self.shown)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Base:
    """The fit of the simplest structure that suits a motion, why it is that one, and all `fits` that were made, by structure.

    `sliding` is the base without friction that is larger near standstill, where this one has it.
    """

    fit: Fit
    findings: tuple[Finding, ...] = ()
    fits: Mapping[str, Fit]
    sliding: _Base | None = None


def choose_structure(
    method: Estimator,
    data: Sequence[Dataset],
    structure: str,
    estimator: str,
    allow: Callable[[Fit], Fit],
) -> Choice:
    """Return the fit of the requested structure, or of the one that the data need ("auto").

    `allow` makes of a fit one that allows for what disturbs the motor. Raises `NotIdentifiable` where the data can't support it,
    and `UsageError` where a structure and an estimator were named that can't go together.
    """
    if structure != "auto":
        _check_combination(method, STRUCTURES[structure], data, estimator)
        simple = _fit_requested(method, STRUCTURES[structure], data)
        fit = allow(simple)
        return Choice(
            fit=fit,
            plain=simple,
            causes=Causes(tuple(data)),
            shown=score_terms(fit),
            findings=_friction_left_out(method, data, simple),
        )
    base = _base(method, data)
    computed = fit_to_computed(method, data, base.fit)
    if computed is not None:
        return Choice(
            fit=computed,
            plain=computed,
            causes=Causes(tuple(data)),
            findings=(about_computed(),),
            computed=True,
        )
    known = base.fits if method is ESTIMATORS["output_error"] else {}
    return _climb(method, data, base, Causes(tuple(data), known), allow)


def _fit_requested(method: Estimator, structure: Structure, data: Sequence[Dataset]) -> Fit:
    """The fit of a structure; of one with more terms than a plain motor's it begins with that as well, as auto comes to it."""
    if not isinstance(structure, NonlinearMotor) or method.supports(structure, data) is not None:
        return fit_structure(method, structure, data)
    try:
        plain = fit_structure(method, STRUCTURES["first_order_coulomb"], data)
    except NotIdentifiable:
        return fit_structure(method, structure, data)
    return method.fit(structure, data, (embed(plain, structure, data), *structure.guesses(data)))


def _check_combination(
    method: Estimator, structure: Structure, data: Sequence[Dataset], estimator: str
) -> None:
    """Raise `UsageError` where the estimator that was named can't work on the structure that was named."""
    hindrance = method.supports(structure, data) if estimator != "auto" else None
    if hindrance is not None:
        raise UsageError(hindrance.sentence)


def _friction_left_out(method: Estimator, data: Sequence[Dataset], simple: Fit) -> tuple[Finding, ...]:
    """A warning where the structure that was requested has no friction, and the data need it."""
    if simple.structure != "first_order" or not turns_both_ways(data):
        return ()
    try:
        with_friction = fit_structure(method, STRUCTURES["first_order_coulomb"], data)
    except NotIdentifiable:
        return ()
    if not (better(with_friction, simple) and shifts_parameters(with_friction, simple)):
        return ()
    gain = change_text(with_friction.model["gain"], simple.model["gain"])
    shares = [f"{np.floor(100 * fit.fit_percent) / 100:.2f} %" for fit in (with_friction, simple)]
    sentence = (
        "These data need Coulomb friction, which this structure lacks: with it the simulation explains "
        f"{' of the output instead of '.join(shares)}, and the gain would be {gain}. "
        "Use `structure=first_order_coulomb`, or leave the choice to the program."
    )
    return (warning("friction-left-out", sentence, parameters=("gain", "time_constant")),)


def _base(method: Estimator, data: Sequence[Dataset]) -> _Base:
    """The simplest structure for a motor that turned so, with Coulomb friction if that is needed."""
    if not turns_both_ways(data):
        return _base_for_one_way(method, data, fit_structure(method, STRUCTURES["first_order_one_way"], data))
    frictionless = fit_structure(method, STRUCTURES["first_order"], data)
    try:
        with_friction = fit_structure(method, STRUCTURES["first_order_coulomb"], data)
    except NotIdentifiable:
        return _Base(fit=frictionless, fits={frictionless.structure: frictionless})
    if hardly_turns_back(with_friction):
        one_way = _base_for_one_way(
            method, data, fit_structure(method, STRUCTURES["first_order_one_way"], data)
        )
        if not better(with_friction, one_way.fit):
            return one_way
    fits = {each.structure: each for each in (frictionless, with_friction)}
    gains = change_text(frictionless.model["gain"], with_friction.model["gain"])
    if better(with_friction, frictionless) and is_certain("coulomb", with_friction):
        explained = _friction_text(frictionless, with_friction)
        sentence = f"Coulomb friction is needed: {explained} the gain would be {gains}."
        finding = info("friction-found", sentence, parameters=("coulomb_voltage",))
        return _Base(fit=with_friction, findings=(finding,), fits=fits)
    if better(with_friction, frictionless) or shifts_parameters(with_friction, frictionless):
        return _Base(fit=with_friction, findings=(_friction_possible(gains),), fits=fits)
    if _hides_friction(with_friction) or has_one_level_each(data):
        return _Base(fit=with_friction, findings=(_friction_hidden(),), fits=fits)
    return _Base(fit=frictionless, findings=(_friction_not_found(data),), fits=fits)


def _friction_not_found(data: Sequence[Dataset]) -> Finding:
    """What to say of a model without friction, by what the levels of the input could show of it."""
    as_well, code = "A model without Coulomb friction explains these data equally well.", "friction-not-found"
    if has_one_magnitude(data):
        sentence = (
            f"{as_well} Under one level both ways only the reversals tell friction from a smaller gain, and a sensor that is "
            "late or coarse at low speed hides it there: record a second level."
        )
        return info(code, sentence, parameters=("gain",))
    if few_levels(data) is not None:
        sentence = (
            f"{as_well} Under so few levels a few percent of friction look like another gain, which the interval of the gain "
            "allows for where the residual shows that the model isn't exact."
        )
        return info(code, sentence)
    return info(
        code, f"{as_well} Any friction there is can't be told from a different gain or offset in these data."
    )


def _allow_with_friction(base: _Base, allow: Callable[[Fit], Fit]) -> tuple[_Base, Fit]:
    """The base and its fit as it is allowed for; that with Coulomb friction if only a filter for a random torque shows it.

    What a random torque does to the position hides a little friction from a simulation. The innovations are white, and twice the
    logarithm of their likelihoods' ratio is compared with Schwarz's criterion.
    """
    fit = allow(base.fit)
    rival = base.fits.get("first_order_coulomb")
    if fit.disturbance is None or rival is None:
        return base, fit
    if base.fit is rival:
        vanished = fit.model["coulomb_voltage"] == 0 and rival.model["coulomb_voltage"] > 0
        return (replace(base, findings=(_friction_vanished(),)) if vanished else base), fit
    with_friction = allow(rival)
    if with_friction.disturbance is None:
        return base, fit
    gains = change_text(fit.model["gain"], with_friction.model["gain"])
    samples = sum(int(record.valid.sum()) for record in fit.records)
    if deviance(fit) - deviance(with_friction) > np.log(samples):
        sentence = (
            "Coulomb friction is needed: even beside a random torque it explains more than chance would, and without friction "
            f"the gain would be {gains}."
        )
        finding = info("friction-found", sentence, parameters=("coulomb_voltage",))
    elif shifts_parameters(with_friction, fit):
        finding = _friction_possible(gains)
    else:
        return base, fit
    return replace(base, fit=rival, findings=(finding,)), with_friction


def _friction_text(without: Fit, fit: Fit) -> str:
    """By how much more a fit explains than one without its friction, in numbers that differ."""
    for digits in (1, 2):
        least, most = (f"{each.fit_percent:.{digits}f}" for each in (without, fit))
        if least != most:
            return f"without it the simulation explains {least} % of the output, with it {most} %, and"
    smaller = 100 * (1 - fit.residual_sd / without.residual_sd)
    return f"with it the residual is {plain(smaller, 2)} % smaller, and without it"


def _friction_possible(gains: str) -> Finding:
    sentence = (
        "These data don't show for certain whether there is Coulomb friction, but it can't be left out: without it the gain "
        f"would be {gains}, and the fit worse or the interval too narrow."
    )
    return info("friction-possible", sentence, parameters=("coulomb_voltage",))


def _hides_friction(with_friction: Fit) -> bool:
    """Whether a fit that ends without friction could have as much of it as motors have: what it takes looks like another gain."""
    return friction_spread(with_changes_between_rows(with_friction)) > _HIDDEN


def _friction_hidden() -> Finding:
    sentence = (
        "These data can't tell Coulomb friction from a smaller gain, so it stays in the model. Record a second level of the "
        "input in one direction: two speeds in the same direction tell them apart."
    )
    return info("friction-possible", sentence, parameters=("coulomb_voltage",))


def _friction_vanished() -> Finding:
    sentence = (
        "These data don't show for certain whether there is Coulomb friction: without a random torque the model needs it, beside "
        "one there is none left."
    )
    return info("friction-possible", sentence, parameters=("coulomb_voltage",))


def _base_for_one_way(method: Estimator, data: Sequence[Dataset], one_way: Fit) -> _Base:
    """The base for a motor that turned one way: the simple one, or that of a shaft that friction holds where it also stood."""
    one_way = _with_short_lag(method, data, one_way)
    simple = _Base(fit=one_way, fits={one_way.structure: one_way})
    begins = any(record.starts_at_rest or rests_at_first(record) for record in data)
    stands = any(stands_at_first(record) for record in data)
    late = not is_usual(one_way)  # a delay may replace friction that the input has to overcome
    idle = any(map(_idles, data))
    if not (begins or stands or late or idle or _stands(data) or _would_stop(one_way)):
        return simple
    try:
        with_rest = fit_structure(method, STRUCTURES["first_order_one_way_rest"], data)
    except NotIdentifiable:
        return simple
    fits = {each.structure: each for each in (one_way, with_rest)}
    # Something holds a shaft that rests when the record begins; a model without it would use a delay or an offset instead, and
    # follow the rounding of the rest besides. What is as good, or as rounding, is no worse.
    left, left_without = map(_misfit_beside_zero, (with_rest, one_way))
    as_good = left <= _AS_GOOD**2 * left_without or is_rounding(with_rest)
    drifts = not (is_usual(with_rest) and as_good)
    # Nor does a shaft that came to rest say that nothing holds it: a constant that were no friction would go on acting.
    rested = begins or idle or (_stands(data) and not turns_both_ways(data))
    worth = not (clearly_better(one_way, with_rest) and drifts) if rested else better(with_rest, one_way)
    driven = any(record.starts_at_rest for record in data) and _drives(one_way)
    # Speeds under several levels may show that a constant does drive it, whatever that is: `speed-levels-off` says so then.
    worth = worth or (driven and (single_level(data) is not None or not clearly_better(one_way, with_rest)))
    worth = worth or (begins and _turns_back_what_stands(one_way))
    # What follows a record more closely by itself than by its input is no motor, but the way in which the shaft sets off.
    by_itself = not worth and input_hardly_matters(one_way) and with_rest.fit_percent > _BY_INPUT
    worth = worth or by_itself
    # A search that hasn't settled and yet is far ahead went on along a valley; the model without rest would only look settled.
    if not worth or not (with_rest.converged or clearly_better(with_rest, one_way)):
        return replace(simple, fits=fits)
    sentence = (
        f"The motor {_rest_in_words(data, begins or stands)}, so the model has friction that holds the shaft."
    )
    without, with_it = (f"{fit.fit_percent:.2f}" for fit in (one_way, with_rest))
    if float(with_it) > float(without):
        sentence += f" Without it the simulation explains {without} % of the output, with it {with_it} %."
    findings = [info(_REST, sentence, parameters=("coulomb_voltage",))]
    if by_itself:
        findings.append(_sets_off_unexplained(one_way, with_rest))
    return _with_breakaway(method, data, _Base(fit=with_rest, findings=tuple(findings), fits=fits))


def _sets_off_unexplained(by_itself: Fit, with_rest: Fit) -> Finding:
    """A finding that a motion of which the input is no cause fits better than the model with friction that is taken."""
    more, less = (f"{percent(fit.fit_percent)} %" for fit in (by_itself, with_rest))
    sentence = (
        "The way in which the shaft sets off isn't that of this model: a motion that the input has next to no part in explains "
        f"{more} of the output, this model {less}. Its time constant and delay may be far off. If the shaft was at rest before "
        "the record, say `starts_at_rest=True`; otherwise leave out the rows in which it sets off."
    )
    return warning("sets-off-unexplained", sentence, parameters=("time_constant", "delay"))


def _with_short_lag(method: Estimator, data: Sequence[Dataset], one_way: Fit) -> Fit:
    """The fit, or on ramps whose bend was taken for a lag of a good part of their time, the minimum nearby with a shorter one.

    A motor without friction, whose lag never ends, is bent as a ramp is that begins with static friction or ends at a limit. It
    says nothing of the gain, which a ramp shows whatever the lag is.
    """
    slow = _SLOW * max(record.duration for record in data)
    if not all(map(is_ramp, data)) or one_way.model["time_constant"] < slow:
        return one_way
    structure = one_way.model.structure
    names = one_way.model.names
    u, speed = [record.input_at_output for record in data], [smooth_speed(record) for record in data]
    gain, at_none = np.polyfit(np.concatenate(u), np.concatenate(speed), 1)
    step = max(record.sample_time for record in data)
    guess = {"gain": gain, "time_constant": 2.0 * step, "coulomb_voltage": -at_none / gain, "delay": step}
    start = np.concatenate(
        [[guess[name] for name in names], *(record.nuisance for record in one_way.records)]
    )
    free = np.arange(len(start)) != names.index("time_constant")
    nearest = lowest(structure, data, (minimise(structure, data, start, free).theta,))
    if nearest.theta[names.index("time_constant")] > slow:
        return one_way
    short = method.fit(structure, data, (nearest.theta,))
    is_as_good = short.residual_sd <= _BENDS * one_way.residual_sd
    # One that vanishes has no place beside the delay, whose interval would be that of nothing but the search.
    return short if _NONE * step < short.model["time_constant"] < slow and is_as_good else one_way


def _misfit_beside_zero(fit: Fit) -> float:
    """The sum of squares that a fit leaves, without the zeros of sensors of the speed."""
    return sum(cost_beside_zero(record.data, record.residual[record.valid]) for record in fit.records)


def _with_breakaway(method: Estimator, data: Sequence[Dataset], base: _Base) -> _Base:
    """The base with friction that is larger near standstill, where ramps from rest can't do without it.

    A shaft that breaks away at a larger input than one friction allows has a speed at once. A long lag instead would do the same
    to the beginning of a ramp.
    """
    structure = STRUCTURES[_STICKS]
    if is_rounding(base.fit) or not all(map(is_ramp, data)) or method.supports(structure, data) is not None:
        return base
    some = [_thin(record) for record in data]
    left = sum(float(np.sum(each.residual[:: _spacing(each.data)] ** 2)) for each in base.fit.records)
    slow = _SLOW * max(record.duration for record in data)

    def breaks_away(cost: float, lag: float) -> bool:
        return cost < _BREAKS_AWAY**2 * left and lag < slow

    try:
        # On a ramp an offset and a delay of any size do the same: a usual delay is tried first.
        minima = (lowest(structure, some, (start,)) for start in _starts(base.fit, structure, some))
        at = structure.parameters.index(TIME_CONSTANT)
        nearest = next((each for each in minima if breaks_away(each.cost, each.theta[at])), None)
        sticks = None if nearest is None else method.fit(structure, data, (nearest.theta,))
    except NotIdentifiable:
        return base
    if sticks is None or sticks.residual_sd > _BREAKS_AWAY * base.fit.residual_sd:
        return base
    sentence = (
        "The shaft breaks away at a larger input than keeps it turning, so the model has friction that falls with the speed "
        f"(Stribeck). Without it the simulation explains {base.fit.fit_percent:.2f} % of the output, with it "
        f"{sticks.fit_percent:.2f} %."
    )
    finding = info("stribeck-found", sentence, parameters=("coulomb_voltage",))
    fits = {**base.fits, sticks.structure: sticks}
    return _Base(fit=sticks, findings=(*base.findings, finding), fits=fits, sliding=base)


def _starts(slides: Fit, structure: Structure, data: Sequence[Dataset]) -> Iterator[Array]:
    """The vectors (P + ΣQ,) from which the structure is searched, the plain fit's first."""
    yield embed(slides, structure, data)
    yield from structure.guesses(data)


def _spacing(record: Dataset) -> int:
    """The samples from one to the next of those that show how a ramp sets off."""
    return max(len(record.y) // _FEW, 1)


def _thin(record: Dataset) -> Dataset:
    """A record with some of its outputs, and with means of its input over as many rows: a ramp stays where it is."""
    rows = slice(None, None, _spacing(record))
    firsts = np.arange(len(record.u))[rows]
    means = np.add.reduceat(record.u, firsts) / np.diff(firsts, append=len(record.u))
    return replace(
        record,
        t_input=record.t_input[rows],
        u=means,
        t_output=record.t_output[rows],
        y=record.y[rows],
        current=None,
        reference=None,
        rows=None,
    )


def _rest_in_words(data: Sequence[Dataset], begins: bool) -> str:
    """What a motor does that friction holds, by its records; `begins`: from their first rows on."""
    if _stands(data):
        return "stands still in part of the record"
    return "starts from rest" if begins else "may have stood for a while"


def _drives(one_way: Fit) -> bool:
    """Whether the constant that a motor loses would drive it, or exceeds its input: neither would let a shaft rest."""
    level, lost = drive_level(one_way), one_way.model["coulomb_voltage"]
    return not 0.0 <= lost * np.sign(level) < abs(level)


def _idles(record: Dataset) -> bool:
    """Whether an input is zero for at least one sample in fifty, and the shaft hardly moves then.

    A constant would act there as well, and friction doesn't.
    """
    off = record.input_at_output == 0.0
    speed = np.abs(smooth_speed(record))
    return bool(np.mean(off) > _A_FEW and np.median(speed[off]) < _HARDLY * np.percentile(speed, 95))


def _would_stop(one_way: Fit) -> bool:
    """Whether the input is less than what a motor loses for a while: friction would stop the shaft, the model turns it back."""
    sense, lost = np.sign(drive_level(one_way)), one_way.model["coulomb_voltage"]
    return any(bool(np.any(sense * record.data.u < sense * lost)) for record in one_way.records)


def _turns_back_what_stands(one_way: Fit) -> bool:
    """Whether the motor stands for most of the time for which a model without rest turns it back."""
    sense, lost = np.sign(drive_level(one_way)), one_way.model["coulomb_voltage"]
    back = [sense * record.data.input_at_output < sense * lost for record in one_way.records]
    still = [stands(record.data)[weak] for record, weak in zip(one_way.records, back, strict=True)]
    return bool(np.mean(np.concatenate([*still, [False]])) > 0.5)


def _stands(data: Sequence[Dataset]) -> bool:
    """Whether at least one sample in fifty, and three of them, were taken while the motor stood still."""
    still = np.concatenate([stands(record) for record in data])
    return bool(np.mean(still) > _A_FEW and np.count_nonzero(still) >= _SEVERAL)


def _climb(
    method: Estimator,
    data: Sequence[Dataset],
    base: _Base,
    causes: Causes,
    allow: Callable[[Fit], Fit],
) -> Choice:
    """The base with a rung more for each term that the data ask for and can tell, and why there are no more."""
    base, fit = _allow_with_friction(base, allow)
    here, refused = _of_base(base, fit, causes), dict[str, Rung]()
    if base.sliding is not None:
        below = _of_base(base.sliding, allow(base.sliding.fit), causes)
        return replace(here, rung=Rung(term="stribeck", plain=base.fit, fit=fit, doubt=""), below=below)
    if any(finding.code == _REST for finding in base.findings):
        return here  # the data determine nothing more about its friction
    if _candidate_terms(here.shown, fit) and _is_damaged(causes, fit):
        return here
    one_sine = are_driven_by_one_sine(data)  # under which several terms explain the same
    for _ in range(_RUNGS):
        terms = [
            term
            for term in _candidate_terms(here.shown, here.fit)
            if term not in refused
            and with_added_term(here.fit.structure, term)
            and not (term == "asymmetric" and not _shows_directions(data))
        ]
        significant = _significant_terms(here.shown)
        rungs = (
            try_rung(method, data, here.plain, here.fit, term, term in significant, allow) for term in terms
        )
        accepted = (each for each in rungs if not _note_refusal(each, refused))
        rung = (
            min(accepted, key=lambda each: schwarz_criterion(each.fit), default=None)
            if one_sine
            else next(accepted, None)
        )
        if rung is None:
            break
        if rung.term == "stribeck":
            here, rung = _without_asymmetry(method, data, here, rung, allow)
        here = _one_up(here, rung, refused)
    hidden = [each.hidden for each in refused.values() if each.hidden]
    stop = stop_finding(here.fit, here.shown, refused)
    return replace(here, findings=(*here.findings, stop, *hidden))


def _without_asymmetry(
    method: Estimator, data: Sequence[Dataset], here: Choice, rung: Rung, allow: Callable[[Fit], Fit]
) -> tuple[Choice, Rung]:
    """The place below the rung for each direction, and friction that falls tried from there, if both directions then are alike.

    Friction that differs by direction was tried first, and made up for friction that falls with the speed.
    """
    if here.rung is None or here.rung.term != "asymmetric" or here.below is None:
        return here, rung
    below = replace(here.below, findings=here.below.findings[:-1])
    alike = try_rung(method, data, below.plain, below.fit, "stribeck", True, allow)
    if alike.doubt or schwarz_criterion(alike.fit) > schwarz_criterion(rung.fit):
        return here, rung
    return below, alike


def _shows_directions(data: Sequence[Dataset]) -> bool:
    """Whether friction that differs by direction would show: under several levels of an input that drives both ways.

    A shaft that only coasts in one direction shows how the driver lets go, too; and runs of one level each differ by more than
    their direction.
    """
    u = np.concatenate([record.u for record in data])
    driven = _DRIVEN * float(np.abs(u).max(initial=0.0))
    drives_both_ways = min(np.mean(u > driven), np.mean(u < -driven)) >= _A_FEW
    return few_levels(data) is None and not has_one_level_each(data) and bool(drives_both_ways)


def _of_base(base: _Base, fit: Fit, causes: Causes) -> Choice:
    """The choice of a base, whose `fit` is as it is allowed for."""
    return Choice(fit=fit, plain=base.fit, causes=causes, shown=score_terms(fit), findings=base.findings)


def _one_up(here: Choice, rung: Rung, refused: Mapping[str, Rung]) -> Choice:
    """The choice with a rung more, and below it the one without, which says that the rung was left out."""
    doubt = "neither its size nor the gain would be known"
    if rung.term == "winding":
        doubt = "it can't be told from a delay"
    elif "gravity" in rung.term:
        doubt = "its size wouldn't be certain, and the gain or a part of the motion would stay open"
    lost = replace(rung, doubt=doubt)
    stop = stop_finding(here.fit, here.shown, {**refused, rung.term: lost})
    earlier = [f for f in here.findings if "coulomb" not in rung.term or f.code != "friction-not-found"]
    return replace(
        here,
        fit=rung.fit,
        plain=rung.plain,
        shown=score_terms(rung.fit),
        findings=(*earlier, rung_finding(rung, here.plain, here.fit)),
        rung=rung,
        below=replace(here, findings=(*here.findings, stop)),
    )


def _is_damaged(causes: Causes, fit: Fit) -> bool:
    """Whether something is wrong with the records themselves, to which a richer structure would only bend."""
    if any(map(had_spikes, causes.records)):
        return True
    findings = [finding for record in causes.records for finding in record.findings]
    return names_a_cause([*findings, *about_data(causes.records)]) or causes.are_damage(fit.fit_percent)


def _note_refusal(rung: Rung, refused: dict[str, Rung]) -> bool:
    """Whether something speaks against a rung; it is noted in `refused`."""
    if rung.doubt:
        refused[rung.term] = rung
    return bool(rung.doubt)


def _candidate_terms(shown: Sequence[TermScore], fit: Fit) -> list[str]:
    """The rungs to try: those that the data ask for, and all where the fit leaves a colour that nothing explains.

    A score test knows of small terms only: where gravity is large, the model's angle is so wrong that a pull by it means nothing,
    and under a sine a delay has taken the place of friction that falls with the speed.
    Where a long record is nearly explained, what is missing is small, and the intervals hold it: each trial would take seconds.
    """
    significant = _significant_terms(shown)
    first = [
        term for term in significant if term == "winding"
    ]  # two poles bend all else, and are fitted in no time
    if sum(len(record.data.y) for record in fit.records) >= _LARGE and fit.fit_percent >= _NEARLY_ALL:
        return first
    falls = ["stribeck"] if any(f"_{friction}" in fit.structure for friction in _BOTH_WAYS) else []
    if not explains_the_colour(fit) or _mostly_disturbance(fit):
        return list(dict.fromkeys([*first, *_BY_TRIAL, *significant, *falls]))
    one_sine = are_driven_by_one_sine([record.data for record in fit.records])
    # Friction was looked for before gravity was known, and so in vain.
    again = ["coulomb"] if fit.structure == "first_order_gravity" else []
    return list(dict.fromkeys([*again, *significant, *(falls if one_sine else [])]))


def _mostly_disturbance(fit: Fit) -> bool:
    """Whether a random torque makes more of the output than one beside a motor does: it can stand for any term."""
    return fit.disturbance is not None and fit.fit_percent < _NEARLY_ALL


def _significant_terms(shown: Sequence[TermScore]) -> list[str]:
    """The rungs that the data ask for, strongest first."""
    significant = [one for one in shown if _asks(one)]
    significant.sort(key=lambda one: -one.size)
    return list(dict.fromkeys(str(one.term.rung) for one in significant))


def _asks(one: TermScore) -> bool:
    """Whether a score test calls for a rung: friction that falls with the speed or grows with the load, not the other way.

    Where its absence moves gain or time constant by more than their own standard deviation, a hint is enough to try it: a
    filter for a random torque takes a good part of what is missing for noise.
    """
    if one.term.rung is None or one.size <= ASKED:
        return False
    if one.term.rung in ("stribeck", "load") and one.braking < 0:
        return False
    hint = one.term.rung != "winding" and one.moved > 1  # what a delay is made of is in the intervals already
    return one.size > one.term.limit or hint
