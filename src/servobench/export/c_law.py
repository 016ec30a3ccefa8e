"""A tuned controller in C99 for a microcontroller: the law with the gains from `tune`, tick by tick, with test vectors.

The vectors come from the law itself, as `systems.control` runs it; its file states it. The C text has its operations in the same
order, for a sample time that doesn't change.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from servobench.core.channels import LONGEST_STEP, SHORTEST_STEP, Channel, DeviceInfo, Sample
from servobench.core.errors import FormatError, UsageError
from servobench.core.parameter_names import plain_words
from servobench.export.base import Wishes, write_files
from servobench.systems.control.base import CONTROLLERS
from servobench.systems.control.lead import Lead
from servobench.systems.control.pid import Pid
from servobench.systems.control.state_feedback import StateFeedback
from servobench.systems.tuning.base import Tunable
from servobench.systems.tuning.tune import SCHEMA

_LAWS: dict[str, type[Tunable]] = {"lead": Lead, "pid": Pid, "state_feedback": StateFeedback}
_TICKS = 240  # of the test vectors
_LARGEST = 1_000_000  # bytes
_BEFORE_A_WRAP = 2**31 - 40  # counts

_TEXT = """\
/* A controller of the {followed}, in C99: {kind}, as servobench tuned it by {method}.
 *
 * Call {name}_start once, then {name}_step every {sample_time} s with the reference in {unit} and the encoder's counter, which
 * may wrap at 32 bits; {counts_per_rev} counts are a turn. The position is 0 where the counter is 0. It returns volts. A
 * reference that is not finite gives 0 V and resets the controller. Don't compile it with -ffast-math, which assumes that such
 * a reference can't occur.
 *
 * Self-test: cc -std=c99 -D{upper}_SELF_TEST {name}.c -lm && ./a.out
 */
#include <math.h>
#include <stdint.h>

#define {upper}_T {sample_time} /* s */
#define {upper}_SCALE {scale} /* rad in a count */
#define {upper}_LIMIT {limit} /* V */
{defines}
typedef struct {{
    int started;
    int32_t counts; /* of the tick before */
    double travel; /* counts, without wraps: whole numbers, exact up to 2^53 */
    double slope; /* rad/s, between the last two ticks */
    double speed; /* rad/s, filtered */
    double integral; /* V */
{fields}}} {name}_state;

/* The next output of a low-pass filter, w/(s + w) by the trapezoid rule with h = w T. */
static double {name}_lowpass(double y, double x, double before, double h)
{{
    double gain = 0.5 * h / (1.0 + 0.5 * h);
    return (1.0 - 0.5 * h) / (1.0 + 0.5 * h) * y + gain * (x + before);
}}

static void {name}_start({name}_state *state)
{{
    static const {name}_state zero = {{0}};
    *state = zero;
}}

static double {name}_step({name}_state *state, double reference, int32_t counts)
{{
    const int first = !state->started;
    double position, error, wanted, limited;
    if (!isfinite(reference)) {{
        {name}_start(state);
        return 0.0;
    }}
    if (first) {{
        state->started = 1;
        state->travel = (double)counts;
    }} else {{
        /* The shortest way from the last count to this one, also where the counter wrapped. */
        const double moved = (double)(int32_t)((uint32_t)counts - (uint32_t)state->counts);
        const double slope = moved * {upper}_SCALE / {upper}_T;
        state->travel += moved;
        state->speed = {name}_lowpass(state->speed, slope, state->slope, {upper}_CUTOFF * {upper}_T);
        state->slope = slope;
    }}
    state->counts = counts;
    position = state->travel * {upper}_SCALE;
{law}
    (void)position; /* which a law of the speed doesn't use */
    (void)error; /* which a law without an integral doesn't */
{integral}    limited = fmin(fmax(wanted, -{upper}_LIMIT), {upper}_LIMIT);
{anti_windup}    return limited;
}}

#ifdef {upper}_SELF_TEST
#include <stdio.h>

