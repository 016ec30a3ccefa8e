"""Causes of a bad fit are told only where they are there: behind a measurement chain, and in records longer than the grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from servobench.core.finding import Severity
from servobench.identification.models.motion import turns_between_rows
from servobench.identification.trust.explanations import clocks
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case, Causes, explain
from servobench.identification.trust.explanations.equation import motion
from servobench.identification.trust.explanations.gain_falls import _is_faster_beyond
from servobench.identification.trust.explanations.hysteresis import play
from servobench.identification.trust.explanations.resonance import _comes_round
from servobench.recordings.measurement.dataset import Dataset
from tests.contracts.finding_examples.base import sound, staircase, told
from tests.datasets import QUANTUM, dataset


@pytest.mark.parametrize(
    "chain",
    ["tachometer 10 ms", "tachometer 50 ms", "derivative | average 50 ms", "derivative | lowpass 30 rad/s"],
)
def test_a_sound_record_behind_its_chain_is_explained_by_nothing(chain: str) -> None:
    """The twin motor is of first order: no second pole, no other motor's column."""
    record = dataset(seed=3, kind="prbs", hold=20, samples=5100, chain=chain)

    assert [finding.code for finding in explain([record])] == []


def test_another_motors_input_is_reported_behind_a_chain_too() -> None:
    record = dataset(seed=3, kind="prbs", hold=20, chain="tachometer 20 ms")
    other = dataset(seed=4, kind="prbs", hold=20, chain="tachometer 20 ms")

    assert [finding.code for finding in explain([replace(record, u=other.u)])] == ["input-unrelated"]


def test_an_input_whose_simulation_explains_the_output_is_not_unrelated() -> None:
    """The equation is only a hint; a simulation that explains most of the output outweighs it."""
    record = dataset(seed=3, kind="prbs", hold=20)
    other = dataset(seed=4, kind="prbs", hold=20)

    assert explain([replace(record, u=other.u)], 91.0) == []
    causes = Causes((replace(record, u=other.u),))
    assert causes.are_damage()
    assert not causes.are_damage(91.0)


@pytest.mark.parametrize(("of_gain", "severity"), [(0.8, Severity.WARNING), (1.2, Severity.INFO)])
def test_a_gain_that_falls_by_less_than_its_interval_is_a_remark(of_gain: float, severity: Severity) -> None:
    """The amplifier puts out half of the largest input: small ones have twice the gain, which one known to 120 % allows for."""
    clipped = told(staircase(), np.clip(staircase(), -1.5, 1.5))
    (cause,) = Causes((clipped,)).explain(80.0, of_gain)

    assert cause.code == "gain-falls"
    assert cause.severity is severity


@pytest.mark.parametrize(("of_gain", "severity"), [(0.05, Severity.WARNING), (0.2, Severity.INFO)])
def test_a_limit_near_the_largest_input_is_held_against_the_gain_below_it(
    of_gain: float, severity: Severity
) -> None:
    """A tenth of the largest input has no effect: the gain is 11 % more below that, and hardly used beyond."""
    clipped = told(staircase(), np.clip(staircase(), -2.7, 2.7))
    (cause,) = Causes((clipped,)).explain(80.0, of_gain)

    assert cause.code == "gain-falls"
    assert cause.severity is severity


@pytest.mark.parametrize(
    ("label", "really", "advice"),
    [
        (3.0, 2.2, "or leave it out."),
        (4.0, 3.0, "characteristic bends there"),
        (3.0, -1.0, ""),
        (3.0, -3.5, "or leave it out."),
        (3.0, -3.7, ""),
    ],
    ids=["in the middle", "the largest", "the other way", "a wrong sign", "a wrong sign and another size"],
)
def test_a_level_that_acts_like_another_one_may_have_a_wrong_label(
    label: float, really: float, advice: str
) -> None:
    """Eight levels; none acts against its own sign, unless only that is wrong."""
    levels = np.repeat([-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0], 4)
    u = np.repeat(np.random.default_rng(1).permutation(levels), 100)

    found = [
        cause
        for cause in explain([told(u, np.where(u == label, really, u))])
        if cause.code == "level-disagrees"
    ]

    assert [advice in cause.sentence for cause in found] == [True] * bool(advice)


