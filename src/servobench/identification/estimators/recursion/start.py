"""The start of the recursive estimator: a reference from the samples so far, one step away from the minimum."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable, UsageError
from servobench.identification.estimators.least_squares import lowest
from servobench.identification.estimators.output_error import simulate_record
from servobench.identification.estimators.recursion.motion import Motion, Samples, possible, unknowns
from servobench.identification.models.base import STRUCTURES
from servobench.identification.models.first_order import FirstOrder
from servobench.identification.models.kernels import COLUMNS, COULOMB, DELAY
from servobench.identification.models.level import single_level
from servobench.identification.models.motion import turns_both_ways
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source

SETTLED = 0.3  # standard deviations that the reference may be off
_ROUNDS = 4
_KNOWN = 0.5  # standard deviation of ln K and ln τ, before there is an estimate
_TRAVEL = 50.0  # steps of the encoder that a motor must have made


@dataclass(frozen=True, kw_only=True)
class Setting:
    """The facts about a run that are known before it begins.

    `quantum` is the encoder's step [rad], None if unknown; `sample_time` the time between samples [s], `delay` the
    device's own [s], `input_before` what held before the first sample [V]. With a `structure` its parameters are found, from
    the vector `start` where one is given; without, those that Coulomb friction has.
    Raises `UsageError` for a sample time or an encoder's step that isn't above 0.
    """

    quantum: float | None
    sample_time: float
    delay: float = 0.0
    input_before: float = 0.0
    structure: FirstOrder | None = None
    start: Array | None = None

    def __post_init__(self) -> None:
        for value, what in ((self.sample_time, "sample time"), (self.quantum, "encoder's step")):
            if value is not None and not (np.isfinite(value) and value > 0):
                raise UsageError(f"the {what} is {value!r}; expected a finite number above 0")

    def unknowns(self, motion: Motion) -> tuple[NDArray[np.bool_], bool]:
        """Return which columns (7,) of a motion are to be found, and whether its u_c is friction alone, so not negative."""
        both_ways = bool(motion.friction) and (self.structure is not None or motion.both_ways)
        return unknowns(motion.friction, both_ways), both_ways

    def dataset(self, samples: Samples) -> Dataset:
        """Return samples as the dataset that other estimators work on."""
        return Dataset(
            name="live", t_input=samples.t_in, u=samples.u, input_unit="V", input_before=self.input_before,
            t_output=samples.t, y=samples.y, output_unit="rad", kind="position", quantum=self.quantum,
            delay=self.delay, source=Source(name="live"),
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Uninformed:
    """The information in samples that don't yet determine gain and time constant to half of their size.

    The covariance (7, 7) of a motion's reference (7,) in SI units; infinite for what the samples say nothing about.
    """

    reference: Array
    covariance: Array


def _inseparable() -> Uninformed:
    """A gain and a friction of which each may have any value while K (u - u_c) is known, as one level of the input tells them."""
    covariance = np.zeros((COLUMNS, COLUMNS))
    covariance[np.ix_([0, COULOMB], [0, COULOMB])] = 1.0
    return Uninformed(reference=np.ones(COLUMNS), covariance=covariance)


def start_motion(setting: Setting, samples: Samples) -> Motion | Uninformed | None:
    """Return the motion through all samples at the reference where its estimate is, found from the output-error fit.

    What is known so far if the samples don't determine gain and time constant yet, to half of their size; None if that is
    nothing that could be put in figures.
    """
    data = setting.dataset(samples)
    if np.ptp(samples.y) <= _TRAVEL * (setting.quantum or 0.0):
        return _without_information(np.arange(COLUMNS))
    if np.ptp(samples.u) == 0:
        return _without_information(np.array([1, DELAY]))
    if setting.structure is None and single_level([data]) is not None:
        return _inseparable()
    try:
        reference, friction = _by_output_error(setting, data)
    except NotIdentifiable:  # too little to go by so far: more samples come
        return None
    return run_through(setting, samples, reference, friction)


def _without_information(columns: NDArray[np.int64]) -> Uninformed:
    """Nothing known of these columns: a derivative that is zero, or hidden below the encoder's step, informs about nothing."""
    variance = np.zeros(COLUMNS)
    variance[columns] = np.inf
    return Uninformed(reference=np.ones(COLUMNS), covariance=np.diag(variance))


def start_state(setting: Setting, samples: Samples, motion: Motion, input_before: float) -> Array:
    """Return a motion's reference (7,) with the start state of a new record that begins with these samples."""
    structure = _structure(setting, motion.friction)
    p = motion.reference.copy()
    p[DELAY] -= setting.delay
    data = replace(setting, input_before=input_before).dataset(samples)
    if np.ptp(data.y) == 0:  # at rest, which no fit is needed for
        own = np.array([data.y[0], 0.0])
    else:
        own = simulate_record(structure, p[structure.columns], data).nuisance
    return np.concatenate([motion.reference[: COLUMNS - 2], own])


def _structure(setting: Setting, friction: float) -> FirstOrder:
    name = "first_order_coulomb" if friction else "first_order_one_way"
    return setting.structure or cast(FirstOrder, STRUCTURES[name])


def _by_output_error(setting: Setting, data: Dataset) -> tuple[Array, float]:
    """The reference (7,) that output error finds, and whether it has friction."""
    structure = _structure(setting, 1.0)
    guesses = structure.guesses([data]) if setting.start is None else [setting.start]
    free = np.ones(len(guesses[0]), dtype=bool)
    names = [parameter.name for parameter in structure.parameters]
    if setting.structure is None and not turns_both_ways([data]):
        # If the motor turns one way, offset and friction can't be separated.
        at = names.index("offset_voltage")
        free[at] = False
        guesses = [np.where(np.arange(len(guess)) == at, 0.0, guess) for guess in guesses]
    theta = lowest(structure, [data], guesses, free).theta
    return structure.vector(theta, data), float(structure.friction)


def run_through(
    setting: Setting, samples: Samples, reference: Array, friction: float, earlier: Motion | None = None
) -> Motion | Uninformed | None:
    """Return the motion through all samples, from a reference (7,) in SI units that is moved until it is where the estimate is.

    What rounding at rest weighs, and which filter is watched, comes from an `earlier` motion, or from a first time through.
    `Uninformed` if gain and time constant aren't known to half of their size, None if that leads nowhere.
    """
    known = earlier
    for _ in range(_ROUNDS):
        rest, shown = (known.rest, known.shown) if known else (1.0, 0)
        motion = Motion.initial(reference, friction, setting.sample_time, rest, shown, setting.quantum or 0.0)
        motion.take(samples, setting.input_before, np.zeros(COLUMNS))
        free, is_brake = setting.unknowns(motion)
        answer = motion.answer(free)
        if answer is None:
            return None
        motion.watch(answer)
        sd = np.sqrt(np.diag(answer.covariance))
        if not np.isfinite(sd).all() or (sd[:2] > _KNOWN * np.abs(reference[:2])).any():
            return Uninformed(reference=reference, covariance=answer.covariance)
        change = possible(answer.change, answer, reference, setting.sample_time, is_brake)
        if known is not None and np.all(np.abs(change) <= SETTLED * sd):
            return motion
        reference, known = reference + change, motion
        if setting.quantum:
            motion.rest = max(setting.quantum**2 / 12 / answer.variance, 1.0)
    return None
