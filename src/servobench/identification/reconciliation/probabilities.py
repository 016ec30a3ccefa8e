"""Weighing causes against each other: how probable each is, alone or with another one, by Bayes' rule.

A cause i takes part with the prior probability π_i, and then shifts the values by e_i(s) for a size s with the prior p_i(s). At
most two take part. For the difference d with covariance S the evidence of a set H of causes is

    p(d | H) = ∫ N(d; Σ e_i(s_i), S) Π p_i(s_i) ds_i,     P(H | d) ∝ p(d | H) Π_H π_i Π_not H (1 - π_i)

The integral is a sum over sizes, each with a small normal spread along its curve, so that the sum is smooth however small S
is. There are two more sets: chance alone, e = 0, and something else, e normal with 50 % in each value.
docs/decisions/0014-why.md gives the assumptions and their reasons.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from servobench.core.channels import Array
from servobench.core.probability import chi_square_above
from servobench.core.rounding import TWO_SIDED
from servobench.identification.reconciliation.base import CAUSES, Cause, Excluded, Question, Sizes

CHANCE = "chance"
SOMETHING_ELSE = "something_else"
TOLD = 0.01  # of probability: less is reported as "below 1 %", and not used
_ELSE_OCCURS = 0.05
_ELSE_SD = 0.5  # of ln: two values may differ by half, or twice that, for unknown reasons
_SMOOTH = 0.8  # of the distance between sizes: a sum of normals so wide is smooth to 1e-5
_SLOPE = 1e-4  # of a step: what derivatives are taken over


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """Causes that together may have made the difference, or `chance` or `something_else`, and the probability of that."""

    causes: tuple[str, ...]
    probability: float


@dataclass(frozen=True, eq=False)
class _Shifts:
    """A mixture of normals in the space of the difference: weights (n,), means (n, D), covariances (n, D, D)."""

    weights: Array
    means: Array
    covariances: Array


def weigh(question: Question) -> tuple[Hypothesis, ...]:
    """Return every set of causes with its probability, the most probable first; they add up to one."""
    possible = {name: sizes for name in CAUSES.names() if isinstance(sizes := _sizes(name, question), Sizes)}
    mixtures = {name: _shifts(CAUSES[name], question, sizes) for name, sizes in possible.items()}
    odds = {name: CAUSES[name].occurrence / (1 - CAUSES[name].occurrence) for name in possible}
    logs: dict[tuple[str, ...], float] = {(CHANCE,): _evidence(question, _nothing(question))}
    logs[SOMETHING_ELSE,] = _evidence(question, _other_cause(question)) + np.log(
        _ELSE_OCCURS / (1 - _ELSE_OCCURS)
    )
    for name, mixture in mixtures.items():
        logs[name,] = _evidence(question, mixture) + np.log(odds[name])
    for one, other in combinations(mixtures, 2):
        if other in CAUSES[one].not_with or one in CAUSES[other].not_with:
            continue
        both = _both(mixtures[one], mixtures[other])
        logs[one, other] = _evidence(question, both) + np.log(odds[one] * odds[other])
    values = np.array(list(logs.values()))
    weights = np.exp(values - values.max())
    weights /= weights.sum()
    return _by_probability({key: float(w) for key, w in zip(logs, weights, strict=True)})


def participation(hypotheses: tuple[Hypothesis, ...]) -> Mapping[str, float]:
    """Return for each cause the probability that it takes part, alone or with another one."""
    probabilities: dict[str, float] = {}
    for each in hypotheses:
        for name in each.causes:
            probabilities[name] = probabilities.get(name, 0.0) + each.probability
    return probabilities


def helps_another(name: str, hypotheses: tuple[Hypothesis, ...]) -> float:
    """Return how much more probable the sets of two with this cause are than if it did nothing in them.

    A cause that does nothing beside another leaves its evidence as it is: the set {other, cause} has then the probability
    of {other} times the cause's odds beforehand. What it has above that is owed to the cause.
    """
    odds = CAUSES[name].occurrence / (1 - CAUSES[name].occurrence)
    at = {each.causes: each.probability for each in hypotheses}
    surplus = 0.0
    for causes, probability in at.items():
        if name in causes and len(causes) == 2:
            (other,) = set(causes) - {name}
            surplus += max(probability - odds * at[other,], 0.0)
    return surplus


def without(hypotheses: tuple[Hypothesis, ...], names: Collection[str]) -> tuple[Hypothesis, ...]:
    """Return the sets less causes that make no part of the difference; where nothing else is in a set, it is chance."""
    probabilities: dict[tuple[str, ...], float] = {}
    for each in hypotheses:
        causes = tuple(name for name in each.causes if name not in names) or (CHANCE,)
        probabilities[causes] = probabilities.get(causes, 0.0) + each.probability
    return _by_probability(probabilities)


def _by_probability(probabilities: Mapping[tuple[str, ...], float]) -> tuple[Hypothesis, ...]:
    hypotheses = [Hypothesis(causes=causes, probability=each) for causes, each in probabilities.items()]
    return tuple(sorted(hypotheses, key=lambda each: -each.probability))


def _sizes(name: str, question: Question) -> Sizes | Excluded:
    return CAUSES[name].sizes(question)


def _nothing(question: Question) -> _Shifts:
    d = len(question.names)
    return _Shifts(np.ones(1), np.zeros((1, d)), np.zeros((1, d, d)))


def _other_cause(question: Question) -> _Shifts:
    d = len(question.names)
    return _Shifts(np.ones(1), np.zeros((1, d)), _ELSE_SD**2 * np.eye(d)[None])


def _shifts(cause: Cause, question: Question, sizes: Sizes) -> _Shifts:
    means = np.array([cause.effect(question, float(size)) for size in sizes.values])
    slopes = np.array(
        [
            slope(cause, question, float(size), float(step)) if step > 0 else np.zeros(len(question.names))
            for size, step in zip(sizes.values, sizes.steps, strict=True)
        ]
    )
    along = slopes * (_SMOOTH * sizes.steps)[:, None]
    covariances = along[:, :, None] * along[:, None, :]
    for n, name in enumerate(question.names):
        covariances[:, n, n] += np.broadcast_to(sizes.scatter.get(name, 0.0), len(means)) ** 2
    return _Shifts(sizes.weights, means, covariances)


def slope(cause: Cause, question: Question, size: float, step: float) -> Array:
    """Return the derivative (D,) of a cause's effect by its size, over a small part of a step."""
    width = _SLOPE * step
    after, before = (cause.effect(question, size + side * width) for side in (1, -1))
    return np.asarray((after - before) / (2 * width), dtype=np.float64)


def _both(one: _Shifts, other: _Shifts) -> _Shifts:
    d = one.means.shape[1]
    return _Shifts(
        np.outer(one.weights, other.weights).ravel(),
        (one.means[:, None] + other.means[None]).reshape(-1, d),
        (one.covariances[:, None] + other.covariances[None]).reshape(-1, d, d),
    )


def _evidence(question: Question, shifts: _Shifts) -> float:
    """The logarithm of the density of the difference under a mixture."""
    total = shifts.covariances + question.covariance
    left = question.difference - shifts.means
    solved = np.linalg.solve(total, left[:, :, None])[:, :, 0]
    _, determinant = np.linalg.slogdet(2 * np.pi * total)
    with np.errstate(divide="ignore"):
        logs = np.log(shifts.weights) - 0.5 * (np.einsum("nd,nd->n", left, solved) + determinant)
    top = logs.max()
    return float(top + np.log(np.exp(logs - top).sum()))


def chance_is_enough(question: Question) -> bool:
    """Return whether each figure lies within its own 95 % interval, or all of them within their common 95 % region."""
    if (np.abs(question.difference) <= TWO_SIDED * question.sd).all():
        return True
    return chi_square_above(question.distance(question.difference), len(question.names)) >= 0.05
