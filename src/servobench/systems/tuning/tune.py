"""The verb `tune`: a controller for an identified motor and a specification, with its margins; or why there is none.

What is refused, and why from there on, is explained in docs/decisions/0019-control.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from servobench.core.errors import UnknownName, UsageError
from servobench.core.finding import Finding, info, warning
from servobench.core.settings import with_units
from servobench.core.toml import table_lines
from servobench.systems.control.base import CONTROLLERS
from servobench.systems.control.lead import Lead
from servobench.systems.control.pid import Pid
from servobench.systems.first_order import FirstOrderMotor
from servobench.systems.tuning.base import METHODS, Method, Tunable, Unreachable, Wish
from servobench.systems.tuning.loop import LoopValue, least_margins, loop_margins, nominal_margins
from servobench.systems.tuning.placement import Pole, match_poles
from servobench.systems.tuning.response import check_sample_time, step_response, ticks_of, unit_step

SCHEMA = "servobench.tuning/1"
LEAST_PHASE, GOOD_PHASE = math.radians(30), math.radians(45)
"""The smallest phase margin that a loop must keep, and good practice (Åström and Murray, section 10.2)."""
LEAST_FACTOR = 2.0
"""By which the gain may be off before a loop is unstable."""
MOST_OFF = 0.03
"""The largest distance of a pole from its specified place, as a part of its distance from zero."""
_MOST_TURNED = (
    0.5  # rad of phase in a sample time at the gain crossover; beyond, the motor does much between two ticks
)
_FASTEST_POLE = 1.0  # rad in a sample time; a faster pole is gone in a tick or two
_FARTHEST = 1000.0  # times slower or faster than specified: the range of the search, in steps of a twentieth
_STEP, _SLACK = 1.05, 1.01
_TUNABLE = ("lead", "pid", "state_feedback")


@dataclass(frozen=True, kw_only=True)
class TuningResult:
    """A controller for a motor: margins and step response with 95 % intervals, and what there is to know.

    `method` and `wish` are what it was found by and for, `poles` those wished for beside those of the loop, `quantities` what the
    wish says in other words, as (wished, obtained, unit), and `findings` what to know of it.

    `largest_step` is the change of the reference [rad or rad/s] that takes all of the voltage limit, without friction.
    """

    controller: Tunable
    method: str
    wish: Wish
    poles: tuple[Pole, ...]
    quantities: Mapping[str, tuple[float, float, str]]
    margins: Mapping[str, LoopValue]
    response: Mapping[str, LoopValue]
    largest_step: float
    findings: tuple[Finding, ...]

    @property
    def toml(self) -> str:
        """The controller as the table [controller] of an experiment's file."""
        table = {"type": CONTROLLERS.name_of(self.controller), **with_units(self.controller)}
        return "\n".join(table_lines(("controller",), table)).strip() + "\n"

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data of the schema `servobench.tuning/1`; a margin that nothing limits is null."""
        controller = {
            "type": CONTROLLERS.name_of(self.controller),
            **self.controller.model_dump(exclude_none=True),
        }
        return {
            "schema": SCHEMA,
            "method": self.method,
            "sample_time": self.wish.sample_time,
            "voltage_limit": self.wish.voltage_limit,
            "controller": controller,
            "toml": self.toml,
            "poles": [
                {"wished": _complex(each.wished), "obtained": _complex(each.obtained)} for each in self.poles
            ],
            "margins": {name: _plain(each) for name, each in self.margins.items()},
            "response": {name: _plain(each) for name, each in self.response.items()},
            "largest_step": {"value": self.largest_step, "unit": self.controller.reference_unit},
            "findings": [
                {"code": each.code, "severity": str(each.severity), "sentence": each.sentence}
                for each in self.findings
            ],
        }


def tune(motor: FirstOrderMotor, method: str, wish: Wish) -> TuningResult:
    """Return the controller that a method finds for a motor, whose positions are in rad.

    Raises `UsageError` where the wish can't be had: faster than delay, sample time or voltage allow, or with poles more than 3 %
    off those wished for, with the nearest wish that can.
    """
    if wish.controller not in _TUNABLE:
        raise UnknownName("controller that can be tuned", wish.controller, _TUNABLE)
    finder = METHODS[method]
    check_sample_time(finder.poles(wish), motor, wish.sample_time)
    poles: tuple[Pole, ...] = ()
    problem = _beyond_the_ticks(finder, wish)
    if not problem:
        try:
            controller = finder(motor, wish)
        except Unreachable as error:
            problem = str(error)
    if not problem:
        margins = loop_margins(controller, motor, wish.sample_time)
        poles = _poles(finder, controller, motor, wish)
        problem = _too_fast(controller, motor, wish, margins) or _off(controller, wish, poles)
    if not problem:
        slowest = max(pole.obtained.real for pole in poles)
        response, peak = step_response(
            controller, motor, wish.sample_time, margins["gain_crossover"].value, slowest
        )
        problem = _too_high(controller, wish, peak)
    if problem:
        raise UsageError(f"{finder.speed_text(wish)}: {problem}{_nearest(finder, motor, wish)}")
    return TuningResult(
        controller=controller,
        method=method,
        wish=wish,
        poles=poles,
        quantities=_quantities(finder, wish, poles),
        margins=margins,
        response=response,
        largest_step=wish.voltage_limit / peak,
        findings=tuple(_findings(controller, motor, wish, margins, peak, finder)),
    )


def _poles(finder: Method, controller: Tunable, motor: FirstOrderMotor, wish: Wish) -> tuple[Pole, ...]:
    return match_poles(
        controller, motor, wish.sample_time, finder.poles(wish), finder.poles_cancelled(motor, wish)
    )


def _quantities(finder: Method, wish: Wish, poles: tuple[Pole, ...]) -> dict[str, tuple[float, float, str]]:
    wished = finder.quantities(wish, [pole.wished for pole in poles])
    obtained = finder.quantities(wish, [pole.obtained for pole in poles])
    return {name: (value, obtained[name][0], unit) for name, (value, unit) in wished.items()}


def _beyond_the_ticks(finder: Method, wish: Wish) -> str:
    """The reason why poles are too fast for a loop with ticks, as a clause, or nothing."""
    fastest = max(map(abs, finder.poles(wish)))
    if fastest * wish.sample_time <= _FASTEST_POLE * (1.0 + 1e-9):
        return ""
    return (
        f"faster than a controller that runs every {wish.sample_time:g} s can be: poles may go up to "
        f"{_FASTEST_POLE / wish.sample_time:.4g} rad/s, and {fastest:.4g} rad/s is requested"
    )


def _off(controller: Tunable, wish: Wish, poles: tuple[Pole, ...]) -> str:
    """The reason why the poles aren't the specified ones, as a clause, or nothing."""
    worst = max(poles, key=lambda pole: pole.off)
    if worst.off <= MOST_OFF:
        return ""
    return (
        f"the slowest poles of the loop would be {_poles_text(pole.obtained for pole in poles)} rad/s instead of "
        f"{_poles_text(pole.wished for pole in poles)} rad/s: the filter at {controller.cutoff:.3g} rad/s and the delay add one "
        "that is as slow"
    )


