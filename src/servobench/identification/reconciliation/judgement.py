"""One cause and the difference: the size needed, how much it explains, and whether the data contradict it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import TWO_SIDED
from servobench.identification.reconciliation.base import (
    CAUSES,
    Cause,
    Decision,
    Excluded,
    Name,
    Question,
    Sizes,
)
from servobench.identification.reconciliation.probabilities import (
    TOLD,
    Hypothesis,
    helps_another,
    participation,
    slope,
)

_LIMIT = 10.83  # χ² of one degree of freedom that chance exceeds once in a thousand
_LOOKS = 401
_NO_HELP = 0.05  # of the difference's χ²: what takes away less than this doesn't explain anything


@dataclass(frozen=True, kw_only=True)
class Size:
    """A size of a cause in words; `low` and `high` are the ends of its 95 % interval, empty where it can't vary."""

    value: float
    """As the cause counts it."""
    text: str
    """In words, with its unit."""
    low: str = ""
    high: str = ""


@dataclass(frozen=True, kw_only=True)
class Share:
    """The part of the difference in a figure that a cause explains, 1 for all of it, with its 95 % interval.

    The ends are NaN where the difference itself might be none.
    """

    name: Name
    """The figure."""
    value: float
    """The part."""
    interval: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class JudgedCause:
    """A cause, how probable it is that it takes part, and what speaks for and against it.

    `against` says why it can't be the cause, or not alone; empty if nothing contradicts it. `needed` is the size that
    explains most, None where no size helps without another cause. `likely` is the size that such a cause has before anybody
    looks at the difference, and `explains` what that explains.
    """

    name: str
    """A name that stays the same."""
    label: str
    """The same for people."""
    law: str
    """Its effect on gain and time constant."""
    probability: float
    """That it takes part, alone or with another; 0 where it isn't possible."""
    possible: bool
    """Whether it can be a cause of this at all, alone or with another."""
    against: str
    needed: Size | None
    likely: Size | None
    explains: tuple[Share, ...]
    decision: Decision
    """The experiment that would decide about it."""


def judge(name: str, question: Question, hypotheses: tuple[Hypothesis, ...]) -> JudgedCause:
    """Return what there is to say about the cause of that name.

    `hypotheses` are all sets of causes. A cause of which no size helps, neither alone nor beside another one, isn't possible:
    that it may be there all the same, as before anybody looked, explains nothing.
    """
    cause = CAUSES[name]
    sizes = cause.sizes(question)
    if isinstance(sizes, Excluded):
        return JudgedCause(
            name=name,
            label=cause.label,
            law=cause.law,
            probability=0.0,
            possible=False,
            against=sizes.reason,
            needed=None,
            likely=None,
            explains=(),
            decision=cause.decision_for(question, 0.0),
        )
    best = _best(cause, question, sizes)
    likely = _likely(cause, question, sizes, best)
    left = question.difference - cause.effect(question, best)
    alone = question.distance(left) < (1 - _NO_HELP) * question.distance(question.difference)
    beside = helps_another(name, hypotheses) >= TOLD
    against = _against(cause, question, left, helps=alone, known=len(sizes.values) == 1)
    return JudgedCause(
        name=name,
        label=cause.label,
        law=cause.law,
        probability=participation(hypotheses).get(name, 0.0) if alone or beside else 0.0,
        possible=alone or beside,
        against=f"not alone: {against}" if beside and not alone else against,
        needed=_size(cause, question, sizes, best) if alone else None,
        likely=Size(value=likely, text=cause.size_text(question, likely)),
        explains=_shares(cause, question, sizes, likely),
        decision=cause.decision_for(question, best),
    )


def _best(cause: Cause, question: Question, sizes: Sizes) -> float:
    """The size that leaves least of the difference: of the sizes there are, or of the whole domain where they are a range."""

    def remainder(size: float) -> float:
        return question.distance(question.difference - cause.effect(question, float(size)))

    tried = list(sizes.values)
    if sizes.is_range:
        tried += list(np.linspace(*cause.domain(question), _LOOKS))
    tried.sort()
    values = [remainder(size) for size in tried]
    at = int(np.argmin(values))
    low, high = tried[max(at - 1, 0)], tried[min(at + 1, len(tried) - 1)]
    if not sizes.is_range or high <= low:
        return float(tried[at])
    from scipy.optimize import minimize_scalar

    minimum = minimize_scalar(
        remainder, bounds=(low, high), method="bounded", options={"xatol": 1e-6 * (high - low)}
    )
    return float(minimum.x) if minimum.fun < values[at] else float(tried[at])


