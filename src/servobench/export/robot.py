"""Constants for robot code: feedforward constants of an identified mechanism and feedback gains, in the user's unit.

u = kS sgn(v) + kG + kCos cos(θ - φ) + kV v + kA dv/dt, with kV = 1/K and kA = τ/K, which follows from the first-order motor
solved for its input. kG is a load that doesn't change (an elevator's weight), kCos that of an arm, at its largest where θ = φ.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from servobench.core.errors import NotIdentifiable, UsageError
from servobench.core.estimate import Estimate
from servobench.core.rounding import TWO_SIDED
from servobench.export.base import Wishes
from servobench.export.first_order import comment_for, first_order_motor
from servobench.export.summary import ResultSummary
from servobench.export.tuning import SAFE, Tuning, tune_loops
from servobench.identification.design.assumed_motor import AssumedMotor
from servobench.identification.design.next_tests import best_next_tests
from servobench.systems.first_order import FirstOrderMotor, inverse, ratio

TARGETS_OF_ROBOTS = ("cpp", "java", "python", "wpilib")
WISHES = frozenset({"unit", "wheel_diameter", "sample_time", "measurement_delay", "closed_loop"})
PERIOD = 0.02
"""The default period of a robot's loop [s]."""
_LEAST_LOAD = 0.05  # V; a smaller offset is that of an amplifier, and no weight
_SHARP = 0.1  # of kA: half of an interval that asks for no more tests
_COUNT = 2 * math.pi / 4096  # rad; an encoder as robots have them, which only puts tests in an order
_GRAVITY = ("gravity_voltage_sine", "gravity_voltage_cosine")


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotConstants:
    """Feedforward constants by name, each with its interval, and gains for loops around speed and position.

    `unit` is the unit of position they are in, `period` [s] the loop's, `measurement_delay` [s] how late its measurement comes,
    `comment` where they come from, `notes` what to know of them. `level_angle` is φ [`unit`], None without an arm.
    """

    unit: str
    feedforward: Mapping[str, Estimate]
    gains: Tuning
    period: float
    measurement_delay: float
    level_angle: float | None
    comment: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def mechanism(self) -> str:
        """WPILib's name of a mechanism with these constants: `Arm`, `Elevator`, or `SimpleMotor`."""
        return (
            "Arm" if "kCos" in self.feedforward else "Elevator" if "kG" in self.feedforward else "SimpleMotor"
        )


def robot_constants(answer: ResultSummary, target: str, wishes: Wishes) -> RobotConstants:
    """Return the constants for robot code; `target` is what messages call the form that asks for them.

    Raises `UsageError` for a motor that isn't of first order, not driven by a voltage, or turned the other way by it, and for a
    unit that doesn't fit; `NotIdentifiable` where its gain isn't known.
    """
    if answer.document["parameters"]["gain"].get("state") == "unknown":
        raise NotIdentifiable(
            f"{target}: these data don't determine the gain, so there is no kV; identify tests at two or more voltages together, "
            "such as all four of SysId"
        )
    own = None if answer.user_unit is None or wishes.wheel_diameter else answer.user_unit[0]
    motor = first_order_motor(answer, target, wishes.unit or own, wishes.wheel_diameter)
    if motor.gain.value < 0:
        raise UsageError(
            f"{target}: a positive voltage turns this motor in the negative direction; invert the motor or the encoder, then "
            "identify again (a robot's constants are positive)"
        )
    period, late = wishes.sample_time or PERIOD, wishes.measurement_delay or 0.0
    arm, level_angle = _arm(answer, motor.unit)
    constants = feedforward(motor) | arm
    if arm:  # whose load has its own constant: what is left of an offset is none
        constants.pop("kG", None)
    gains = tune_loops(motor, period, wishes.closed_loop, measurement_delay=late)
    return RobotConstants(
        unit=motor.unit,
        feedforward=constants,
        gains=gains,
        period=period,
        measurement_delay=late,
        level_angle=level_angle,
        comment=comment_for(motor, answer),
        notes=(*_notes(motor, level_angle, constants), *_range_note(answer), *_margin_note(gains)),
    )


def feedforward(motor: FirstOrderMotor) -> dict[str, Estimate]:
    """Return kS [V], kV [V·s/unit], kA [V·s²/unit] and, where there is an offset of 0.05 V or more, kG [V], with intervals.

    None of the first three is negative, and kA lies no further out than τ/K does at the ends of both intervals.
    """
    gain, tau = motor.gain, motor.time_constant
    acceleration = ratio(tau, gain, float(motor.moments[0, 1]), f"V·s²/{motor.unit}")
    low, high = acceleration.interval
    if gain.interval[0] > 0:
        low, high = (
            max(low, tau.interval[0] / gain.interval[1]),
            min(high, tau.interval[1] / gain.interval[0]),
        )
    constants = {
        "kV": inverse(gain, f"V·s/{motor.unit}"),
        "kA": _not_negative(replace(acceleration, interval=(low, high))),
    }
    if motor.coulomb_voltage is not None:
        constants = {"kS": _not_negative(motor.coulomb_voltage), **constants}
    offset = motor.offset_voltage
    if (
        offset is not None
        and abs(offset.value) >= _LEAST_LOAD
        and not offset.interval[0] <= 0 <= offset.interval[1]
    ):
        constants["kG"] = offset
    return constants