def _poles_text(poles: Iterable[complex]) -> str:
    return ", ".join(f"{p.real:.3g}" if not p.imag else f"{p.real:.3g}{p.imag:+.3g}j" for p in poles)


def _too_fast(
    controller: Tunable,
    motor: FirstOrderMotor,
    wish: Wish,
    margins: Mapping[str, LoopValue] | Mapping[str, float],
) -> str:
    """The reason why a controller is too fast for delay and sample time, as a clause, or nothing.

    The worse end of an interval counts.
    """
    low = {name: each.interval[0] if isinstance(each, LoopValue) else each for name, each in margins.items()}
    high = {name: each.interval[1] if isinstance(each, LoopValue) else each for name, each in margins.items()}
    crossover = high["gain_crossover"]
    if math.isnan(crossover):
        return "the loop's gain is below 1 everywhere: it would have no effect"
    if crossover * wish.sample_time > _MOST_TURNED:
        where = (
            f"has its crossover at {crossover:.3g} rad/s"
            if math.isfinite(crossover)
            else f"has a gain above 1 up to half the sample rate, {math.pi / wish.sample_time:.4g} rad/s"
        )
        return (
            f"faster than a controller that runs every {wish.sample_time:g} s can be: its loop {where}, and "
            f"{_MOST_TURNED / wish.sample_time:.3g} rad/s is the highest possible crossover"
        )
    rise, fall = low["gain_margin"], low["gain_margin_downwards"]
    if low["phase_margin"] < LEAST_PHASE or min(rise, fall) < LEAST_FACTOR:
        bears = f"rise by a factor of {rise:.2g}" if rise <= fall else f"fall to 1/{fall:.2g}"
        passed, left = motor.delay + wish.sample_time, math.degrees(low["phase_margin"])
        return (
            f"too fast for {passed:.3g} s of delay and sample time and a filter of {1 / controller.cutoff:.3g} s: "
            f"{left:.0f}° of phase would be left, and the gain might {bears}; the minimum is "
            f"{math.degrees(LEAST_PHASE):.0f}° and a factor of {LEAST_FACTOR:g} either way"
        )
    return ""


def _too_high(controller: Tunable, wish: Wish, peak: float) -> str:
    """The reason why a step needs more voltage than there is, as a clause, or nothing. `peak` [V] is what a unit of it takes."""
    if wish.step is None or peak * abs(wish.step) <= wish.voltage_limit:
        return ""
    return (
        f"a step of {wish.step:g} {controller.reference_unit} would need {peak * abs(wish.step):.3g} V, and the "
        f"limit is {wish.voltage_limit:g} V"
    )


