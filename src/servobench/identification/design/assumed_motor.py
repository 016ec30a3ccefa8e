"""The motor that a design assumes, and where each value is from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from servobench.core.channels import LARGEST_VALUE, LONGEST_STEP, SHORTEST_STEP, Array
from servobench.core.errors import FormatError, NotIdentifiable
from servobench.core.finding import Severity, Verdict
from servobench.identification.estimators.disturbance import Disturbance
from servobench.identification.models.base import STRUCTURES, Structure
from servobench.identification.models.nominal import nominal_values
from servobench.identification.result import SCHEMAS
from servobench.identification.uncertainty.cautions import cautions
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source
from servobench.rig.motor.parameters import DataSheet, data_sheet

if TYPE_CHECKING:
    from servobench.identification.result import Result

TOLERANCE = 0.2  # a data sheet's gain and time constant are held for no better than this
_FRICTION = 0.02  # of the sheet's voltage: the assumed Coulomb friction if it isn't known
_ENCODER = (
    "the encoder's {} counts a turn are the only noise: no random torque, no error of the clock; a design from a "
    "recording of the motor (`recording=...`) uses its noise"
)
_KNOWN = 2.5  # standard deviations of an estimate to which the limits hold


@dataclass(frozen=True, kw_only=True)
class AssumedMotor:
    """A motor as assumed before the experiment: a first-order motor, by how much it may differ, and the noise.

    `name` says which motor it is. `gain` [rad/(s·V)] and `time_constant` [s] may be off by the relative `tolerance`;
    `coulomb_voltage` and `offset_voltage` [V]; `dead_band` [V] is the amplifier's; `delay` [s] is the lag of the winding where
    `winding` is true. `quantum` [rad] is a count of the encoder, `noise` the standard deviation of a sample [rad], at least
    quantum/√12, that of an error spread evenly over a count (Widrow and Kollár 2008); `disturbance` is a random torque, None
    without one. `resistance` [Ω] and `motor_constant` [V·s/rad] are None if they aren't known. `assumptions` are sentences.
    """

    name: str
    gain: float
    time_constant: float
    tolerance: float
    quantum: float
    noise: float
    coulomb_voltage: float = 0.0
    offset_voltage: float = 0.0
    delay: float = 0.0
    dead_band: float = 0.0
    winding: bool = False
    disturbance: Disturbance | None = None
    resistance: float | None = None
    motor_constant: float | None = None
    assumptions: tuple[str, ...] = ()

    def dataset(self, t: Array, u: Array, y: Array | None = None) -> Dataset:
        """Return the data of an experiment with input u (N,) at the times t (N,) [s], from rest; y (N,) is the position [rad]."""
        return Dataset(
            name="design",
            t_input=t,
            u=u,
            input_unit="V",
            input_before=0.0,
            t_output=t,
            y=np.zeros(len(t)) if y is None else y,
            output_unit="rad",
            kind="position",
            source=Source(name="design"),
            quantum=self.quantum,
        )

    def theta(self, structure: Structure, start_speed: float = 0.0) -> Array:
        """Return the structure's parameters (P + Q,), with a start at position 0 and a speed [rad/s]."""
        value = {
            "gain": self.gain,
            "time_constant": self.time_constant,
            "coulomb_voltage": self.coulomb_voltage,
            "offset_voltage": self.offset_voltage,
            "delay": self.delay,
        }
        return np.array([*(value[p.name] for p in structure.parameters), 0.0, start_speed])

    def motion(
        self, t: Array, u: Array, gain: float = 1.0, time_constant: float = 1.0
    ) -> tuple[Array, Array]:
        """Return position [rad] and speed [rad/s] (N,) at t from rest, gain and time constant times so much."""
        from servobench.identification.models.first_order import FirstOrder

        structure = STRUCTURES["first_order_coulomb"]
        if not isinstance(structure, FirstOrder):
            raise TypeError(f"first_order_coulomb is {type(structure).__name__}; expected FirstOrder")
        theta = self.theta(structure)
        theta[:2] *= gain, time_constant
        data, none = self.dataset(t, u), np.empty(0, dtype=np.int64)
        position, _ = structure.response(theta, data, "position", none)
        speed, _ = structure.response(theta, data, "speed", none)
        return position, speed


def from_data_sheet(name: str) -> AssumedMotor:
    """Return the motor of a data sheet, within 20 %; raises `UnknownName`.

    A sheet has no friction; 2 % of its voltage limit is assumed, as some there always is.
    """
    sheet = data_sheet(name)
    nominal = nominal_values(sheet.motor)
    quantum = 2 * math.pi / sheet.counts_per_rev
    friction = nominal.get("coulomb_voltage", _FRICTION * sheet.voltage_limit)
    return AssumedMotor(
        name=name,
        gain=nominal["gain"],
        time_constant=nominal["time_constant"],
        tolerance=TOLERANCE,
        quantum=quantum,
        noise=quantum / math.sqrt(12),
        coulomb_voltage=friction,
        delay=nominal["delay"],
        dead_band=sheet.dead_band,
        winding=sheet.motor.inductance > 0,
        resistance=sheet.motor.resistance,
        motor_constant=sheet.motor.motor_constant,
        assumptions=(
            *_of_the_amplifier(sheet),
            f"gain and time constant are those of the data sheet {name}, within {100 * TOLERANCE:g} %",
            f"Coulomb friction is assumed to take {friction:.2g} V, as the data sheet doesn't give it"
            if "coulomb_voltage" not in nominal
            else f"Coulomb friction takes {friction:.2g} V",
            _ENCODER.format(sheet.counts_per_rev),
        ),
    )


