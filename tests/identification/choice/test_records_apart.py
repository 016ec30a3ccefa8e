"""Records of a joint fit that agree, or don't, on its parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from servobench.core.finding import Finding, Severity, Verdict
from servobench.identification.choice.noise_choice import allow_for_disturbance
from servobench.identification.choice.records_apart import _open_parameters, _under_the_same_noise
from servobench.identification.estimators.base import ESTIMATORS
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.identification.result import Result
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import QUANTUM, dataset
from tests.identification.choice.test_structure_choice import breakaway
from tests.rig.motor.reference import Truth, march

TRUTH = Truth()
FRICTION = TRUTH.coulomb_torque * TRUTH.resistance / TRUTH.motor_constant  # V


def runs(*frictions: float) -> list[Dataset]:
    """Runs of the reference motor behind an ideal encoder, under as many random inputs, with so many times its friction."""
    random = np.random.default_rng(3)
    found = []
    for n, times in enumerate(frictions):
        u = np.repeat(random.choice([-3.0, -1.0, 1.0, 3.0], 20), 100)
        angle = march(TRUTH._replace(coulomb_torque=times * TRUTH.coulomb_torque), u, 0.002)[:, 2]
        y = (np.floor(angle / QUANTUM) + 0.5) * QUANTUM
        plain = dataset(seed=0, samples=len(u), y=y)
        found.append(replace(plain, u=u, input_before=0.0, name=f"run {n}"))
    return found


def apart(result: Result) -> list[Finding]:
    return [finding for finding in result.findings if finding.code == "records-apart"]


def test_two_records_are_held_against_each_other() -> None:
    result = identify(runs(1.0, 3.0), "first_order_coulomb")

    (finding,) = apart(result)
    assert finding.severity is Severity.INFO  # its size is in the interval
    assert "coulomb_voltage" in finding.parameters
    assert result.fit is not None
    friction = result.fit["coulomb_voltage"]
    # Each run alone knows its own friction to some 10 µV: the interval holds both.
    assert friction.interval[0] < FRICTION + 2e-5
    assert friction.interval[1] > 3 * FRICTION - 2e-5
    # The jackknife of two values is half of their difference.
    assert friction.sd >= FRICTION * (1 - 1e-3)
    assert "in run 0" in finding.sentence
    assert "in run 1" in finding.sentence


def of_two_inertias(*levels: list[float], torque_noise: float = 0.0) -> list[Dataset]:
    """Runs of the reference motor and of one of twice its inertia, each under a random input of its own levels [V].

    The second is under a random torque as well [N·m·√s].
    """
    records = []
    for n, (times, own) in enumerate(zip((1.0, 2.0), levels, strict=True)):
        u = np.repeat(np.random.default_rng(n).choice(own, 20), 100)
        torque = {"torque_noise": torque_noise, "step": 5e-5, "seed": n} if n and torque_noise else {}
        angle = march(TRUTH._replace(inertia=times * TRUTH.inertia), u, 0.002, **torque)[:, 2]
        plain = dataset(seed=0, samples=len(u), y=(np.floor(angle / QUANTUM) + 0.5) * QUANTUM)
        records.append(replace(plain, u=u, input_before=0.0, name=f"run {n}"))
    return records


def test_a_record_of_another_motor_is_noticed_beside_one_that_turns_one_way_only() -> None:
    """That one can't tell friction and offset apart, but its time constant."""
    result = identify(of_two_inertias([1.0, 2.0, 3.0], [-3.0, -1.0, 1.0, 3.0]), "first_order_coulomb")

    (finding,) = apart(result)
    assert "time_constant" in finding.parameters
    assert not {"coulomb_voltage", "offset_voltage"} & set(finding.parameters)
    assert result.verdict is Verdict.DOUBTFUL


@pytest.mark.parametrize("torque_noise", [1e-5, 1e-4])
def test_a_record_of_another_motor_is_noticed_where_one_of_the_two_has_a_random_torque(
    torque_noise: float,
) -> None:
    both_ways = [-3.0, -1.0, 1.0, 3.0]
    result = identify(of_two_inertias(both_ways, both_ways, torque_noise=torque_noise), "first_order_coulomb")

    (finding,) = apart(result)
    assert "time_constant" in finding.parameters
    assert result.verdict is Verdict.DOUBTFUL


def test_time_constants_that_differ_by_half_are_a_doubt() -> None:
    """Of two inertias: the interval holds both, but no motor has both."""
    records = of_two_inertias([-3.0, -1.0, 1.0, 3.0], [-3.0, -1.0, 1.0, 3.0])

    (finding,) = apart(identify(records, "first_order_coulomb"))

    assert "time_constant" in finding.parameters
    assert finding.severity is Severity.WARNING


def test_records_that_differ_show_it_beside_a_random_torque_that_takes_it_up() -> None:
    """A motor that answers small inputs by a fifth more than large ones: innovations are white, and the joint gain is one's."""
    random = np.random.default_rng(3)
    records = []
    for n, (gain, level) in enumerate(((1.2, 0.9), (1.0, 3.0))):
        u = level * np.repeat(random.choice([-1.0, 1.0], 20), 100)
        angle = march(TRUTH, gain * u, 0.002, torque_noise=1e-4, step=5e-5, seed=n)[:, 2]
        data = dataset(seed=0, samples=len(u), y=(np.floor(angle / QUANTUM) + 0.5) * QUANTUM)
        records.append(replace(data, u=u, input_before=0.0, name=f"run {n}"))
    result = identify(records)

    (finding,) = apart(result)
    assert finding.severity is Severity.INFO
    assert result.fit is not None
    assert result.fit.disturbance is not None
    low, high = result.fit["gain"].interval
    assert low < 23.7 < 1.2 * 23.7 < high  # rad/(s·V): the reference motor's, and a fifth more


