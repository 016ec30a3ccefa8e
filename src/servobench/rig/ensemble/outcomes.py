"""The outcomes of each motor of an ensemble: gain and time constant; with a controller overshoot, settling time, phase margin."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from servobench.core.channels import Array
from servobench.rig.ensemble.motors import Motors
from servobench.rig.ensemble.simulation import Course
from servobench.rig.experiment import Experiment
from servobench.systems.control.open_loop import OpenLoop
from servobench.systems.control.sampled_law import sampled_law

UNITS: Mapping[str, str] = MappingProxyType(
    {
        "gain": "rad/(s·V)",
        "time_constant": "s",
        "overshoot": "1",
        "settling_time": "s",
        "phase_margin": "rad",
    }
)
"""The outcomes and their units; an overshoot is a part of the step."""

_FREQUENCIES = 600  # over six decades below the Nyquist frequency: neighbours are 2.3 % apart
_AT_ONCE = 1000  # motors whose frequency responses are held in memory
_TURN = 2 * np.pi


def outcomes_of(motors: Motors, course: Course, experiment: Experiment) -> dict[str, Array]:
    """Return each outcome that the experiment has (n,): a margin needs a controller, an overshoot a step of its reference."""
    outcomes = {"gain": motors.gain, "time_constant": motors.time_constant}
    if isinstance(experiment.controller, OpenLoop):
        return outcomes
    if np.isfinite(course.overshoot).any():
        outcomes |= {"overshoot": course.overshoot, "settling_time": course.settling_time}
    return {**outcomes, "phase_margin": phase_margins(motors, experiment)}


def phase_margins(motors: Motors, experiment: Experiment) -> Array:
    """Return the phase margin of the sampled loop around each motor (n,) [rad], infinite where |L| is 1 nowhere.

    L(z) = C(z) G(z), z = e^(jωh), with G(z) by zero-order hold (Franklin, Powell and Workman 1998, section 4.3) and no friction.
    At |L| = 1, found on a grid of frequencies and by a straight line in log |L| within its cells, the margin is the phase of -L;
    of several the one nearest to 0 counts.
    """
    h = experiment.sample_time
    law = sampled_law(experiment.controller, h)
    omega = np.geomspace(1e-6 * np.pi / h, (1 - 1e-6) * np.pi / h, _FREQUENCIES)
    by_law = np.array([law.at(1j * np.tan(0.5 * each * h)) for each in omega])
    margins = []
    for start in range(0, len(motors), _AT_ONCE):
        part = Motors(
            parameters={name: each[start : start + _AT_ONCE] for name, each in motors.parameters.items()},
            series=motors.series,
        )
        margins.append(_nearest_margins(by_law * _motor_responses(part, np.exp(1j * omega * h), h)))
    return np.concatenate(margins)


def _motor_responses(motors: Motors, z: Array, h: float) -> Array:
    """The angle over the voltage of each motor at each z (n, F)."""
    from servobench.rig.ensemble import kernels as at

    c = motors.coefficients(h, 0.0, 1.0)[:, : len(motors), None]
    # (zI - A)⁻¹ B by Cramer's rule, then θ (z - 1) = t₀ i + t₁ ω + t_b u.
    det = (z - c[at.A00]) * (z - c[at.A11]) - c[at.A01] * c[at.A10]
    current = ((z - c[at.A11]) * c[at.B0] + c[at.A01] * c[at.B1]) / det
    speed = ((z - c[at.A00]) * c[at.B1] + c[at.A10] * c[at.B0]) / det
    return np.asarray((c[at.T0] * current + c[at.T1] * speed + c[at.TB]) / (z - 1.0))


def _nearest_margins(loop: Array) -> Array:
    """The margin nearest to 0 of loops (n, F)."""
    size, phase = np.log(np.abs(loop)), np.angle(-loop)
    crosses = size[:, :-1] * size[:, 1:] <= 0.0
    place = size[:, :-1] / np.where(crosses, size[:, :-1] - size[:, 1:], 1.0)
    turned = (np.diff(phase, axis=1) + np.pi) % _TURN - np.pi
    there = (phase[:, :-1] + place * turned + np.pi) % _TURN - np.pi
    candidates = np.where(crosses, there, np.inf)
    nearest = np.argmin(np.abs(candidates), axis=1)
    return np.asarray(candidates[np.arange(len(loop)), nearest])
