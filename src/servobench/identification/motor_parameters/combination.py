"""All observations of a motor combined: the parameters that they determine, their intervals, and what stays open."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from servobench.core.channels import Array
from servobench.core.estimate import Estimate
from servobench.core.finding import Finding, info, list_text, warning
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.base import Fit
from servobench.identification.motor_parameters.observation import UNITS, Motor, Observation, from_values
from servobench.identification.motor_parameters.shaft import shaft_and_current
from servobench.identification.motor_parameters.stall import stall
from servobench.recordings.measurement.dataset import Dataset

_LEVEL = 0.95
_OPEN = 1e-6  # of a direction that the data say nothing about: a parameter with a larger part in it isn't determined
_VAGUE = 0.5  # relative standard deviation above which a parameter is as good as unknown
_CONFLICT = 10.83  # χ² of one more number than is needed: one in a thousand


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorEstimates:
    """The physical parameters that are determined, by name (SI units), with 95 % intervals, and findings on those that aren't.

    The intervals of `estimates` are those of the logarithm, as resistance and torque constant are ratios: value · e^(±1.96
    sd/value), which is Fieller's to third order. That of the viscous friction, a small difference, is value ± 1.96 sd.
    """

    estimates: Mapping[str, Estimate] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()

    def __getitem__(self, name: str) -> Estimate:
        """Return the estimate of a parameter that is determined."""
        return self.estimates[name]


def motor_parameters(
    fit: Fit,
    *,
    stalled: Sequence[Dataset] = (),
    known: Mapping[str, float | tuple[float, float]] | None = None,
) -> MotorEstimates:
    """Return R, k, J, b, the Coulomb torque and, from a second-order fit, L, as far as the data determine them.

    From the fit come K, τ and u_c; from the measured current of its records, where they have one, 1/R and k/R; from `stalled`,
    records of a shaft that stands still under a voltage, R; and `known` states values in SI units, `{"resistance": 8.4}`, or
    with a standard deviation, `{"resistance": (8.4, 0.4)}`. A series resistance, such as the amplifier's, is part of R.

    What isn't determined is left out, and a finding says so and what to measure. Raises `UnknownName` or `UsageError` for a
    `known` that no motor has.
    """
    known_values = from_values(known or {})
    parts = [shaft_and_current(fit), stall(stalled), known_values]
    findings = [finding for part in parts for finding in part.findings]
    if not len(parts[0].values):
        return MotorEstimates(findings=tuple(findings))
    joint = _join(parts)
    start = _start(fit, joint)
    solution = _solve(joint, start)
    findings += _about(solution, fit, joint)
    return MotorEstimates(estimates=solution.estimates(), findings=tuple(findings))


def _join(parts: Sequence[Observation]) -> Observation:
    """All numbers together; the parts don't depend on each other."""
    size = sum(len(part.values) for part in parts)
    covariance, at = np.zeros((size, size)), 0
    for part in parts:
        n = len(part.values)
        covariance[at : at + n, at : at + n] = part.covariance
        at += n
    return Observation(
        laws=tuple(law for part in parts for law in part.laws),
        values=np.concatenate([part.values for part in parts]),
        covariance=covariance,
        sentence=" and ".join(part.sentence for part in parts if part.sentence),
    )


def _start(fit: Fit, joint: Observation) -> dict[str, float]:
    """A motor that obeys the fit exactly: for any R and k, b, J, T_c and L follow from K, τ, u_c and τ_e.

    Any R will do if it isn't determined.
    """
    names = fit.model.names
    k = 1.0 / fit.model["gain"]
    motor = {
        "resistance": 1.0,
        "motor_constant": k,
        "inertia": fit.model["time_constant"] * k * k,
        "viscous_friction": 0.0,
    }
    if "coulomb_voltage" in names and fit.model["coulomb_voltage"] > 0:
        motor["coulomb_torque"] = fit.model["coulomb_voltage"] * k
    if "electrical_time_constant" in names:
        motor["inductance"] = fit.model["electrical_time_constant"]
    return motor


