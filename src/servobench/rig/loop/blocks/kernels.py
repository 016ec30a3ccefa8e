"""A block of ticks of a run in virtual time, compiled: the twin, its sensors, the guard and the control law in one call.

Each tick does what `run_ticks` does with `Guarded` around a `Twin`, operation by operation and each rounded by itself, so that
the results are the same to the last bit. A tick in which anything isn't ordinary (a monitor's alarm, a value that isn't finite,
a shaft that may be running away) isn't done: the block ends before it, and `run_ticks` does it.

The numbers p (P,) and the state s (S,) are laid out in `servobench.rig.devices.handover`, c (19,) are the motor's coefficients.
Of a control law x (X,) is the state, `gains` (G,) are its numbers, and `after` (X,) is the next state. `coming` (M, 2) has the
voltages that are yet to act, `normals` (R,) normal numbers, and `rows` (N, C) what is recorded. Everything is in SI units.
"""

from __future__ import annotations

import math

import numpy as np

from servobench.core.channels import Array
from servobench.core.compiled import stack_room, strictly_compiled, strictly_inlined
from servobench.rig.devices import handover as at
from servobench.rig.devices.guard.plausibility import BAND, BLOCKED_SHARE
from servobench.rig.devices.guard.polarity import FEWEST_COUNTS, FEWEST_POINTS, MOST_POINTS
from servobench.rig.devices.guard.steps import ROUNDING
from servobench.rig.motor import kernels as motor
from servobench.rig.motor.plant import SAME
from servobench.systems.control import kernels as laws

_FAR = 2.0**62  # counts
room_of_numbers, room_of_state = stack_room(at.NUMBERS), stack_room(at.FIRST_POINT)


@strictly_compiled
def run_block(
    c: Array,
    p: Array,
    s: Array,
    new: Array,
    coming: Array,
    law: int,
    gains: Array | None,
    x: Array | None,
    after: Array | None,
    references: Array,
    normals: Array,
    parts: Array,
    factors: Array,
    rows: Array,
) -> int:
    """Do the ticks after the last one, one for each reference (N,), and return how many were ordinary; the rest isn't done.

    Changes `s`, the control law's state `x`, and the queue `coming` (M + N, 2) of which s says what is filled; `new` and `after`
    are room for the next s and x. `normals` are drawn in advance, as many as the ticks may need; `factors` (N, 3, 3) are what
    three of them do as a random torque in a whole tick and in its `parts` (N,), each in billionths; N is 0 without such a torque.
    Fills a row for each tick: time, commanded, applied, counts, tachometer and current where there are any, time due, late,
    saturated, and the reference under control.
    """
    for k in range(at.FIRST_POINT, len(s)):
        new[k] = s[k]
    # The numbers are those of this function alone, so that they may stand in registers.
    held, begun, ended = room_of_numbers(), room_of_state(), room_of_state()
    for k in range(at.NUMBERS):
        held[k] = p[k]
    for k in range(at.FIRST_POINT):
        begun[k] = ended[k] = s[k]
    done = 0
    while done < len(references):
        reference = references[done]
        if not latch(c, held, ended, coming, normals, parts, factors):
            break
        counts, time = int(ended[at.COUNTS]), ended[at.TIME]
        looked = held[at.POLARITY] != 0.0 and gather_impulse(held, ended)
        if looked and may_run_away(held, ended, new):
            break
        commanded = reference
        if gains is not None and x is not None and after is not None:
            commanded = laws.voltage_of(law, after, x, gains, reference, counts, time)
        if not (math.isfinite(reference) and math.isfinite(commanded)):
            break
        write_voltage(held, ended, coming, commanded, time)
        for k in range(at.FIRST_POINT):
            begun[k] = ended[k]
        if looked:
            for k in range(at.FIRST_POINT, at.FIRST_POINT + at.POINT * int(ended[at.POINTS])):
                s[k] = new[k]
        if x is not None and after is not None:
            for k in range(len(x)):
                x[k] = after[k]
        fill(rows, done, held, ended, reference)
        done += 1
    for k in range(at.FIRST_POINT):
        s[k] = begun[k]
    return done


