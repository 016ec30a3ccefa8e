"""Encoder, driving, step, pulse, sinusoid and model: each number of their studies and corrections, worked out another way.

The motor in time comes from `tests/rig/motor/reference.py`, steps of microseconds through the bare equations;
the rest is algebra.
"""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.signal import cont2discrete, lfilter, lti

import servobench as sb
from servobench.core.errors import NotIdentifiable, UnknownName, UsageError
from servobench.lab.exercise_file import exercise
from servobench.lab.expression import Expression
from servobench.lab.motion import motion_of
from servobench.lab.stand import MotorStand, stand_of, stand_on_the_twin
from servobench.lab.studies import quadrature
from servobench.lab.studies.base import Column
from servobench.lab.studies.breakaway import Breakaway
from servobench.lab.studies.inertias import Body, Inertias, Total
from servobench.lab.studies.levels import Levels
from servobench.lab.studies.pulse_response import PulseResponse, Push
from servobench.lab.studies.sinusoid_response import SinusoidResponse, Wave
from servobench.lab.studies.step_reading import StepReading
from servobench.lab.studies.wrap_times import WrapTimes
from servobench.report.palette import Style
from tests.rig.motor.reference import Truth, march

NAMES = ("encoder", "driving", "step", "pulse", "sinusoid", "modelling")

# Table 1 of the paper, and the friction that the simulated motor is said to have.
R, L, K, ROTOR, B, COULOMB = 8.4, 1.16e-3, 0.042, 4.0e-6, 1e-6, 8e-4
HUB, DISC = 0.5 * 0.0106 * 0.0111**2, 0.5 * 0.053 * 0.0248**2
J = ROTOR + HUB + DISC
GAIN = K / (R * B + K * K)  # of the simulated motor, whose data sheet has no viscous friction
SHEET_GAIN = 1 / K
LOST = R * COULOMB / K  # V that friction takes
COUNT = 2 * math.pi / 2048
T = 0.002


def slow_and_fast(b: float) -> tuple[float, float]:
    """The time constants of L J s² + (R J + L b) s + (R b + k²)."""
    fast, slow = sorted(-1 / np.roots([L * J, R * J + L * b, R * b + K * K]).real)
    return float(slow), float(fast)


TAU, FAST = slow_and_fast(B)
SHEET_TAU, _ = slow_and_fast(0.0)
TRUTH = Truth(inertia=J)


def stand(name: str) -> MotorStand:
    return stand_on_the_twin(exercise(name))


def column(name: str, study: str, wanted: str) -> Column:
    tables = stand(name).study_result(study).tables
    return next(c for table in tables for c in table.columns if c.name == wanted)


def values(name: str, study: str, wanted: str) -> list[float]:
    return [float(v) for v in column(name, study, wanted).values]