def interval_text(e: Estimate) -> str:
    """Return a constant's interval in words: both ends, the upper one of what may be 0, or that it isn't known."""
    low, high = e.interval
    if not (math.isfinite(low) and math.isfinite(high)):
        return "not known from these data"
    if low <= 0.0 <= e.value:
        return f"at most {number_text(high, e)}"
    return f"{number_text(low, e)} to {number_text(high, e)}"


def number_text(value: float, e: Estimate) -> str:
    """Return a number of an estimate with two digits of half of its interval, four digits at least and ten at most."""
    half = 0.5 * (e.interval[1] - e.interval[0])
    size = max(abs(value), 1e-300)
    digits = 2 + math.floor(math.log10(size)) - math.floor(math.log10(half)) if 0 < half < math.inf else 4
    return f"{value:.{min(max(digits, 4), 10)}g}"


def _not_negative(e: Estimate) -> Estimate:
    return replace(e, value=max(e.value, 0.0), interval=(max(e.interval[0], 0.0), max(e.interval[1], 0.0)))


def _arm(answer: ResultSummary, unit: str) -> tuple[dict[str, Estimate], float | None]:
    """kCos and the angle at which gravity takes the most, from u_gs sin θ + u_gc cos θ = kCos cos(θ - φ)."""
    if not answer.estimates.keys() >= set(_GRAVITY):
        return {}, None
    names = list(answer.estimates)
    rows = [names.index(name) for name in _GRAVITY]
    sine, cosine = (answer.estimates[name].value for name in _GRAVITY)
    size = math.hypot(sine, cosine)
    slope = np.array([sine, cosine]) / (size or 1.0)
    sd = math.sqrt(max(float(slope @ answer.covariance[np.ix_(rows, rows)] @ slope), 0.0))
    angle = math.atan2(sine, cosine) * {"rad": 1.0, "deg": 180 / math.pi, "rev": 0.5 / math.pi}.get(unit, 1.0)
    ends = (max(size - TWO_SIDED * sd, 0.0), size + TWO_SIDED * sd)
    return {"kCos": Estimate(value=size, sd=sd, interval=ends, level=0.95, unit="V")}, angle


def _notes(motor: FirstOrderMotor, level_angle: float | None, constants: Mapping[str, Estimate]) -> list[str]:
    notes = []
    if motor.coulomb_voltage is None:
        notes.append("kS is left out: the model has no friction.")
    if motor.one_way:
        notes.append(
            "The motor turned one way only, so kS holds friction and any constant load (kG) together; let it turn both ways."
        )
    if level_angle is not None:
        notes.append(
            f"kCos is the voltage that holds the arm level. In these data it is level at {level_angle:.4g} {motor.unit}; "
            "subtract that from the angle that the feedforward gets."
        )
    elif "kG" in constants:
        notes.append(
            "kG is the offset voltage, a constant load (an elevator's weight) if nothing else shifts the input."
        )
    return notes


def _range_note(answer: ResultSummary) -> list[str]:
    """Between which voltages the constants were found."""
    low, high = answer.input_range
    if not math.isfinite(low + high):
        return []
    return [
        f"In the data the voltage was between {low:.3g} and {high:.3g} V; elsewhere the constants weren't tested."
    ]


def _margin_note(gains: Tuning) -> list[str]:
    """A warning about a loop whose margin the intervals don't warrant."""
    if gains.phase_margin[1] >= SAFE:
        return []
    return [
        f"The feedback gains may be unsafe: over the intervals the speed loop's phase margin lies between "
        f"{math.degrees(gains.phase_margin[1]):.0f} and {math.degrees(gains.phase_margin[2]):.0f} deg, and below 0 it is "
        "unstable. Ask for a slower closed loop (`closed_loop=...`), or record tests that determine the delay."
    ]


def next_tests_of(answer: ResultSummary, period: float) -> tuple[str, ...]:
    """Return the three tests that would sharpen kA most, in words, the best first; none where kA is known to 10 %.

    They stay within the voltages of the data; `period` [s] is that of the loop that would log them.
    """
    motor = first_order_motor(answer, "the design of a test")
    e, largest = feedforward(motor)["kA"], max(map(abs, answer.input_range))
    if (
        motor.unit != "rad"
        or not 0 < largest < math.inf
        or e.interval[1] - e.interval[0] < 2 * _SHARP * e.value
    ):
        return ()
    tau = motor.time_constant
    assumed = AssumedMotor(
        name="the mechanism",
        gain=motor.gain.value,
        time_constant=max(tau.value, min(0.5 * tau.interval[1], period))
        if math.isfinite(tau.interval[1])
        else tau.value,
        tolerance=0.0,
        quantum=_COUNT,
        noise=_COUNT / math.sqrt(12),
        coulomb_voltage=max(motor.coulomb_voltage.value, 0.0) if motor.coulomb_voltage else 0.0,
        delay=motor.delay,
    )
    tests = best_next_tests(assumed, tuple(answer.estimates), answer.covariance, largest, period)
    return tuple(each.sentence for each in tests)
