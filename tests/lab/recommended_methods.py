"""The method that each exercise's text recommends, carried out by hand: on counts, voltages and currents alone.

Nothing in here calls the measurement chains, the estimators or the studies that know the right answers. What a student reads off
a scope is read off the samples, and what the text says to compute is computed with NumPy and SciPy.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from servobench.lab.stand import MotorStand
from servobench.rig.experiment.experiment import DeviceChoice
from servobench.systems.control.open_loop import OpenLoop
from servobench.systems.control.pid import Pid
from servobench.systems.signals.constant import Constant
from servobench.systems.signals.pulse import Pulse
from servobench.systems.signals.ramp import Ramp
from servobench.systems.signals.sine import Sine
from servobench.systems.signals.square import Square
from servobench.systems.signals.staircase import Staircase

Array = NDArray[np.float64]
Answers = Mapping[str, float]

COUNT = 2 * math.pi / 2048
# Table 1 of the paper, which every student has.
R, L, K, ROTOR = 8.4, 1.16e-3, 0.042, 4.0e-6
HUB, DISC = 0.5 * 0.0106 * 0.0111**2, 0.5 * 0.053 * 0.0248**2
J = ROTOR + HUB + DISC
SHEET_GAIN, SHEET_TAU = 1 / K, R * J / K**2


@dataclass(frozen=True, kw_only=True, eq=False)
class Course:
    """Times [s], the voltage that held from each on [V], the angle in whole counts [rad], and the current [A], (N,) each."""

    t: Array
    u: Array
    angle: Array
    current: Array
    ended: str

    @property
    def sample_time(self) -> float:
        return float(self.t[1] - self.t[0])

    @cached_property
    def speed(self) -> Array:
        """The plain difference of the angle [rad/s]."""
        return np.concatenate([[0.0], np.diff(self.angle)]) / self.sample_time

    def at(self, t: float) -> int:
        """The sample at a time."""
        return round((t - self.t[0]) / self.sample_time)

    def mean_speed(self, start: float, end: float) -> float:
        """The mean speed between two times [rad/s]."""
        return float((self.angle[self.at(end)] - self.angle[self.at(start)]) / (end - start))

    def lowpass(self, cutoff: float) -> Array:
        """The speed behind ω/(s + ω) by Tustin's rule: (1 + 2/ωT) y + (1 - 2/ωT) y' = x + x'."""
        return self._filter_columns(2 / (cutoff * self.sample_time), tustin=True)

    def euler(self, cutoff: float) -> Array:
        """The same by forward Euler: y = y' + ωT (x' - y')."""
        return self._filter_columns(cutoff * self.sample_time, tustin=False)

    def _filter_columns(self, a: float, *, tustin: bool) -> Array:
        x, y = self.speed, np.zeros(len(self.t))
        for n in range(1, len(y)):
            if tustin:
                y[n] = (x[n] + x[n - 1] - (1 - a) * y[n - 1]) / (1 + a)
            else:
                y[n] = y[n - 1] + a * (x[n - 1] - y[n - 1])
        return y


@dataclass(frozen=True, kw_only=True, eq=False)
class Student:
    """Somebody with a motor, or with its recording alone; what they get of it is in `Course`s."""

    stand: MotorStand

    @cached_property
    def own(self) -> Course:
        """The recording of the exercise's experiment."""
        return course(self.stand.recording)

    def run(self, *, faults: tuple[dict[str, Any], ...] = (), **changes: object) -> Course:
        """The exercise's experiment with some settings changed, carried out on the same motor."""
        asked = self.stand.experiment
        device = DeviceChoice(name=asked.device.name, settings=asked.device.settings, faults=faults)
        return course(self.stand.run(asked.model_copy(update={"device": device, **changes})))