@pytest.mark.parametrize("ratio", [0.9, 0.96, 1.2])
def test_of_two_halves_of_an_amplifier_the_ratio_is_given_and_no_level_is_blamed(ratio: float) -> None:
    """Eight levels, of which the negative ones act by another part than the positive ones: the smaller part is named."""
    levels = np.repeat([-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0], 4)
    u = np.repeat(np.random.default_rng(1).permutation(levels), 100)

    record = told(u, np.where(u < 0.0, ratio * u, u))

    [found] = explain([record])
    [mirrored] = explain([replace(record, y=-record.y)])

    assert found.code == "directions-differ"
    assert mirrored.sentence == found.sentence  # whichever way the shaft turns under a positive input
    percent = 100.0 * (1.0 - min(ratio, 1.0 / ratio))
    size = float(found.sentence.split("gain is ")[1].split(" %")[0])
    assert size == pytest.approx(percent, abs=0.2 * percent)
    assert ("smaller for negative inputs" in found.sentence) == (ratio < 1.0)


@pytest.mark.parametrize(("damping", "code"), [(0.2, "response-oscillates"), (0.7, "second-pole")])
def test_a_pair_of_poles_oscillates_only_where_it_is_hardly_damped(damping: float, code: str) -> None:
    """Steps of a shaft on poles of 4 Hz: beyond half of critical damping nobody sees it swing."""
    u = np.repeat(np.random.default_rng(2).uniform(-3.0, 3.0, 12), 250)
    step, rate, speed, own = 0.002, 0.0, np.zeros(3000), 2 * np.pi * 4.0
    for n in range(1, 3000):
        rate += step * (own**2 * (20.0 * u[n - 1] - speed[n - 1]) - 2.0 * damping * own * rate)
        speed[n] = speed[n - 1] + step * rate
    record = replace(
        dataset(seed=1, samples=3000, u=u), y=speed, kind="speed", output_unit="rad/s", quantum=None
    )

    (found,) = explain([record])
    assert found.code == code
    # Nothing swings in a filter; and one that is known is part of the model.
    assert ("a filter of the sensor" in found.sentence) == (code == "second-pole")
    (chained,) = explain([replace(record, chain_known=True)])
    assert "a filter of the sensor" not in chained.sentence


def test_nothing_swings_faster_than_the_rows_can_show() -> None:
    """4 Hz in rows a tenth of a second apart: poles of 9 Hz make the equation hold, which no rows of 0.1 s show."""
    u = np.repeat(np.random.default_rng(2).uniform(-3.0, 3.0, 60), 250)
    step, rate, speed, own = 0.002, 0.0, np.zeros(len(u)), 2 * np.pi * 4.0
    for n in range(1, len(u)):
        rate += step * (own**2 * (20.0 * u[n - 1] - speed[n - 1]) - 2.0 * 0.2 * own * rate)
        speed[n] = speed[n - 1] + step * rate
    rows = slice(None, None, 50)
    record = dataset(seed=1, samples=len(u[rows]), sample_time=0.1, u=u[rows], y=speed[rows])

    swinging = explain([replace(record, kind="speed", output_unit="rad/s", quantum=None)])

    assert "response-oscillates" not in [finding.code for finding in swinging]


def test_a_record_so_long_that_the_grid_misses_its_input_is_explained_by_nothing() -> None:
    """Levels of 40 ms over 1500 s, on a grid of 6000 points 250 ms apart: what acts between them isn't seen."""
    levels = np.random.default_rng(0).uniform(-3, 3, 37_500)
    record = _ideal(np.repeat(levels, 10), 0.004)

    assert explain([record]) == []


@pytest.mark.parametrize("frequency", [3.0, 12.0, 30.0])
@pytest.mark.parametrize("which", [0, 2], ids=["at the motor", "at the load"])
def test_two_masses_that_swing_are_reported_as_a_resonance(frequency: float, which: int) -> None:
    """Two halves of the motor's inertia with a spring between: the poles' frequency is known, to 5 % with the damping's."""
    record = two_masses(frequency, which)

    [found] = explain([record])

    assert found.code == "response-oscillates"
    told = float(found.sentence.split("oscillates at about ")[1].split(" Hz")[0])
    assert told == pytest.approx(_pole(frequency), rel=0.05)


