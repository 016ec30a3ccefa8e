"""The laws against algebra, python-control and the measurement chain; the switch from one to another; the counter that wraps."""

import math
from typing import Any

import control as ct
import numpy as np
import pytest

from servobench.core.channels import Array, Channel, DeviceInfo, Sample
from servobench.core.errors import UsageError
from servobench.core.settings import with_units
from servobench.recordings.measurement.base import Chain
from servobench.systems.control import kernels
from servobench.systems.control.lead import Lead
from servobench.systems.control.open_loop import OpenLoop
from servobench.systems.control.pid import Pid
from servobench.systems.control.running import Running
from servobench.systems.control.state_feedback import StateFeedback
from tests.systems.control.laws import LAWS, closed_loop, device, sample, voltages

H = 1 / 512  # s; the times of all ticks are exact
FINE = 2 * math.pi * 1e9  # counts a turn: a nanoradian each
GAIN, TAU = 24.0, 0.1


def motor(sample_time: float = H, gain: float = GAIN, tau: float = TAU) -> Any:
    """Return x' = plant(x, u) of x = (θ, ω) and K/(s(τs + 1)), exact for a voltage that holds."""
    a = math.exp(-sample_time / tau)
    g = tau * (1 - a)

    def plant(x: Array, u: float) -> Array:
        end = gain * u
        return np.array([x[0] + g * x[1] + (sample_time - g) * end, a * x[1] + (1 - a) * end])

    return plant


