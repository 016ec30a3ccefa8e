"""Statements on causes agree: an excluded cause has probability zero, and isn't among those to decide between."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.estimators.base import Fit
from servobench.identification.identify import identify
from servobench.identification.reconciliation.base import CAUSES
from servobench.identification.reconciliation.claim import Claim
from servobench.identification.reconciliation.explanation import Explanation
from servobench.identification.reconciliation.judgement import judge
from servobench.identification.reconciliation.probabilities import (
    CHANCE,
    helps_another,
    participation,
    weigh,
    without,
)
from servobench.identification.reconciliation.questions import about_claims, about_sheet
from servobench.identification.reconciliation.reconcile import reconcile
from servobench.identification.reconciliation.reenactment import METHODS
from servobench.identification.why import why
from servobench.report.explanation import ExplanationReport
from tests.datasets import dataset
from tests.identification.reconciliation.motors import BEHIND, SHEET, identified, undeclared
from tests.rig.motor.reference import Truth


def fit_of() -> Fit:
    fit = identified().fit
    assert fit is not None
    return fit


def explanations() -> list[Explanation]:
    """Claims of a gain, a time constant or both, 0.4 to 2.5 times as large and of 2 to 4 digits; and sheets that are off."""
    random = np.random.default_rng(2026)
    found = []
    results = [identified(), identified(chain=BEHIND), identified(Truth(viscous_friction=3e-5))]
    unknown = identify(undeclared(dataset(seed=1, chain=BEHIND)))  # its delay is a figure, and may be a cause
    for n in range(30):
        result = results[n % len(results)]
        assert result.fit is not None
        factors = np.exp(random.uniform(math.log(0.4), math.log(2.5), 2))
        digits = int(random.integers(2, 5))
        both = [
            f"{short}={abs(result.fit[name].value) * factor:.{digits}g}"
            for short, name, factor in zip(("gain", "tau"), ("gain", "time_constant"), factors, strict=True)
        ]
        claims = (both, both[:1], both[1:])[random.integers(3)]
        method = (None, *METHODS)[random.integers(1 + len(METHODS))]
        found.append(why(result, claims, nominal=SHEET if n % 2 else None, method=method))
    found.append(why(unknown, nominal=SHEET))
    found.append(why(results[0], ["tau=99"]))
    for n in range(20):
        off = np.exp(random.uniform(-0.5, 0.5, 3))
        sheet = replace(
            SHEET,
            resistance=SHEET.resistance * off[0],
            motor_constant=SHEET.motor_constant * off[1],
            disc_inertia=SHEET.disc_inertia * off[2],
        )
        found.append(why(results[n % len(results)], nominal=sheet))
    return found


def named_in(text: str) -> str:
    """Return the places in which sentences name causes that are likely, alike, or to be decided about."""
    places = (
        r"most likely cause is ([^.(]*)|most probably ([^.]*)|can't distinguish ([^:]*)|To decide ([^:]*)"
    )
    return " ".join("".join(each) for each in re.findall(places, text))


def test_no_cause_that_is_excluded_has_a_probability_or_is_to_be_decided_about() -> None:
    seen: dict[bool, set[str]] = {True: set(), False: set()}
    for found in explanations():
        if found.agrees:
            continue
        ruled_out = " ".join(each for each in found.sentences if each.startswith("It isn't "))
        others = " ".join(each for each in found.sentences if not each.startswith("It isn't "))
        assert sum(each.probability for each in found.hypotheses) == pytest.approx(1.0)
        named = {name for each in found.hypotheses for name in each.causes} | set(found.alike)
        for cause in found.causes:
            seen[cause.possible].add(cause.name)
            is_told = re.search(rf"\b{cause.label} \(", ruled_out) is not None
            assert is_told == (not cause.possible), (cause.name, found)
            assert (cause.name in named) == cause.possible
            if not cause.possible:
                assert cause.probability == 0.0
                assert cause.against
                asked = re.findall(
                    r"most likely cause is ([^.(]*)|most probably ([^.]*)|can't distinguish ([^:]*)|To decide ([^:]*)",
                    others,
                )
                assert cause.label not in " ".join(" ".join(each) for each in asked)
        page = ExplanationReport([], found).html()
        for cause in (each for each in found.causes if not each.possible):
            row = page[page.index(f">{cause.label}<", page.index("<table")) :].split("</tr>")[0]
            assert re.search(r"<td[^>]*>\s*–\s*</td>", row), row
    # Otherwise the above says nothing of some cause.
    assert seen[True] == set(CAUSES.names())
    assert {"viscous_friction", "delay", "measurement_lag", "method"} <= seen[False]


def test_friction_is_no_cause_of_a_time_constant_alone_that_is_too_large() -> None:
    """K and τ fall together, and there is next to none to be taken away: R b/k² is 0.5 % of what 31 % more would take."""
    found = why(identified(chain=BEHIND), ["tau=0.13"], nominal=SHEET)

    assert not found["viscous_friction"].possible
    assert not found["delay"].possible
    assert "viscous" not in found.sentences[-1]


def test_friction_stays_possible_where_it_helps_the_torque_constant() -> None:
    """With k 10 % smaller and R b/k² 0.05 more, K is κ/(κ² + x) and τ 1/(κ² + x) times as large: 4.7 and 16 % more.

    Alone friction makes both smaller, and alone the smaller k makes K too large for that τ.
    """
    kappa, x = 0.9, 0.05
    asked = about_sheet(fit_of(), replace(SHEET, viscous_friction=0.0))
    after = {
        "gain": asked.before["gain"] * kappa / (kappa**2 + x),
        "time_constant": asked.before["time_constant"] / (kappa**2 + x),
    }
    tight = replace(asked, after={**asked.after, **after}, covariance=np.diag([0.005**2, 0.005**2]))

    found = judge("viscous_friction", tight, weigh(tight))

    assert found.possible
    assert found.needed is None
    assert found.against.startswith("not alone: ")
    assert found.probability == participation(weigh(tight))["viscous_friction"]


def test_what_nothing_is_known_of_helps_nobody() -> None:
    """With a covariance beyond all sizes the evidence of all sets is alike: what is left is what was supposed."""
    vague = replace(about_sheet(fit_of(), SHEET), covariance=1e12 * np.eye(2))
    hypotheses = weigh(vague)

    for name in CAUSES.names():
        if name in participation(hypotheses):
            # (size/sd)² = (4/1e6)² is what sizes of up to ln 60 can change.
            assert helps_another(name, hypotheses) < 2e-11
            assert participation(hypotheses)[name] < CAUSES[name].occurrence * (1 + 1e-9)


def test_leaving_out_a_cause_changes_no_probability_of_the_others() -> None:
    hypotheses = weigh(about_claims(fit_of(), [Claim.parse("tau=0.13")]))
    before = participation(hypotheses)

    left = without(hypotheses, {"viscous_friction", "delay"})

    after = participation(left)
    assert sum(each.probability for each in left) == pytest.approx(1.0)
    assert not {"viscous_friction", "delay"} & set(after)
    assert [after[name] for name in after if name != CHANCE] == pytest.approx(
        [before[name] for name in after if name != CHANCE]
    )


def test_identify_s_findings_name_no_cause_that_is_excluded() -> None:
    for truth in (Truth(resistance=10.4), Truth(motor_constant=0.038), Truth(viscous_friction=3e-5)):
        result = identified(truth)
        assert result.fit is not None
        excluded = [each.label for each in why(result, nominal=SHEET).causes if not each.possible]

        told = named_in(" ".join(each.sentence for each in reconcile(result.fit, SHEET)))

        assert excluded
        assert "likeliest" not in told
        assert "between" in told or "whether" in told
        assert not [label for label in excluded if label in told]


def test_claims_that_lie_within_their_intervals_have_no_likeliest_cause() -> None:
    """Gain and time constant are correlated: 1.9 sd off in each, against the correlation, is improbable together."""
    fit = fit_of()
    names = ("gain", "time_constant")
    at = [fit.model.names.index(name) for name in names]
    correlated = fit.covariance.copy()
    sd = np.array([0.1, 0.1]) * fit.model.theta[at]
    correlated[np.ix_(at, at)] = np.outer(sd, sd) * [[1, 0.9], [0.9, 1]]
    result = replace(identified(), fit=replace(fit, covariance=correlated))
    off = fit.model.theta[at] * np.exp([0.15, -0.15])

    found = why(result, {"gain": float(off[0]), "tau": float(off[1])})

    assert found.agrees
    assert found.decision is None
    assert found.alike == ()
    assert not any("likeliest" in each for each in found.sentences)


def test_an_unknown_brake_is_neither_a_bearing_nor_the_encoders_scale() -> None:
    """An eddy-current brake as strong as the back-emf, b = k²/R = 2.1e-4 N·m·s/rad: gain and time constant are halved."""
    braked = identified(Truth(viscous_friction=0.042**2 / 8.4), kind="prbs")

    found = why(braked, nominal=SHEET)

    assert found.causes[0].name == "brake"
    assert found.causes[0].probability > 0.5
    assert {each.name: each.probability for each in found.causes}["encoder_scale"] < 0.1