def _nearest(finder: Method, motor: FirstOrderMotor, wish: Wish) -> str:
    """The nearest loop that a slower or a faster wish leads to, to a twentieth; empty where there is none."""
    for n in range(1, math.ceil(math.log(_FARTHEST) / math.log(_STEP))):
        for factor, word in ((_STEP**n, "fastest"), (_STEP**-n, "slowest")):
            if _is_feasible(finder, motor, wish.slower(factor)):
                # Beyond by more than the rounding of what is printed.
                speed = finder.speed_text(wish.slower(factor * (_SLACK if factor > 1 else 1 / _SLACK)))
                return f"; the {word} possible is about {speed}"
    return ""


def _is_feasible(finder: Method, motor: FirstOrderMotor, wish: Wish) -> bool:
    try:
        if _beyond_the_ticks(finder, wish):
            return False
        check_sample_time(finder.poles(wish), motor, wish.sample_time)
        controller = finder(motor, wish)
        nominal = nominal_margins(controller, motor, wish.sample_time)
        ticks_of(motor, wish.sample_time, nominal["gain_crossover"])
    except UsageError:
        return False
    if _too_fast(controller, motor, wish, nominal) or _off(
        controller, wish, _poles(finder, controller, motor, wish)
    ):
        return False
    if wish.step is not None and _too_high(controller, wish, _peak(controller, motor, wish, nominal)):
        return False
    # The intervals cost hundreds of times more: only where neither the estimate nor some of the draws are too fast.
    return not any(
        _too_fast(controller, motor, wish, margins(controller, motor, wish.sample_time))
        for margins in (least_margins, loop_margins)
    )


def _peak(controller: Tunable, motor: FirstOrderMotor, wish: Wish, margins: Mapping[str, float]) -> float:
    """The largest voltage [V] after a unit step of the reference, of the motor as it is estimated."""
    ticks = ticks_of(motor, wish.sample_time, margins["gain_crossover"])
    centre = (motor.gain.value, motor.time_constant.value, motor.delay)
    return unit_step(controller, *centre, wish.sample_time, ticks).peak


def _findings(
    controller: Tunable,
    motor: FirstOrderMotor,
    wish: Wish,
    margins: Mapping[str, LoopValue],
    peak: float,
    finder: Method,
) -> list[Finding]:
    findings = []
    if motor.doubtful:
        findings.append(
            warning(
                "motor-doubtful",
                "The motor's result is doubtful, and so are these gains; see its findings first.",
            )
        )
    findings += [warning("motor-not-known", caution) for caution in motor.cautions]
    low = margins["phase_margin"].interval[0]
    if low < GOOD_PHASE:
        findings.append(
            warning(
                "margin-small",
                f"The phase margin may be as low as {math.degrees(low):.0f}°, and {math.degrees(GOOD_PHASE):.0f}° "
                "is good practice: choose a slower loop or more damping.",
            )
        )
    gain, coulomb = _stiffness(controller), motor.coulomb_voltage
    if gain and coulomb is not None and coulomb.value > 0:
        unit = controller.reference_unit
        findings.append(
            info(
                "friction-leaves-error",
                f"Without an integral part, Coulomb friction of {coulomb.value:.2g} V can hold the shaft up to "
                f"{coulomb.value / abs(gain):.2g} {unit} off its reference; a third pole (`poles=...`) adds one.",
            )
        )
    for pole in finder.poles_cancelled(motor, wish):
        findings.append(
            info(
                "pole-cancelled",
                f"The motor's own pole at {pole.real:.3g} 1/s is cancelled: it doesn't appear in the response to "
                f"the reference, but the effect of a load dies out with its {-1 / pole.real:.3g} s.",
            )
        )
    if wish.step is None:
        findings.append(
            info(
                "largest-step",
                f"A step of more than {wish.voltage_limit / peak:.3g} {controller.reference_unit} needs more than "
                f"{wish.voltage_limit:g} V, so the response is slower than the model's.",
            )
        )
    return findings


def _stiffness(controller: Tunable) -> float:
    """The gain that holds a position against friction [V/rad]; 0 where an integral part does, or a speed is followed."""
    if controller.output == "speed":
        return 0.0
    if isinstance(controller, Lead):
        return controller.gain
    if isinstance(controller, Pid):
        return 0.0 if controller.ki else controller.kp
    return 0.0 if controller.integral_gain else controller.position_gain


def _complex(pole: complex) -> dict[str, float]:
    return {"real": pole.real, "imaginary": pole.imag}


def _plain(quantity: LoopValue) -> dict[str, Any]:
    value, low, high = (x if math.isfinite(x) else None for x in (quantity.value, *quantity.interval))
    return {"value": value, "interval": [low, high], "level": 0.95, "unit": quantity.unit}
