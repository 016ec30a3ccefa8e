"""The verb `tune`: a controller for an identified motor and a wish, with what is left of its margins; or why it can't be had.

What is refused, and why from there on, is told in docs/decisions/0019-control.md.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from servobench.control.base import CONTROLLERS
from servobench.control.lead import Lead
from servobench.control.pid import Pid
from servobench.errors import UnknownName, UsageError
from servobench.experiment.experiment import Experiment
from servobench.export.answer import Answer
from servobench.export.first_order import FirstOrderMotor
from servobench.finding import Finding, info, warning
from servobench.tuning.base import METHODS, Method, Tunable, Wish
from servobench.tuning.loop import Told, loop_margins, nominal_margins
from servobench.tuning.response import step_response, ticks_of, unit_step

SCHEMA = "servobench.tuning/1"
LEAST_PHASE, GOOD_PHASE = math.radians(30), math.radians(45)
"""What a loop has to keep of its phase at the least, and what is good practice (Åström and Murray, section 10.2)."""
LEAST_FACTOR = 2.0
"""By which the gain may be off before a loop is unstable."""
_MOST_TURNED = 0.5  # rad of phase in a sample time at the gain crossover: as far as gains serve that are found without sampling
_SLOWEST = 1000.0  # times slower than wished: as far as an answer is looked for, in steps of a twentieth
_STEP, _SLACK = 1.05, 1.01
_TUNABLE = ("lead", "pid", "state_feedback")


@dataclass(frozen=True, kw_only=True)
class Tuned:
    """A controller for a motor: margins and step response with 95 % intervals, and what there is to know.

    `method` and `wish` are what it was found by and for, `findings` what to know of it.

    `largest_step` is the change of the reference [rad or rad/s] that takes all of the voltage limit, without friction.
    """

    controller: Tunable
    method: str
    wish: Wish
    margins: Mapping[str, Told]
    response: Mapping[str, Told]
    largest_step: float
    findings: tuple[Finding, ...]

    @property
    def toml(self) -> str:
        """The controller as the table [controller] of an experiment's file."""
        text = Experiment(controller=self.controller).to_toml()
        return "[controller]" + text.partition("[controller]")[2].partition("\n[")[0].rstrip() + "\n"

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
            "margins": {name: _plain(each) for name, each in self.margins.items()},
            "response": {name: _plain(each) for name, each in self.response.items()},
            "largest_step": {"value": self.largest_step, "unit": self.controller.reference_unit},
            "findings": [
                {"code": each.code, "severity": str(each.severity), "sentence": each.sentence}
                for each in self.findings
            ],
        }


def tune(answer: Answer, method: str, wish: Wish) -> Tuned:
    """Return the controller that a method finds for the motor in an answer.

    Raises `UsageError` where the wish can't be had: faster than delay, sample time or voltage allow, with the fastest that
    can; and for a motor of another structure than the first-order one, or one that isn't driven by a voltage.
    """
    if wish.controller not in _TUNABLE:
        raise UnknownName("controller that can be tuned", wish.controller, _TUNABLE)
    motor = FirstOrderMotor.of(answer, "tune", "rad")
    finder = METHODS[method]
    controller = finder(motor, wish)
    margins = loop_margins(controller, motor, wish.sample_time)
    problem = _too_fast(controller, motor, wish, margins)
    if not problem:
        response, peak = step_response(controller, motor, wish.sample_time, margins["gain_crossover"].value)
        problem = _too_high(controller, wish, peak)
    if problem:
        raise UsageError(f"{finder.told(wish)}: {problem}{_fastest(finder, motor, wish)}")
    return Tuned(
        controller=controller,
        method=method,
        wish=wish,
        margins=margins,
        response=response,
        largest_step=wish.voltage_limit / peak,
        findings=tuple(_findings(answer, controller, motor, wish, margins, peak)),
    )


def _too_fast(
    controller: Tunable, motor: FirstOrderMotor, wish: Wish, margins: Mapping[str, Told] | Mapping[str, float]
) -> str:
    """Why a controller is too fast for delay and sample time, in a clause, or nothing. The worse end of an interval counts."""
    low = {name: each.interval[0] if isinstance(each, Told) else each for name, each in margins.items()}
    high = {name: each.interval[1] if isinstance(each, Told) else each for name, each in margins.items()}
    crossover = high["gain_crossover"]
    if math.isnan(crossover):
        return "the loop's gain is below 1 everywhere: it would do nothing"
    if crossover * wish.sample_time > _MOST_TURNED:
        where = (
            f"has its crossover at {crossover:.3g} rad/s"
            if math.isfinite(crossover)
            else f"has a gain above 1 up to half the sample rate, {math.pi / wish.sample_time:.4g} rad/s"
        )
        return (
            f"faster than a controller that runs every {wish.sample_time:g} s can be: its loop {where}, and "
            f"{_MOST_TURNED / wish.sample_time:.3g} rad/s is as far as a crossover goes"
        )
    if low["phase_margin"] < LEAST_PHASE or low["gain_margin"] < LEAST_FACTOR:
        passed, left = motor.delay + wish.sample_time, math.degrees(low["phase_margin"])
        return (
            f"too fast for the {passed:.3g} s that pass before anything is seen (delay and sample time) and a filter of "
            f"{1 / controller.cutoff:.3g} s: {left:.0f}° of the phase would be left, and a factor of {low['gain_margin']:.2g} "
            f"of the gain; {math.degrees(LEAST_PHASE):.0f}° and {LEAST_FACTOR:g} are the least to have"
        )
    return ""


