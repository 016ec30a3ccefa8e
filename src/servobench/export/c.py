"""A speed controller in C99 for a microcontroller: PI with feedforward and anti-windup, with vectors that test it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.units import convert
from servobench.export.base import TARGETS, Wishes
from servobench.export.first_order import comment_for, first_order_motor
from servobench.export.summary import ResultSummary
from servobench.export.tuning import Tuning, smoothing, tune_loops
from servobench.systems.first_order import FirstOrderMotor

_TICKS = 240  # of the test vectors

_TEXT = """\
/* A speed controller for the identified motor, in C99.
{comment}
 *
 * Gain {gain} {unit}/(s V), time constant {tau} s, delay {delay} s. Closed loop {closed_loop} s;
 * phase margin {margin} deg (95 % interval {margin_low} to {margin_high}).
 *
 * Call {name}_start once, then {name}_step every {sample_time} s with the desired and measured speed in {unit}/s{with_counts}.
 * It returns volts. An input that is not finite gives 0 V and resets the controller. Don't compile it with -ffast-math, which
 * assumes that such inputs can't occur.
 *
 * Self-test: cc -std=c99 -D{upper}_SELF_TEST {name}.c -lm && ./a.out
 */
#include <math.h>
#include <stdint.h>

#define {upper}_SAMPLE_TIME {sample_time_f} /* s */
#define {upper}_KP {kp} /* V s/{unit} */
#define {upper}_KI_T {ki_t} /* V s/{unit}, for each tick */
#define {upper}_KV {kv} /* V s/{unit}, feedforward of speed */
#define {upper}_KS {ks} /* V, feedforward of Coulomb friction */
#define {upper}_OFFSET {offset} /* V */
#define {upper}_LIMIT {limit} /* V */
{count_defines}
typedef struct {{
    float integral; /* V */
{count_fields}}} {name}_state;

static void {name}_start({name}_state *state)
{{
    state->integral = 0.0f;
{count_start}}}
{count_function}
static float {name}_step({name}_state *state, float reference, float speed)
{{
    float error, feedforward, wished, limited, increment;
    if (!isfinite(reference) || !isfinite(speed)) {{
        {name}_start(state);
        return 0.0f;
    }}
    error = reference - speed;
    feedforward = {upper}_KV * reference;
    feedforward = feedforward + {upper}_OFFSET;
    if (reference > 0.0f)
        feedforward = feedforward + {upper}_KS;
    if (reference < 0.0f)
        feedforward = feedforward - {upper}_KS;
    wished = {upper}_KP * error;
    wished = wished + feedforward;
    wished = wished + state->integral;
    limited = fminf(fmaxf(wished, -{upper}_LIMIT), {upper}_LIMIT);
    increment = {upper}_KI_T * error;
    /* At a limit the integral only moves away from it. */
    if (wished == limited || (wished > limited) != (increment > 0.0f))
        state->integral = state->integral + increment;
    return limited;
}}

#ifdef {upper}_SELF_TEST
#include <stdio.h>

/* {row_meaning} */
static const {row_type} inputs[{ticks}][2] = {{
{inputs}
}};
static const float volts[{ticks}] = {{
{outputs}
}};