@strictly_inlined
def latch(c: Array, p: Array, s: Array, coming: Array, normals: Array, parts: Array, factors: Array) -> bool:
    """Carry the motor to the next tick, read it and check what was read; return False where that isn't ordinary."""
    s[at.INDEX] += 1.0
    now = s[at.INDEX] * p[at.TICK]
    if not (now < math.inf and advance_to(c, p, s, coming, normals, parts, factors, now)):
        return False
    turned = np.floor(s[at.THETA] * p[at.COUNTS_PER_REV] / (2 * math.pi))
    if not -_FAR < turned < _FAR:
        return False
    counts = wrap(int(turned), int(p[at.HALF_RANGE]))
    if len(normals) > 0 and s[at.DRAWS] + 2.0 > len(normals):
        return False
    read_sensors(p, s, normals)
    if not (math.isfinite(s[at.SEEN_SPEED]) and math.isfinite(s[at.SEEN_CURRENT])):
        return False
    take_motion(p, s, counts, now)
    if s[at.TIME] - s[at.FED_AT] > p[at.TIMEOUT] or is_alarming(p, s) or stalls(p, s):
        return False
    return not (p[at.PATIENCE] > 0.0 and stands_still(p, s))


@strictly_inlined
def advance_to(
    c: Array, p: Array, s: Array, coming: Array, normals: Array, parts: Array, factors: Array, time: float
) -> bool:
    """Carry the motor forward to a time, as `Plant.advance_to`; return False where that takes more than is here."""
    while s[at.FIRST_COMING] < s[at.COMING]:
        first = int(s[at.FIRST_COMING])
        if not coming[first, 0] <= time + SAME * p[at.TICK]:
            break
        s[at.FIRST_COMING] += 1.0
        if not advance(c, p, s, normals, parts, factors, coming[first, 0]):
            return False
        s[at.VOLTAGE] = coming[first, 1]
    return advance(c, p, s, normals, parts, factors, time)


@strictly_inlined
def advance(c: Array, p: Array, s: Array, normals: Array, parts: Array, factors: Array, time: float) -> bool:
    """Carry the motor forward under one voltage."""
    h = p[at.TICK]
    while True:
        left = time - s[at.PLANT_TIME]
        if not left > SAME * h:
            return True
        step = h if left > (1 - SAME) * h else left
        if p[at.BLOCKED] != 0.0:
            return False
        i, w, theta, v = s[at.CURRENT], s[at.SPEED], s[at.THETA], s[at.VOLTAGE]
        if step == h:
            i, w, theta = motor.tick(c, i, w, theta, v)
        else:
            i, w, theta = motor.advance_switching(c, i, w, theta, v, step)
        if len(factors) > 0 and w != 0.0:
            f, n = 0 if step == h else place_of(parts, step / (SAME * h)), int(s[at.DRAWS])
            if f < 0 or n + 3 > len(normals):
                return False
            x, y, z = normals[n], normals[n + 1], normals[n + 2]
            i += factors[f, 0, 0] * x + factors[f, 0, 1] * y + factors[f, 0, 2] * z
            w += factors[f, 1, 0] * x + factors[f, 1, 1] * y + factors[f, 1, 2] * z
            theta += factors[f, 2, 0] * x + factors[f, 2, 1] * y + factors[f, 2, 2] * z
            s[at.DRAWS] += 3.0
        s[at.CURRENT], s[at.SPEED], s[at.THETA] = i, w, theta
        s[at.PLANT_TIME] = time if left <= (1 + SAME) * h else s[at.PLANT_TIME] + step


@strictly_inlined
def place_of(parts: Array, part: float) -> int:
    """Return where a part of a tick stands among those that are known, but for rounding; -1 where it isn't one of them."""
    whole = np.rint(part)
    for k in range(1, len(parts)):
        if parts[k] == whole:
            return k
    return -1