def test_a_swing_as_fast_as_the_shaft_turns_may_come_round_with_it() -> None:
    """The shaft makes 4.9 turns a second."""
    record = two_masses(6.0, 0)

    [found] = explain([record])
    [other] = explain([replace(record, kind="position", output_unit="m")])

    assert found.code == other.code == "response-oscillates"
    assert "makes 4.9 turns a second" in found.sentence
    assert "oscillates at about" in other.sentence


def test_what_swings_exactly_once_a_turn_at_a_steady_speed_is_ripple() -> None:
    """Of an eccentric encoder; a shaft whose speed changes all the time swings as often as it turns by chance."""
    t = 0.01 * np.arange(200)
    speed = 2 * np.pi * 5.0 * (1 + 0.03 * np.sin(2 * np.pi * 5.0 * t))
    like = dataset(seed=1, samples=len(t), sample_time=0.01, u=np.full(len(t), 3.0), y=speed)
    steady = replace(like, kind="speed", output_unit="rad/s", quantum=None)

    comes_round = [
        _comes_round(found, frequency)
        for record, frequency in ((steady, 5.0), (steady, 5.6), (replace(steady, output_unit="m/s"), 5.0))
        if (found := motion(record)) is not None
    ]

    assert comes_round == [True, False, False]
    assert [each.code for each in explain([two_masses(5.25, 0)])] == ["response-oscillates"]


def _masses(frequency: float) -> np.ndarray:
    """The matrix of (θ₁, ω₁, θ₂, ω₂): τ 0.1 s, two halves of one inertia, the resonance lightly damped (2 % of critical)."""
    resonance = 2 * np.pi * frequency
    spring, damper = 0.5 * resonance**2, 2 * 0.02 * resonance * 0.5
    return np.array(
        [
            [0, 1, 0, 0],
            [-spring, -2 / 0.1 - damper, spring, damper],
            [0, 0, 0, 1],
            [spring, damper, -spring, -damper],
        ]
    )


def _pole(frequency: float) -> float:
    """The frequency [Hz] of the pair of poles that is damped least, of the matrix itself."""
    poles = np.linalg.eigvals(_masses(frequency))
    pairs = poles[poles.imag > 0]
    return float(np.abs(pairs[np.argmax(pairs.real)])) / (2 * np.pi)


def two_masses(frequency: float, which: int) -> Dataset:
    from scipy.signal import cont2discrete

    step, random = 0.002, np.random.default_rng(1)
    u = np.repeat(random.choice([-3.0, 3.0], 100), 50)
    drive = np.array([[0.0], [2 * 237.0], [0.0], [0.0]])
    a, b, *_ = cont2discrete((_masses(frequency), drive, np.eye(4), np.zeros((4, 1))), step)
    x, y = np.zeros(4), np.empty(len(u))
    for k, level in enumerate(u.tolist()):
        y[k] = x[which]
        x = a @ x + b[:, 0] * level
    t = np.arange(len(u)) * step
    like = dataset(seed=0, samples=2, y=np.zeros(2))
    return replace(like, t_input=t, u=u, t_output=t, y=np.round(y / QUANTUM) * QUANTUM)


def _ideal(u: np.ndarray, step: float) -> Dataset:
    """A motor without friction, K 23.7 rad/(s V), τ 0.1 s, exact at the samples: θ = K ∫u - τ ω."""
    from scipy.signal import lfilter

    decay = np.exp(-step / 0.1)
    speed = lfilter([0.0, 23.7 * (1 - decay)], [1.0, -decay], u)
    angle = 23.7 * step * np.concatenate([[0.0], np.cumsum(u[:-1])]) - 0.1 * speed
    like = dataset(seed=0, samples=2, y=np.zeros(2))
    t = np.arange(len(u)) * step
    return replace(like, t_input=t, u=u, t_output=t, y=np.round(angle, 6), quantum=None)


@pytest.mark.parametrize("seed", range(4))
def test_one_level_says_nothing_of_how_drag_grows(seed: int) -> None:
    """Five seconds at 2 V from the first row on, under a random torque: the equation held better with drag."""
    data = dataset(seed=seed, samples=2500, u=np.full(2500, 2.0), torque_noise=2e-4)
    moved = motion(data)
    assert moved is not None

    assert EXPLANATIONS["drag"](Case((moved,))) is None