@dataclass(frozen=True, kw_only=True, eq=False)
class _Solution:
    """The motor nearest to the numbers, the covariance of its coordinates, which of them are determined, and the misfit.

    Coordinates are the logarithms of the parameters; that of the viscous friction is R b/k² for the R and k at the solution.
    """

    motor: dict[str, float]
    covariance: Array
    determined: Mapping[str, bool]
    misfit: float
    spare: int

    def relative(self, name: str) -> float:
        """The standard deviation of a coordinate: for all but the viscous friction that of the parameter, as a part of it."""
        place = list(self.motor).index(name)
        return math.sqrt(max(float(self.covariance[place, place]), 0.0))

    def is_determined(self, name: str) -> bool:
        """Whether a parameter is determined, and not only vaguely."""
        return self.determined[name] and self.relative(name) <= _VAGUE

    def estimates(self) -> dict[str, Estimate]:
        """The parameters that are determined."""
        return {name: self._estimate(name) for name in self.motor if self.is_determined(name)}

    def _estimate(self, name: str) -> Estimate:
        value, relative = float(self.motor[name]), self.relative(name)
        if name == "viscous_friction":
            sd = relative * _drag_scale(self.motor)
            interval = (value - TWO_SIDED * sd, value + TWO_SIDED * sd)
        else:
            sd = relative * value
            interval = (value * math.exp(-TWO_SIDED * relative), value * math.exp(TWO_SIDED * relative))
        return Estimate(value=value, sd=sd, interval=interval, level=_LEVEL, unit=UNITS[name])


def _drag_scale(motor: Motor) -> float:
    """k²/R: the viscous friction that would take as much of the torque as the back-emf does."""
    return motor["motor_constant"] ** 2 / motor["resistance"]


def _solve(joint: Observation, start: dict[str, float]) -> _Solution:
    """Weighted least squares for the motor, Gauss and Newton; of several that do as well, one near the start."""
    whiten = _whitener(joint.covariance)
    motor, free = dict(start), len(start)
    for _ in range(60):
        slopes = whiten @ _slopes(joint, motor)
        left = whiten @ (joint.values - _predict(joint, motor))
        change = np.linalg.pinv(slopes, rcond=1e-10) @ left
        change *= min(1.0, 1.0 / float(np.abs(change).max(initial=1e-300)))
        motor = _move(motor, change)
        if np.abs(change).max(initial=0.0) < 1e-12:
            break
    slopes = whiten @ _slopes(joint, motor)
    left = whiten @ (joint.values - _predict(joint, motor))
    _, sizes, directions = np.linalg.svd(slopes, full_matrices=True)
    rank = int(np.sum(sizes > 1e-10 * sizes[0]))
    open_part = np.linalg.norm(directions[rank:], axis=0) if rank < free else np.zeros(free)
    inverse = np.linalg.pinv(slopes, rcond=1e-10)
    return _Solution(
        motor=motor,
        covariance=inverse @ inverse.T,
        determined={name: bool(open_part[n] < _OPEN) for n, name in enumerate(motor)},
        misfit=float(left @ left),
        spare=len(joint.values) - rank,
    )


def _whitener(covariance: Array) -> Array:
    """A matrix W (N, N) with W C W' = 1, computed in units of the standard deviations.

    A combination of numbers that is known to less than a hundred-thousandth of the others' counts as known to that.
    """
    sd = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(sd, sd))
    return np.asarray((vectors / np.sqrt(np.maximum(values, 1e-10))).T / sd, dtype=np.float64)


def _move(motor: dict[str, float], change: Array) -> dict[str, float]:
    """The motor after a change of its coordinates."""
    return {
        name: value + step * _drag_scale(motor) if name == "viscous_friction" else value * math.exp(step)
        for (name, value), step in zip(motor.items(), change, strict=True)
    }


def _predict(joint: Observation, motor: Motor) -> Array:
    return np.array([law(motor) for law in joint.laws])


def _slopes(joint: Observation, motor: dict[str, float]) -> Array:
    """The derivatives of the numbers (N, P) by the coordinates; the laws are smooth, so central differences are enough."""
    columns, step = [], 1e-6
    for n in range(len(motor)):
        change = np.zeros(len(motor))
        change[n] = step
        columns.append(
            (_predict(joint, _move(motor, change)) - _predict(joint, _move(motor, -change))) / (2 * step)
        )
    return np.column_stack(columns)