@strictly_inlined
def wrap(whole: int, half: int) -> int:
    """Return a count as a signed counter of 2 half numbers shows it."""
    if -half <= whole < half:
        return whole  # what follows is the slowest of all that a tick does
    return (whole + half) % (2 * half) - half


@strictly_inlined
def read_sensors(p: Array, s: Array, normals: Array) -> None:
    """Read the tachometer, then the current sensor; 0 where there is none."""
    if p[at.SPEED_STEP] > 0.0:
        speed = s[at.SPEED] + noise(s, normals, p[at.SPEED_NOISE])
        s[at.SEEN_SPEED] = quantise(speed, p[at.SPEED_STEP])
    if p[at.CURRENT_STEP] > 0.0:
        current = s[at.CURRENT] + noise(s, normals, p[at.CURRENT_NOISE])
        largest = p[at.CURRENT_RANGE]
        s[at.SEEN_CURRENT] = larger(-largest, smaller(largest, quantise(current, p[at.CURRENT_STEP])))


@strictly_inlined
def noise(s: Array, normals: Array, deviation: float) -> float:
    """Return the next number of a normal distribution; without a deviation none is drawn."""
    if deviation == 0.0:
        return 0.0
    s[at.DRAWS] += 1.0
    return float(0.0 + deviation * normals[int(s[at.DRAWS]) - 1])


@strictly_inlined
def quantise(value: float, step: float) -> float:
    """Return the nearest multiple of a step; a whole number of Python is never -0."""
    return float((np.rint(value / step) + 0.0) * step)


@strictly_inlined
def smaller(a: float, b: float) -> float:
    """Return min(a, b) as Python does."""
    return b if b < a else a


@strictly_inlined
def larger(a: float, b: float) -> float:
    """Return max(a, b) as Python does."""
    return b if b > a else a


@strictly_inlined
def take_motion(p: Array, s: Array, counts: int, time: float) -> None:
    """Take a sample, as `Motion.take`."""
    dt = time - s[at.TIME]
    if not dt > 0.0:
        dt = p[at.TICK]
    step = counts - int(s[at.COUNTS])
    if p[at.HALF_COUNTER] > 0.0:
        step = wrap(step, int(p[at.HALF_COUNTER]))
    s[at.COUNTS], s[at.TIME], s[at.DT], s[at.STEP] = counts, time, dt, step
    s[at.POSITION] += step
    s[at.SMOOTH_SPEED] += (s[at.STEP] * p[at.ANGLE] / dt - s[at.SMOOTH_SPEED]) * dt / (p[at.SMOOTHING] + dt)
    fastest = abs(s[at.SMOOTH_SPEED])
    if p[at.SPEED_STEP] > 0.0:
        speed = abs(s[at.SEEN_SPEED])
        fastest = fastest if speed <= fastest else speed
    s[at.FASTEST] = fastest


@strictly_inlined
def is_alarming(p: Array, s: Array) -> bool:
    """Return whether a monitor without a memory has an alarm: of current, speed, travel or steps."""
    if p[at.MOST_CURRENT] < math.inf and not abs(s[at.SEEN_CURRENT]) <= p[at.MOST_CURRENT]:
        return True
    if not s[at.FASTEST] <= p[at.MOST_SPEED] or not abs(s[at.POSITION]) <= p[at.MOST_TRAVEL]:
        return True
    if p[at.STEPS] == 0.0:
        return False
    fastest, half, step = p[at.FASTEST_STEP], p[at.HALF_COUNTER], abs(s[at.STEP])
    if math.isnan(fastest):
        return bool(step >= half)
    possible = fastest * s[at.DT]
    if half > 0.0 and possible >= half:
        return True
    return bool(step > possible + fastest * p[at.TICK] + ROUNDING)