@pytest.mark.parametrize("cause", ["gain_falls", "hysteresis"])
def test_one_level_of_a_measured_input_shows_neither_a_limit_nor_a_play(cause: str) -> None:
    """Clipped below its level, or held behind a play, it is that level without its noise, and the equation holds better."""
    driven = _ideal(np.concatenate([np.zeros(5), np.full(2500, 2.0)]), 0.002)
    noise = 0.02 * np.random.default_rng(1).standard_normal(len(driven.u))
    moved = motion(replace(driven, u=np.where(driven.u > 0, driven.u + noise, 0.0)))
    assert moved is not None

    assert EXPLANATIONS[cause](Case((moved,))) is None


@pytest.mark.parametrize(
    ("cause", "change"),
    [("gain_falls", lambda u: np.clip(u, -2.0, 2.0)), ("hysteresis", lambda u: play(u, 0.3))],
)
def test_an_input_of_many_levels_shows_a_limit_and_a_play(
    cause: str, change: Callable[..., np.ndarray]
) -> None:
    """A triangle of 3 V that goes to and fro five times."""
    u = 3.0 * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * np.arange(5000) / 1000))
    moved = motion(replace(_ideal(change(u), 0.002), u=u))
    assert moved is not None
    case = Case((moved,))

    found = EXPLANATIONS[cause](case)

    assert found is not None
    assert found.misfit < 0.1 * case.plain.misfit


@pytest.mark.parametrize("slope", [0.0, 0.3, 0.6])
def test_how_much_an_input_beyond_a_limit_still_does_is_stated(slope: float) -> None:
    """A triangle of 3 V of which what is beyond 1.5 V acts by a part."""
    u = 3.0 * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * np.arange(5000) / 1000))
    acting = slope * u + (1 - slope) * np.clip(u, -1.5, 1.5)

    found = explain([replace(_ideal(acting, 0.002), u=u)])

    assert [finding.code for finding in found] == ["gain-falls"]
    assert ("no further effect" in found[0].sentence) == (slope == 0)
    # The limits that are tried lie a tenth of the largest input apart, and this is one of them.
    assert (f"act only {100 * slope:.0f} % as much" in found[0].sentence) == (slope > 0)


def test_a_limit_that_no_input_came_near_is_not_said_to_have_been_seen() -> None:
    """±4 and ±12 V, of which 6 V reach the motor."""
    u = np.repeat(np.random.default_rng(5).choice([-12.0, -4.0, 4.0, 12.0], 30), 100)

    (cause,) = explain([replace(_ideal(np.clip(u, -6.0, 6.0), 0.002), u=u)])

    assert cause.code == "gain-falls"
    assert "Inputs of 12 V act like about 6 V:" in cause.sentence


def test_a_limit_in_a_record_of_eighty_samples_is_explained() -> None:
    """A loop on a small board logs every 35 ms: ±10 V in steps, of which 3 V reach a motor of 0.1 s."""
    u = np.repeat(np.random.default_rng(5).choice([-10.0, -6.0, -2.0, 2.0, 6.0, 10.0], 16), 5)

    assert [finding.code for finding in explain([replace(_ideal(np.clip(u, -3.0, 3.0), 0.035), u=u)])] == [
        "gain-falls"
    ]


