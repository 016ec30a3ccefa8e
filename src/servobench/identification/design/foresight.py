"""The standard deviations to expect from an experiment, before it is run.

The covariance is that of the estimator that will be used on the data, with every nuisance parameter (friction, offset, delay,
start state) unknown. It is the mean of these parts over motors drawn from the present knowledge of the motor:

- the noise: σ² (J'J)⁻¹, or what the encoder's real rounding of the drawn motor's positions makes of the parameters where that
  is more: rounding that repeats with the input doesn't average out, and that depends on the motor by chance.
  Where a random torque acts, (J'J)⁻¹ of the innovations of a Kalman filter;
- what a first-order model can't know of a delay, which may be the lag of a winding (`models.lag`), as far as the residuals will
  leave it open, and of friction that may be larger near rest (`uncertainty.friction_near_rest`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from servobench.core.channels import Array
from servobench.identification.design.assumed_motor import AssumedMotor
from servobench.identification.estimators.covariance import inverse
from servobench.identification.estimators.disturbance import whiten
from servobench.identification.models.base import STRUCTURES, Structure
from servobench.identification.models.lag import lag_errors
from servobench.identification.uncertainty.friction_near_rest import BEFORE, excess_errors

_BOTH_WAYS = 0.02  # of the samples, as for `structure="auto"`
_SEED = 20_260
_ANY_SHARE = 3**-0.5  # the root mean square of a share of the delay between none and all
_MOVING = 0.1  # of the speed that friction takes: a start speed beside the kink at rest


@dataclass(frozen=True, kw_only=True)
class Foresight:
    """The predicted standard deviations `sd` of the parameters by name, in SI units, and the structure that they belong to.

    `rounding` is how many times larger the scatter from the encoder's real rounding is than white noise would make it, the worse
    of gain and time constant; 1 where a random torque makes it unimportant.
    """

    structure: str
    sd: Mapping[str, float]
    rounding: float


def foresee(motor: AssumedMotor, t: Array, u: Array, draws: int) -> Foresight:
    """Return what an experiment with the input u (N,) at the times t (N,) [s] will tell of a motor at rest at first.

    The same draws are used for all experiments, so that they can be compared.
    """
    _, speed = motor.motion(t, u)
    both = min(np.mean(speed > 0), np.mean(speed < 0)) > _BOTH_WAYS
    name = "first_order_coulomb" if both else "first_order_one_way"
    structure = STRUCTURES[name]
    parts = [_parts(each, structure, t, u, random) for each, random in draw_motors(motor, draws)]
    white, scatter, extra = (np.mean([part[k] for part in parts], axis=0) for k in range(3))
    noise = np.maximum(np.diag(white), np.diag(scatter))
    sd = np.sqrt(noise + np.diag(extra))
    names = [parameter.name for parameter in structure.parameters]
    main = [names.index("gain"), names.index("time_constant")]
    ratio = np.sqrt(np.diag(scatter)[main] / np.diag(white)[main])
    return Foresight(
        structure=name,
        sd=dict(zip(names, map(float, sd), strict=True)),
        rounding=float(ratio.max()) if motor.disturbance is None else 1.0,
    )


def draw_motors(motor: AssumedMotor, draws: int) -> list[tuple[AssumedMotor, np.random.Generator]]:
    """Return motors within the tolerance of the assumed one, with a generator for the noise of each."""
    motors = []
    for number in range(draws):
        random = np.random.default_rng([_SEED, number])
        gain, tau = 1 + motor.tolerance * random.uniform(-1, 1, 2)
        motors.append(
            (replace(motor, gain=motor.gain * gain, time_constant=motor.time_constant * tau), random)
        )
    return motors


def count_position(motor: AssumedMotor, position: Array, random: np.random.Generator) -> Array:
    """Return what the encoder makes of a position (N,) [rad] from a random start: the middle of each count, with the noise."""
    before = np.sqrt(max(motor.noise**2 - motor.quantum**2 / 12, 0.0))
    angle = position + motor.quantum * random.uniform() + before * random.standard_normal(len(position))
    return np.asarray((np.floor(angle / motor.quantum) + 0.5) * motor.quantum, dtype=np.float64)


def _parts(
    motor: AssumedMotor, structure: Structure, t: Array, u: Array, random: np.random.Generator
) -> tuple[Array, Array, Array]:
    """The covariances (P, P) that white noise, real rounding, and what the model can't know make, for one motor."""
    # Exactly at rest the output has no derivative by the start speed, and a fit never ends exactly there.
    barely = _MOVING * motor.gain * motor.coulomb_voltage * float(np.sign(u[np.argmax(u != 0)]))
    data, theta, shared = motor.dataset(t, u), motor.theta(structure, barely), len(structure.parameters)
    prediction = structure.predict(theta, data)
    errors = [structure.unmodelled(theta, data)]
    if motor.delay > 0:
        share = 1.0 if motor.winding else _ANY_SHARE
        errors.append(share * lag_errors(structure, theta, data, motor.delay).sum(axis=1, keepdims=True))
    excess = [BEFORE * each for each in excess_errors(structure, [theta], [data])]
    rounding = count_position(motor, prediction.y, random) - prediction.y
    columns = np.column_stack([prediction.jacobian, rounding, *errors, *excess])
    if motor.disturbance is None:
        columns = columns / motor.noise
    else:
        columns = whiten(columns, data, structure.sliding(theta, data), motor.disturbance)
    j, rounded, e = np.split(columns, [len(theta), len(theta) + 1], axis=1)
    bread = inverse(j.T @ j)
    shift = (bread @ (j.T @ rounded))[:shared, 0]
    scatter = np.outer(shift, shift) if motor.disturbance is None else np.zeros((shared, shared))
    # Each form of an excess friction is as probable as another.
    widths = excess[0].shape[1] if excess else 0
    whole = e.shape[1] - widths
    forms = [np.append(np.arange(whole), whole + n) for n in range(widths)] or [np.arange(whole)]
    unknown = np.mean([_unknown_part(j, bread, e[:, form])[:shared, :shared] for form in forms], axis=0)
    return bread[:shared, :shared], scatter, np.asarray(unknown)


def _unknown_part(j: Array, bread: Array, errors: Array) -> Array:
    """The covariance (P + Q, P + Q) by errors (N, E) of size one beside a Jacobian, as much of them as the residuals will leave.

    `bread` is (J'J)⁻¹; see `estimators.structure_errors`.
    """
    shift = bread @ (j.T @ errors)
    left = errors - j @ shift
    information = np.eye(left.shape[1]) + left.T @ left
    return shift @ np.linalg.solve(information, shift.T)