@strictly_inlined
def stalls(p: Array, s: Array) -> bool:
    """Return whether the shaft was stalled for too long, as `StallMonitor.check`."""
    if abs(s[at.APPLIED]) <= p[at.STALL_VOLTAGE] or not abs(s[at.SMOOTH_SPEED]) < p[at.STALL_SPEED]:
        s[at.STALLED] = 0.0
        return False
    warned = s[at.STALLED] >= p[at.STALL_WARNING]
    s[at.STALLED] += s[at.DT]
    s[at.LONGEST_STALL] = larger(s[at.LONGEST_STALL], s[at.STALLED])
    if not warned and s[at.STALLED] >= p[at.STALL_WARNING]:
        s[at.STALL_WARNINGS] += 1.0
    return bool(s[at.STALLED] >= p[at.STALL_DURATION])


@strictly_inlined
def stands_still(p: Array, s: Array) -> bool:
    """Return whether the encoder stands although the motor must be turning, as `PlausibilityMonitor.check`."""
    u, dt = s[at.APPLIED], s[at.DT]
    if -BAND <= s[at.POSITION] - s[at.ANCHOR] <= BAND:
        s[at.STANDING] += dt
    else:
        s[at.ANCHOR], s[at.STANDING], s[at.BEFORE] = s[at.POSITION], 0.0, s[at.SMOOTH_SPEED]
        s[at.DROVE] = 0.0
    direction = 0.0
    if u >= p[at.SUSPECT_VOLTAGE]:
        direction = 1.0
    elif u <= -p[at.SUSPECT_VOLTAGE]:
        direction = -1.0
    if direction != s[at.DIRECTION]:
        s[at.DIRECTION], s[at.PUSHED], s[at.DROVE] = direction, 0.0, 0.0
    s[at.PUSHED] += dt
    draws = p[at.CURRENT_STEP] > 0.0 and not math.isnan(p[at.RESISTANCE])
    if draws:
        drop = s[at.SEEN_CURRENT] * p[at.RESISTANCE]
        s[at.SMOOTH_DROP] += (drop - s[at.SMOOTH_DROP]) * dt / (p[at.SMOOTHING] + dt)
        at_rest = BLOCKED_SHARE * abs(u)
        s[at.AT_REST] = 1.0 if larger(drop * direction, s[at.SMOOTH_DROP] * direction) >= at_rest else 0.0
        if drop * direction >= at_rest:
            s[at.DROVE] = 1.0
    if direction == 0.0 or s[at.STANDING] < p[at.PATIENCE] or s[at.PUSHED] < p[at.PATIENCE]:
        return False
    was_at_speed = bool(s[at.BEFORE] * direction >= p[at.AT_SPEED])
    if not draws:
        return was_at_speed
    return bool(s[at.AT_REST] == 0.0 and (was_at_speed or s[at.DROVE] != 0.0))


@strictly_inlined
def gather_impulse(p: Array, s: Array) -> bool:
    """Take the voltage since the last point of a motion, and return whether the next one is due, as `PolarityMonitor.check`."""
    if p[at.FEEDBACK] == 0.0:
        s[at.POINTS] = 0.0
        return False
    s[at.IMPULSE] += s[at.APPLIED] * s[at.DT]
    s[at.SINCE] += s[at.DT]
    return bool(s[at.POINTS] == 0.0 or s[at.SINCE] >= s[at.GRID_TIME])


@strictly_inlined
def may_run_away(p: Array, s: Array, points: Array) -> bool:
    """Take a point of a motion, and return whether the monitor has to look at the points, in place of a state, closely."""
    last = at.FIRST_POINT + at.POINT * (int(s[at.POINTS]) - 1)
    mean = (s[at.IMPULSE] - points[last + 1]) / s[at.SINCE] if s[at.POINTS] > 0.0 else 0.0
    s[at.SINCE] = 0.0
    take_point(p, s, points, mean)
    if s[at.POINTS] <= FEWEST_POINTS or -p[at.SUSPECT_SHARE] < mean < p[at.SUSPECT_SHARE]:
        return False
    sign = 1.0 if mean > 0.0 else -1.0
    moved = sign * (points[at.FIRST_POINT + 3] - s[at.POSITION])
    return bool(s[at.FROM_REST] != 0.0 and moved >= FEWEST_COUNTS)