def test_a_limit_in_a_speed_that_was_cut_into_files_is_explained_as_in_one() -> None:
    """Each record's speed counted from its own first value, so that no equation held for several of them."""
    u = np.repeat(np.random.default_rng(5).choice([1.0, 4.0, 7.0, 10.0], 40), 50)
    whole = _ideal(np.clip(u, -5.0, 5.0), 0.01)
    data = replace(whole, u=u, y=np.gradient(whole.y, 0.01), kind="speed", output_unit="rad/s")
    slow, fast = (np.flatnonzero(u[49::50] == level) * 50 + 45 for level in (1.0, 10.0))
    begins = np.sort([slow[0], fast[len(fast) // 2]])
    parts = [
        replace(
            data,
            t_input=data.t_input[a:b],
            u=u[a:b],
            t_output=data.t_output[a:b],
            y=data.y[a:b],
            input_before=u[a],
        )
        for a, b in pairwise([*begins.tolist(), len(u)])
    ]

    assert np.ptp([part.y[0] for part in parts]) > 50.0
    assert [finding.code for finding in explain([data])] == ["gain-falls"]
    assert [finding.code for finding in explain(parts)] == ["gain-falls"]


@pytest.mark.parametrize(("rate", "named"), [(0.005, False), (0.02, True)])
def test_two_clocks_drift_apart_by_a_sample_at_least(rate: float, named: bool) -> None:
    """In rows of 20 ms: by 10 ms in 2 s, which any one row may be out by, or by 60 ms in 3 s."""
    fine = dataset(seed=1, kind="prbs", samples=4000, sample_time=0.001, hold=100)
    t = 0.02 * np.arange(150 if named else 100)
    y = np.interp(t * (1.0 + rate), fine.t_output, fine.y)
    record = replace(fine, t_input=t, u=fine.u[::20][: len(t)], t_output=t, y=y)
    case = Case(tuple(each for each in [motion(record)] if each is not None))

    assert (EXPLANATIONS["clock_drift"](case) is not None) is named


def test_records_with_larger_inputs_that_act_less_may_be_of_a_characteristic_that_bends() -> None:
    """Of 1 to 3 V acted 70 %, of 0.3 to 1 V all; and with the smaller inputs acting less, it's no such bend."""
    small, large = (level * sound(samples=2000).u for level in (1 / 3, 1.0))
    bent = [replace(told(small, small), name="small"), replace(told(large, 0.7 * large), name="large")]
    other = [replace(told(small, 0.7 * small), name="small"), replace(told(large, large), name="large")]

    [cause], [odd] = explain(bent), explain(other)

    assert cause.code == odd.code == "records-disagree"
    assert "the characteristic may bend" in cause.sentence
    assert "may bend" not in odd.sentence
    [turned] = explain([bent[0], replace(told(large, -1.1 * large), name="large")])
    assert "may bend" not in turned.sentence


@pytest.mark.parametrize(("limit", "largest", "is_limited"), [(1.5, 3.0, True), (2.0, 3.0, False)])
def test_inputs_that_turn_the_shaft_faster_are_beyond_no_limit(
    limit: float, largest: float, is_limited: bool
) -> None:
    """A slow triangle clipped at 1.5 V: beyond that the speed stays; without a limit, beyond 2 V, it doesn't."""
    u = largest * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * np.arange(5000) / 5000))
    acting = np.clip(u, -1.5, 1.5) if is_limited else u
    found = motion(replace(_ideal(acting, 0.002), u=u))
    assert found is not None

    assert _is_faster_beyond(Case((found,)), limit) is not is_limited


@pytest.mark.parametrize(("turns", "happens_between"), [(0.4, False), (0.6, True)])
def test_of_rows_half_a_turn_apart_no_weight_is_told(turns: float, happens_between: bool) -> None:
    angle = 2 * np.pi * turns * np.arange(400.0)

    assert turns_between_rows([dataset(seed=1, samples=400, y=angle)]) is happens_between
    assert not turns_between_rows([replace(dataset(seed=1, samples=400, y=angle), output_unit="m")])


@pytest.mark.parametrize(("way", "is_weight"), [(0.3, False), (0.6, True)])
def test_on_a_third_of_a_turn_in_one_direction_no_weight_is_told(way: float, is_weight: bool) -> None:
    """A shaft that starts and is slowed down again: a torque that varies with the angle may do that, or anything else."""
    t = np.arange(400) / 400
    angle = 2 * np.pi * way * (3 * t**2 - 2 * t**3)
    slowed = dataset(seed=1, samples=400, u=np.full(400, 3.0), y=angle)
    case = Case(tuple(filter(None, [motion(slowed)])))

    assert (EXPLANATIONS["weight"](case) is not None) is is_weight


def test_an_input_without_any_part_in_the_motion_is_shifted_by_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What is left of a shift is a column's coefficient over the gain's, which may be zero."""
    case = Case(tuple(filter(None, [motion(sound())])))
    without = replace(case.plain, coefficients=np.zeros_like(case.plain.coefficients))
    monkeypatch.setattr(clocks, "_shift_inputs", lambda *_: (0.5, without))

    assert clocks._constant_shift(case) is None


@pytest.mark.parametrize(("really", "named"), [(3.04, False), (3.3, True)])
def test_a_level_that_is_off_by_what_motors_differ_by_has_no_wrong_label(really: float, named: bool) -> None:
    levels = np.repeat([-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0], 4)
    u = np.repeat(np.random.default_rng(1).permutation(levels), 100)

    causes = explain([told(u, np.where(u == 3.0, really, u))])

    assert ("level-disagrees" in {cause.code for cause in causes}) == named