def _size(cause: Cause, question: Question, sizes: Sizes, best: float) -> Size:
    """The best size with its interval, which is that of the difference carried back through the effect's slope."""
    text = cause.size_text(question, best)
    low, high = cause.domain(question)
    if not sizes.is_range:
        return Size(value=best, text=text)
    g = slope(cause, question, best, 1e-2 * (high - low))
    information = float(g @ np.linalg.solve(question.covariance, g))
    if not information > 0:
        return Size(value=best, text=text)
    half = TWO_SIDED / math.sqrt(information)
    ends = (max(best - half, low), min(best + half, high))
    if ends[1] <= 0:  # people say from how little to how much less
        ends = ends[::-1]
    return Size(
        value=best, text=text, low=cause.amount(question, ends[0]), high=cause.amount(question, ends[1])
    )


def _likely(cause: Cause, question: Question, sizes: Sizes, best: float) -> float:
    """The size that is typical: what the cause says, or of separate ones the best, or the root mean square where it helps.

    The last is no more than what is needed.
    """
    if sizes.likely is not None:
        return sizes.likely
    if not sizes.is_range:
        return best
    toward = np.linalg.solve(question.covariance, question.difference)
    helps = np.array([float(cause.effect(question, float(size)) @ toward) > 0 for size in sizes.values])
    helps &= sizes.steps > 0
    if not helps.any():
        return 0.0
    w, v = sizes.weights[helps], sizes.values[helps]
    usual = float(np.sign(v @ w) * np.sqrt((w @ v**2) / w.sum()))
    return best if best * usual > 0 and abs(best) < abs(usual) else usual


def _shares(cause: Cause, question: Question, sizes: Sizes, size: float) -> tuple[Share, ...]:
    """The share of each figure's difference, with the ends that the difference's own interval and the cause's scatter make."""
    effect = cause.effect(question, size)
    shares = []
    for n, name in enumerate(question.names):
        scatter = float(np.max(sizes.scatter.get(name, 0.0)))
        half = TWO_SIDED * math.hypot(float(question.sd[n]), scatter)
        d, e = float(question.difference[n]), float(effect[n])
        ends = sorted(_share(e, d + side * half) for side in (1, -1))
        known = abs(d) > half
        shares.append(
            Share(
                name=name, value=_share(e, d), interval=(ends[0], ends[1]) if known else (math.nan, math.nan)
            )
        )
    return tuple(shares)


def _share(effect: float, difference: float) -> float:
    """The part of a difference between two figures, both given as logarithms of ratios."""
    return math.expm1(effect) / math.expm1(difference) if difference else math.nan


def _against(cause: Cause, question: Question, left: Array, *, helps: bool, known: bool) -> str:
    """The evidence against a cause, empty for none."""
    if not helps:
        return _no_help(cause, question, known=known)
    if question.distance(left) <= _LIMIT + len(question.names) - 1:
        return ""
    worst = parameter_in_words(question.names[int(np.argmax(np.abs(left) / question.sd))])
    if known:
        return f"not alone: its size is known and leaves part of the {worst} unexplained"
    return f"not alone: at any size it leaves part of the {worst} unexplained"


def _no_help(cause: Cause, question: Question, *, known: bool) -> str:
    """The reason why a cause explains nothing of the difference."""
    low, high = cause.domain(question)
    toward = np.linalg.solve(question.covariance, question.difference)
    sizes = cause.sizes(question)
    if isinstance(sizes, Sizes) and known:
        size = float(sizes.values[0])
        wrong = float(cause.effect(question, size) @ toward) < 0
        return (
            "it acts in the opposite direction"
            if wrong
            else f"{cause.size_text(question, size)} is too little"
        )
    if isinstance(sizes, Sizes) and not sizes.is_range:
        return "no possible size comes close"
    wrong = float(cause.effect(question, low + 0.1 * (high - low)) @ toward) < 0
    return (
        "it acts in the opposite direction" if wrong and low > -1 else "no size of it explains the difference"
    )
