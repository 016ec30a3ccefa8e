"""Score tests for missing terms: against motors that have the term, and motors that haven't."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.finding import Verdict
from servobench.identification.estimators.base import ESTIMATORS
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES, Structure
from servobench.identification.result import Result
from servobench.identification.trust.explanations.base import explain
from servobench.identification.trust.missing_terms import TERMS, missing_terms, score_terms
from servobench.identification.uncertainty import score_test
from servobench.identification.uncertainty.score_test import TermScore
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import QUANTUM, dataset
from tests.truth.test_intervals import answers

H, STEPS = 0.002, 200


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _odd_motor(u, stribeck, drag, lopsided, warming, ageing, ripple, cycles, gap, out):  # type: ignore[no-untyped-def]
    """A first-order motor of 23.8 rad/(s·V) and 0.1 s with what the model doesn't know, in steps of 10 µs."""
    gain, tau, coulomb = 23.8, 0.1, 0.16
    dt = H / STEPS
    w = theta = load = 0.0
    for n in range(len(u)):
        load = min(max(load, theta - 0.5 * gap), theta + 0.5 * gap)
        out[n] = load
        gone = n / len(u)
        for _ in range(STEPS):
            lost = coulomb * (1.0 + stribeck * np.exp(-((w / 6.0) ** 2))) * (1.0 + ageing * gone)
            push = u[n] * (1.0 + lopsided * np.sign(w)) - drag * w * abs(w) + ripple * np.sin(cycles * theta)
            rate = (
                dt / tau / (1.0 + warming * gone)
            )  # more resistance: less torque from the input, and less braking
            free = w + rate * (gain * push - w)
            stop = rate * gain * lost
            new = free - min(stop, max(-stop, free))
            theta += 0.5 * dt * (w + new)
            w = new


def odd(seed: int, kind: Literal["square", "prbs"] = "prbs", **what: float) -> Dataset:
    data = dataset(seed=seed, kind=kind, y=np.zeros(5000))
    angle: NDArray[np.float64] = np.empty(5000)
    names = ("stribeck", "drag", "lopsided", "warming", "ageing", "ripple", "cycles", "gap")
    assert set(what) <= set(names)
    _odd_motor(data.u, *(what.get(name, 0.0) for name in names), angle)
    return replace(data, y=(np.floor((angle + 1e-3) / QUANTUM) + 0.5) * QUANTUM)


def doubts(result: Result) -> set[str]:
    return {finding.code for finding in result.findings} & {term.code for term in TERMS}


@pytest.mark.parametrize("seed", range(5))
def test_a_motor_that_is_as_the_model_says_is_trusted(seed: int) -> None:
    result = identify(odd(seed))
    assert doubts(result) == set()
    assert result.verdict == Verdict.TRUSTED


@pytest.mark.parametrize(
    ("code", "what"),
    [
        ("friction-depends-on-speed", {"stribeck": 0.3}),
        ("drag-not-linear", {"drag": 2e-5}),  # 0.09 V of 3 V at full speed
        ("directions-differ", {"lopsided": 0.02}),
        ("motor-changes", {"warming": 0.02}),
        ("friction-changes", {"ageing": 0.1}),
        ("ripple", {"ripple": 0.02, "cycles": 6.0}),
        ("backlash", {"gap": 2 * QUANTUM}),
    ],
)
def test_what_the_model_lacks_is_named(code: str, what: dict[str, float]) -> None:
    result = identify(odd(1, **what), structure="first_order_coulomb")
    assert code in doubts(result)
    assert result.verdict == Verdict.TRUSTED  # its size is in the intervals
    assert result.fit is not None
    for name, true in (("gain", 23.8), ("time_constant", 0.1)):
        low, high = result.fit[name].interval
        assert low < true < high, (name, low, high)


def test_a_motor_that_turned_one_way_only_shows_nothing_of_another_direction() -> None:
    """Its model, which doesn't stick, turns back under too small an input; a lag that it lacks then looked like unequal drag."""
    u = np.array([0.2, 3.0, 0.1, 2.0, 0.0, 2.5])[np.arange(3000) // 125 % 6]
    b, decay = np.zeros(len(u)), np.exp(-H / 0.02)
    drive = 23.8 * np.maximum(u - 0.5, 0.0)
    for k in range(1, len(u)):
        b[k] = drive[k - 1] + np.exp(-H / 0.1) * (b[k - 1] - drive[k - 1])
    for k in range(1, len(u)):
        b[k] = b[k] + decay * (b[k - 1] - b[k])
    data = replace(dataset(seed=1, samples=len(u), u=u, y=b), kind="speed", output_unit="rad/s", quantum=None)
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [data])

    asked = {each.term.code for each in score_terms(fit)}
    assert "friction-depends-on-speed" in asked
    assert not asked & {"directions-differ", "drag-differs", "backlash"}


def test_a_ripple_shows_in_a_motor_that_turns_one_way_only() -> None:
    assert "ripple" in doubts(identify(odd(1, "square", ripple=0.02, cycles=3.0)))


