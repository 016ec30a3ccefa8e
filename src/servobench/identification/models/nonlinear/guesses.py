"""First guesses for the nonlinear motors, with the motion that drives friction and gravity taken from the data.

With measured direction, speed and angle, every lost voltage is a known signal, and the output is linear in all parameters
except τ, d and ω_s. So a coarse grid over those three, with a linear least-squares problem at each point, comes near the
minimum of the cost without a step that could diverge, as it does for the first-order structures (`models.search`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.identification.models.base import Parameter, Structure
from servobench.identification.models.common_parameters import DELAY, GAIN, OFFSET, TIME_CONSTANT
from servobench.identification.models.first_order import FirstOrder
from servobench.identification.models.motion import check_moves, directions, smooth_speed
from servobench.identification.models.records import START_SPEED, beside_rest
from servobench.recordings.measurement.dataset import Dataset

_TAUS = 14
_DELAYS = (0.1, 1.0, 3.0, 8.0)  # sample times
_STRIBECK = (0.03, 0.15)  # of the largest speed
_ROWS = 1500  # of a record: a guess needs no more
_LOAD = 0.05  # the first guess of μ, which multiplies gravity and so isn't linear
_UNIT = FirstOrder((GAIN, TIME_CONSTANT, OFFSET, DELAY))


class FrictionAndGravity(Structure, Protocol):
    """The properties of a motor with friction and gravity that the guesses need."""

    @property
    def stribeck(self) -> bool:
        """Whether friction falls with the speed."""
        ...

    @property
    def gravity(self) -> bool:
        """Whether the load depends on the angle."""
        ...

    def vector(self, theta: Array, data: Dataset) -> Array:
        """Return the kernel's vector for theta (P + Q,)."""
        ...


def guesses_from_motion(structure: FrictionAndGravity, data: Sequence[Dataset]) -> tuple[Array, ...]:
    """Return the best vector for each ω_s of the grid, with friction also at rest and moving the other way.

    Raises `NotIdentifiable` where the data can't support the structure: too few samples, no motion, or gravity without an angle.
    """
    for record in data:
        check_moves(record, len(structure.parameters))
        if structure.gravity:
            _check_angle(record)
    trials = [_best(structure, data, part) for part in (_STRIBECK if structure.stribeck else (1.0,))]
    trials.sort(key=lambda trial: trial[0])
    if not np.isfinite(trials[0][0]):
        raise NotIdentifiable(
            "no motor with friction and gravity fits these data; look at them with `servobench inspect`"
        )
    moving = [vector for cost, vector in trials if np.isfinite(cost)]
    if not structure.friction:
        return tuple(moving)
    return tuple(
        guess
        for vector in moving
        for guess in beside_rest(
            vector, _still(structure, vector, data), _friction_speed(structure, vector, data)
        )
    )


def _check_angle(data: Dataset) -> None:
    if data.kind == "speed":
        raise NotIdentifiable(
            f"{data.name}: gravity depends on the angle, but the output is a speed: record the position of the arm"
        )
    if data.position_unit != "rad":
        raise NotIdentifiable(
            f"{data.name}: gravity depends on the angle, but the position is in {data.position_unit}, and it isn't "
            "known how many make a turn: give its unit (deg, rev), or the counts per revolution"
        )


def _best(structure: FrictionAndGravity, data: Sequence[Dataset], part: float) -> tuple[float, Array]:
    """The cost and the vector of the best τ and d for an ω_s that is that part of the largest speed."""
    step = max(record.sample_time for record in data)
    longest = max(record.duration for record in data)
    top = max(float(np.abs(smooth_speed(record)).max()) for record in data)
    signals = [_signals(structure, record, part * top) for record in data]
    best: tuple[float, Array] = (np.inf, np.empty(0))
    for tau in np.geomspace(0.5 * step, max(0.25 * longest, 2 * step), _TAUS):
        fixed = [_signal_columns(record, own, float(tau)) for record, own in zip(data, signals, strict=True)]
        for delay in _DELAYS:
            trial = _trial(structure, data, fixed, float(tau), delay * step, part * top)
            best = min(best, trial, key=lambda t: t[0])
    return best


def _linear(structure: FrictionAndGravity) -> tuple[Parameter, ...]:
    """The parameters whose lost voltage is a known signal of the motion."""
    return tuple(p for p in structure.parameters if p.name not in _ELSEWHERE)


_ELSEWHERE = {"gain", "time_constant", "delay", "stribeck_speed", "load_friction"}


def _signals(structure: FrictionAndGravity, data: Dataset, stribeck_speed: float) -> list[Array]:
    """The part of the input that each linear parameter takes, from the measured motion, (M,) each."""
    sense, speed = directions(data), np.abs(smooth_speed(data))
    known = {
        "offset_voltage": np.ones(len(data.y)),
        "coulomb_voltage": sense,
        "coulomb_voltage_forward": 0.5 * (1.0 + sense),
        "coulomb_voltage_backward": 0.5 * (sense - 1.0),
        "drag_asymmetry": speed,
        "stribeck_voltage": sense * np.exp(-speed / stribeck_speed),
        "gravity_voltage_sine": np.sin(data.y),
        "gravity_voltage_cosine": np.cos(data.y),
    }
    return [known[parameter.name] for parameter in _linear(structure)]