def course(recording: Any) -> Course:
    """The columns of a recording's table."""
    counts = np.asarray(recording["counts"].values, dtype=float)
    bits = recording["counts"].channel.counter_bits
    jumps = np.diff(counts)
    jumps -= 2.0**bits * np.round(jumps / 2.0**bits)
    angle = COUNT * np.concatenate([[0.0], np.cumsum(jumps)])
    return Course(
        t=np.asarray(recording["counts"].t, dtype=float),
        u=np.asarray(recording["applied"].values, dtype=float),
        angle=angle,
        current=np.asarray(recording["current"].values, dtype=float),
        ended=recording.stopped.reason,
    )


# --- what a hand does


def first(condition: NDArray[np.bool_]) -> int:
    """The first sample where something holds."""
    assert condition.any()
    return int(np.argmax(condition))


def cursor(seen: Course, speed: Array, start: float, end: float) -> float:
    """The time from a step to the first sample at which the speed has passed 63.2 % of its change [s]: a cursor lies on a
    sample.
    """
    before = seen.mean_speed(start - 0.4, start) if start > 0.4 else 0.0
    after = seen.mean_speed(end - 0.5, end)
    part = speed[seen.at(start) : seen.at(end)]
    part = (part - before) / (after - before)
    return first(part >= 1 - math.exp(-1)) * seen.sample_time


def asymptote(seen: Course, start: float, cursors: tuple[float, float]) -> float:
    """The time from a step until the line through two points of the angle meets the angle before the step [s]."""
    a, b = cursors
    slope = seen.mean_speed(a, b)
    return a - start - float(seen.angle[seen.at(a)] - seen.angle[seen.at(start)]) / slope


@dataclass(frozen=True, kw_only=True)
class Fit:
    """K [rad/(s·V)], τ [s], the Coulomb voltage [V], and the residual of the angle (N,) [rad]."""

    gain: float
    tau: float
    lost: float
    residual: Array


def fitted(seen: Course, *, friction: bool = True) -> Fit:
    """Least squares of the angle of τ dω/dt = -ω + K (u - u_c sgn ω), which is solved in closed form between two edges.

    A delay and the angle at the start are fitted, too; with `friction` false a constant voltage stands in the place of u_c.
    """
    edges = [0, *(np.flatnonzero(np.diff(seen.u)) + 1), len(seen.t) - 1]
    levels = [(float(seen.t[a]), float(seen.u[a])) for a in edges[:-1]]
    one_way = float(seen.u.min()) >= 0 and len({u for _, u in levels if u}) < 2

    def angle(theta: Array) -> Array:
        gain, tau, delay, start = theta[:4]
        lost = 0.0 if one_way else theta[4]
        offset, friction_voltage = (0.0, lost) if friction else (lost, 0.0)
        moved = [(t + delay if number else t, u - offset) for number, (t, u) in enumerate(levels)]
        return start + motion(seen.t, moved, gain, tau, friction_voltage)

    theta = np.array([20.0, 0.08, 1e-4, 0.0, 0.15 if friction else 0.0])[: 4 if one_way else 5]
    # A wrong model likes to begin before its cause; two samples early is as far as rounded times allow.
    late = np.array([np.inf, np.inf, 0.1, np.inf, np.inf])[: len(theta)]
    early = np.array([-np.inf, 1e-3, -2 * seen.sample_time, -np.inf, -np.inf])[: len(theta)]
    scale = (1.0, 0.01, 1e-4, 1e-3, 0.01)[: len(theta)]
    found = least_squares(lambda x: angle(x) - seen.angle, theta, x_scale=scale, bounds=(early, late))
    lost = float(found.x[4]) if len(theta) == 5 else 0.0
    return Fit(gain=float(found.x[0]), tau=float(found.x[1]), lost=lost, residual=found.fun)


