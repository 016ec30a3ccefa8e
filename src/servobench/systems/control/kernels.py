"""The laws, compiled: each is (state x, numbers p, reference, counts, time) -> (next state, voltage); each law's file states it.

A loop that is compiled as a whole calls `pid_into` and the like, which fill the next state in and make no array.

Sources: see `control.pid`, and for the others the file of each.

All begin with the same numbers and states: those of the shaft, of what is followed, and of the integral and the bias. States x
(and `new`, the next ones) are (X,), numbers p are (P,), laid out below. The reference is in rad or rad/s, times are in s.
"""

from __future__ import annotations

import math

import numpy as np

from servobench.core.channels import Array
from servobench.core.compiled import compiled, strictly_compiled, strictly_inlined

# States. The travel is a whole number of counts, exact up to 2^53: 285 years at a million counts a second.
SEEN, TIME, TRAVEL, SLOPE, SPEED, INTEGRAL, BIAS, OWN = range(8)
# Values of SEEN: at rest before the first sample; taken over, before and after its first sample; under way.
AT_REST, TAKEN_OVER, ONE_SAMPLE, UNDER_WAY = 0.0, 1.0, 2.0, 3.0
# Numbers.
SAMPLE_TIME, SCALE, MODULUS, LOWEST, HIGHEST, CUTOFF, FOLLOWS_SPEED, KI, TRACKING, FADE, GAINS = range(11)
# Of PID: states of the reference's and of the speed's derivative.
REFERENCE, REFERENCE_SLOPE, REFERENCE_RATE, SPEED_SLOPE, SPEED_RATE = range(OWN, OWN + 5)
KP, KD, WEIGHT_P, WEIGHT_D = range(GAINS, GAINS + 4)
# Of lead: its own output and the error of the sample before.
LED, ERROR = range(OWN, OWN + 2)
LEAD_GAIN, ZERO, POLE = range(GAINS, GAINS + 3)
# Of state feedback.
K_POSITION, K_SPEED, K_REFERENCE = range(GAINS, GAINS + 3)

_LONGEST_STEP = (
    10.0  # sample times that an integral counts at once: a law was not in charge through a longer gap
)

PID, LEAD, STATE_FEEDBACK = 1, 2, 3
"""The numbers of the laws for `voltage_of`; 0 is none, as in open loop."""


@compiled
def pid(x: Array, p: Array, reference: float, counts: int, time: float) -> tuple[Array, float]:
    """Return the next state of `pid_into`, and the voltage."""
    new = np.empty_like(x)
    return new, pid_into(new, x, p, reference, counts, time)


@compiled
def lead(x: Array, p: Array, reference: float, counts: int, time: float) -> tuple[Array, float]:
    """Return the next state of `lead_into`, and the voltage."""
    new = np.empty_like(x)
    return new, lead_into(new, x, p, reference, counts, time)


@compiled
def state_feedback(x: Array, p: Array, reference: float, counts: int, time: float) -> tuple[Array, float]:
    """Return the next state of `state_feedback_into`, and the voltage."""
    new = np.empty_like(x)
    return new, state_feedback_into(new, x, p, reference, counts, time)


@strictly_compiled
def pid_into(new: Array, x: Array, p: Array, reference: float, counts: int, time: float) -> float:
    """u = kp (b r - y) + ∫ ki (r - y) dt + kd d/dt (c r - y), the derivative filtered."""
    for k in range(len(x)):
        new[k] = x[k]
    speed_before = x[SPEED]
    dt = take_sample(new, p, counts, time)
    y, rate = new[TRAVEL] * p[SCALE], new[SPEED]
    if p[FOLLOWS_SPEED] != 0.0:
        if dt > 0.0 and x[SEEN] == UNDER_WAY:
            slope = (new[SPEED] - speed_before) / dt
            new[SPEED_RATE] = lowpass_step(x[SPEED_RATE], slope, x[SPEED_SLOPE], p[CUTOFF] * dt)
            new[SPEED_SLOPE] = slope
        y, rate = new[SPEED], new[SPEED_RATE]
    if dt > 0.0:
        slope = (reference - x[REFERENCE]) / dt
        new[REFERENCE_RATE] = lowpass_step(x[REFERENCE_RATE], slope, x[REFERENCE_SLOPE], p[CUTOFF] * dt)
        new[REFERENCE_SLOPE] = slope
    new[REFERENCE] = reference
    if x[SEEN] == ONE_SAMPLE:
        complete_switch(new, p, p[KP] if p[FOLLOWS_SPEED] != 0.0 else p[KD])
    feedback = p[KP] * (p[WEIGHT_P] * reference - y) + p[KD] * (p[WEIGHT_D] * new[REFERENCE_RATE] - rate)
    return settle_voltage(new, p, dt, reference - y, feedback)


