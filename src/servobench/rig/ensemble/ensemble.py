"""The verb `ensemble`: many motors with tolerances through one experiment, and what came of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from servobench.core.arguments import check_type, text_of_value
from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.json_numbers import finite
from servobench.recordings.recording import Recording
from servobench.rig.devices.twin import TwinSettings
from servobench.rig.ensemble.motors import Motors
from servobench.rig.ensemble.outcomes import UNITS, outcomes_of
from servobench.rig.ensemble.records import recording_of
from servobench.rig.ensemble.sensitivity import Sensitivity, ends_of, sensitivities
from servobench.rig.ensemble.simulation import check_can_be_simulated, simulate
from servobench.rig.ensemble.tolerances import (
    Tolerance,
    draw_motors,
    nominal_values,
    tolerances_of,
)
from servobench.rig.experiment import Experiment

SCHEMA = "servobench.ensemble/1"
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
"""The shares of the motors that lie below the lines of the bands."""
MOST = 200_000
"""The largest number of motors; they take 5 kB of memory each."""
_LOOKS = 200
_MOST_COUNTS = 1_000_000_000  # 2 GB


@dataclass(frozen=True, kw_only=True, eq=False)
class Bands:
    """The distribution of a quantity over the motors: `values` (5, K) are its quantiles 5, 25, 50, 75 and 95 % at `t` (K,) [s].

    `name` is `speed` or `position`, `unit` that of the values.
    """

    name: str
    unit: str
    t: Array
    values: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Ensemble:
    """Motors that are alike but for their tolerances, and what one experiment makes of them.

    `parameters` has the true parameters of each motor and `outcomes` what they make: gain and time constant; with a controller
    the phase margin, and for a step of its reference overshoot and settling time; each (n,), NaN where a motor has none. `final`
    is each motor's current [A], speed [rad/s] and angle [rad] at the end (3, n). `nominal` are the outcomes of the motor without
    tolerances, `sensitivities` which tolerance moves them and by how much, `bands` speed and position over time; `seed` drew
    the motors. If asked for, `counts` (n, N) are the encoder's at each tick, in 16 bits that wrap around, and `applied` [V] the
    voltage from then on: (N,), the same for all, or (n, N).
    """

    experiment: Experiment
    motor: TwinSettings
    tolerances: tuple[Tolerance, ...]
    seed: int
    parameters: Mapping[str, Array]
    outcomes: Mapping[str, Array]
    nominal: Mapping[str, float]
    sensitivities: tuple[Sensitivity, ...]
    bands: tuple[Bands, ...]
    final: Array
    counts: Array | None = None
    applied: Array | None = None

    def __len__(self) -> int:
        """The number of motors."""
        return int(self.final.shape[1])

    def __repr__(self) -> str:
        """The number of motors, and their tolerances."""
        return f"<Ensemble of {len(self)} motors: {', '.join(map(str, self.tolerances)) or 'all alike'}>"

    def recording(self, number: int) -> Recording:
        """Return the recording of one of the motors, a run of a twin that is this motor, from which it can be identified.

        Raises `UsageError` for a number of none.
        """
        _check_count("number", number, len(self) - 1, least=0)
        own = {name: float(values[number]) for name, values in self.parameters.items()}
        return recording_of(own, number, self.experiment, self.motor, self.seed)

    def linear_share(self, outcome: str) -> float:
        """Return the part of an outcome's variance over the motors that straight lines through the tolerances explain.

        Far from 1 it says that the outcome bends within the tolerances, or hangs on the random torque, and that the shares of
        the sensitivities are rough. NaN where nothing varies.
        """
        values = self.outcomes[outcome]
        known = values[np.isfinite(values)]
        by_lines = sum(each.effect**2 / 3 for each in self.sensitivities if each.outcome == outcome)
        variance = float(known.var()) if len(known) else 0.0
        return by_lines / variance if variance > 0 else math.nan

    def to_dict(self) -> dict[str, Any]:
        """Return the ensemble as plain data, motor by motor left out."""
        data = {
            "schema": SCHEMA,
            "motors": len(self),
            "seed": self.seed,
            "tolerances": {
                each.name: {"value": each.value, "half": each.half, "unit": each.unit}
                for each in self.tolerances
            },
            "outcomes": {name: self._summary(name) for name in self.outcomes},
            "sensitivities": [
                {
                    "outcome": each.outcome,
                    "parameter": each.parameter,
                    **{n: getattr(each, n) for n in ("low", "high", "effect", "share")},
                }
                for each in self.sensitivities
            ],
        }
        return {name: finite(each) for name, each in data.items()}

    def _summary(self, name: str) -> dict[str, Any]:
        values = self.outcomes[name]
        known = values[np.isfinite(values)]
        quantiles = np.quantile(known, QUANTILES).tolist() if len(known) else [math.nan] * len(QUANTILES)
        return {
            "unit": UNITS[name],
            "nominal": self.nominal[name],
            "known": len(known),
            "quantiles": {f"{100 * q:g}": x for q, x in zip(QUANTILES, quantiles, strict=True)},
            "linear_share": self.linear_share(name),
        }


def ensemble(
    motor: TwinSettings | str,
    experiment: Experiment,
    n: int,
    spread: Mapping[str, object],
    *,
    seed: int = 0,
    threads: int | None = None,
    counts: bool = False,
    progress: Callable[[float], object] = lambda _: None,
) -> Ensemble:
    """Simulate an experiment on n motors with tolerances, and say which tolerance matters.

    `motor` is a twin's settings or the name of a data sheet; the device that the experiment names isn't used. `spread` has a
    tolerance for each parameter that has one: a part of its value (0.1 or "10%"), or a half width with its unit
    ("2e-4 N*m"); a motor's value lies evenly within. `seed` draws the motors and their random torques, each motor
    the same in a small ensemble and in a large one; the result doesn't depend on `threads`, by default one for each processor.
    With `counts` those of the encoder and the voltages are kept, too. `progress` is told the part that is done.

    The encoder, the amplifier's limit and dead band, the limits of voltage and slew and the control law are those of a run; a
    tick in which the shaft stops or turns back is exact to first order, and nothing ends a run before its time.

    Raises `UnknownName` and `UsageError` for a motor, an experiment, a number or a tolerance that can't be simulated.

    >>> import servobench as sb
    >>> motors = sb.ensemble("qube_servo_2", sb.Experiment(duration="1 s"), 100, {"motor_constant": "5%"})
    >>> f"{motors.outcomes['gain'].min():.1f} to {motors.outcomes['gain'].max():.1f} rad/(s·V)"
    '22.6 to 24.9 rad/(s·V)'
    """
    twin = _twin(motor)
    check_type(
        "experiment", experiment, Experiment, 'an Experiment, such as servobench.Experiment(duration="5 s")'
    )
    _check_count("n", n, MOST)
    _check_count("seed", seed, 2**63, least=0)
    if threads is not None:
        _check_count("threads", threads, 1024)
    check_type("counts", counts, bool, "True or False")
    _begin(progress)
    check_can_be_simulated(experiment, twin)
    if counts and n * (experiment.samples or 0) > _MOST_COUNTS:
        raise UsageError(
            f"counts of {n} motors at {experiment.samples} ticks are too many to keep; expected at most {_MOST_COUNTS} together"
        )
    tolerances = tolerances_of(twin, spread)
    series = float(twin.amplifier_resistance)
    motors = Motors(parameters=draw_motors(twin, tolerances, n, seed), series=series)
    looks = look_ticks(experiment)
    course = simulate(
        motors,
        experiment,
        twin,
        seed=seed,
        looks=looks,
        recorded=counts,
        threads=threads,
        progress=progress,
    )
    ends = Motors(parameters=ends_of(nominal_values(twin), tolerances), series=series)
    quiet = twin.model_copy(update={"torque_noise": 0.0})
    at_ends = outcomes_of(
        ends, simulate(ends, experiment, quiet, seed=seed, looks=looks[-1:], threads=1), experiment
    )
    outcomes = outcomes_of(motors, course, experiment)
    t = np.concatenate([[0.0], looks * experiment.sample_time])
    return Ensemble(
        experiment=experiment,
        motor=twin,
        tolerances=tolerances,
        seed=seed,
        parameters=motors.parameters,
        outcomes=outcomes,
        nominal={name: float(at_ends[name][0]) for name in outcomes if name in at_ends},
        sensitivities=sensitivities(tolerances, at_ends),
        bands=(
            _bands("speed", "rad/s", t, 0.0, course.states[1]),
            _bands("position", "rad", t, twin.start_angle, course.states[2]),
        ),
        final=course.states[:, -1].copy(),
        counts=course.counts,
        applied=course.voltages if counts else None,
    )


def look_ticks(experiment: Experiment) -> Array:
    """Return the numbers of ticks (K,) after which the bands look at the motors: up to 200, evenly spread, to the end."""
    ticks = experiment.samples or 0
    return np.unique(np.linspace(0, ticks, min(_LOOKS, ticks) + 1).round().astype(np.int64)[1:])


def _bands(name: str, unit: str, t: Array, start: float, values: Array) -> Bands:
    later = np.quantile(values, QUANTILES, axis=1)
    return Bands(name=name, unit=unit, t=t, values=np.concatenate([np.full((5, 1), start), later], axis=1))


def _twin(motor: object) -> TwinSettings:
    check_type("motor", motor, (str, TwinSettings), "the name of a data sheet, or a twin's settings")
    if isinstance(motor, TwinSettings):
        return motor
    twin = TwinSettings(motor=str(motor))
    twin.data_sheet  # noqa: B018  # raises UnknownName, which lists the known ones
    return twin


def _begin(progress: Callable[[float], object]) -> None:
    try:
        progress(0.0)
    except TypeError as error:
        raise UsageError(
            f"progress is {text_of_value(progress)}; expected a function that takes the part that is done: {error}"
        ) from error


def _check_count(name: str, value: object, most: int, *, least: int = 1) -> None:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value <= most:
        raise UsageError(f"{name} is {text_of_value(value)}; expected a whole number from {least} to {most}")