def _signal_columns(data: Dataset, signals: Sequence[Array], tau: float) -> tuple[Array, Array]:
    """The columns that don't depend on the delay: minus the responses to the signals (M, L), and those to the start state (M,
    Q).
    """
    from servobench.identification.models.records import with_input

    lost = [-_input_columns(with_input(data, data.t_output, signal), tau, 0.0)[0] for signal in signals]
    return np.column_stack(lost), _input_columns(data, tau, 0.0)[1]


def _input_columns(data: Dataset, tau: float, delay: float) -> tuple[Array, Array]:
    """The response to the input for K = 1, (M,), and those to the start state (M, Q), through the chain."""
    theta = np.zeros(len(_UNIT.parameters) + len(_UNIT.nuisance(data)))
    theta[[0, 1, 3]] = 1.0, tau, delay
    jacobian = _UNIT.predict(theta, data).jacobian
    return jacobian[:, 0], jacobian[:, 4:]


def _trial(
    structure: FrictionAndGravity,
    data: Sequence[Dataset],
    fixed: Sequence[tuple[Array, Array]],
    tau: float,
    delay: float,
    stribeck_speed: float,
) -> tuple[float, Array]:
    """The cost of a point of the grid and the vector that it stands for; an infinite one where the motor would stand still."""
    shared = 1 + fixed[0][0].shape[1]
    own = [start.shape[1] for _, start in fixed]
    blocks, place = [], shared
    for record, (lost, start) in zip(data, fixed, strict=True):
        valid = np.flatnonzero(record.valid)
        rows = valid[:: max(1, len(valid) // _ROWS)]
        block = np.zeros((len(rows), shared + sum(own) + 1))
        block[:, 0] = _input_columns(record, tau, delay)[0][rows]
        block[:, 1:shared] = lost[rows]
        block[:, place : place + start.shape[1]] = start[rows]
        block[:, -1] = record.y[rows]
        blocks.append(block)
        place += start.shape[1]
    a = np.vstack(blocks)
    if not np.isfinite(a).all():
        return np.inf, np.empty(0)
    solution = np.linalg.lstsq(a[:, :-1], a[:, -1], rcond=1e-10)[0]
    cost = float(np.sum((a[:, -1] - a[:, :-1] @ solution) ** 2))
    gain = float(solution[0])
    if gain == 0.0:
        return np.inf, np.empty(0)
    linear = dict(zip(_linear(structure), solution[1:shared] / gain, strict=True))
    value = {
        **{p.name: float(x) for p, x in linear.items()},
        "gain": gain,
        "time_constant": tau,
        "delay": delay,
        "stribeck_speed": stribeck_speed,
        "load_friction": _LOAD,
    }
    _correct_signs(value, gain)
    parameters = [np.clip(value[p.name], p.lower, p.upper) for p in structure.parameters]
    return cost, np.concatenate([parameters, solution[shared:]])


def _correct_signs(value: dict[str, float], gain: float) -> None:
    """Friction is told for K > 0 above; with a negative gain it brakes by -K, and forward and backward change places."""
    if gain < 0:
        for name in ("coulomb_voltage", "stribeck_voltage"):
            if name in value:
                value[name] = -value[name]
        if "coulomb_voltage_forward" in value:
            forward, backward = value["coulomb_voltage_forward"], value["coulomb_voltage_backward"]
            value["coulomb_voltage_forward"], value["coulomb_voltage_backward"] = -backward, -forward
    if "stribeck_voltage" in value:
        # At zero the Stribeck speed would have no derivative.
        value["stribeck_voltage"] = max(
            value["stribeck_voltage"], 0.1 * abs(value.get("coulomb_voltage", 0.1))
        )


def _still(
    structure: FrictionAndGravity, theta: Array, data: Sequence[Dataset]
) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """The places of the start speeds of the records in which a shaft at rest would stay at rest at first."""
    from servobench.identification.models.nonlinear import kernels

    places, at = [], len(structure.parameters)
    for record in data:
        own = structure.nuisance(record)
        p = structure.vector(
            np.concatenate([theta[: len(structure.parameters)], theta[at : at + len(own)]]), record
        )
        left, held = kernels.at_rest(p, record.input_before, p[kernels.POSITION], structure.gravity)
        if abs(left) <= held:
            places.append(at + [parameter.name for parameter in own].index(START_SPEED.name))
        at += len(own)
    return np.array(places, dtype=np.int64)


def _friction_speed(structure: FrictionAndGravity, theta: Array, data: Sequence[Dataset]) -> float:
    """The speed that friction takes, K u_c."""
    from servobench.identification.models.nonlinear import kernels

    p = structure.vector(theta, data[0])
    return abs(float(p[kernels.GAIN] * p[kernels.COULOMB]))