int main(void)
{{
    {name}_state state;
    float worst = 0.0f;
    int k;
    {name}_start(&state);
    for (k = 0; k < {ticks}; k++) {{
        float off = fabsf({call} - volts[k]);
        worst = fmaxf(worst, off);
    }}
    printf("%d ticks, at most %g V off\\n", k, (double)worst);
    /* Equal to the last bit without fused multiplications; these add some units in the last place. */
    return worst <= 1e-5f * {upper}_LIMIT ? 0 : 1;
}}
#endif
"""

_COUNT_DEFINES = """\
#define {upper}_SPEED_PER_COUNT {speed_per_count} /* {unit}/s for one count a tick */
#define {upper}_FILTER {filter} /* share of a new speed in the filtered one */
"""
_COUNT_FUNCTION = """
/* The speed from the counts of the encoder, which may wrap at 32 bits: differenced and low-pass filtered. */
static float {name}_speed({name}_state *state, int32_t counts)
{{
    uint32_t moved = (uint32_t)counts - (uint32_t)state->counts;
    float raw = (float)(int32_t)moved * {upper}_SPEED_PER_COUNT;
    float change = raw - state->speed;
    if (!state->started) {{
        state->started = 1;
        state->counts = counts;
        return 0.0f;
    }}
    state->counts = counts;
    change = change * {upper}_FILTER;
    state->speed = state->speed + change;
    return state->speed;
}}
"""


@TARGETS.member("c")
class C:
    """One C99 file: a PI speed controller with feedforward and anti-windup in single precision, and its test vectors.

    With `counts_per_rev=...` also the speed from an encoder's counts. `sample_time=...` is needed.
    """

    suffix: ClassVar[str] = ".c"
    wishes: ClassVar[frozenset[str]] = frozenset(
        {"unit", "sample_time", "closed_loop", "counts_per_rev", "voltage_limit"}
    )

    def render(self, answer: ResultSummary, wishes: Wishes, stem: str) -> Mapping[str, bytes]:
        """Return the one file.

        Raises `UsageError` without a sample time, for a motor that isn't of first order or not driven by a voltage, and for a
        name that is none in C.
        """
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,40}", stem):
            raise UsageError(
                f"{stem}.c: names in C are letters, digits and _; choose such a name, like motor.c"
            )
        if wishes.sample_time is None:
            raise UsageError(
                "c needs the time between two calls of the controller: give `sample_time=...`, such as 2ms"
            )
        motor = first_order_motor(answer, "c", wishes.unit)
        tau = motor.time_constant.value
        if wishes.sample_time > tau:
            raise UsageError(
                f"`sample_time={wishes.sample_time:g}`: the motor's response is over between two samples, as its "
                f"time constant is {tau:.3g} s; give less than that, usually a tenth of it or less"
            )
        gains = tune_loops(
            motor,
            wishes.sample_time,
            wishes.closed_loop,
            filtered=wishes.counts_per_rev is not None,
            integral_lag=1,
        )
        controller = _Controller.of(motor, gains, wishes, _limit(answer, wishes))
        return {f"{stem}.c": _text(answer, motor, gains, controller, stem).encode()}


@dataclass(frozen=True, kw_only=True)
class _Controller:
    """The controller's numbers, each one that single precision has, and the same steps as the C text, operation by operation."""

    sample_time: float
    kp: np.float32
    ki_t: np.float32
    kv: np.float32
    ks: np.float32
    offset: np.float32
    limit: np.float32
    speed_per_count: np.float32 | None
    filter: np.float32

    @classmethod
    def of(cls, motor: FirstOrderMotor, gains: Tuning, wishes: Wishes, limit: float) -> _Controller:
        period = wishes.sample_time or math.nan
        per_count = None
        if wishes.counts_per_rev is not None:
            per_count = np.float32(_turn(motor.unit) / wishes.counts_per_rev / period)
        return cls(
            sample_time=period,
            kp=np.float32(gains.speed_gain),
            ki_t=np.float32(gains.speed_integral * period),
            kv=np.float32(1.0 / motor.gain.value),
            ks=np.float32(
                math.copysign(motor.coulomb_voltage.value, motor.gain.value) if motor.coulomb_voltage else 0.0
            ),
            offset=np.float32(motor.offset_voltage.value if motor.offset_voltage else 0.0),
            limit=np.float32(limit),
            speed_per_count=per_count,
            filter=np.float32(smoothing(period, gains.filter)),
        )

    def step(
        self, integral: np.float32, reference: np.float32, speed: np.float32
    ) -> tuple[np.float32, np.float32]:
        """The next integral and the volts."""
        if not (np.isfinite(reference) and np.isfinite(speed)):
            return np.float32(0), np.float32(0)
        error = reference - speed
        feedforward = self.kv * reference + self.offset
        if reference > 0:
            feedforward = feedforward + self.ks
        if reference < 0:
            feedforward = feedforward - self.ks
        wished = self.kp * error + feedforward + integral
        limited = min(max(wished, -self.limit), self.limit)
        increment = self.ki_t * error
        if wished == limited or bool(wished > limited) != bool(increment > 0):
            integral = integral + increment
        return integral, limited

    def speed(self, before: np.float32, moved: int) -> np.float32:
        """The filtered speed after so many more counts."""
        raw = np.float32(moved) * (self.speed_per_count or np.float32(0))
        return before + (raw - before) * self.filter


def _limit(answer: ResultSummary, wishes: Wishes) -> float:
    """The voltage that the controller may put out: what is said, or the largest that the data have seen."""
    if wishes.voltage_limit is not None:
        return wishes.voltage_limit
    limit = max(map(abs, answer.input_range))
    if not 0 < limit < math.inf:
        raise UsageError("c: the data have no voltage to use as the limit; give `voltage_limit=...`")
    return limit


def _turn(unit: str) -> float:
    """One revolution in that unit of position."""
    try:
        return convert(1.0, "rev", unit)
    except ValueError:
        raise UsageError(
            f"`counts_per_rev=...`: the position is in {unit}, which has no revolutions"
        ) from None