@strictly_inlined
def take_point(p: Array, s: Array, points: Array, mean: float) -> None:
    """Take a point: time, impulse, mean voltage, position; those before the last time at rest are let go."""
    count, first = int(s[at.POINTS]), at.FIRST_POINT
    if count > 0:
        last = first + at.POINT * (count - 1)
        sign, step = (1.0 if mean > 0.0 else -1.0), s[at.POSITION] - points[last + 3]
        if mean * points[last + 2] <= 0.0 or sign * step > 0.0:
            s[at.FROM_REST] = 1.0 if sign * s[at.LAST_STEP] >= -1.0 or sign * step > 0.0 else 0.0
            for k in range(at.POINT):
                points[first + k] = points[last + k]
            count = 1
            s[at.GRID_TIME] = p[at.FINEST]
        elif s[at.POSITION] == points[first + 3] and count >= FEWEST_POINTS:
            for k in range(at.POINT * (count - 1)):
                points[first + k] = points[first + at.POINT + k]
            count -= 1
            s[at.FROM_REST] = 1.0
        elif count >= MOST_POINTS:
            half = (count + 1) // 2
            for point in range(half):
                for k in range(at.POINT):
                    points[first + at.POINT * point + k] = points[first + 2 * at.POINT * point + k]
            count = half
            s[at.GRID_TIME] *= 2.0
        s[at.LAST_STEP] = step
    here = first + at.POINT * count
    points[here], points[here + 1] = s[at.TIME], s[at.IMPULSE]
    points[here + 2], points[here + 3] = mean, s[at.POSITION]
    s[at.POINTS] = count + 1


@strictly_inlined
def write_voltage(p: Array, s: Array, coming: Array, commanded: float, now: float) -> None:
    """Put a voltage out within the limits, as `Guarded.write` and `Twin.write`."""
    u = commanded
    if not -p[at.LARGEST] <= u <= p[at.LARGEST]:
        u = math.copysign(p[at.LARGEST], u)
    if p[at.SLEW] < math.inf:
        most = p[at.SLEW] * s[at.DT]
        u = smaller(larger(u, s[at.APPLIED] - most), s[at.APPLIED] + most)
    v = larger(-p[at.LIMIT], smaller(p[at.LIMIT], u))
    s[at.APPLIED] = v
    if abs(v) <= p[at.DEAD_BAND]:
        v = 0.0
    elif v > 0.0:
        v -= p[at.DEAD_BAND]
    else:
        v += p[at.DEAD_BAND]
    last = int(s[at.COMING])
    coming[last, 0], coming[last, 1] = now + p[at.DELAY], v
    s[at.COMING] += 1.0
    s[at.WRITES] += 1.0
    s[at.FED_AT], s[at.COMMANDED] = s[at.TIME], commanded
    within = -p[at.EXACT] <= s[at.APPLIED] - commanded <= p[at.EXACT]
    s[at.SATURATED] = 0.0 if within else 1.0
    s[at.CLIPPED] += s[at.SATURATED]


@strictly_inlined
def fill(rows: Array, n: int, p: Array, s: Array, reference: float) -> None:
    """Write the row of a tick that is done."""
    now = s[at.TIME]
    rows[n, 0], rows[n, 1], rows[n, 2], rows[n, 3] = now, s[at.COMMANDED], s[at.APPLIED], s[at.COUNTS]
    k = 4
    if p[at.SPEED_STEP] > 0.0:
        rows[n, k] = s[at.SEEN_SPEED]
        k += 1
    if p[at.CURRENT_STEP] > 0.0:
        rows[n, k] = s[at.SEEN_CURRENT]
        k += 1
    rows[n, k], rows[n, k + 1], rows[n, k + 2] = now, 0.0, s[at.SATURATED]
    if rows.shape[1] > k + 3:
        rows[n, k + 3] = reference