/* reference, counts; a reference of NAN is one that isn't finite */
static const double inputs[{ticks}][2] = {{
{inputs}
}};
static const double volts[{ticks}] = {{
{outputs}
}};

int main(void)
{{
    {name}_state state;
    double worst = 0.0;
    int k;
    {name}_start(&state);
    for (k = 0; k < {ticks}; k++)
        worst = fmax(worst, fabs({name}_step(&state, inputs[k][0], (int32_t)inputs[k][1]) - volts[k]));
    printf("%d ticks, at most %g V off\\n", k, worst);
    /* The vectors have times, whose steps are rounded, and a compiler may fuse multiplications. */
    return worst <= 1e-8 * {upper}_LIMIT ? 0 : 1;
}}
#endif
"""
_INTEGRAL = """\
    if (!first)
        state->integral += {upper}_KI * error * {upper}_T;
    wanted += state->integral;
"""
_ANTI_WINDUP = """\
    /* Beyond a limit the integral follows what is left of the voltage (back-calculation). */
    if (!first)
        state->integral += (limited - wanted) * {share};
"""
_PID = """\
    {{
        double y = position, rate = state->speed;
{of_speed}        if (!first) {{
            const double slope = (reference - state->reference) / {upper}_T;
            state->reference_rate
                = {name}_lowpass(state->reference_rate, slope, state->reference_slope, {upper}_CUTOFF * {upper}_T);
            state->reference_slope = slope;
        }}
        state->reference = reference;
        error = reference - y;
        wanted = {upper}_KP * ({upper}_B * reference - y) + {upper}_KD * ({upper}_C * state->reference_rate - rate);
    }}"""
_PID_OF_SPEED = """\
        if (!first) {{
            const double change = (state->speed - state->speed_before) / {upper}_T;
            state->speed_rate = {name}_lowpass(state->speed_rate, change, state->speed_slope, {upper}_CUTOFF * {upper}_T);
            state->speed_slope = change;
        }}
        state->speed_before = state->speed;
        y = state->speed;
        rate = state->speed_rate;
"""
_LEAD = """\
    error = reference - {y};
    if (first) {{
        state->led = {upper}_GAIN * error;
    }} else {{
        const double half = 0.5 * {upper}_T;
        const double rise = (1.0 / {upper}_ZERO + half) * error - (1.0 / {upper}_ZERO - half) * state->error;
        state->led = ((1.0 / {upper}_POLE - half) * state->led + {upper}_GAIN * rise) / (1.0 / {upper}_POLE + half);
    }}
    state->error = error;
    wanted = state->led;"""
_STATE_FEEDBACK = """\
    error = reference - {y};
    wanted = {upper}_K_REFERENCE * reference - {upper}_K_POSITION * position - {upper}_K_SPEED * state->speed;"""


class _Law(NamedTuple):
    """A controller kind's part of the text: its numbers with a comment each, its states, and its lines."""

    numbers: Mapping[str, tuple[float, str]]
    states: tuple[str, ...]
    lines: str
    proportional: float
    integral: float
    tracking: float


@dataclass(frozen=True, kw_only=True)
class TunedLaw:
    """A controller that was tuned, with its `method`, its `sample_time` [s] and the `voltage_limit` [V] it was tuned for."""

    controller: Tunable
    method: str
    sample_time: float
    voltage_limit: float


def read_tuning(path: str | os.PathLike[str]) -> TunedLaw | None:
    """Return the controller in a file that `servobench tune --json` printed; None where the file is of something else.

    Raises `FormatError` for such a file that is damaged.
    """
    file = Path(path)
    if not file.is_file() or file.stat().st_size > _LARGEST:
        return None
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None  # whatever reads it as a result says why it is none
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        return None
    return law_of_tuning(document, str(file))