def motion(t: Array, levels: list[tuple[float, float]], gain: float, tau: float, lost: float) -> Array:
    """The angle (N,) from rest under levels of the voltage, each from its time on, with friction and rest between."""
    angle, theta, omega = np.zeros(len(t)), 0.0, 0.0
    ends = [*(start for start, _ in levels[1:]), float(t[-1]) + 1.0]
    for (start, u), end in zip(levels, ends, strict=True):
        now = start
        while now < end:
            turning = math.copysign(1.0, omega) if omega else math.copysign(1.0, u)
            if not omega and abs(u) <= lost:
                angle[t >= now] = theta
                break
            steady = gain * (u - lost * turning)
            rest = now + tau * math.log1p(-omega / steady) if omega * steady < 0 else math.inf
            until = min(end, rest)
            after = np.clip(np.append(t[t >= now], until), now, until) - now
            way = theta + steady * after + (omega - steady) * tau * -np.expm1(-after / tau)
            angle[t >= now] = way[:-1]
            theta = float(way[-1])
            omega = 0.0 if until == rest else steady + (omega - steady) * math.exp(-(until - now) / tau)
            now = until
    return angle


def fundamental(seen: Course, frequency: float, start: float) -> complex:
    """Speed over voltage at a frequency: whole periods of both, times 2 sin and 2 cos, and their means."""
    omega = 2 * math.pi * frequency
    periods = math.floor((seen.t[-1] - start) * frequency + 1e-6)
    first_sample = len(seen.t) - round(periods / (frequency * seen.sample_time))
    # A difference belongs to the middle between two samples, a voltage that is held to the middle of its sample.
    speed, voltage = seen.speed[first_sample:], seen.u[first_sample:]
    t = seen.t[first_sample:]
    y = np.mean(2 * speed * np.exp(-1j * omega * (t - seen.sample_time / 2)))
    u = np.mean(2 * voltage * np.exp(-1j * omega * (t + seen.sample_time / 2)))
    return complex(y / u)


def breaks_away(student: Student, to: float = 1.2, lasting: float = 24.0) -> float:
    """The voltage on a slow ramp at which the counter is first seen to move [V]."""
    ramp = Ramp(initial=0.0, final=to, start=0.0, duration=lasting)
    seen = student.run(signal=ramp, duration=lasting, sample_time=0.01)
    return float(seen.u[first(seen.angle != 0) - 1])


# --- exercise by exercise


def encoder(student: Student) -> Answers:
    counts = 4 * 512
    return {
        "counts": counts,
        "degrees": 360 / counts,
        "gain": 2 * math.pi / counts,
        "angle": 5120 * 2 * math.pi / counts,
        "restart": 0,
        "wrap": 2**24 / counts,
    }


def driving(student: Student) -> Answers:
    own = student.own
    answers = {
        "sign": math.copysign(1.0, own.angle[own.at(2.0)] - own.angle[own.at(1.0)]),
        "speed": own.mean_speed(1.5, 2.0),
        "heat": 10**2 / 8.4,
    }
    held = student.run(
        faults=({"name": "blocked_shaft", "from": 1.0},), signal=Constant(value=6.0), duration=6.0
    )
    breakaway = breaks_away(student)
    return answers | {
        "stall": float(held.t[-1]) - 1.0,
        "breakaway": breakaway,
        "lost": 100 * (0.5 - breakaway) / 0.5,
    }


def speed(student: Student) -> Answers:
    step, at = COUNT / 0.002, 47.6

    def noise(sample_time: float) -> float:
        f = at * sample_time / COUNT % 1
        return COUNT / sample_time * math.sqrt(f * (1 - f))

    return {
        "step": step,
        "modulus": 2**16,
        "jump": -(2**16) * step,
        "counts": at * 0.002 / COUNT,
        "noise": noise(0.002),
        "halved": noise(0.001) / noise(0.002),
    }


def edges_of_the_square(seen: Course) -> list[tuple[float, float]]:
    """Each edge that has a whole half period before it and behind it."""
    at = np.flatnonzero(np.diff(seen.u)) + 1
    return [(float(seen.t[a]), float(seen.t[b])) for a, b in pairwise(at)]


def filter_(student: Student) -> Answers:
    own = student.own
    behind = own.euler(50.0)
    return {
        "hertz": 50 / (2 * math.pi),
        "amplitude": 100 * abs(50 / (50j + 50)),
        "time": 1000 / 150,
        "lag": 1000 / 50 + 1,
        "read": float(np.mean([cursor(own, behind, a, b) for a, b in edges_of_the_square(own)])),
        "best": least_wrong_cutoff(student.run(duration=40.0)),
    }


