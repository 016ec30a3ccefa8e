"""Bayes' rule, held against integrals that are done another way."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from servobench.identification.reconciliation.base import CAUSES, Question, Sizes
from servobench.identification.reconciliation.claim import Claim
from servobench.identification.reconciliation.probabilities import (
    CHANCE,
    SOMETHING_ELSE,
    participation,
    weigh,
)
from servobench.identification.reconciliation.questions import about_claims, about_sheet
from tests.identification.reconciliation.motors import SHEET, identified


def sheet_question(covariance: np.ndarray | None = None, **after: float) -> Question:
    fit = identified().fit
    assert fit is not None
    asked = about_sheet(fit, SHEET)
    values = {**asked.after, **after}
    return replace(asked, after=values, covariance=asked.covariance if covariance is None else covariance)


def probabilities(asked: Question) -> dict[tuple[str, ...], float]:
    return {each.causes: each.probability for each in weigh(asked)}


@pytest.mark.parametrize("sd", [1e-5, 1e-3, 0.02])
def test_the_odds_of_resistance_against_chance_are_those_of_two_normals(sd: float) -> None:
    """For a sheet without friction, resistance moves ln τ by a normal number of 12 %: the integral has a closed form."""
    s = np.diag([sd**2, (2 * sd) ** 2])
    asked = sheet_question(s, time_constant=0.1150, gain=23.82)
    found = probabilities(asked)

    along = s + np.diag([0.0, 0.12**2])
    zero = np.zeros(2)
    expected = 0.1 / 0.9 * multivariate_normal(zero, along).pdf(asked.difference)
    other = multivariate_normal(zero, s + 0.25 * np.eye(2)).pdf(asked.difference) * 0.05 / 0.95
    # Held against something else, whose odds no sd makes vanish. The spread that smooths the sum widens 12 % by 0.3 %, and the
    # tails beyond four standard deviations are cut.
    ratio = found["series_resistance",] / found[SOMETHING_ELSE,]
    assert ratio == pytest.approx(expected / other, rel=0.01)


@pytest.mark.parametrize("sd", [1e-4, 0.01])
def test_the_evidence_of_viscous_friction_is_that_of_an_integral_over_its_sizes(sd: float) -> None:
    asked = sheet_question(sd**2 * np.eye(2), gain=22.0, time_constant=0.0920)
    found = probabilities(asked)

    def density(x: float) -> float:
        shift = -math.log1p(x)
        return 2 * norm.pdf(x, scale=0.1) * float(np.prod(norm.pdf(asked.difference - shift, scale=sd)))

    peak = math.exp(-float(asked.difference.mean())) - 1
    expected, _ = quad(density, max(peak - 10 * sd, 0), peak + 10 * sd, epsabs=0, epsrel=1e-10)
    other = multivariate_normal(np.zeros(2), (sd**2 + 0.25) * np.eye(2)).pdf(asked.difference)
    ratio = found["viscous_friction",] / found[SOMETHING_ELSE,]
    assert ratio == pytest.approx(expected * (0.15 / 0.85) / (other * 0.05 / 0.95), rel=0.03)


@pytest.mark.parametrize("text", ["tau=0.13", "tau=0.0807", "tau=0.0992", "tau=5"])
def test_probabilities_add_up_to_one_however_far_the_claim_is(text: str) -> None:
    fit = identified().fit
    assert fit is not None
    hypotheses = weigh(about_claims(fit, [Claim.parse(text)]))

    assert sum(each.probability for each in hypotheses) == pytest.approx(1.0)
    assert all(1 <= len(each.causes) <= 2 for each in hypotheses)
    parts = participation(hypotheses)
    assert set(parts) <= {*CAUSES.names(), CHANCE, SOMETHING_ELSE}
    assert all(0 <= part <= 1 + 1e-12 for part in parts.values())


def test_a_claim_far_from_everything_is_something_else() -> None:
    fit = identified().fit
    assert fit is not None
    hypotheses = weigh(about_claims(fit, [Claim.parse("gain=240"), Claim.parse("tau=0.9")]))

    assert hypotheses[0].causes == (SOMETHING_ELSE,)


def test_two_causes_of_which_one_is_a_part_of_the_other_never_go_together() -> None:
    fit = identified().fit
    assert fit is not None

    assert ("measurement_lag", "method") not in probabilities(about_claims(fit, [Claim.parse("tau=0.13")]))


def test_probabilities_are_right_on_average_where_differences_come_about_as_is_supposed() -> None:
    """Draw causes and sizes from their priors, and a difference from them: of all that gets 30 %, 30 % must be so.

    So that for each cause the probabilities that it gets add up to how often it took part, within chance.
    """
    random = np.random.default_rng(14)
    asked = sheet_question(np.diag([0.01**2, 0.02**2]))
    sizes = {name: found for name in CAUSES.names() if isinstance(found := CAUSES[name].sizes(asked), Sizes)}
    odds = {name: CAUSES[name].occurrence / (1 - CAUSES[name].occurrence) for name in sizes}
    sets = [(), *((name,) for name in sizes), *combinations(sizes, 2)]
    weights = np.array([math.prod(odds[name] for name in each) for each in sets])
    names = [*sizes, CHANCE]
    given, was = np.zeros((200, len(names))), np.zeros((200, len(names)))
    for n in range(len(given)):
        chosen = sets[random.choice(len(sets), p=weights / weights.sum())]
        difference = random.multivariate_normal(np.zeros(2), asked.covariance)
        for name in chosen:
            difference += CAUSES[name].effect(asked, drawn(sizes[name], random))
        after = {
            name: asked.before[name] * math.exp(d) for name, d in zip(asked.names, difference, strict=True)
        }
        hypotheses = [each for each in weigh(replace(asked, after=after)) if each.causes != (SOMETHING_ELSE,)]
        total = sum(each.probability for each in hypotheses)  # something else was never drawn
        parts = participation(tuple(hypotheses))
        given[n] = [parts.get(name, 0.0) / total for name in names]
        was[n] = [name in chosen or (name == CHANCE and not chosen) for name in names]

    spread = np.sqrt((given * (1 - given)).sum(axis=0))
    # 4 standard deviations of chance; half a case more where a cause hardly ever got a probability between none and all.
    assert (np.abs(was.sum(axis=0) - given.sum(axis=0)) <= 4 * spread + 0.5).all()


def drawn(sizes: Sizes, random: np.random.Generator) -> float:
    """Return a size from a cause's prior: a sample of a range stands for all between its neighbours."""
    at = random.choice(len(sizes.values), p=sizes.weights)
    return float(sizes.values[at] + sizes.steps[at] * random.uniform(-0.5, 0.5))