def law_of_tuning(document: Mapping[str, Any], name: str) -> TunedLaw:
    """Return the controller in plain data of the schema `servobench.tuning/1`; raises `FormatError`, which calls them `name`."""
    try:
        settings = dict(document["controller"])
        kind = settings.pop("type")
        controller = _LAWS[kind](**settings)
        step, limit = float(document["sample_time"]), float(document["voltage_limit"])
    except (KeyError, TypeError, ValueError) as error:
        raise FormatError(f"{name} is incomplete: {error!r} while reading {SCHEMA}") from None
    if not SHORTEST_STEP <= step <= LONGEST_STEP or not 0.0 < limit < math.inf:
        raise FormatError(
            f"{name}: a sample time of {step:g} s and a limit of {limit:g} V; expected numbers above 0"
        )
    return TunedLaw(
        controller=controller, method=str(document.get("method", "")), sample_time=step, voltage_limit=limit
    )


def export_law(tuned: TunedLaw, path: str | os.PathLike[str], wishes: Wishes) -> tuple[Path, ...]:
    """Write a tuned controller as one C99 file, and return it.

    `wishes.counts_per_rev` are the encoder's, and all that can be wished: sample time and limit are those of the tuning. Raises
    `UsageError` for a missing or another wish, and a name that is none in C, `StorageError` where the file can't be written.
    """
    file = Path(path)
    file = file if file.suffix else file.with_name(f"{file.name}.c")
    if file.suffix != ".c" or not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,40}", file.stem):
        raise UsageError(
            f"{file}: names in C are letters, digits and _, and end in .c; choose such a name, like loop.c"
        )
    if wishes != Wishes(counts_per_rev=wishes.counts_per_rev):
        raise UsageError(
            "a tuned controller takes its sample time, its voltage limit and its unit from `servobench tune`: set them there, "
            "and only `counts_per_rev=...` here"
        )
    counts = wishes.counts_per_rev
    if counts is None or not 0.0 < counts < math.inf:
        raise UsageError("c needs the encoder's counts per turn: give `counts_per_rev=...`, such as 2048")
    return write_files({file.name: text_of_law(tuned, counts, file.stem).encode("ascii", "replace")}, file)


def text_of_law(tuned: TunedLaw, counts_per_rev: float, name: str) -> str:
    """Return the C text of a tuned controller for an encoder with so many counts a turn; `name` begins its names."""
    controller, upper = tuned.controller, name.upper()
    law = _law_of(controller, tuned.sample_time)
    numbers: dict[str, tuple[float, str]] = {"CUTOFF": (controller.cutoff, "rad/s"), **law.numbers}
    if law.integral:
        numbers["KI"] = (law.integral, "V for each second of an error of 1")
    share = f"{min(tuned.sample_time / law.tracking, 1.0)!r}" if law.integral else ""
    rows = _vectors(tuned, counts_per_rev, law)
    follows_speed = controller.output == "speed"

    def insert(text: str) -> str:
        return text.format(
            name=name,
            upper=upper,
            y="state->speed" if follows_speed else "position",
            share=share,
            of_speed=_PID_OF_SPEED.format(name=name, upper=upper) if follows_speed else "",
        )

    return _TEXT.format(
        name=name,
        upper=upper,
        followed=controller.output,
        kind=plain_words(CONTROLLERS.name_of(controller)),
        method=plain_words(tuned.method).replace("*/", ""),
        unit=controller.reference_unit,
        sample_time=repr(tuned.sample_time),
        counts_per_rev=f"{counts_per_rev:g}",
        scale=repr(2 * math.pi / counts_per_rev),
        limit=repr(tuned.voltage_limit),
        defines="\n".join(
            f"#define {upper}_{key} {value!r} /* {unit} */" for key, (value, unit) in numbers.items()
        ),
        fields="".join(f"    double {each};\n" for each in law.states),
        law=insert(law.lines),
        integral=insert(_INTEGRAL) if law.integral else "",
        anti_windup=insert(_ANTI_WINDUP) if law.integral else "",
        ticks=_TICKS,
        inputs=",\n".join(f"    {{{_literal(r)}, {c}}}" for r, c, _ in rows),
        outputs=",\n".join(f"    {_literal(u)}" for _, _, u in rows),
    )