def _of_the_amplifier(sheet: DataSheet) -> tuple[str, ...]:
    if not sheet.dead_band:
        return ()
    return (
        f"the amplifier's dead band, {sheet.dead_band:g} V, is compensated by its driver; if it isn't, turn one way "
        "only",
    )


def from_result(result: Result, name: str) -> AssumedMotor:
    """Return the motor that was identified, with its noise; raises `NotIdentifiable` where there is no such model."""
    fit, data = result.fit, result.data
    if result.verdict is Verdict.REFUSED:
        reason = next(f" {each.sentence}" for each in result.findings if each.severity is Severity.REFUSAL)
        raise NotIdentifiable(f"{_no_motor(name)}{reason}")
    if fit is None:
        raise NotIdentifiable(
            f"{name} has no model to design for; record the motor again, or give a data sheet"
        )
    record = data[0]
    if (
        not {"gain", "time_constant"} <= set(fit.model.names)
        or record.input_unit != "V"
        or record.position_unit != "rad"
    ):
        raise NotIdentifiable(
            f"{name}: its model is {fit.structure} from {record.input_unit} to {record.position_unit}; a design needs gain "
            "and time constant from V to rad: give a data sheet"
        )
    values = {each: (e.value, e.sd) for each, e in fit.estimates.items()}
    quantum = record.quantum or math.sqrt(12) * fit.residual_sd
    least = quantum / math.sqrt(12)
    extra = f"the noise is {max(fit.residual_sd, least):.3g} rad, as in that recording"
    if fit.disturbance is not None:
        extra = "random torque and noise are those of that recording"
    made = _from_result(name, values, quantum, max(fit.residual_sd, least), extra, fit.disturbance)
    return _with_cautions(made, result.to_dict(derived=False))


def from_result_file(content: Mapping[str, Any], name: str, counts_per_rev: float) -> AssumedMotor:
    """Return the motor of a result's JSON; the counts of a turn aren't in it. Raises `FormatError`, `NotIdentifiable`."""
    if content.get("schema") not in SCHEMAS:
        raise FormatError(f"{name} isn't a result of servobench; expected the schema {SCHEMAS[-1]}")
    if content.get("verdict") == Verdict.REFUSED:
        raise NotIdentifiable(_no_motor(name))
    parameters = content.get("parameters") or {}
    if not {"gain", "time_constant"} <= set(parameters):
        raise NotIdentifiable(f"{name} has no gain and time constant to design for; give a data sheet")
    if parameters["gain"]["unit"] != "rad/(s·V)":
        raise NotIdentifiable(
            f"{name}: its gain is in {parameters['gain']['unit']}; a design needs rad/(s·V): give a data sheet"
        )
    try:
        values = {each: (float(p["value"]), float(p["sd"] or 0.0)) for each, p in parameters.items()}
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise FormatError(f"{name} is incomplete: {error!r} while reading its parameters") from None
    _check_motor(name, values)
    quantum = 2 * math.pi / counts_per_rev
    extra = _ENCODER.format(f"{counts_per_rev:g}")
    return _with_cautions(_from_result(name, values, quantum, quantum / math.sqrt(12), extra, None), content)


def _no_motor(name: str) -> str:
    """What is said of a result that was refused: its values are no motor's."""
    return f"{name} is refused, so there is no motor to design for."


def _with_cautions(motor: AssumedMotor, content: Mapping[str, Any]) -> AssumedMotor:
    return replace(motor, assumptions=(*motor.assumptions, *cautions(content)))


def _check_motor(name: str, values: Mapping[str, tuple[float, float]]) -> None:
    """Raise `FormatError` where values and standard deviations by name aren't those of a motor."""
    for each, numbers in values.items():
        if not max(map(abs, numbers)) <= LARGEST_VALUE:
            raise FormatError(
                f"{name}: its {each} is {numbers[0]:g} with a standard deviation of {numbers[1]:g}; no motor has that"
            )
    tau = values["time_constant"][0]
    if not SHORTEST_STEP <= tau <= LONGEST_STEP or values["gain"][0] == 0.0:
        raise FormatError(
            f"{name}: its gain is {values['gain'][0]:g} and its time constant {tau:g} s; expected a gain that isn't zero and "
            f"{SHORTEST_STEP:g} to {LONGEST_STEP:g} s"
        )


def _from_result(
    name: str,
    values: Mapping[str, tuple[float, float]],
    quantum: float,
    noise: float,
    extra: str,
    disturbance: Disturbance | None,
) -> AssumedMotor:
    known = {each: value for each, (value, _) in values.items()}
    uncertain = max(_KNOWN * values[each][1] / abs(known[each]) for each in ("gain", "time_constant"))
    tolerance = min(max(uncertain, 0.05), 0.5)
    return AssumedMotor(
        name=name,
        gain=known["gain"],
        time_constant=known["time_constant"],
        tolerance=tolerance,
        quantum=quantum,
        noise=noise,
        coulomb_voltage=max(known.get("coulomb_voltage", 0.0), 0.0),
        offset_voltage=known.get("offset_voltage", 0.0),
        delay=max(known.get("delay", 0.0), 0.0),
        disturbance=disturbance,
        assumptions=(
            f"the motor is that of {name}, within {100 * tolerance:.2g} %",
            extra,
        ),
    )
