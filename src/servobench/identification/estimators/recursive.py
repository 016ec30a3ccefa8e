"""Recursive prediction error: the minimum of `prediction_error`, found sample by sample while the motor runs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable, UsageError
from servobench.core.finding import Finding, refusal
from servobench.identification.estimators.base import ESTIMATORS, Abilities, Fit, hindrance
from servobench.identification.estimators.disturbance import Disturbance
from servobench.identification.estimators.output_error import simulate_record
from servobench.identification.estimators.prediction_error import with_innovations
from servobench.identification.estimators.recursion.bank import Likeliest
from servobench.identification.estimators.recursion.motion import NOTHING, Motion, Samples, possible
from servobench.identification.estimators.recursion.start import (
    SETTLED,
    Setting,
    Uninformed,
    run_through,
    start_motion,
    start_state,
)
from servobench.identification.estimators.recursion.whiteness import is_white
from servobench.identification.models.base import STRUCTURES, Model, Structure
from servobench.identification.models.first_order import FirstOrder
from servobench.identification.models.kernels import COLUMNS, COULOMB, DELAY, OFFSET
from servobench.identification.models.records import is_plain
from servobench.recordings.measurement.dataset import Dataset

_KEPT = 20_000  # samples that may still be gone through again
_FIRST = 200  # samples, before a first look
_LATER = 0.3  # of the samples so far: so many more before the reference is examined again
_SETTLES = 2.0  # time constants, after which a start state is determined
_AT_ONCE = 1000  # samples of a record
_PLACES = {
    "gain": 0,
    "time_constant": 1,
    "coulomb_voltage": COULOMB,
    "offset_voltage": OFFSET,
    "delay": DELAY,
}


class Recursive:
    """Follows a first-order motor sample by sample, and says what is known of it so far.

    The motor is simulated at a reference, with the derivatives by all parameters; Kalman filters for random torques of many
    sizes turn what is left over into innovations, and their sums give the Gauss-Newton step from the reference to the
    minimum of the prediction error, its covariance, and the likelihood of each size (Ljung 1999, chapter 11, with gain 1/t; the
    filters side by side after Magill 1965). The first reference is that of `output_error`. While the first 20,000 samples last,
    the run is gone through again whenever it has become 1.3 times as long; later the reference moves on from where it is.

    `setting` says what is known beforehand; without a structure the Coulomb voltage is what friction and offset take together
    while the motor turns one way only, and the offset is found once it has turned both ways. Memory and cost for each sample are
    bounded. Nothing is forgotten: a motor that changes is for `white` to notice, and for a new object to follow.
    """

    def __init__(self, setting: Setting) -> None:
        self.setting = setting
        self._input_before = setting.input_before
        self._before_again: float | None = None
        self.samples = 0
        self.behind = 0
        """The number of the last samples that had no residual yet when they were taken: they wait for inputs of later rows, or
        for a start state."""
        self._last = -np.inf
        self._kept: list[Samples] | None = []
        self._waiting: list[Samples] | None = None
        self._motion: Motion | None = None
        self._next = _FIRST
        self._fresh = 0
        self._off = np.zeros(COLUMNS)
        self._found: Likeliest | None = None
        self.uninformed: Uninformed | None = None
        """The result of the last look that led anywhere, if it was too little for an estimate; None once there is one."""

    def take(self, t: Array, u: Array, counts: Array) -> Array:
        """Take rows: times t (N,) [s], inputs u (N,) that hold from then on [V], unwrapped counts (N,); any N, in order.

        Returns the residuals of the live model [rad] that have become known, in the order of the rows; none before there is a
        model. Raises `UsageError` for rows that aren't finite, or don't follow the earlier ones.
        """
        if self.setting.quantum is None:
            raise UsageError("counts need the encoder's step: give the quantum, or positions to take_samples")
        t, u, c = (np.asarray(x, dtype=np.float64) for x in (t, u, counts))
        return self.take_samples(Samples(t=t, y=(c + 0.5) * self.setting.quantum, t_in=t, u=u))

    def take_samples(self, samples: Samples) -> Array:
        """Take samples of the position [rad] and of the input, each at its own times, as `take` does."""
        samples.check(self._last)
        if not len(samples.t):
            return np.empty(0)
        self.samples += len(samples.t)
        self._last = float(samples.t[-1])
        self._found = None
        if self._kept is not None:
            self._kept.append(samples)
        residual = np.empty(0) if self._motion is None else self._follow(self._motion, samples)
        self.behind = self._samples_to_wait()
        if self.samples >= self._next:
            self.move_reference()
        return residual

    def _samples_to_wait(self) -> int:
        if self._waiting is not None:
            return sum(len(each.t) for each in self._waiting)
        return 0 if self._motion is None else len(self._motion.pending.t)

    def start_again(self, input_before: float | None = None) -> None:
        """Say that the next row doesn't follow the last one: rows were lost, and with them what the input was meanwhile.

        What is known of the parameters stays; where the motor is, and how fast, is found anew. `input_before` is what held just
        before the next row, where that is known [V].
        """
        self._last = -np.inf
        self._found = None
        self._before_again = input_before
        if self._motion is None:
            self._kept = []
            return
        if self._waiting is None:
            self._motion.start_again()
        self._kept, self._waiting = None, []

    def move_reference(self) -> None:
        """Move the reference to the estimate, and process the run again if it is still in memory."""
        if self._kept is not None:
            self._go_through(reduce(Samples.then, self._kept, NOTHING))
        elif self._motion is not None and self._waiting is None:
            self._move_on(self._motion)
        run_length = self.samples if self._kept is None else len(self._kept[0].t)
        self._next = self.samples + max(int(_LATER * run_length), _FIRST)

    def _go_through(self, samples: Samples) -> None:
        """Begin again with all samples so far: where the estimate is, or where output error finds it in twice as many."""
        outcome: Motion | Uninformed | None = None
        now = self._now()
        if now is None or len(samples.t) >= 2 * self._fresh:
            outcome = start_motion(self.setting, samples)
            self._fresh = len(samples.t) if isinstance(outcome, Motion) else self._fresh
        if not isinstance(outcome, Motion) and now is not None and self._motion is not None:
            outcome = run_through(self.setting, samples, now, self._motion.friction, self._motion)
        if isinstance(outcome, Motion):
            self._motion, self._off, self._found = outcome, np.zeros(COLUMNS), None
        if self._motion is not None:
            self.uninformed = None
        elif isinstance(outcome, Uninformed):  # otherwise what the look before told still holds
            self.uninformed = outcome
        self._kept = [samples]
        if len(samples.t) > _KEPT:
            # The old samples of a motor that hasn't moved contain no information.
            self._kept = None if self._motion else [samples.since(_KEPT // 2)]

    def _move_on(self, motion: Motion) -> None:
        """Move the reference of a motion whose beginning isn't kept any more, if it is off by what matters."""
        answer, now = self._answer(), self._now()
        if answer is None or now is None:
            return
        motion.watch(answer)
        change = now - motion.reference
        if np.any(np.abs(change) > SETTLED * np.sqrt(np.diag(answer.covariance))):
            motion.shift(change)
            self._off, self._found = np.zeros(COLUMNS), None

    @property
    def structure(self) -> str:
        """The name of the structure whose parameters are found."""
        if self.setting.structure is not None:
            return STRUCTURES.name_of(self.setting.structure)
        if self._both_ways:
            return "first_order_coulomb"
        return "first_order_one_way_rest" if self._motion and self._motion.rested else "first_order_one_way"

    @property
    def reference(self) -> Array | None:
        """The parameters (K, τ, u₀, u_c, d) and the last start state that the motor is followed at; None before a model."""
        return None if self._motion is None else self._motion.reference

    def estimate(self) -> dict[str, tuple[float, float]]:
        """Return value and standard deviation of each parameter by name, in SI units; empty as long as nothing is known."""
        answer, now = self._answer(), self._now()
        if answer is None or now is None:
            return {}
        now[DELAY] -= self.setting.delay
        sd = np.sqrt(np.diag(answer.covariance))
        return {name: (float(now[at]), float(sd[at])) for name, at in self._places.items()}

    @property
    def covariance(self) -> Array | None:
        """The covariance (P, P) of the parameters in the order of `estimate`; None as long as nothing is known."""
        answer = self._answer()
        if answer is None:
            return None
        at = list(self._places.values())
        return answer.covariance[np.ix_(at, at)]

    @property
    def white(self) -> bool | None:
        """Whether the last innovations leave nothing to explain: the motor is as the model says. None: too few to say."""
        answer = self._answer()
        if answer is None or self._motion is None:
            return None
        motion = self._motion
        together = motion.blocks_in(float(motion.reference[1]))
        return is_white(motion.recent, motion.residuals, answer, self.setting.quantum, together)

    @property
    def disturbance(self) -> Disturbance | None:
        """The likeliest random torque, with the measurement noise of a sample; None as long as nothing is known."""
        answer = self._answer()
        if answer is None or self._motion is None:
            return None
        ratio = float(self._motion.bank.ratio[answer.filter])
        return Disturbance(tau=float(self._motion.reference[1]), ratio=ratio, variance=answer.variance)

    @property
    def _both_ways(self) -> bool:
        return self._motion is not None and self.setting.unknowns(self._motion)[1]

    @property
    def _places(self) -> dict[str, int]:
        """The index of each parameter in a reference."""
        if self.setting.structure is not None:
            names = [parameter.name for parameter in self.setting.structure.parameters]
            return dict(zip(names, map(int, self.setting.structure.columns), strict=True))
        if self._both_ways:
            return _PLACES
        lost = COULOMB if self._motion is None or self._motion.friction else OFFSET
        return {"gain": 0, "time_constant": 1, "coulomb_voltage": lost, "delay": DELAY}

    def _answer(self) -> Likeliest | None:
        if self._found is None and self._motion is not None:
            free, _ = self.setting.unknowns(self._motion)
            self._found = self._motion.answer(free)
            if self._found is not None:
                self._off = self._found.change
        return self._found

    def _now(self) -> Array | None:
        """The reference (7,) moved to where the estimate is; None as long as nothing is known."""
        answer, motion = self._answer(), self._motion
        if answer is None or motion is None:
            return None
        _, is_brake = self.setting.unknowns(motion)
        change = possible(answer.change, answer, motion.reference, self.setting.sample_time, is_brake)
        return motion.reference + change

    def _follow(self, motion: Motion, samples: Samples) -> Array:
        """Follow the motor; again after rows were lost, once there are enough new ones to tell how it moves."""
        if self._waiting is not None:
            self._waiting.append(samples)
            samples = reduce(Samples.then, self._waiting, NOTHING)
            if samples.t[-1] - samples.t[0] < _SETTLES * motion.reference[1]:
                return np.empty(0)
            before = self._before_again
            input_before = float(samples.u[0]) if before is None else before
            try:
                motion.reference = start_state(self.setting, samples, motion, input_before)
            except NotIdentifiable:  # too few samples so far: more come
                return np.empty(0)
            self._waiting, self._input_before = None, input_before
        return motion.take(samples, self._input_before, self._off)