def _about(solution: _Solution, fit: Fit, joint: Observation) -> list[Finding]:
    findings = []
    determined = [name for name in solution.motor if solution.is_determined(name)]
    if determined:
        sentence = (
            f"{_first_upper(_list_text(determined))} {'comes' if len(determined) == 1 else 'come'} from the model and "
            f"{joint.sentence or 'the shaft'}."
        )
        findings.append(info("motor-parameters-told", sentence, parameters=tuple(determined)))
    undetermined = [name for name in solution.motor if not solution.determined[name]]
    vague = [
        name for name in solution.motor if solution.determined[name] and not solution.is_determined(name)
    ]
    if undetermined:
        findings.append(_open(undetermined, fit))
    if vague:
        findings.append(_vague(vague, solution))
    if "viscous_friction" in determined:
        findings += _near_zero(solution)
    if "motor_constant" in determined:
        findings += _beyond_back_emf(solution, fit, joint)
    if solution.spare > 0 and solution.misfit > _CONFLICT + 2.0 * (solution.spare - 1):
        findings.append(_disagree(joint))
    if "coulomb_torque" in determined and "one_way" in fit.structure:
        findings.append(_with_offset())
    return findings


def _open(names: Sequence[str], fit: Fit) -> Finding:
    """The motor that voltage and shaft can't distinguish from others, and what would."""
    k = 1.0 / fit.model["gain"]
    sentence = (
        f"{_first_upper(_list_text(names))} can't be separated: a motor with twice the resistance and half the inertia "
        "and friction gives the same record. Measure the armature's current, record the stalled shaft with its "
        f"current, or state a value (`known=resistance=8.4`). The torque constant is at most 1/K = {k:.4g} V·s/rad, "
        "its value without viscous friction."
    )
    return info("motor-parameters-not-told", sentence, parameters=tuple(names))


def _vague(names: Sequence[str], solution: _Solution) -> Finding:
    parts = " and ".join(
        f"{parameter_in_words(name)} ({100 * solution.relative(name):.0f} %)" for name in names
    )
    return info(
        "motor-parameters-vague",
        f"Too uncertain to give: {parts} (relative standard deviations). Voltage and speed were nearly "
        "proportional; use an input that changes often, in both directions.",
        parameters=tuple(names),
    )


def _beyond_back_emf(solution: _Solution, fit: Fit, joint: Observation) -> list[Finding]:
    """Whether the back-emf alone would hold the motor below the speed that it reaches: K k = 1/(1 + R b/k²) is at most 1."""
    constant = solution.estimates()["motor_constant"].interval[0]
    gain = min(map(abs, fit["gain"].interval))
    if constant * gain <= 1:
        return []
    sentence = (
        f"The torque constant is at least {constant:.4g} V·s/rad, and with that a motor can't turn faster than "
        f"{1 / constant:.4g} rad/s per volt, but this one reaches {gain:.4g}: friction would have to drive it. The "
        f"model and {joint.sentence} contradict each other; check the torque constant, and the units of input and output."
    )
    return [warning("motor-parameters-disagree", sentence, parameters=("motor_constant", "viscous_friction"))]


def _near_zero(solution: _Solution) -> list[Finding]:
    low, high = solution.estimates()["viscous_friction"].interval
    if not low <= 0 <= high:
        return []
    sentence = "The viscous friction isn't significantly different from zero: its interval includes zero."
    return [info("viscous-friction-near-zero", sentence, parameters=("viscous_friction",))]


def _disagree(joint: Observation) -> Finding:
    return warning(
        "motor-parameters-disagree",
        f"The model and {joint.sentence} contradict each other by more than chance: the motor constant or the "
        "resistance is wrong, the current's scale is wrong, or a series resistance was left out.",
        parameters=("resistance", "motor_constant"),
    )


def _with_offset() -> Finding:
    return info(
        "coulomb-torque-with-offset",
        "The motor turned one way only, so the Coulomb torque includes the input's offset.",
        parameters=("coulomb_torque",),
    )


def _list_text(names: Sequence[str]) -> str:
    return list_text([parameter_in_words(name) for name in names])


def _first_upper(text: str) -> str:
    return text[:1].upper() + text[1:]
