"""Margins of the sampled loop against the loop itself: the package's controllers, tick by tick, around an exact motor."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from servobench.core.channels import Array, Channel, DeviceInfo, Sample
from servobench.core.errors import UsageError
from servobench.systems.control.lead import Lead
from servobench.systems.control.pid import Pid
from servobench.systems.control.state_feedback import StateFeedback
from servobench.systems.margins import Margins
from servobench.systems.sampled_loop import SampledLoop, sampled_margins
from servobench.systems.tuning.loop import open_loop

K, TAU, H = 23.8, 0.0992, 0.002
COUNT = 1e-9  # rad
INFO = DeviceInfo(
    name="motor",
    channels=(
        Channel(name="voltage", unit="V"),
        Channel(name="counts", unit="counts", counts_per_rev=2 * math.pi / COUNT),
    ),
)
LAWS: dict[str, Any] = {
    "P": Pid(kp=2.0),
    "PD": Pid(kp=4.36, kd=0.164, cutoff=500.0),
    "PID": Pid(kp=4.0, ki=10.0, kd=0.15, cutoff=300.0),
    "lead": Lead(gain=2.84, zero=11.2, pole=323.0),
    "state feedback": StateFeedback(position_gain=4.0, speed_gain=0.15, cutoff=400.0),
    "state feedback, integral": StateFeedback(
        position_gain=4.0, speed_gain=0.15, integral_gain=8.0, cutoff=400.0
    ),
    "speed PI": Pid(output="speed", kp=0.1, ki=1.0, cutoff=300.0),
    "speed PID": Pid(output="speed", kp=0.1, ki=1.0, kd=5e-4, cutoff=300.0),
    "speed I": Pid(output="speed", kp=0.0, ki=2.0, cutoff=100.0),
    "speed lead": Lead(output="speed", gain=0.1, zero=20.0, pole=200.0, cutoff=300.0),
    "speed state feedback": StateFeedback(
        output="speed", position_gain=0.0, speed_gain=0.12, integral_gain=1.0, cutoff=300.0
    ),
}
DELAYS = (0.0, 0.4 * H, H, 2.7 * H)


def held(length: float) -> tuple[Array, Array]:
    """The change of angle and speed over a time at a voltage: the matrix exponential of the motor with its input."""
    whole = expm(np.array([[0.0, 1.0, 0.0], [0.0, -1 / TAU, K / TAU], [0.0, 0.0, 0.0]]) * length)
    return whole[:2, :2], whole[:2, 2]


def swings(controller: Any, times: float, delay: float, ticks: int = 6000) -> tuple[float, float]:
    """The largest output in the fourth and in the last sixth of a run from 1 rad, 1 rad/s, with so many times the voltage."""
    later = int(delay // H)
    part = delay - later * H
    (a1, b1), (a2, b2) = held(part), held(H - part)
    x = np.array([1.0, 1.0])
    on_its_way = [0.0] * (later + 2)  # the newest first
    state = controller.start(H, INFO)
    course = np.empty(ticks)
    for k in range(ticks):
        sample = Sample(index=k, time=k * H, counts=math.floor(x[0] / COUNT))
        state, voltage = controller.step(state, 0.0, sample)
        on_its_way = [times * voltage, *on_its_way[:-1]]
        course[k] = abs(x[1] if controller.output == "speed" else x[0])
        x = a2 @ (a1 @ x + b1 * on_its_way[later + 1]) + b2 * on_its_way[later]
    sixth = ticks // 6
    return float(course[3 * sixth : 4 * sixth].max()), float(course[-sixth:].max())


def margins_of(controller: Any, delay: float) -> Margins:
    return sampled_margins(open_loop(controller, K, TAU, delay, H))


@pytest.mark.parametrize("delay", DELAYS)
@pytest.mark.parametrize("name", LAWS)
def test_the_loop_itself_bears_the_gain_margin_and_no_more(name: str, delay: float) -> None:
    """1 % of the gain to either side: swings that die out, and swings that grow."""
    factor = margins_of(LAWS[name], delay).gain_margin

    assert factor > 1
    before, after = swings(LAWS[name], 0.99 * factor, delay)
    assert after < before
    before, after = swings(LAWS[name], 1.01 * factor, delay)
    assert after > before


def test_a_loop_that_less_gain_makes_unstable_has_its_margin_below_1() -> None:
    """On paper (1 + k K kd) kp = τ ki at the limit: k = 0.38 here."""
    controller = Pid(kp=1.0, ki=20.0, kd=0.11, cutoff=500.0)
    factor = margins_of(controller, 0.0).gain_margin

    assert 0.3 < factor < 0.5
    before, after = swings(controller, 1.01 * factor, 0.0)
    assert after < before
    before, after = swings(controller, 0.99 * factor, 0.0)
    assert after > before


@pytest.mark.parametrize("name", ["PD", "PID", "lead", "speed PI"])
@pytest.mark.parametrize("delay", [0.0, 0.4 * H])
def test_the_loop_itself_bears_the_delay_margin_and_no_more(name: str, delay: float) -> None:
    """Whole samples turn L by -ωd exactly; a part of one changes what folds down from ω - 2π/h, too.

    The motor, ω⁻² there, passes of that (ωh/2π)² beside what it passes at ω: at 60 rad/s 4e-4, far below the 2 % to either side.
    """
    margin = margins_of(LAWS[name], delay).delay_margin

    before, after = swings(LAWS[name], 1.0, delay + 0.98 * margin, 3000)
    assert after < before
    before, after = swings(LAWS[name], 1.0, delay + 1.02 * margin, 3000)
    assert after > before


def test_a_pure_gain_around_the_speed_is_at_its_limit_where_a_root_passes_minus_1() -> None:
    """By hand: z - a + kK(1 - a) is zero at z = -1 for kK(1 - a) = 1 + a; in w its L is K(1 - a)(1 - w)/((1 - a) + (1 + a)w)."""
    a = math.exp(-H / TAU)
    above = (-K * (1 - a), K * (1 - a))
    loop = SampledLoop(numerator=above, denominator=(1 + a, 1 - a), whole=0, sample_time=H, output="speed")
    found = sampled_margins(loop)

    assert found.gain_margin == pytest.approx((1 + a) / (K * (1 - a)), rel=1e-12)
    assert found.phase_crossover == pytest.approx(math.pi / H, rel=1e-12)
    # One sample of delay: z² - az + kK(1 - a), whose complex roots have the product 1 at the limit, and z + 1/z = a there.
    late = SampledLoop(numerator=above, denominator=(1 + a, 1 - a), whole=1, sample_time=H, output="speed")
    assert sampled_margins(late).gain_margin == pytest.approx(1 / (K * (1 - a)), rel=1e-12)
    assert sampled_margins(late).phase_crossover == pytest.approx(math.acos(a / 2) / H, rel=1e-12)


@pytest.mark.parametrize("sample_time", [1e-5, 0.002, 0.05, 2.0])
def test_a_gain_around_the_position_is_at_its_limit_by_jurys_criterion(sample_time: float) -> None:
    """By hand: z² - (1 + a - k c₁) z + a + k c₂, c₁ = K(h - τ(1 - a)), c₂ = K(τ(1 - a) - ah).

    |z| = 1 where a + k c₂ = 1, or at z = -1 where 2(1 + a) = k(c₁ - c₂): what comes first.
    """
    x = sample_time / TAU
    a, fall = math.exp(-x), -math.expm1(-x)
    # By their series where the differences would cancel: c₁ = Kτ (x²/2 - x³/6 ...), c₂ = Kτ (x²/2 - x³/3 ...).
    series = x < 1e-3
    c1 = K * TAU * (x**2 / 2 - x**3 / 6 if series else x - fall)
    c2 = K * TAU * (x**2 / 2 - x**3 / 3 if series else fall - a * x)
    limits = [fall / c2, *([2 * (1 + a) / (c1 - c2)] if c1 > c2 else [])]

    found = sampled_margins(open_loop(Pid(kp=1.0), K, TAU, 0.0, sample_time))

    # The next term of the series is x²/10 of c; the motor's own coefficients are differences that lose τ/h of the digits.
    assert found.gain_margin == pytest.approx(min(limits), rel=1e-9 + (x**2 if series else 0) + 1e-15 / x)


def test_of_loops_at_random_no_crossing_is_missed() -> None:
    """The roots of D + k N themselves, for k from 1 to the margin and beyond: how many are outside changes there alone."""
    rng = np.random.default_rng(11)
    for _ in range(60):
        kp, ki, kd = np.exp(rng.uniform(np.log([0.1, 0.01, 1e-3]), np.log([20.0, 100.0, 1.0])))
        law = Pid(kp=kp, ki=ki, kd=kd, cutoff=float(np.exp(rng.uniform(3, 8))))
        loop = open_loop(law, K, TAU, float(rng.uniform(0, 5 * H)), H)
        n, d = np.array(loop.in_w.numerator), np.array(loop.in_w.denominator)

        def outside(k: float, n: Array = n, d: Array = d) -> int:
            return int((np.roots(np.polyadd(d, k * n)).real > 0).sum())

        factor = sampled_margins(loop).gain_margin
        reach = min(abs(math.log(factor)), math.log(1e4))
        inner = np.exp(np.linspace(-0.999 * reach, 0.999 * reach, 200))
        assert len({outside(float(k)) for k in inner}) == 1
        if math.isinf(factor):  # unstable with any gain
            continue
        beyond = 1.001 if factor > 1 else 1 / 1.001
        assert outside(factor * beyond) != outside(factor / beyond)


@pytest.mark.parametrize("cutoff", [1e11, 1e15, 1e30])
def test_a_filter_far_faster_than_the_ticks_does_nothing(cutoff: float) -> None:
    """By hand, with C(z) = kp + kd (1 - 1/z)/h around the motor with its hold."""
    a = math.exp(-H / TAU)
    c1, c2 = H - TAU * (1 - a), TAU * (1 - a) - a * H

    def loop(w: float) -> complex:
        z = np.exp(1j * w * H)
        return complex((4 + 0.15 * (1 - 1 / z) / H) * K * (c1 * z + c2) / ((z - 1) * (z - a)))

    crossover = brentq(lambda w: abs(loop(w)) - 1, 1, 500, xtol=1e-12)
    found = margins_of(Pid(kp=4.0, kd=0.15, cutoff=cutoff), 0.0)

    # The filter's pole and zero are 2/(ω_c h) = 1e-8 apart or less, and so is what they turn.
    assert found.gain_crossover == pytest.approx(crossover, rel=1e-7)
    assert found.phase_margin == pytest.approx(math.pi + np.angle(loop(crossover)), abs=1e-7)


def test_gains_beyond_all_numbers_are_reported() -> None:
    with pytest.raises(UsageError, match="take smaller gains"):
        open_loop(Pid(kp=1.0, kd=1e307), K, TAU, 0.0, H)


def test_nothing_comes_out_of_a_law_without_gains() -> None:
    found = sampled_margins(open_loop(Pid(kp=0.0), K, TAU, 0.0, H))

    assert found.gain_margin == found.phase_margin == found.delay_margin == math.inf
    assert math.isnan(found.gain_crossover)