class RecursiveFit:
    """The member `recursive`: gives a record to `Recursive` as if it came in while the motor ran, and says what it said last.

    Several records follow each other, each with its own start state; a reference is found from the first.
    """

    abilities = Abilities(
        method=(
            "follows the motor sample by sample with a bank of filters for random torques of different "
            "sizes; also runs live"
        ),
        noise="a random torque on the motor and white measurement noise; estimates both levels",
        interval="covers under a random torque, and at any time while the motor runs",
        position=True,
        speed=False,
        chain=False,
        irregular_times=True,
        several_records=True,
        closed_loop=True,
        delay=True,
        friction=True,
        disturbance=True,
    )

    def supports(self, structure: Structure, data: Sequence[Dataset]) -> Finding | None:
        """Return a refusal for data that aren't a plain position, or a structure that isn't a first-order motor."""
        if not isinstance(structure, FirstOrder):
            return refusal(
                "estimator-unsuited",
                "recursive takes first-order motors only; prediction_error takes others.",
            )
        if not all(is_plain(record) or record.chain.linear for record in data):
            return refusal(
                "estimator-unsuited",
                "recursive works on an unfiltered position; output_error can use data behind a chain.",
            )
        return hindrance("recursive", self.abilities, structure, data)

    def fit(
        self, structure: Structure, data: Sequence[Dataset], starts: Sequence[Array] | None = None
    ) -> Fit:
        """Return the fit after the last sample; raises `NotIdentifiable` where nothing was known by then."""
        lacking = self.supports(structure, data)
        if lacking is not None or not isinstance(structure, FirstOrder):
            raise NotIdentifiable(
                lacking.sentence.rstrip(".") if lacking else "recursive takes first-order motors only"
            )
        live = _follow_records(structure, data, starts)
        estimates, disturbance = live.estimate(), live.disturbance
        if not estimates or disturbance is None or live.covariance is None:
            raise NotIdentifiable(
                "the samples don't determine gain and time constant to within half their size: record for longer"
            )
        theta = np.array([estimates[parameter.name][0] for parameter in structure.parameters])
        own = [simulate_record(structure, theta, record).nuisance for record in data]
        records, disturbance = with_innovations(structure, data, np.concatenate([theta, *own]), disturbance)
        return Fit(
            model=Model(structure=structure, theta=theta, data=data[0]),
            covariance=live.covariance,
            estimator="recursive",
            structure=STRUCTURES.name_of(structure),
            converged=True,
            status="followed to the last sample",
            residual_sd=float(np.sqrt(disturbance.variance)),
            records=records,
            disturbance=disturbance,
        )