@dataclass(frozen=True, kw_only=True)
class _Vectors:
    """The controller's inputs and outputs, tick by tick: references and measurements (N,), volts (N,)."""

    references: Array
    measured: Array
    volts: Array


def _vectors(motor: FirstOrderMotor, controller: _Controller) -> _Vectors:
    """The controller around the identified motor: start, reversal, a wish beyond the limit, a sample that isn't finite."""
    reach = 0.5 * abs(motor.gain.value) * float(controller.limit)
    wishes = np.repeat([0.0, reach, -0.6 * reach, 5.0 * reach, 0.2 * reach, 0.0], _TICKS // 6)
    wishes[_TICKS // 2 + 3] = math.nan
    carry = math.exp(-controller.sample_time / motor.time_constant.value)
    counted = controller.speed_per_count is not None
    integral, filtered, speed, position = np.float32(0), np.float32(0), 0.0, 0.0
    before: int | None = None  # counts; None before the first and after a reset
    rows = []
    for wish in wishes:
        measurement, feedback = float(np.float32(speed)), np.float32(speed)
        if counted:
            counts = round(position / (float(controller.speed_per_count or 1) * controller.sample_time))
            filtered = np.float32(0) if before is None else controller.speed(filtered, counts - before)
            measurement, feedback, before = float(counts), filtered, counts
        integral, volts = controller.step(integral, np.float32(wish), feedback)
        if not math.isfinite(wish):
            filtered, before = np.float32(0), None
        rows.append((float(np.float32(wish)), measurement, float(volts)))
        position += controller.sample_time * speed
        speed = carry * speed + (1 - carry) * motor.gain.value * float(volts)
    references, measured, out = np.array(rows).T
    return _Vectors(references=references, measured=measured, volts=out)


def _text(
    answer: ResultSummary, motor: FirstOrderMotor, gains: Tuning, controller: _Controller, name: str
) -> str:
    vectors = _vectors(motor, controller)
    counted = controller.speed_per_count is not None
    names = {"name": name, "upper": name.upper(), "unit": motor.unit}
    if counted:
        names |= {
            "speed_per_count": _single(controller.speed_per_count),
            "filter": _single(controller.filter),
        }
    margin = [f"{math.degrees(x):.1f}" for x in gains.phase_margin]
    speed = f"{name}_speed(&state, (int32_t)inputs[k][1])" if counted else "(float)inputs[k][1]"
    return _TEXT.format(
        **{key: value for key, value in names.items() if key not in {"speed_per_count", "filter"}},
        comment="\n".join(f" * {line.replace('*/', '* /')}" for line in comment_for(motor, answer)),
        gain=f"{motor.gain.value:.6g}",
        tau=f"{motor.time_constant.value:.6g}",
        delay=f"{motor.delay:.3g}",
        closed_loop=f"{gains.closed_loop:.4g}",
        margin=margin[0],
        margin_low=margin[1],
        margin_high=margin[2],
        sample_time=f"{controller.sample_time:.9g}",
        sample_time_f=_single(np.float32(controller.sample_time)),
        kp=_single(controller.kp),
        ki_t=_single(controller.ki_t),
        kv=_single(controller.kv),
        ks=_single(controller.ks),
        offset=_single(controller.offset),
        limit=_single(controller.limit),
        with_counts=f",\n * which {name}_speed makes of the encoder's counts" if counted else "",
        count_defines=_COUNT_DEFINES.format(**names) if counted else "",
        count_fields="    int32_t counts;\n    float speed;\n    int started;\n" if counted else "",
        count_start="    state->counts = 0;\n    state->speed = 0.0f;\n    state->started = 0;\n"
        if counted
        else "",
        count_function=_COUNT_FUNCTION.format(**names) if counted else "",
        row_meaning="wished speed, counts" if counted else "wished speed, measured speed",
        row_type="double" if counted else "float",
        ticks=len(vectors.volts),
        inputs=",\n".join(
            f"    {{{_literal(r)}, {_literal(y)}}}"
            for r, y in zip(vectors.references, vectors.measured, strict=True)
        ),
        outputs=",\n".join(f"    {_literal(u)}" for u in vectors.volts),
        call=f"{name}_step(&state, (float)inputs[k][0], {speed})",
    )


def _single(value: np.float32 | None) -> str:
    """A number of single precision as C reads it back to the last bit."""
    return f"{float(value or 0.0):.9e}f"


def _literal(value: float) -> str:
    """A number of a test vector: NaN, or one of single precision."""
    return "NAN" if math.isnan(value) else f"{value:.9e}f"