def turned(law: Any, reference: Array, info: DeviceInfo | None = None) -> tuple[Array, Array]:
    """Return angles and voltages of a law around the motor, by default without limit and with a fine encoder."""
    told = info or device(limit=None, bits=None, counts_per_rev=FINE)
    channel = told.channel("counts")
    assert channel is not None
    return closed_loop(
        law, motor(), lambda x: float(x[0]), reference, H, told, 2 * math.pi / (channel.counts_per_rev or 1)
    )


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_compiled_and_interpreted_laws_agree(law: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    reference, counts = rng.normal(0, 5, 300), np.cumsum(rng.integers(-40, 60, 300))
    compiled = voltages(law, reference, counts, H, device(limit=2.0))
    for name in ("take_sample", "lowpass_step", "complete_switch", "settle_voltage"):
        monkeypatch.setattr(kernels, name, getattr(kernels, name).py_func)
    state = law.start(H, device(limit=2.0))
    if isinstance(state, Running):
        state = state._replace(law=state.law.py_func)  # type: ignore[attr-defined]
    found = []
    for k, (r, n) in enumerate(zip(reference.tolist(), counts.tolist(), strict=True)):
        state, u = law.step(state, r, sample(k, n, H))
        found.append(u)

    # Fused multiply-adds round differently: a few last digits of sums of up to some hundred volts.
    np.testing.assert_allclose(compiled, found, rtol=1e-12, atol=1e-10)


@pytest.mark.parametrize("cutoff", [20.0, 100.0, 900.0])
def test_the_speed_of_a_law_is_that_of_the_measurement_chain(cutoff: float) -> None:
    counts = np.cumsum(np.random.default_rng(5).integers(-30, 50, 400))
    t = np.arange(400) * H
    chain = Chain.parse(f"derivative | lowpass {cutoff} rad/s")
    speed = chain(counts * 2 * math.pi / 2048, t)

    follows = Pid(output="speed", kp=1, b=0, cutoff=cutoff)
    damps = Pid(output="position", kp=0, kd=1, cutoff=cutoff)
    feeds_back = StateFeedback(position_gain=0, speed_gain=1, cutoff=cutoff)

    for law in (follows, damps, feeds_back):
        seen = -voltages(law, np.zeros(400), counts, H, device(limit=None))
        np.testing.assert_allclose(seen, speed, rtol=1e-12, atol=1e-12 * np.abs(speed).max())


def test_a_late_sample_tells_the_speed_since_the_one_before_it() -> None:
    law = Pid(output="speed", kp=1, b=0, cutoff=1e9)  # tustin at a far cut-off: y[k] = x[k] + x[k-1] - y[k-1]
    state = law.start(H, device())
    for time, counts in [(0.0, 0), (H, 10), (5 * H, 50), (6 * H, 60)]:
        state, _ = law.step(state, 0.0, Sample(index=0, time=time, counts=counts))

    # Ten counts a tick all along, four ticks of which were missed.
    assert state.x[kernels.SLOPE] == pytest.approx(10 * 2 * math.pi / 2048 / H, rel=1e-12)


def lowpass(cutoff: float) -> Any:
    """ω/(s + ω) by the trapezoid rule, by python-control."""
    return ct.ss(ct.sample_system(ct.tf([cutoff], [1, cutoff]), H, method="bilinear"))


def discrete_motor() -> Any:
    return ct.ss(ct.sample_system(ct.tf([GAIN], [TAU, 1, 0]), H, method="zoh"))


DIFFERENCE = ct.ss(ct.tf([1, -1], [H, 0], H))
SUM = ct.ss(ct.tf([H, 0], [1, -1], H))

LINEAR = {
    "PID of the position": (
        Pid(kp=2, ki=5, kd=0.06, b=0.6, cutoff=200),
        2 * 0.6 + 5 * SUM,
        2 + 5 * SUM + 0.06 * DIFFERENCE * lowpass(200),
    ),
    "PI of the speed": (
        Pid(output="speed", kp=0.1, ki=1.2, cutoff=200),
        0.1 + 1.2 * SUM,
        (0.1 + 1.2 * SUM) * DIFFERENCE * lowpass(200),
    ),
    "PID of the speed": (
        Pid(output="speed", kp=0.1, ki=1.2, kd=0.001, b=0.5, cutoff=100),
        0.05 + 1.2 * SUM,
        (0.1 + 1.2 * SUM + 0.001 * DIFFERENCE * lowpass(100)) * DIFFERENCE * lowpass(100),
    ),
    "lead": (
        Lead(gain=1.5, zero=10, pole=60),
        *2 * (ct.ss(ct.sample_system(ct.tf([1.5 / 10, 1.5], [1 / 60, 1]), H, method="bilinear")),),
    ),
    "state feedback": (
        StateFeedback(position_gain=2, speed_gain=0.05, integral_gain=6, reference_gain=1.5, cutoff=200),
        1.5 + 6 * SUM,
        2 + 0.05 * DIFFERENCE * lowpass(200) + 6 * SUM,
    ),
}


@pytest.mark.parametrize(("law", "forward", "back"), LINEAR.values(), ids=LINEAR)
def test_a_law_around_a_motor_does_what_the_algebra_of_their_transfer_functions_says(
    law: Any, forward: Any, back: Any
) -> None:
    # r = 0 at the first tick: what the law knows before it is nothing, as the algebra has it.
    reference = np.where(np.arange(400) > 0, 1.0, 0.0)
    closed = ct.feedback(discrete_motor(), back) * forward

    angle, _ = turned(law, reference)

    told = ct.forced_response(closed, np.arange(400) * H, reference).outputs
    # A nanoradian of quantisation, which the loop passes on to the angle no more than tenfold; that of the speed, a nanoradian
    # a tick, is summed up with the angle.
    np.testing.assert_allclose(angle, told, rtol=0, atol=1e-8 * max(1.0, float(np.abs(told).max())))


def test_quantisation_shakes_no_more_than_the_loop_passes_on() -> None:
    counts_per_rev, cutoff = 2048.0, 200.0
    law = Pid(kp=2, kd=0.06, cutoff=cutoff)
    reference = np.full(1500, 1.3)
    rough, _ = turned(law, reference, device(limit=None, bits=None, counts_per_rev=counts_per_rev))
    smooth, _ = turned(law, reference)

    # The floor takes up to one quantum from each measurement: the angle is off by that times Σ|g| of what leads from it there.
    plant, back = discrete_motor(), 2 + 0.06 * DIFFERENCE * lowpass(cutoff)
    passed = ct.feedback(plant * back, ct.ss([], [], [], 1.0, H))
    g = ct.impulse_response(passed, np.arange(1500) * H).outputs * H
    bound = 2 * math.pi / counts_per_rev * np.abs(g).sum()
    assert np.abs(rough - smooth).max() <= bound
    assert bound < 5 * 2 * math.pi / counts_per_rev  # and that is a few counts


# ---- the limit


def test_what_is_wanted_beyond_the_limit_is_said_and_not_clipped() -> None:
    _, wanted = turned(Pid(kp=10), np.full(3, 4.0), device(limit=5.0, bits=None, counts_per_rev=FINE))

    assert wanted[0] == 40.0


@pytest.mark.promise("S5")
@pytest.mark.parametrize("law", ["pid", "state_feedback"])
def test_behind_a_saturation_the_overshoot_is_no_larger_than_that_of_the_loop_without_a_limit(
    law: str,
) -> None:
    gains: dict[str, Any] = (
        {"kp": 3, "ki": 6, "kd": 0.12, "cutoff": 300}
        if law == "pid"
        else {"position_gain": 3, "speed_gain": 0.12, "integral_gain": 6, "cutoff": 300}
    )
    member = Pid if law == "pid" else StateFeedback
    limited = device(limit=1.0, bits=None, counts_per_rev=FINE)
    reference = np.full(3000, 20.0)

    free, _ = turned(member(**gains), reference)
    held, wanted = turned(member(**gains), reference, limited)
    wound_up, _ = turned(member(**gains, tracking_time=1e6), reference, limited)

    assert np.abs(wanted).max() > 50  # it is deep in the limit, from the start on
    assert wound_up.max() > 1.3 * 20  # the case is one: without anti-windup it overshoots by a third and more
    assert held.max() <= free.max()
    assert held[-1] == pytest.approx(20.0, abs=0.02)


# ---- switching


def driven(law: Any, state: Any, x: Array, first: int, reference: float, ticks: int, plant: Any) -> Any:
    """Return the voltages of some ticks, the state and the shaft after them."""
    found = []
    for k in range(first, first + ticks):
        state, u = law.step(state, reference, sample(k, int(x[0] * 1e9), H))
        found.append(u)
        x = plant(x, u)
    return found, state, x


@pytest.mark.promise("S38")
@pytest.mark.parametrize("to", [name for name in LAWS if name != "open loop"])
@pytest.mark.parametrize("of", ["open loop", "PID of the position", "PID of the speed"])
def test_the_voltage_goes_on_at_a_switch(of: str, to: str) -> None:
    info, plant, before, after = device(bits=None, counts_per_rev=FINE), motor(), LAWS[of], LAWS[to]
    start = before.start(H, info)
    found, _, x = driven(before, start, np.zeros(2), 0, 2.0, 200, plant)
    now = sample(200, int(x[0] * 1e9), H)

    state = after.take_over(H, info, 1.0, now, found[-1])

    # Ten roundings of the largest term, gain times angle.
    assert after.step(state, 1.0, now)[1] == pytest.approx(found[-1], abs=1e-13 * (1 + abs(x[0])) * 10)


@pytest.mark.promise("S38")
def test_the_same_law_with_other_gains_goes_on_where_it_was() -> None:
    info, plant = device(limit=None, bits=None, counts_per_rev=FINE), motor()
    old, new = Pid(output="speed", kp=0.1, ki=1), Pid(output="speed", kp=0.3, ki=4, cutoff=300)
    found, _, x = driven(old, old.start(H, info), np.zeros(2), 0, 30.0, 3000, plant)

    state = new.take_over(H, info, 30.0, sample(3000, int(x[0] * 1e9), H), found[-1])
    after, _, _ = driven(new, state, x, 3000, 30.0, 200, plant)

    # The motor turns at 30 rad/s; a counter of a nanoradian tells that to 5e-7 rad/s, which kp and ki make some 1e-6 V of.
    np.testing.assert_allclose(after, 30 / GAIN, rtol=0, atol=5e-6)


@pytest.mark.parametrize("to", [name for name in LAWS if "speed" in name or "PD" in name or "lead" in name])
def test_a_turning_motor_is_no_shock_to_a_law_that_has_never_seen_it_turn(to: str) -> None:
    info, plant, law = device(limit=None, bits=None, counts_per_rev=FINE), motor(), LAWS[to]
    found, _, x = driven(OpenLoop(), None, np.zeros(2), 0, 2.0, 1000, plant)
    follows = law.reference_unit == "rad/s"
    now = sample(1000, int(x[0] * 1e9), H)

    state = law.take_over(H, info, float(x[1]) if follows else float(x[0]), now, found[-1])
    voltages_after = [found[-1]]
    for k in range(1000, 1006):
        r = float(x[1] if follows else x[0])  # it asks for what is there already
        state, u = law.step(state, r, sample(k, int(x[0] * 1e9), H))
        voltages_after.append(u)
        x = plant(x, u)

    # A bias of 2 V and of what 48 rad/s are worth to the law, 4.8 V at most, fades by dt/fade_time = 0.4 % a tick: 27 mV.
    # Nothing jumps by these volts themselves.
    assert np.abs(np.diff(voltages_after)).max() < 0.028


def test_a_law_without_integral_lets_go_of_the_voltage_with_its_time_constant() -> None:
    law, info = Pid(kp=1, fade_time=0.1), device()
    state = law.take_over(H, info, 1.0, sample(0, 0, H), 5.0)
    found = []
    for k in range(2000):
        state, u = law.step(state, 1.0, sample(k, 0, H))
        found.append(u)

    t = np.arange(2000) * H
    # 100 products of exponentials, half a digit each.
    np.testing.assert_allclose(found[:100], 1 + 4 * np.exp(-t[:100] / 0.1), rtol=100 * 2**-53)
    assert found[-1] == 1.0  # and is exactly what it says again


def test_where_no_bias_is_wished_the_voltage_jumps() -> None:
    law, now = Pid(kp=1, fade_time=0), sample(0, 0, H)
    state = law.take_over(H, device(), 1.0, now, 5.0)
    assert law.step(state, 1.0, now)[1] == 1.0


@pytest.mark.promise("S47")
@pytest.mark.parametrize("before", [-10.0, 0.0, 8.0])
def test_open_loop_puts_out_its_reference_whatever_was_applied_before(before: float) -> None:
    law = OpenLoop()
    state = law.take_over(H, device(), 6.0, sample(0, 0, H), before)
    found = []
    for k in range(600):
        state, u = law.step(state, 6.0 if k < 300 else -6.0, sample(k, 0, H))
        found.append(u)

    assert found == 300 * [6.0] + 300 * [-6.0]


def test_a_file_of_an_earlier_version_is_read_though_it_says_how_open_loop_fades() -> None:
    assert OpenLoop.model_validate({"fade_time": 0.5}) == OpenLoop()


# ---- the counter


@pytest.mark.promise("S10")
@pytest.mark.parametrize("bits", [16, 24, 32])
def test_the_travel_is_exact_over_a_billion_counts_and_both_ways(bits: int) -> None:
    rng, half = np.random.default_rng(bits), 2 ** (bits - 1)
    largest = min(half - 1, 4_000_000)
    steps = np.concatenate([rng.integers(1, largest, 600), -rng.integers(1, largest, 1200)])
    travel = np.concatenate([[0], np.cumsum(steps)])
    if bits > 16:
        assert travel.max() > 1e9
    law = Pid(kp=1)
    state = law.start(H, device(bits=bits))

    for k, true in enumerate(travel.tolist()):
        state, _ = law.step(state, 0.0, sample(k, (true + half) % (2 * half) - half, H))
        assert int(state.x[kernels.TRAVEL]) == true


def test_a_law_that_takes_over_goes_on_from_the_travel_where_it_is_given_that() -> None:
    law, info = Pid(kp=1, fade_time=0), device(bits=16)
    state = law.take_over(H, info, 0.0, sample(0, 200_000, H), 0.0)
    state, _ = law.step(state, 0.0, sample(0, 200_000, H))

    # The counter shows 200 010 modulo 65 536.
    state, _ = law.step(state, 0.0, sample(1, (200_010 + 32768) % 65536 - 32768, H))

    assert state.x[kernels.TRAVEL] == 200_010


# ---- settings


def test_a_device_without_an_encoder_is_refused() -> None:
    blind = DeviceInfo(name="box", channels=(Channel(name="voltage", unit="V"),))

    with pytest.raises(
        UsageError, match="'pid' needs the shaft's angle, and the device 'box' has no encoder"
    ):
        Pid().start(H, blind)
    with pytest.raises(UsageError, match="doesn't give its encoder's counts"):
        Lead().start(H, device(counts_per_rev=None))
    assert OpenLoop().start(H, blind) is None


def test_a_gain_has_the_unit_of_what_is_followed() -> None:
    assert Pid(kp="1 V/deg").kp == pytest.approx(180 / math.pi)  # type: ignore[arg-type]
    assert Pid(output="speed", kp="1 mV*s/rad").kp == 1e-3  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="V·s/rad"):
        Pid(output="speed", kp="1 V/rad")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="exchange them"):
        Lead(zero=100, pole=10)
    with pytest.raises(ValueError, match="position_gain = 0"):
        StateFeedback(output="speed")


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_settings_are_written_and_read(law: Any) -> None:
    assert type(law)(**with_units(law)) == law
