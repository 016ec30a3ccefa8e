"""Does the model's structure lack something? A score test for each term that a motor may have and the model lacks.

`uncertainty.score_test` explains the test. Here are the terms, each with its sentence for the user and the meaning of its
amount.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, info, warning
from servobench.core.rounding import TWO_SIDED, plain
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution, beyond
from servobench.identification.estimators.prediction_error import (
    THRESHOLD,
    disturbance_test,
    with_innovations,
)
from servobench.identification.models.motion import turns_both_ways
from servobench.identification.models.nonlinear.structure import STRIBECK
from servobench.identification.models.rational import Rational
from servobench.identification.trust.validation import explains_the_colour
from servobench.identification.uncertainty.fall_of_friction import OTHER_FALL, other_fall
from servobench.identification.uncertainty.score_test import ASKED, ScoreTest, Term, TermScore, size_beside

_AS_LIKELY = 3.84  # in χ²: what chance exceeds in 5 % of runs
_RIPPLES = range(1, 17)  # times a revolution
_OF_BOTH_WAYS = ("directions-differ", "drag-differs", "backlash")


def _of_input(shown: TermScore, what: str, times: float = 1.0) -> str:
    """So much of the input."""
    size, half = shown.whole
    unit = shown.fit.records[0].data.input_unit
    return f"About {plain(times * size, 2)} ± {plain(times * half, 1)} {unit} {what}."


def _stribeck_sized(shown: TermScore) -> str:
    return _of_input(shown, "more at rest than at speed")


def _drag_sized(shown: TermScore) -> str:
    return _of_input(
        shown, (f"{'more' if shown.braking > 0 else 'less'} at the largest speed than proportional drag")
    )


def _directions_sized(shown: TermScore) -> str:
    """The two directions are the amount apart from their mean, each way."""
    size, half = shown.whole
    percent = 100 * 2 / shown.largest
    way = "positive" if shown.amount[0] > 0 else "negative"
    return (
        f"In the {way} direction the response is about {plain(percent * size, 2)} ± "
        f"{plain(percent * half, 1)} % larger."
    )


def _directions_within(shown: TermScore) -> bool:
    """Whether the interval of the gain K holds those of both directions, K (1 ± a/u) for an amount a of a largest input u."""
    size, half = shown.whole
    fit = shown.fit
    return (size + half) / shown.largest * abs(fit.model["gain"]) <= TWO_SIDED * fit.sd("gain")


def _ripple_sized(shown: TermScore) -> str:
    return _of_input(shown, "in either direction")


def _backlash_sized(shown: TermScore) -> str:
    """The output is off by half the play either way."""
    size, half = shown.whole
    unit, times = shown.fit.records[0].data.position_unit, 2.0
    if unit == "rad":
        unit, times = "deg", float(np.rad2deg(2.0))
    amount = f"{plain(times * size, 2)} ± {plain(times * half, 1)} {unit}"
    if shown.amount[0] > 0:
        return f"The output runs ahead there by about {amount}, which backlash can't do."
    return (
        f"The output lags there by about {amount}, as with backlash in a gear or a dead band of the driver."
    )


def _ripple(cycles: int) -> Term:
    return Term(
        code="ripple",
        name="ripple",
        sentence=f"Something repeats {cycles}× per revolution (cogging, a commutator, an "
        "eccentric encoder), which the model leaves out; where the motor lingers at one "
        "angle it shifts gain and time constant.",
        to_input=lambda m: m.wave(cycles),
        rung="gravity" if cycles == 1 else None,
        sized=_ripple_sized,
    )


# A fast pole 1/(1 + s d) is a delay d to first order; to second order it adds d²/2 times the second derivative by the delay.
_FAST_POLE = Term(
    code="fast-pole",
    name="a second pole",
    sentence="Part of the apparent delay is the lag of a second, faster pole (the winding's, or "
    "a compliant shaft), which a first-order model puts into its time constant.",
    curved="delay",
    limit=3.5,
    rung="winding",
)

TERMS = (
    Term(
        code="friction-depends-on-speed",
        name="friction that depends on the speed",
        sentence="Friction depends on the speed: near standstill it differs from the model's "
        "constant friction (Stribeck), which shifts gain and time constant.",
        to_input=lambda m: (-np.sign(m.speed) * np.exp(-np.abs(m.speed) / 0.2),),
        rung="stribeck",
        sized=_stribeck_sized,
    ),
    Term(
        code="drag-not-linear",
        name="drag that isn't linear",
        sentence="The speed isn't proportional to the input: drag grows faster or slower than "
        "the speed, so the gain holds for this range of speeds only.",
        to_input=lambda m: (-m.speed * np.abs(m.speed),),
        sized=_drag_sized,
    ),
    Term(
        code="directions-differ",
        name="directions that differ",
        sentence=(
            "The motor responds differently in its two directions; a single gain is a mean of the two."
        ),
        to_input=lambda m: (m.input * np.sign(m.speed),),
        rung="asymmetric",
        sized=_directions_sized,
        within=_directions_within,
    ),
    Term(
        code="drag-differs",
        name="drag that differs by direction",
        sentence=(
            "Drag differs between the two directions; a single gain and time constant are a mean of the two."
        ),
        to_input=lambda m: (-np.abs(m.speed),),
        rung="asymmetric",
        sized=lambda shown: _of_input(shown, "between the two directions at the largest speed", 2.0),
    ),
    Term(
        code="friction-grows-with-load",
        name="friction that grows with the load",
        sentence=(
            "Friction is larger where gravity pulls harder, as in a gear under load, "
            "which the model leaves out."
        ),
        to_input=lambda m: (-m.load * np.sign(m.speed),),
        rung="load",
        sized=lambda shown: _of_input(shown, "under the largest load"),
    ),
    Term(
        code="motor-changes",
        name="a motor that changes",
        sentence="The motor seems different at the end of the record than at its beginning: it may have warmed up, its "
        "friction or its supply may have changed, or the input moves faster than it was logged. The parameters are a mean "
        "over the record.",
        to_input=lambda m: (m.input * m.gone, m.speed * m.gone),
    ),
    Term(
        code="friction-changes",
        name="friction that changes",
        sentence="Friction, or the input's offset, changed during the record.",
        to_input=lambda m: (np.sign(m.speed) * m.gone, m.gone),
    ),
    Term(
        code="backlash",
        name="backlash",
        sentence="At every reversal the model is wrong, which shifts gain and time constant.",
        to_output=lambda m: (np.sign(m.speed),),
        sized=_backlash_sized,
    ),
    _FAST_POLE,
    *(_ripple(cycles) for cycles in _RIPPLES),
)


def score_terms(fit: Fit) -> tuple[TermScore, ...]:
    """Return how strongly the data ask for each of the `TERMS`, and for how much; none where nothing is left to explain."""
    largest = max(float(np.abs(record.data.u).max(initial=0.0)) for record in fit.records)
    if largest == 0 or not np.isfinite(fit.residual_sd) or fit.residual_sd == 0:
        return ()
    return tuple(ScoreTest(fit, largest).scores(_terms(fit, largest)))


def _terms(fit: Fit, largest: float) -> tuple[Term, ...]:
    """The terms to look for; of a model whose friction falls with the speed, another form of the fall.

    A motor that turned one way only shows nothing of another direction, even where its model, which doesn't stick, turns back.
    """
    terms = TERMS
    if not turns_both_ways([record.data for record in fit.records]):
        terms = tuple(term for term in terms if term.code not in _OF_BOTH_WAYS)
    if STRIBECK.name not in fit.model.names:
        return terms
    others = (term for term in terms if term.rung != "stribeck")
    return (other_fall(fit, largest), *others)


def beside_torque(shown: Sequence[TermScore]) -> tuple[TermScore, ...]:
    """Return the scores without those that don't show beside a random torque, where one is likely and the fit tested has none.

    What a torque does to a position looks like many a term, as long as nothing filters it out. Where it explains the residual, a
    term has to show beside it as plainly as by itself; where it doesn't, a hint is enough.
    """
    significant = [one for one in shown if one.size > one.term.limit]
    test = (
        disturbance_test(significant[0].fit)
        if significant and significant[0].fit.disturbance is None
        else None
    )
    if test is None or test.likelihood_ratio <= THRESHOLD:
        return tuple(shown)
    fit, data = significant[0].fit, [record.data for record in significant[0].fit.records]
    records, torque = with_innovations(fit.model.structure, data, fit.vector, test.disturbance)
    filtered = replace(fit, records=records, disturbance=torque, residual_sd=float(np.sqrt(torque.variance)))
    explained = explains_the_colour(filtered)
    again = ScoreTest(filtered, significant[0].largest).scores([one.term for one in significant])
    made_up = {each.term for each in again if each.size <= (each.term.limit if explained else ASKED)}
    return tuple(one for one in shown if one.term not in made_up)


def missing_terms(shown: Sequence[TermScore]) -> list[Finding]:
    """Return a finding for each term that the data ask for beside those that they ask for more, and the structure lacks.

    What looks like a term because a stronger one is lacking is only named with that one, unless it is as likely as the strongest
    but for chance.
    """
    reported: dict[str, TermScore] = {}
    alike: dict[str, list[str]] = {}
    for one in sorted(_strongest(_independent_of_fall(shown)).values(), key=lambda each: -each.size):
        if one.term.rung == "stribeck" and one.braking < 0:
            continue  # no bearing brakes less at rest: it is something else that looks like it
        as_likely = not reported or one.size**2 > next(iter(reported.values())).size ** 2 - _AS_LIKELY
        if as_likely or size_beside(one, tuple(reported.values())) > one.term.limit:
            reported[one.term.code] = one
        else:
            alike.setdefault(next(iter(reported)), []).append(one.term.name)
    return [_finding(code, one, alike.get(code, ())) for code, one in reported.items()]


def with_missing_terms(fit: Fit, shown: Sequence[TermScore]) -> Fit:
    """Return the fit with lines of its budget for what the parameters are off by without terms that the data ask for.

    Only what the intervals don't hold already is added, that of the strongest term first: terms that show in the same residual
    are mostly one thing under several names.
    """
    for one in sorted(_strongest(_independent_of_fall(shown)).values(), key=lambda each: -each.size):
        if len(one.off) != len(fit.model.theta) or not np.isfinite(one.off).all():
            continue
        known = np.isfinite(np.diag(fit.covariance))
        off = np.where(known, _within_reach(fit, one.off), 0.0)
        already = np.where(np.outer(known, known), fit.covariance, 0.0)
        added = beyond(np.outer(off, off), already)
        if added.any():
            reason = f"the data show {one.term.name}, which the model lacks"
            fit = fit.widen(Contribution(source=one.term.name, covariance=added, reason=reason))
    return fit


def _within_reach(fit: Fit, off: Array) -> Array:
    """A change of the parameters (P,), shortened to where neither gain nor time constant changes by more than its own value.

    By then they aren't known, and the linear step that it comes from no longer shows what is known of them together.
    """
    at = [
        n
        for n, name in enumerate(fit.model.names)
        if name in ("gain", "time_constant") and fit.model.theta[n]
    ]
    farthest = max((float(abs(off[n] / fit.model.theta[n])) for n in at), default=0.0)
    return off / max(farthest, 1.0)


def _independent_of_fall(shown: Sequence[TermScore]) -> list[TermScore]:
    """The scores without those that don't show beside a friction that falls in another form than the model's, where that shows.

    Such a model is known to have the wrong form; what else shows in the same residual is mostly that.
    """
    falls = [one for one in shown if one.term.code == OTHER_FALL and one.size > one.term.limit]
    return [one for one in shown if one in falls or not falls or size_beside(one, falls) > one.term.limit]


def _strongest(shown: Sequence[TermScore]) -> dict[str, TermScore]:
    """Of the terms that the data ask for, the strongest of each code."""
    strongest: dict[str, TermScore] = {}
    for one in shown:
        before = strongest.get(one.term.code)
        if one.size > max(one.term.limit, before.size if before else 0.0):
            strongest[one.term.code] = one
    return strongest


def _finding(code: str, shown: TermScore, alike: Sequence[str]) -> Finding:
    """The finding on a missing term: a doubt, unless the intervals hold it, or an unknown filter may be what makes it up.

    `alike` are terms that would show in the same residual.
    """
    sentence = _sentence(shown)
    if alike:
        sentence += f" It may also be {' or '.join(dict.fromkeys(alike))}."
    concerned = ("gain", "time_constant")
    data = [record.data for record in shown.fit.records]
    if any(each.kind == "speed" and not each.chain and not each.chain_known for each in data):
        hedged = f"{sentence} A filter may cause all of this: first say how the speed was measured."
        return info(code, hedged, parameters=concerned)
    if not {"gain", "time_constant"} <= set(shown.fit.model.names):
        return warning(code, sentence, parameters=concerned)
    return info(code, f"{sentence} The intervals allow for that.", parameters=concerned)


def superfluous_terms(fit: Fit) -> list[Finding]:
    """Return a rational structure's faults: a coefficient that can't be distinguished from zero, or no integrator.

    That is what an order more, or an integrator less, than the motor has would leave near zero.
    """
    structure = fit.model.structure
    if not isinstance(structure, Rational):
        return []
    names = [name for name in fit.model.names if name != "delay"]
    unsure = [name for name in names if not 2 * fit.sd(name) < abs(fit.model[name])]
    findings = []
    if unsure:
        unsure_text = ", ".join(f"{n} ({fit.model[n]:.3g} ± {TWO_SIDED * fit.sd(n):.2g})" for n in unsure)
        sentence = (
            f"These coefficients aren't significantly different from zero: {unsure_text}. The order is "
            "higher than the data support, which makes the others less certain: try "
            f"{_lower(structure)}."
        )
        findings.append(warning("term-not-told-from-zero", sentence, parameters=tuple(unsure)))
    last = f"a{structure.order}"
    data = fit.records[0].data
    if data.kind == "position" and not structure.integrator and last in unsure:
        sentence = (
            f"The output is a position, and the structure's lowest coefficient {last} comes out "
            "near zero, as for a motor that keeps turning while it is driven: fix it at zero "
            f"with _integrator ({_lower(structure)})."
        )
        findings.append(info("integrator-likely", sentence, parameters=(last,)))
    return findings


def _lower(structure: Rational) -> str:
    """The name of the structure with a pole less: one that an integrator replaces."""
    order = max(structure.order - 1, 1)
    zeros = min(structure.zeros, order - 1)
    integrator = "_integrator" if structure.integrator or structure.order > 1 else ""
    return f"rational_{order}_{zeros}{integrator}{'_delay' if structure.delayed else ''}"


def _sentence(shown: TermScore) -> str:
    sized = f" {shown.term.sized(shown)}" if shown.term.sized and _possible(shown) else ""
    return f"{shown.term.sentence}{sized} ({shown.size:.0f} standard deviations.)"


def _possible(shown: TermScore) -> bool:
    """Whether a term has a size that can be: no larger than the input, or than the output's range, of which it is a part."""
    if not shown.amount.size:
        return False
    outputs = [float(np.ptp(record.data.y)) for record in shown.fit.records]
    return shown.whole[0] <= (shown.largest if shown.term.to_input else max(outputs))