def counts_of(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.floor(angle / COUNT)


def correction(name: str, where: str) -> float:
    found = next(c for c in exercise(name).corrections if c.where.startswith(where))
    return Expression(found.answer).evaluate(stand(name).facts).value


# Encoder


def test_a_count_is_what_the_paper_says_but_for_a_digit_that_slipped_in() -> None:
    ours, paper = column("encoder", "gains", "value").values, column("encoder", "gains", "value").paper

    assert ours[:2] == (2048, 2048)
    assert ours[2] == 0.17578125
    assert ours[3] == pytest.approx(0.0030679615757712823, rel=1e-12)
    assert ours[4] == pytest.approx(0.0030679615757712823 / T, rel=1e-12)
    assert paper[:4] == (2048, "", 0.175778125, 0.003068)
    assert f"{ours[3]:.6f}" == f"{paper[3]:.6f}"
    assert correction("encoder", "II.B") == 0.17578125 != paper[2]
    # The sentence of the correction: one count in so many turns.
    assert abs(paper[2] / 0.17578125 - 1) == pytest.approx(2e-5, rel=0.2)  # type: ignore[operator]
    assert 1 / (2048 * abs(paper[2] / 0.17578125 - 1)) == pytest.approx(27, abs=0.5)  # type: ignore[operator]


def test_counters_wrap_when_their_range_is_turned_through() -> None:
    speed = 10 / K

    turns = [2**bits / 2048 for bits in (16, 24, 32)]
    assert values("encoder", "widths", "turns") == turns == [32, 8192, 2097152]
    assert values("encoder", "widths", "wrap") == pytest.approx(
        [2 * math.pi * n / speed for n in turns], rel=1e-12
    )
    assert values("encoder", "widths", "first") == pytest.approx(
        [math.pi * n / speed for n in turns], rel=1e-12
    )
    # What the text says: 16 bits within a second, 32 bits after hours.
    first = values("encoder", "widths", "first")
    assert first[0] < 1
    assert first[2] > 2 * 3600


def test_a_simulated_counter_of_16_bits_jumps_where_the_equations_say() -> None:
    course = march(TRUTH, np.full(1250, 10.0), T)
    counts = counts_of(course[:, 2])
    at = [int(np.argmax(counts >= 32768 + n * 65536)) for n in range(3)]

    # The reference is exact to 1e-6 of the angle, which is less than the 73 counts of a sample: the same sample, and the counts
    # to one that lies on an edge.
    assert values("encoder", "widths", "time") == pytest.approx([T * k for k in at], abs=1e-9)
    before = [counts[k - 1] - n * 65536 for n, k in enumerate(at)]
    assert values("encoder", "widths", "before") == pytest.approx(before, abs=1)
    after = [counts[k] - (n + 1) * 65536 for n, k in enumerate(at)]
    assert values("encoder", "widths", "after") == pytest.approx(after, abs=1)


def test_each_run_starts_at_zero_wherever_the_one_before_has_ended() -> None:
    t = T * np.arange(1250)
    end = counts_of(march(TRUTH, np.where((t >= 0.5) & (t < 1.0), 1.0, 0.0), T)[:, 2])[-1]

    assert values("encoder", "zero", "first") == [0, 0]
    assert values("encoder", "zero", "last") == pytest.approx([end, end], abs=1)
    assert values("encoder", "zero", "angle") == pytest.approx([COUNT * end] * 2, abs=COUNT)


# Driving


def test_a_positive_voltage_counts_up_and_each_level_adds_what_the_equations_say() -> None:
    u = np.repeat([0.0, 0.5, 0.0, -0.5, 0.0], 500)
    counts = counts_of(march(TRUTH, u, T)[:, 2])
    edges = [0, 500, 1000, 1500, 2000, 2499]

    added = [counts[b] - counts[a] for a, b in pairwise(edges)]
    assert values("driving", "levels", "counts") == pytest.approx(added, abs=1)  # a count on an edge
    assert column("driving", "levels", "turned").values == (
        "stays",
        "goes up",
        "goes up",
        "goes down",
        "goes down",
    )
    # Steady to e^-5 over the half second that is looked at, on average e^-5 τ/0.5 s of K u; and two counts in it.
    speed = GAIN * (0.5 - LOST)
    slack = speed * math.exp(-5) * TAU / 0.5 + 2 * COUNT / 0.5
    assert values("driving", "levels", "speed")[1] == pytest.approx(speed, abs=slack)
    assert values("driving", "levels", "speed")[3] == pytest.approx(-speed, abs=slack)


def seen_at(lost: float) -> float:
    """The voltage on a ramp of 0.05 V/s when three counts are full, for a motor that begins to slide at `lost`."""
    rate = 0.05

    def angle(t: float) -> float:
        return GAIN * rate * (t * t / 2 - TAU * t + TAU * TAU * (1 - math.exp(-t / TAU)))

    return lost + rate * float(brentq(lambda t: angle(t) - 3 * COUNT, 1e-6, 5.0))


def test_the_shaft_begins_to_move_where_friction_and_dead_band_are_made_up_for() -> None:
    friction = [0, LOST, 2 * LOST, LOST, LOST]
    dead = [0, 0, 0, 0.35, 0.65]
    found = values("driving", "breakaway", "start")
    lost = [a + b for a, b in zip(friction, dead, strict=True)]

    assert values("driving", "breakaway", "friction")[1:] == pytest.approx(friction, rel=1e-12)
    assert values("driving", "breakaway", "sum")[1:] == pytest.approx(lost, rel=1e-12)
    # A sample of the ramp is 0.5 mV: the voltage held before the sample in which it is seen, and the hold, half of it late.
    assert found == pytest.approx([seen_at(LOST), *map(seen_at, lost)], abs=0.8e-3)
    speeds = [max(0.0, GAIN * (0.5 - v)) for v in (LOST, *lost)]
    # Two counts in half a second, and what is left of the rise after 1.5 s.
    assert values("driving", "breakaway", "speed") == pytest.approx(speeds, abs=2 * COUNT / 0.5)
    assert speeds[4:] == [0, 0]


def test_the_note_says_how_late_the_ramp_is_seen() -> None:
    # With the data sheet's gain and time constant: 9.6 mV, as with the motor's own to two digits.
    assert f"Seen {1000 * (seen_at(0.0)):.1f}" in stand("driving").study_result("breakaway").tables[0].note


def test_a_dead_band_of_the_newer_unit_holds_the_motor_at_half_a_volt() -> None:
    assert correction("driving", "II.C, driving") == pytest.approx(0.65 + LOST, rel=1e-12)
    assert correction("driving", "II.C, driving") > 0.5


def test_a_held_shaft_is_cut_off_after_the_time_of_its_monitor_and_not_below_its_threshold() -> None:
    cut = values("driving", "stall", "cut")
    volts = [4.0, 6.0, 10.0, 4.0]

    assert math.isnan(cut[0])
    for n, threshold, duration in ((1, 1.0, 3.0), (2, 1.0, 3.0), (3, 0.3, 10.0)):
        # The monitor's speed is smoothed over 10 ms: at each sample it keeps 10/12 until it is below the threshold.
        samples = math.log(GAIN * (volts[n] - LOST) / threshold) / math.log(1.2)
        assert cut[n] == pytest.approx(
            duration + T * samples, abs=3 * T
        )  # begin, end, and the last way before the hold
    current = values("driving", "stall", "current")
    assert current == pytest.approx([u / R for u in volts], abs=3 / 4096)  # half a step of 6 A/2¹²
    assert values("driving", "stall", "heat") == pytest.approx([u * u / R for u in volts], abs=10 * 3 / 4096)
    said = stand("driving").study_result("stall").sentences
    assert "as asked" in said[0]
    assert "more than 5 V, 3 s" in said[1]
    assert "more than 1 V, 10 s" in said[3]


# Step


def passes(t: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    return float(np.interp(1 - math.exp(-1), y, t))


def test_each_way_of_reading_the_step_gives_what_theory_says() -> None:
    found = values("step", "reading", "tau")
    t = np.linspace(0, 1.5, 150001)
    _, behind = lti([1.0], np.polymul([TAU, 1], np.polymul([FAST, 1], [1 / 50, 1]))).step(T=t)
    rise = (behind >= 0.1) & (behind <= 0.9)
    slope = np.polyfit(t[rise], np.log(1 - behind[rise]), 1)[0]

    # Differences come half a sample late. A count in a sample is 1.5 rad/s of 20; filtered it is a tenth of that, over
    # a slope of 0.37 · 20/τ: 2 ms.
    rough = COUNT / T / (math.exp(-1) * GAIN * (1 - LOST) / TAU)
    smooth = 0.1 * rough
    assert found[0] == pytest.approx(passes(t, behind) + T / 2, abs=smooth)
    assert found[1] == pytest.approx(TAU + FAST + T / 2, abs=rough)
    assert found[2] == pytest.approx(-1 / slope, abs=smooth)
    # θ = K u (t - τ - τ_fast); the counter shows half a count less on average. Its ripple of half a count beats eight times
    # in the 0.83 s of the line (12.98 counts a sample), which may turn it by 6 · 0.5/(8π · 0.83 s) = 0.14 counts/s, and carry it
    # 0.3 counts from the middle of the line back to the step.
    late = 0.5 * COUNT / (GAIN * (1 - LOST))
    assert found[3] == pytest.approx(TAU + FAST + late, abs=0.6 * late)
    assert found[4] == pytest.approx(TAU, abs=smooth)
    assert found[5] == pytest.approx(TAU, rel=5e-3)


def test_a_motor_reads_slower_behind_the_papers_filter_by_nearly_all_of_its_lag() -> None:
    t = np.linspace(0, 1.5, 150001)
    _, behind = lti([1.0], np.polymul([TAU, 1], [1 / 50, 1])).step(T=t)
    _, sheet = lti([1.0], np.polymul([SHEET_TAU, 1], [1 / 50, 1])).step(T=t)
    expected = values("step", "reading", "expected")

    # One motor in the whole table, the one that was identified: that is the twin's within 0.5 %, as tested above.
    assert expected[0] == pytest.approx(passes(t, behind) + T / 2, rel=5e-3)
    assert expected[1] == pytest.approx(TAU + T / 2, rel=5e-3)
    assert expected[3] == expected[4] == expected[5] == values("step", "reading", "tau")[5]
    assert correction("step", "II.E") == pytest.approx(passes(t, sheet) + T / 2, abs=1e-6)
    assert column("step", "reading", "tau").paper[0] == 0.13
    # Most of the way from 0.0998 s to 0.13 s.
    assert (correction("step", "II.E") - 0.0998) / (0.13 - 0.0998) > 0.7


def test_equal_lags_have_a_reading_too() -> None:
    from servobench.lab.studies.step_reading import behind_filter

    t = np.linspace(0, 1.5, 150001)
    assert behind_filter(0.1, 0.1) == pytest.approx(passes(t, 1 - (1 + t / 0.1) * np.exp(-t / 0.1)), abs=1e-6)
    assert behind_filter(0.1, 0.1 * (1 + 1e-5)) == pytest.approx(behind_filter(0.1, 0.1), rel=1e-5)


# Pulse


def pushed(voltage: float, width: float) -> NDArray[np.float64]:
    t = T * np.arange(round((0.2 + width + 1.5) / T))
    return march(TRUTH, np.where((t > 0.2 - T / 2) & (t < 0.2 + width - T / 2), voltage, 0.0), T)


def test_a_pulse_leaves_an_angle_and_friction_explains_what_it_lacks() -> None:
    pulses = [(1.0, 0.1), (1.0, 0.25), (1.0, 0.5), (2.0, 0.25), (-1.0, 0.5)]
    courses = [pushed(*pulse) for pulse in pulses]
    angles = [float(course[-1, 2]) for course in courses]

    # Whole counts, floored; the reference is exact to much less than one.
    assert values("pulse", "pulses", "angle") == pytest.approx(angles, abs=1.01 * COUNT)
    assert values("pulse", "pulses", "area") == pytest.approx([u * w for u, w in pulses], rel=1e-9)
    assert values("pulse", "pulses", "linear") == pytest.approx([u * w / K for u, w in pulses], rel=1e-9)
    for n, ((u, w), course, angle) in enumerate(zip(pulses, courses, angles, strict=True)):
        moves = T * (np.flatnonzero(np.abs(course[:, 1]) > 0)[-1] + 1) - 0.2
        # The last count comes up to √(2 q/a) before the shaft stands, as it slows down by a = K u_c/τ.
        early = math.sqrt(2 * COUNT * TAU / (GAIN * LOST)) + T
        assert moves - early <= values("pulse", "pulses", "rest")[n] + w <= moves + 2 * T
        # From rest to rest the equations add up to θ = K (area - u_c t): friction is what the text says it is.
        assert abs(angle) == pytest.approx(GAIN * (abs(u) * w - LOST * moves), abs=GAIN * LOST * 2 * T)
        # With the data sheet's gain in place of the motor's, and a time that is short by up to `early`.
        least = (abs(u) * w - abs(angle) / SHEET_GAIN) / moves
        assert (
            least * 0.99 < values("pulse", "pulses", "friction")[n] < least * moves / (moves - early) * 1.01
        )
    assert np.allclose(values("pulse", "pulses", "friction"), LOST, rtol=0.1)


# Sinusoid


def swing(amplitude: float, offset: float) -> NDArray[np.float64]:
    """The last of four periods of 0.4 Hz: speed and angle, and the angle of the one before."""
    t = T * np.arange(5001)
    course = march(TRUTH, offset + amplitude * np.sin(2 * math.pi * 0.4 * t), T, step=1e-5)
    return course[:, 1:]


@pytest.mark.parametrize(("row", "amplitude", "offset"), [(0, 1.0, 0.0), (1, 3.0, 0.0), (2, 1.0, 2.0)])
def test_the_speed_swings_as_the_equations_do(row: int, amplitude: float, offset: float) -> None:
    course = swing(amplitude, offset)
    last = course[-1250:]
    t = T * np.arange(5001)[-1250:]
    omega = 2 * math.pi * 0.4
    phasor = 2j * complex(np.mean(last[:, 0] * np.exp(-1j * omega * t)))

    # A count in the angle is ω counts in the speed, at any one sample; over 1250 it is far less.
    assert values("sinusoid", "waves", "amplitude")[row] == pytest.approx(abs(phasor), abs=omega * COUNT)
    lag = math.degrees(math.atan2(phasor.imag, phasor.real))
    assert values("sinusoid", "waves", "phase")[row] == pytest.approx(
        lag, abs=math.degrees(omega * COUNT / abs(phasor))
    )
    drift = float(course[-1, 1] - course[-1251, 1])
    assert values("sinusoid", "waves", "drift")[row] == pytest.approx(drift, abs=2 * COUNT)
    span = float(np.ptp(last[:, 1]))
    assert values("sinusoid", "waves", "span")[row] == pytest.approx(span, abs=2 * COUNT)


def test_friction_takes_a_part_of_the_amplitude_only_where_the_shaft_reverses() -> None:
    found, linear = (values("sinusoid", "waves", name) for name in ("amplitude", "linear"))
    omega = 2 * math.pi * 0.4

    assert linear == pytest.approx(
        [a * SHEET_GAIN / math.hypot(1, omega * SHEET_TAU) for a in (1, 3, 1)], rel=1e-9
    )
    lag = -math.degrees(math.atan(omega * SHEET_TAU) + omega * T / 2)
    assert values("sinusoid", "waves", "lag") == pytest.approx([lag] * 3, rel=1e-9)
    # Viscous friction alone, between 1 and 3 V: the data sheet's gain is too high by R b/k².
    assert found[2] / linear[2] == pytest.approx(1 / (1 + R * B / K**2), abs=1e-3)
    # A Coulomb torque that reverses acts as a square wave of u_c, whose fundamental is 4/π u_c: to first order that is lost.
    for row, amplitude in ((0, 1.0), (1, 3.0)):
        assert 1 - found[row] / linear[row] == pytest.approx(4 / math.pi * LOST / amplitude, rel=0.15)
    # Zero mean: the angle stays. Mean 2 V: it goes by K (2 V - u_c) a period.
    drift = values("sinusoid", "waves", "drift")
    assert drift[:2] == pytest.approx([0, 0], abs=COUNT)
    assert drift[2] == pytest.approx(GAIN * (2 - LOST) * 2.5, abs=2 * COUNT)


# Model


def test_the_rotor_is_a_fifth_of_all_that_turns_and_of_the_time_constant() -> None:
    assert values("modelling", "bodies", "inertia") == pytest.approx(
        [1e6 * j for j in (ROTOR, HUB, DISC, HUB + DISC, J)], rel=1e-12
    )
    tau = values("modelling", "bodies", "tau")
    assert [round(each, 4) for each in tau[3:]] == [0.0807, 0.0998]
    assert tau == pytest.approx([R * j / K**2 for j in (ROTOR, HUB, DISC, HUB + DISC, J)], rel=1e-12)
    assert values("modelling", "bodies", "share") == pytest.approx(
        [100 * j / J for j in (ROTOR, HUB, DISC, HUB + DISC, J)], rel=1e-12
    )
    assert 0.18 < ROTOR / J < 0.21  # "a fifth"
    assert column("modelling", "bodies", "mass").values[1:3] == (0.0106, 0.053)
    assert column("modelling", "bodies", "radius").values[1:3] == (0.0111, 0.0248)


def test_table_1_is_the_data_sheet_and_the_recording_tells_gain_and_time_constant() -> None:
    ours, paper = (getattr(column("modelling", "table1", "value"), name) for name in ("values", "paper"))

    assert ours[:5] == pytest.approx([8.4, 0.042, 0.042, 4.0e-6, 1.16], rel=1e-12)
    assert paper == (8.4, 0.042, 0.042, 4.0e-6, 1.16, "", "", "", 0.13)
    assert ours[5] == pytest.approx(1000 * L / R, rel=1e-12)
    assert round(ours[6], 1) == 23.8
    # Intervals of the default experiment: 0.02 % of the gain, 0.3 % of the time constant, four of them.
    assert ours[7] == pytest.approx(GAIN, rel=1e-3)
    assert ours[8] == pytest.approx(TAU, rel=1.2e-2)


def test_the_poles_are_the_eigenvalues_of_the_equations() -> None:
    slow, fast = sorted(np.linalg.eigvals([[-R / L, -K / L], [K / J, 0.0]]).real)[::-1]
    short = -K * K / (R * J)
    poles = [values("modelling", "linear", f"pole{n}") for n in (1, 2, 3)]

    assert poles[0] == pytest.approx([short, 0, slow, 0], rel=1e-9)
    assert poles[1] == pytest.approx([math.nan, short, fast, slow], rel=1e-9, nan_ok=True)
    assert poles[2] == pytest.approx([math.nan] * 3 + [fast], rel=1e-9, nan_ok=True)
    assert column("modelling", "linear", "form").values == (
        "23.81 / (0.09977 s + 1)",
        "23.81 / (0.09977 s² + s)",
        "23.81 / (0.00001378 s² + 0.09977 s + 1)",
        "23.81 / (0.00001378 s³ + 0.09977 s² + s)",
    )
    facts = stand("modelling").facts
    assert facts["linear_gain"].value == pytest.approx(SHEET_GAIN, rel=1e-12)
    assert [facts[f"linear_{n}"].value for n in ("slow", "fast", "neglected", "electrical")] == pytest.approx(
        [-1 / slow, -1 / fast, -1 / short, L / R], rel=1e-9
    )


def test_models_beside_the_recording_are_off_by_what_the_equations_say() -> None:
    t = T * np.arange(5001)
    u = np.where((t * 0.4) % 1 < 0.5 - 1e-9, 3.0, 1.0)
    u = u if float(stand("modelling").recording["applied"].values[0]) == 3.0 else 4.0 - u
    u = u[:5000]
    assert np.array_equal(u, stand("modelling").recording["applied"].values)
    angle = march(TRUTH, u, T)[:, 2]
    measured = (angle[10:] - angle[:-10]) / (10 * T)
    errors = []
    for gain, tau in ((SHEET_GAIN, R * (HUB + DISC) / K**2), (SHEET_GAIN, R * J / K**2), (SHEET_GAIN, 0.13)):
        a, b, *_ = cont2discrete(([gain], [tau, 1.0, 0.0]), T, "zoh")
        a = np.atleast_2d(a)
        driven, held = (lfilter(a[0], b, x) for x in (u, np.ones(5000)))
        driven, held = ((x[10:] - x[:-10]) / (10 * T) for x in (driven, held))
        lost = np.linalg.lstsq(held[:, None], driven - measured, rcond=None)[0][0]
        errors.append(math.sqrt(float(np.mean((measured - driven + lost * held) ** 2))))
    rounding = COUNT / (10 * T) / math.sqrt(6)

    found = values("modelling", "beside", "error")
    # Whole counts add to it in quadrature; the smallest of them is as large as that, and takes up a part of it.
    assert found[:3] == pytest.approx([math.hypot(e, rounding) for e in errors], rel=0.1)
    assert found[3] == pytest.approx(rounding, rel=0.1)
    spread = float(np.std(measured))
    assert values("modelling", "beside", "fit") == pytest.approx(
        [100 * (1 - e / spread) for e in found], abs=0.01
    )
    assert f"an error of {rounding:.2g} rad/s" in stand("modelling").study_result("beside").tables[0].note


def test_the_step_responses_of_the_figure_are_those_of_the_transfer_functions() -> None:
    from servobench.lab.studies.linear_model import _step
    from servobench.systems.transfer_function import TransferFunction

    den = (L * J / K**2, R * J / K**2, 1.0)
    t = np.linspace(0, 0.5, 501)
    _, expected = lti([1 / K], den).step(T=t)

    # scipy integrates by matrix exponentials: rounding only.
    assert _step(TransferFunction(numerator=(1 / K,), denominator=den), t) == pytest.approx(
        expected, abs=1e-9
    )


def test_the_corrections_of_the_model_stand_on_algebra() -> None:
    # V = (R + k) I and J s Ω = k I: 1 V makes a constant acceleration.
    assert correction("modelling", "eq. 7") == pytest.approx(K / ((R + K) * (HUB + DISC)), rel=1e-12)
    assert correction("modelling", "eq. 5") == pytest.approx(R * J / K**2, rel=1e-12)
    assert correction("modelling", "II.E") == pytest.approx(TAU, rel=1.2e-2)
    # As the twin turns; the half of its 95 % interval is 6e-6 of it, and here are three of them.
    assert correction("modelling", "eq. 10") == pytest.approx(GAIN, rel=1.9e-5)


# All of them


@pytest.mark.parametrize("name", NAMES)
def test_every_study_stands_in_the_text_and_its_figures_can_be_drawn(name: str) -> None:
    found = exercise(name)
    assert [piece.study for piece in found.pieces if piece.study] == list(found.studies)
    for study in found.studies:
        for figure in stand(name).study_result(study).figures:
            for width in (360, 720):
                assert figure.draw(Style(width=width)).axes
            assert figure.caption.endswith(".")
            assert figure.description.endswith(".")


def test_a_recording_alone_is_enough_for_what_reads_and_told_where_a_study_needs_the_motor() -> None:
    found = exercise("driving")
    alone = stand_of(found, stand("driving").recording)

    assert (
        alone.study_result("levels").tables[0].columns[1].values
        == column("driving", "levels", "counts").values
    )
    with pytest.raises(NotIdentifiable, match="a single recording"):
        alone.study_result("breakaway")


def test_what_does_not_fit_a_study_is_reported() -> None:
    here = stand("sinusoid")
    with pytest.raises(UsageError, match="40 levels at most"):
        Levels()(here)
    with pytest.raises(UsageError, match="expected a whole number of them"):
        SinusoidResponse(waves=(Wave(frequency=0.37),))(here)
    with pytest.raises(NotIdentifiable, match=r"a pulse of 0\.1 V and 0\.5 s doesn't move the shaft"):
        PulseResponse(pulses=(Push(voltage=0.1),))(here)
    with pytest.raises(NotIdentifiable, match="the asymptote of the position is read off a single step"):
        StepReading()(stand("pulse"))
    with pytest.raises(UsageError, match="doesn't jump"):
        WrapTimes(bits=(24,), duration=0.1)(here)
    with pytest.raises(UnknownName, match="no body called 'arm'"):
        Inertias(bodies=(Body(name="disc", inertia=1e-5),), totals=(Total(name="all", of=("disc", "arm")),))(
            here
        )
    with pytest.raises(ValueError, match="a mass and a radius, or else an inertia"):
        Body(name="disc", mass=0.05)


def test_a_study_that_needs_a_data_sheet_says_so() -> None:
    found = replace(
        exercise("pulse"), experiment=exercise("pulse").experiment.model_copy(update={"nominal": ""})
    )

    with pytest.raises(
        UsageError, match=r'takes the gain of a data sheet, .* add nominal = "qube_servo_2" or'
    ):
        stand_on_the_twin(found).study_result("pulses")


def test_a_ramp_that_never_moves_the_shaft_gives_no_voltage() -> None:
    found = Breakaway(to=0.1, duration=2.0)(stand("driving"))
    starts = next(c for c in found.tables[0].columns if c.name == "start").values

    assert math.isnan(float(starts[0]))
    assert float(starts[1]) < 0.1  # without friction it moves


def test_a_motion_is_unwrapped_and_begins_at_zero() -> None:
    with sb.connect("twin", counter_bits=16, start_angle=99.0) as motor:
        recording = sb.run(sb.Experiment(signal=sb.Constant(value=10.0), duration=1.0), motor)
    motion = motion_of(recording)
    course = march(TRUTH, np.full(500, 10.0), T, angle=99.0)

    assert motion.angle[0] == 0
    assert motion.angle[-1] == pytest.approx(float(course[-1, 2] - 99.0), abs=2 * COUNT)
    assert motion.area == pytest.approx(10 * 499 * T, rel=1e-9)


def test_two_channels_are_decoded_to_the_counts_that_are_drawn() -> None:
    """A decoder that knows nothing but which state follows which: 10, 11, 01, 00 is forwards."""
    forwards = [(1, 0), (1, 1), (0, 1), (0, 0)]
    angle = np.concatenate(
        [np.linspace(0.01, 2.99, 1000), np.linspace(2.99, -1.99, 2000)]
    )  # lines, there and back
    a, b = quadrature.channels(angle)
    states = [forwards.index((int(x), int(y))) for x, y in zip(a, b, strict=True)]
    steps = [{0: 0, 1: 1, 3: -1}[(after - before) % 4] for before, after in pairwise(states)]

    assert np.array_equal(np.concatenate([[0], np.cumsum(steps)]), np.floor(4 * angle))


def test_a_line_of_the_disc_has_four_states_and_the_table_names_the_edge_between_them() -> None:
    (table,) = stand("encoder").study_result("channels").tables
    columns = {column.name: column.values for column in table.columns}
    states = list(zip(columns["a"], columns["b"], strict=True))

    assert columns["angle"] == pytest.approx([360 / 2048 * n for n in range(4)])
    assert len(set(states)) == 4
    for before, after, edge in zip([states[-1], *states], states, columns["edge"], strict=False):
        changed = [
            f"{name} to {now}" for name, then, now in zip("AB", before, after, strict=True) if then != now
        ]
        assert changed == [edge]