def least_wrong_cutoff(own: Course) -> float:
    """The cut-off whose readings are least wrong, in steps of a fifth: root mean square about the τ that Identify gives."""
    tau = fitted(own).tau
    found = {}
    for cutoff in 500.0 / 1.2 ** np.arange(0, 12):
        behind = own.euler(cutoff)
        read = [cursor(own, behind, a, b) - 0.5 * own.sample_time for a, b in edges_of_the_square(own)]
        found[cutoff] = float(np.sqrt(np.mean((np.array(read) - tau) ** 2)))
    return min(found, key=lambda each: found[each])


def step(student: Student) -> Answers:
    own = student.own
    tau = asymptote(own, 1.0, (2.5, 3.498))
    return {
        "gain": own.mean_speed(2.998, 3.498) / 1.0,
        "level": 100 * (1 - math.exp(-1)),
        "read": cursor(own, own.lowpass(50.0), 1.0, 3.498),
        "lag": 1000 / 50,
        "time_constant": tau,
        "pole": -1 / tau,
    }


def pulse(student: Student) -> Answers:
    def moved(seen: Course) -> float:
        """The time for which the shaft moved: from the beginning of the pulse to the last count [s]."""
        return float(seen.t[np.flatnonzero(np.diff(seen.angle))[-1] + 1]) - 0.2

    own = student.own
    answers = {
        "area": 1 * 0.5,
        "linear": SHEET_GAIN * 0.5,
        "angle": float(own.angle[-1]),
        "speed": float(own.angle[-1] - own.angle[-100]),
    }
    high = student.run(signal=Pulse(rest=0.0, level=2.0, start=0.2, width=0.25), duration=0.2 + 0.25 + 1.5)
    # θ = K (A - u_c t) twice, with the same K and A.
    a, b = (float(each.angle[-1]) for each in (own, high))
    return answers | {"friction": 0.5 * (b - a) / (b * moved(own) - a * moved(high))}


def sinusoid(student: Student) -> Answers:
    def wave(offset: float) -> Course:
        return student.run(signal=Sine(amplitude=1.0, offset=offset, frequency=0.4), duration=10.002)

    shifted, bare = wave(2.0), wave(0.0)
    late = shifted.lowpass(50.0)[shifted.at(2.5) :]
    omega = 2 * math.pi * 0.4
    return {
        "omega": omega,
        "ratio": 100 / math.hypot(1, omega * SHEET_TAU),
        "amplitude": 0.5 * float(late.max() - late.min()),
        "drift": float(shifted.angle[shifted.at(7.5)] - shifted.angle[shifted.at(5.0)]),
        "stays": float(bare.angle[bare.at(7.5)] - bare.angle[bare.at(5.0)]),
    }


def stability(student: Student) -> Answers:
    own = student.own
    tau = fitted(own).tau
    swing = student.run(signal=Sine(amplitude=1.0, frequency=0.4), duration=5.002)
    return {
        "pole": -1 / tau,
        "axis": 1,
        "drift": own.mean_speed(1.998, 2.498),
        "sinusoid": float(swing.angle[swing.at(5.0)] - swing.angle[swing.at(2.5)]),
        "enough": 1,
        "rest": breaks_away(student),
    }


def modelling(student: Student) -> Answers:
    return {
        "disc": DISC,
        "inertia": J,
        "gain": 1 / K,
        "tau": SHEET_TAU,
        "electrical": 1000 * L / R,
        "found": fitted(student.own).tau,
    }


def identification(student: Student) -> Answers:
    found = fitted(student.own)
    return {"time_constant": found.tau, "gain": found.gain}