ESTIMATORS.member("recursive")(RecursiveFit())


def _follow_records(
    structure: FirstOrder, data: Sequence[Dataset], starts: Sequence[Array] | None
) -> Recursive:
    """The estimate after all records."""
    own = len(structure.parameters) + len(structure.nuisance(data[0]))
    live = Recursive(
        Setting(
            quantum=data[0].quantum,
            sample_time=data[0].sample_time,
            delay=data[0].delay,
            input_before=data[0].input_before,
            structure=structure,
            start=None if starts is None else starts[0][:own],
        )
    )
    for record in data:
        if record is not data[0]:
            live.start_again(record.input_before)
        first, last = 0, 0
        while first < len(record.t_output):
            until = min(first + _AT_ONCE, len(record.t_output))
            # All inputs that may act on these samples: a delay may be two samples below zero, and no more.
            reach = record.t_output[until - 1] + 3 * max(record.sample_time, record.input_step)
            end = int(np.searchsorted(record.t_input, reach, side="right"))
            end = len(record.u) if until == len(record.t_output) else end
            live.take_samples(
                Samples(
                    t=record.t_output[first:until],
                    y=record.y[first:until],
                    t_in=record.t_input[last:end],
                    u=record.u[last:end],
                )
            )
            first, last = until, end
    live.move_reference()
    return live