def _too_high(controller: Tunable, wish: Wish, peak: float) -> str:
    """Why a step asks for more voltage than there is, in a clause, or nothing. `peak` [V] is what a unit of it takes."""
    if wish.step is None or peak * abs(wish.step) <= wish.voltage_limit:
        return ""
    return (
        f"a step of {wish.step:g} {controller.reference_unit} would ask for {peak * abs(wish.step):.3g} V, and the limit is "
        f"{wish.voltage_limit:g} V"
    )


def _fastest(finder: Method, motor: FirstOrderMotor, wish: Wish) -> str:
    """What the fastest loop is that can be had by the same wish, to a twentieth; empty where there is none."""
    slower = wish
    for _ in range(math.ceil(math.log(_SLOWEST) / math.log(_STEP))):
        slower = slower.slower(_STEP)
        try:
            found = finder(motor, slower)
        except UsageError:
            continue
        nominal = nominal_margins(found, motor, wish.sample_time)
        if _too_fast(found, motor, wish, nominal):
            continue
        if wish.step is not None and _too_high(found, wish, _peak(found, motor, wish, nominal)):
            continue
        # The intervals cost hundreds of times more: only of what can be had without them.
        if not _too_fast(found, motor, wish, loop_margins(found, motor, wish.sample_time)):
            # Slower by more than the rounding of what is printed.
            return f"; about {finder.told(slower.slower(_SLACK))} is the fastest that can be had"
    return ""


def _peak(controller: Tunable, motor: FirstOrderMotor, wish: Wish, margins: Mapping[str, float]) -> float:
    """The largest voltage [V] after a unit step of the reference, of the motor as it is estimated."""
    ticks = ticks_of(motor, wish.sample_time, margins["gain_crossover"])
    centre = (motor.gain.value, motor.time_constant.value, motor.delay)
    return unit_step(controller, *centre, wish.sample_time, ticks).peak


def _findings(
    answer: Answer,
    controller: Tunable,
    motor: FirstOrderMotor,
    wish: Wish,
    margins: Mapping[str, Told],
    peak: float,
) -> list[Finding]:
    found = []
    if answer.verdict == "doubtful":
        found.append(
            warning(
                "motor-doubtful",
                "The motor's result is doubtful, and so is what is made of it; see why first.",
            )
        )
    low = margins["phase_margin"].interval[0]
    if low < GOOD_PHASE:
        found.append(
            warning(
                "margin-small",
                f"Of the phase {math.degrees(low):.0f}° may be all that is left, and {math.degrees(GOOD_PHASE):.0f}° are good "
                "practice: wish for a slower loop or more damping.",
            )
        )
    gain, coulomb = _stiffness(controller), motor.coulomb_voltage
    if gain and coulomb is not None and coulomb.value > 0:
        unit = controller.reference_unit
        found.append(
            info(
                "friction-leaves-error",
                f"Without an integral part, Coulomb friction of {coulomb.value:.2g} V can hold the shaft up to "
                f"{coulomb.value / abs(gain):.2g} {unit} off its reference; a third pole (--poles) brings one.",
            )
        )
    if wish.step is None:
        found.append(
            info(
                "largest-step",
                f"A step of more than {wish.voltage_limit / peak:.3g} {controller.reference_unit} asks for more than "
                f"{wish.voltage_limit:g} V, and is answered more slowly than the model says.",
            )
        )
    return found


def _stiffness(controller: Tunable) -> float:
    """The gain that holds a position against friction [V/rad]; 0 where an integral part does, or a speed is followed."""
    if controller.output == "speed":
        return 0.0
    if isinstance(controller, Lead):
        return controller.gain
    if isinstance(controller, Pid):
        return 0.0 if controller.ki else controller.kp
    return 0.0 if controller.integral_gain else controller.position_gain


def _plain(told: Told) -> dict[str, Any]:
    value, low, high = (x if math.isfinite(x) else None for x in (told.value, *told.interval))
    return {"value": value, "interval": [low, high], "level": 0.95, "unit": told.unit}