@strictly_compiled
def lead_into(new: Array, x: Array, p: Array, reference: float, counts: int, time: float) -> float:
    """u = gain (1 + s/zero)/(1 + s/pole) (r - y), by the trapezoid rule."""
    for k in range(len(x)):
        new[k] = x[k]
    dt = take_sample(new, p, counts, time)
    y = new[SPEED] if p[FOLLOWS_SPEED] != 0.0 else new[TRAVEL] * p[SCALE]
    error = reference - y
    if x[SEEN] != UNDER_WAY:
        # Nothing has changed before the first sample that it sees, nor before the first that tells the speed.
        new[LED] = p[LEAD_GAIN] * error
    elif dt > 0.0:
        half = 0.5 * dt
        rise = (1.0 / p[ZERO] + half) * error - (1.0 / p[ZERO] - half) * x[ERROR]
        new[LED] = ((1.0 / p[POLE] - half) * x[LED] + p[LEAD_GAIN] * rise) / (1.0 / p[POLE] + half)
    new[ERROR] = error
    if x[SEEN] == ONE_SAMPLE and p[FOLLOWS_SPEED] != 0.0:
        complete_switch(new, p, p[LEAD_GAIN])
    return settle_voltage(new, p, dt, error, new[LED])


@strictly_compiled
def state_feedback_into(new: Array, x: Array, p: Array, reference: float, counts: int, time: float) -> float:
    """u = k_r r - k_θ θ - k_ω ω + ∫ k_i (r - y) dt."""
    for k in range(len(x)):
        new[k] = x[k]
    dt = take_sample(new, p, counts, time)
    position, speed = new[TRAVEL] * p[SCALE], new[SPEED]
    if x[SEEN] == ONE_SAMPLE:
        complete_switch(new, p, p[K_SPEED])
    y = speed if p[FOLLOWS_SPEED] != 0.0 else position
    feedback = p[K_REFERENCE] * reference - p[K_POSITION] * position - p[K_SPEED] * speed
    return settle_voltage(new, p, dt, reference - y, feedback)


@strictly_inlined
def voltage_of(law: int, new: Array, x: Array, p: Array, reference: float, counts: int, time: float) -> float:
    """Return the voltage [V] of the law of that number, and fill its next states in, `new` (X,); the rest as in the laws."""
    if law == PID:
        return pid_into(new, x, p, reference, counts, time)
    if law == LEAD:
        return lead_into(new, x, p, reference, counts, time)
    return state_feedback_into(new, x, p, reference, counts, time)


@strictly_compiled
def take_sample(new: Array, p: Array, counts: int, time: float) -> float:
    """Take a sample into a state: travel and filtered speed. Return the time since the sample before, 0 where there was none.

    A step of the counter is the shortest one that leads to its new value (half-range rule). A sample that is no later than
    the one before tells no speed; the travel counts it.
    """
    if new[SEEN] == AT_REST or new[SEEN] == TAKEN_OVER:
        new[SEEN] = UNDER_WAY if new[SEEN] == AT_REST else ONE_SAMPLE
        new[TIME], new[TRAVEL] = time, counts
        return 0.0
    step = counts - np.int64(new[TRAVEL])
    if p[MODULUS] > 0.0:
        modulus = np.int64(p[MODULUS])
        step = (step + modulus // 2) % modulus - modulus // 2
    dt = time - new[TIME]
    new[TRAVEL] += step
    new[TIME] = time
    if dt <= 0.0:
        return 0.0
    slope = step * p[SCALE] / dt
    if new[SEEN] == ONE_SAMPLE:
        # The first difference after a switch is all that is known of a speed that the filter hasn't followed.
        new[SEEN], new[SPEED] = UNDER_WAY, slope
    else:
        new[SPEED] = lowpass_step(new[SPEED], slope, new[SLOPE], p[CUTOFF] * dt)
    new[SLOPE] = slope
    return float(dt)


@strictly_compiled
def lowpass_step(y: float, x: float, x_before: float, h: float) -> float:
    """Return the next output of ω/(s + ω) by the trapezoid rule, with h = ω dt: the stage `lowpass`."""
    gain = 0.5 * h / (1.0 + 0.5 * h)
    return (1.0 - 0.5 * h) / (1.0 + 0.5 * h) * y + gain * (x + x_before)


@strictly_compiled
def complete_switch(new: Array, p: Array, per_speed: float) -> None:
    """Give back to the integral or the bias what the voltage loses to a speed that was not known at the switch."""
    if new[SEEN] != UNDER_WAY:
        return
    if p[KI] != 0.0:
        new[INTEGRAL] += per_speed * new[SPEED]
    elif p[FADE] > 0.0:
        new[BIAS] += per_speed * new[SPEED]


@strictly_compiled
def settle_voltage(new: Array, p: Array, dt: float, error: float, feedback: float) -> float:
    """Return the voltage with the integral and the bias of this tick; where it is beyond a limit, take the integral back.

    The integral follows what the limit leaves, dI/dt = ki e + (limited - wanted)/T_t (back-calculation).
    """
    new[INTEGRAL] += p[KI] * error * min(dt, _LONGEST_STEP * p[SAMPLE_TIME])
    if new[BIAS] != 0.0:
        new[BIAS] *= math.exp(-dt / p[FADE])
        if abs(new[BIAS]) < 1e-6:
            new[BIAS] = 0.0
    wanted = feedback + new[INTEGRAL] + new[BIAS]
    limited = min(max(wanted, p[LOWEST]), p[HIGHEST])
    if p[KI] != 0.0 and dt > 0.0:
        new[INTEGRAL] += (limited - wanted) * min(dt / p[TRACKING], 1.0)
    return float(wanted)