def test_the_ripple_that_is_there_is_the_one_that_is_reported() -> None:
    (finding,) = (f for f in identify(odd(1, ripple=0.02, cycles=6.0)).findings if f.code == "ripple")
    assert "6× per revolution" in finding.sentence


@pytest.mark.parametrize("kind", ["square", "prbs"])
@pytest.mark.parametrize("noise", [0.0, 1e-6, 1e-5])
def test_neither_an_encoder_nor_a_random_torque_is_taken_for_a_missing_term(kind: str, noise: float) -> None:
    for seed in range(5):
        result = identify(dataset(seed=seed, kind=kind, torque_noise=noise))  # type: ignore[arg-type]
        assert doubts(result) == set()
        assert "residual-follows-input" not in {finding.code for finding in result.findings}


def test_a_second_pole_of_a_tenth_of_the_time_constant_is_within_the_intervals() -> None:
    """Prediction error would take it for a disturbance: the time constant 8 % wrong, and no colour left."""
    from tests.rig.motor.reference import Truth

    result = identify(dataset(seed=1, truth=Truth(inductance=84e-3)))
    assert "residual-follows-input" in {finding.code for finding in result.findings}
    assert result.fit is not None
    low, high = result.fit["time_constant"].interval
    assert low < answers(Truth(inductance=84e-3))["time_constant"] < high


def test_a_size_beyond_the_input_is_not_reported() -> None:
    """A ripple of 250 V in a motor that got 3 V: something else moves it, and the number would be believed."""
    fit = identify(odd(1, ripple=0.02, cycles=6.0)).fit
    assert fit is not None
    (term,) = (term for term in TERMS if term.code == "ripple" and "repeats 6× per" in term.sentence)
    told = []
    for size in (0.02, 250.0):
        shown = TermScore(
            term=term,
            size=9.0,
            fit=fit,
            largest=3.0,
            amount=np.array([size, 0.0]),
            covariance=np.eye(2) * 1e-6,
        )
        told.append(missing_terms([shown])[0].sentence)
    assert "0.02 ± 0.002 V in either direction" in told[0]
    assert "in either direction" not in told[1]
    assert "6× per revolution" in told[1]


@pytest.mark.parametrize("kind", ["square", "prbs"])
@pytest.mark.parametrize("drag", [1e-4, 2e-4])
def test_drag_too_large_for_a_score_test_is_reported_with_its_size(
    kind: Literal["square", "prbs"], drag: float
) -> None:
    """A tenth of the input and more: the fit bends to it, and its residuals are too coloured to ask for a term.

    The size is at the 99th percentile of the speed, up to 6 % below the fastest, which is 12 % of its square.
    """
    record = odd(1, kind, drag=drag)
    fastest = float(np.abs(np.diff(record.y[::25])).max()) / (25 * H)

    [found] = explain([record])

    assert found.code == "drag-not-linear"
    told = float(found.sentence.split("takes about ")[1].split(" V")[0])
    assert told == pytest.approx(drag * fastest**2, rel=0.12)
    assert [f.code for f in identify(record).findings].count("drag-not-linear") == 1


@pytest.mark.parametrize("percent", [0.9, 1.1])
def test_a_difference_of_the_directions_is_reported_and_no_doubt(percent: float) -> None:
    """The gain is K ± 1 %, and K (1 ± a/u) in the two directions, with a of u = 3 V known to a hundredth of it."""
    fit = identify(odd(1)).fit
    assert fit is not None
    at = fit.model.names.index("gain")
    covariance = fit.covariance.copy()
    covariance[at, at] = (0.01 * fit["gain"].value / 1.959964) ** 2
    (term,) = (term for term in TERMS if term.code == "directions-differ")
    amount = 3.0 * percent / 100
    shown = TermScore(
        term=term,
        size=9.0,
        fit=replace(fit, covariance=covariance, intervals={}),
        largest=3.0,
        amount=np.array([amount]),
        covariance=np.array([[(0.01 * amount / 1.959964) ** 2]]),
    )
    (told,) = missing_terms([shown])
    assert told.severity == "info"
    assert "The intervals allow for that." in told.sentence


def test_a_term_that_leads_beyond_what_any_motor_does_is_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its response is infinite; a product with it is no number, and NumPy would warn of it, which is an error here."""
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [odd(1, drag=2e-5)])
    assert any(shown.size > 0.0 for shown in score_terms(fit) if shown.term.to_input is not None)
    original = score_test.simulate_output

    def simulate(structure: Structure, theta: Array, data: Dataset, u: Array | None = None) -> Array:
        found = original(structure, theta, data, u)
        return found if u is None else np.full_like(found, np.inf)

    monkeypatch.setattr(score_test, "simulate_output", simulate)

    driven = [shown for shown in score_terms(fit) if shown.term.to_input is not None]
    assert len(driven) > 0
    assert all(shown.size == 0.0 for shown in driven)