def validation(student: Student) -> Answers:
    own = student.own
    plain = fitted(own, friction=False).residual
    missed = float(np.sqrt(np.mean(plain**2)))
    return {
        "rounding": 1 / math.sqrt(12),
        "by_chance": 1.5,
        "trained": 100 * (1 - missed / float(np.std(own.angle))),
        "times": missed / COUNT * math.sqrt(12),
        "friction": fitted(own).lost,
    }


def sampling(student: Student) -> Answers:
    euler = 1 - 0.02 / SHEET_TAU
    return {
        "coarse": COUNT / 0.001,
        "electrical": 1000 * L / R,
        "limit": 2000 * L / R,
        "factor": 1 - 0.002 * R / L,
        "seen": -0.02 / math.log(euler),
        "halved": fitted(student.own).tau / 2,
    }


def noise(student: Student) -> Answers:
    held = student.run(signal=Constant(value=3.0), duration=5.0)
    n = 20  # samples of 40 ms
    ends = np.arange(held.at(2.0), len(held.t))
    window = np.array([held.angle[e - n : e + 1] for e in ends])
    differences = (window[:, -1] - window[:, 0]) / 0.04
    x = 0.002 * (np.arange(n + 1) - n / 2)
    lines = window @ x / (x @ x)
    return {
        "worst": COUNT / 0.004 / 2,
        "average": COUNT / 0.002 / math.sqrt(6),
        "window": 20,
        "better": float(np.std(differences) / np.std(lines)),
    }


def frequency_response(student: Student) -> Answers:
    constant = student.run(signal=Constant(value=3.0), duration=3.0)
    steady = constant.mean_speed(2.0, 2.998) / 3
    responses = {}
    for frequency in (0.4, 0.8, 1.2, 1.6, 2.0, 2.4, 2.8, 4.8):
        duration = 1.002 + math.ceil(2 * frequency) / frequency
        seen = student.run(signal=Sine(amplitude=3.0, offset=0.0, frequency=frequency), duration=duration)
        responses[frequency] = fundamental(seen, frequency, 1.0)
    f = np.array(list(responses))
    decibels = 20 * np.log10(np.abs(list(responses.values())))
    level = 20 * math.log10(steady / math.sqrt(2))
    n = first(decibels < level)
    corner = 2 * math.pi * math.exp(np.interp(-level, -decibels[n - 1 : n + 1], np.log(f[n - 1 : n + 1])))
    phase = float(np.angle(responses[0.4]))
    return {
        "steady": steady,
        "decibels": float(decibels[0]),
        "half_power": steady / math.sqrt(2),
        "corner": corner,
        "by_magnitude": 1 / corner,
        "by_phase": math.tan(-phase) / (2 * math.pi * 0.4),
    }


def parameter_estimation(student: Student) -> Answers:
    volts = [v for v in range(-5, 6) if v]

    def levels(dwell: float, **changes: Any) -> tuple[Array, Array]:
        """Speed and current in the second half of each level."""
        signal = Staircase(levels=tuple(map(float, volts)), dwell=dwell)
        seen = student.run(signal=signal, duration=dwell * len(volts), **changes)
        ends = [(n + 1) * dwell - seen.sample_time for n in range(len(volts))]
        halves = [slice(seen.at(end - dwell / 2) + 1, seen.at(end) + 1) for end in ends]
        speeds = [seen.mean_speed(end - dwell / 2, end) for end in ends]
        return np.array(speeds), np.array([seen.current[half].mean() for half in halves])

    _, held = levels(1.0, faults=({"name": "blocked_shaft"},))
    resistance = float(np.polyfit(held, volts, 1)[0])
    omega, current = levels(2.0)
    k = float(np.mean((np.array(volts) - resistance * current) / omega))
    torque = k * current
    # The line on either side of rest: its slope is b, and half of the step between the two is friction.
    (up, above), (down, below) = (np.polyfit(omega[part], torque[part], 1) for part in (omega > 0, omega < 0))
    return {
        "current": float(held[volts.index(3)]),
        "resistance": resistance,
        "torque_constant": k,
        "inertia": J,
        "time_constant": resistance * J / (resistance * 0.5 * float(up + down) + k**2),
        "torque": 1000 * 0.5 * float(above - below),
    }