@pytest.mark.parametrize("friction", [0.0, 1.0, 3.0])
def test_records_of_one_motor_agree(friction: float) -> None:
    assert not apart(identify(runs(friction, friction, friction, friction)))


def test_one_record_has_nothing_to_disagree_with() -> None:
    assert not apart(identify(runs(1.0), "first_order"))


def switched(offset: float, name: str) -> Dataset:
    """A speed behind a flag that is 0 and 1 by turns: what a motor of 2.5 rad/s per unit does at its working point `offset`."""
    u = np.repeat([0.0, 1.0] * 6, 200)
    keep = np.exp(-0.002 / 0.08)
    speed = 2.5 * (offset + lfilter([1 - keep], [1, -keep], u))
    y = speed + 0.05 * np.random.default_rng(5).standard_normal(len(u))
    data = dataset(seed=0, samples=len(u), u=u, y=y)
    return replace(data, name=name, kind="speed", output_unit="rad/s", input_unit="1", quantum=None)


def test_records_with_different_zeros_of_the_input_are_no_wrong_structure() -> None:
    low, high = switched(2.5, "low"), switched(4.1, "high")

    result = identify([low, high])

    (finding,) = (each for each in result.findings if each.code == "records-disagree")
    assert "one by one" in finding.sentence
    assert result.verdict != Verdict.TRUSTED
    assert "structure-wrong" not in {each.code for each in result.findings}
    for alone in (low, high):
        fit = identify(alone).fit
        assert fit is not None
        assert abs(fit["gain"].value - 2.5) < 3 * fit["gain"].sd


@pytest.mark.parametrize(("sags_to", "tells_gain"), [(0.95, False), (0.6, True)])
def test_a_level_that_sags_doesnt_tell_the_gain_of_a_motor_that_turned_one_way(
    sags_to: float, tells_gain: bool
) -> None:
    """After a rest: that isn't driving, and doesn't count."""
    both_ways, _ = runs(1.0, 1.0)
    step = np.concatenate([np.zeros(200), 3.0 * np.linspace(1.0, sags_to, 800)])
    one_way = replace(dataset(seed=2, samples=1000, u=step), name="one way")
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [both_ways, one_way])

    undetermined = _open_parameters(fit, [one_way])
    assert {"coulomb_voltage", "offset_voltage"} <= undetermined
    assert ("gain" not in undetermined) is tells_gain


@pytest.mark.parametrize("structure", ["auto", "first_order", "first_order_coulomb"])
def test_a_record_that_only_coasts_is_held_against_another_one(structure: str) -> None:
    """It has no input that could tell the gain, and tells how fast the speed falls."""
    both_ways, _ = runs(1.0, 1.0)
    slower = TRUTH._replace(inertia=1.5 * TRUTH.inertia, coulomb_torque=0.0)
    angle = march(slower, np.repeat([3.0, 0.0], 1000), 0.002)[:, 2]
    plain = dataset(seed=0, samples=2000, y=(np.floor(angle / QUANTUM) + 0.5) * QUANTUM)
    coast = replace(plain, u=np.repeat([3.0, 0.0], 1000), name="coast").part(2.0, 4.0)
    assert not coast.u.any()

    result = identify([both_ways, coast], structure)

    assert result.fit is not None
    assert all("gain" not in finding.parameters for finding in apart(result))


def test_a_selection_without_a_torque_is_fitted_as_the_whole_that_has_one() -> None:
    clean, _ = runs(1.0, 1.0)
    turned = dataset(seed=3, kind="prbs", torque_noise=1e-4)
    method, structure = ESTIMATORS["output_error"], STRUCTURES["first_order_coulomb"]
    whole = allow_for_disturbance(method.fit(structure, [turned]))
    other = method.fit(structure, [clean])
    assert whole.estimator == "prediction_error"
    assert allow_for_disturbance(other).estimator != whole.estimator

    assert _under_the_same_noise(whole, other, allow_for_disturbance).estimator == whole.estimator


@pytest.mark.parametrize("static", [0.5, 0.7, 0.9])
def test_a_ramp_isnt_held_to_the_time_constant_of_a_step(static: float) -> None:
    """A shaft that breaks away late looks slow, and the step, backward, shows that it isn't."""
    records = []
    for sense, u in ((1.0, 0.005 * np.arange(802)), (-1.0, np.full(302, 7.0))):
        u[:2] = 0.0
        plain = dataset(seed=1, samples=len(u), sample_time=0.02, u=sense * u, y=sense * breakaway(u, static))
        records.append(replace(plain, quantum=np.pi / 360, name=f"{sense:g}"))
    result = identify(records)

    assert result.verdict is Verdict.TRUSTED
    assert not apart(result)
    assert result["gain"].interval[0] < 2.74 < result["gain"].interval[1]