def _law_of(controller: Tunable, sample_time: float) -> _Law:
    """A kind's part, as in its file and `control.kernels`."""
    speed = controller.output == "speed"
    unit = "V s/rad" if speed else "V/rad"
    if isinstance(controller, Pid):
        numbers = {
            "KP": (controller.kp, unit),
            "KD": (controller.kd, "V s^2/rad" if speed else "V s/rad"),
            "B": (controller.b, "weight of the reference"),
            "C": (controller.c, "weight of the reference's derivative"),
        }
        states: tuple[str, ...] = ("reference", "reference_slope", "reference_rate")
        states += ("speed_before", "speed_slope", "speed_rate") if speed else ()
        either = controller.ki == 0 or controller.kp == 0
        tracking = controller.tracking_time or (sample_time if either else abs(controller.kp / controller.ki))
        return _Law(numbers, states, _PID, controller.kp, controller.ki, tracking)
    if isinstance(controller, Lead):
        numbers = {
            "GAIN": (controller.gain, unit),
            "ZERO": (controller.zero, "rad/s"),
            "POLE": (controller.pole, "rad/s"),
        }
        return _Law(numbers, ("led", "error"), _LEAD, controller.gain, 0.0, sample_time)
    followed = controller.speed_gain if speed else controller.position_gain
    forward = followed if controller.reference_gain is None else controller.reference_gain
    numbers = {
        "K_REFERENCE": (forward, unit),
        "K_POSITION": (controller.position_gain, "V/rad"),
        "K_SPEED": (controller.speed_gain, "V s/rad"),
    }
    by_gain = abs(followed / controller.integral_gain) if controller.integral_gain else 0.0
    tracking = controller.tracking_time or by_gain or sample_time
    return _Law(numbers, (), _STATE_FEEDBACK, followed, controller.integral_gain, tracking)


def _vectors(tuned: TunedLaw, counts_per_rev: float, law: _Law) -> list[tuple[float, int, float]]:
    """Reference, counter and voltage of each tick: steps both ways, some beyond the limit, a reference that isn't finite.

    The counter wraps where the speed is followed; a position as far away as that would leave nothing but the limit to see.
    The shaft follows through a lag and a wobble of its own, whatever the voltage is, so that the integral meets the limit.
    """
    limit, step = tuned.voltage_limit, tuned.sample_time
    device = DeviceInfo(
        name="vectors",
        channels=(
            Channel(name="counts", unit="counts", counter_bits=32, counts_per_rev=counts_per_rev),
            Channel(name="voltage", unit="V", minimum=-limit, maximum=limit),
        ),
    )
    scale = 2 * math.pi / counts_per_rev
    reach = limit / (abs(law.proportional) or _TICKS / 12 * step * abs(law.integral) or 1.0)
    levels = np.repeat([0.0, 0.5, -0.6, 3.0, 0.2, 0.0], _TICKS // 6) * reach
    levels[_TICKS // 2 + 3] = math.nan
    is_speed = tuned.controller.output == "speed"
    state, started, rows, place = tuned.controller.start(step, device), 0, [], 0.0
    begin = _BEFORE_A_WRAP if is_speed else 0
    for k, level in enumerate(levels):
        wobble = 0.05 * reach * math.sin(0.37 * k)
        toward = 0.0 if math.isnan(level) else 0.8 * level
        place += step * (toward + wobble) if is_speed else 0.1 * (toward + wobble - place)
        count = begin + round(place / scale) + (3 * k if is_speed else 0)
        wrapped = (count + 2**31) % 2**32 - 2**31
        if math.isnan(level):
            state, started = tuned.controller.start(step, device), k + 1
            rows.append((level, wrapped, 0.0))
            continue
        sample = Sample(index=k, time=step * (k - started), counts=wrapped)
        state, wanted = tuned.controller.step(state, float(level), sample)
        rows.append((level, wrapped, float(min(max(wanted, -limit), limit))))
    return rows


def _literal(value: float) -> str:
    return "NAN" if math.isnan(value) else repr(float(value))