def second_order(student: Student) -> Answers:
    own = student.own
    frequency = math.sqrt(SHEET_GAIN * 2 / SHEET_TAU)
    damping = 1 / (2 * frequency * SHEET_TAU)
    root = math.sqrt(1 - damping**2)
    return {
        "frequency": frequency,
        "damping": damping,
        "peak": 1000 * math.pi / (frequency * root),
        "overshoot": 100 * math.exp(-math.pi * damping / root),
        "measured": 100 * (float(own.angle.max()) - 1.0),
        "largest": 10 / 5,
    }


def pd(student: Student) -> Answers:
    damping = -math.log(0.025) / math.hypot(math.pi, math.log(0.025))
    frequency = math.pi / (0.15 * math.sqrt(1 - damping**2))
    kp = frequency**2 * SHEET_TAU / SHEET_GAIN
    return {
        "damping": damping,
        "frequency": frequency,
        "kp": kp,
        "kd": (2 * damping * frequency * SHEET_TAU - 1) / SHEET_GAIN,
        "voltage": 1.5 * kp,
        "beyond": max(float(student.own.angle.max()) - 1.5, 0.0),
    }


def lead(student: Student) -> Answers:
    crossover = 60.0
    left = 90 - math.degrees(math.atan(crossover * SHEET_TAU))
    missing = 75 - left + math.degrees(crossover * 0.001)
    ratio = (1 + math.sin(math.radians(missing))) / (1 - math.sin(math.radians(missing)))
    gain = crossover * math.hypot(1, crossover * SHEET_TAU) / (SHEET_GAIN * math.sqrt(ratio))
    return {
        "left": left,
        "lead": missing,
        "ratio": ratio,
        "zero": crossover / math.sqrt(ratio),
        "gain": gain,
        "voltage": gain * ratio,
    }


def steady_state_error(student: Student) -> Answers:
    square = student.run(
        signal=Square(low=1.0, high=3.0, frequency=0.4), controller=OpenLoop(), duration=10.0
    )
    own = student.own
    end = own.t > 6.0 - 0.5
    return {
        "type": 1,
        "step": 0,
        "ramp": 5 / (SHEET_GAIN * 5),
        "derivative": 5 * (1 + 0.25 * SHEET_GAIN) / (SHEET_GAIN * 5),
        "friction": fitted(square).lost / 5,
        "measured": float(np.mean(5 * own.t[end] - own.angle[end])),
    }


def routh(student: Student) -> Answers:
    a = 10.0
    return {
        "square": 1 + a * SHEET_TAU,
        "limit": a * (1 + a * SHEET_TAU) / (SHEET_TAU * SHEET_GAIN),
        "right": 2,
        "frequency": math.sqrt(a / SHEET_TAU),
        "tried": swings_for_ever(student),
    }


def swings_for_ever(student: Student) -> float:
    """The gain at which peaks neither rise nor fall, by halving from 1 to 40 until it is known to within 2 %."""

    def growing(k: float) -> bool:
        law = Pid(output="speed", kp=0.0, ki=k / 10, cutoff=10.0)
        seen = student.run(controller=law, signal=Ramp(initial=0.0, final=60.0, duration=0.5), duration=6.0)
        speed = seen.lowpass(50.0)
        early, late = speed[seen.at(1.0) : seen.at(3.0)], speed[seen.at(4.0) : seen.at(5.998)]
        return float(late.max() - late.min()) > float(early.max() - early.min())

    low, high = 1.0, 40.0
    while high / low > 1.02:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if growing(middle) else (middle, high)
    return math.sqrt(low * high)


METHODS: Mapping[str, Callable[[Student], Answers]] = {
    **{
        each.__name__: each
        for each in (
            encoder, driving, speed, step, pulse, sinusoid, stability, modelling, identification, validation, sampling,
            noise, frequency_response, parameter_estimation, second_order, pd, lead, steady_state_error, routh,
        )
    },
    "filter": filter_,
}  # fmt: skip
