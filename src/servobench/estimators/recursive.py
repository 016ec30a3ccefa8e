"""Recursive prediction error: the minimum of `prediction_error`, found sample by sample while the motor runs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import numpy as np

from servobench.channels import Array
from servobench.errors import NotIdentifiable, UsageError
from servobench.estimators.base import ESTIMATORS, Abilities, Fit, FittedRecord, hindrance
from servobench.estimators.disturbance import Disturbance, whitened
from servobench.estimators.output_error import simulated
from servobench.estimators.recursion.bank import Likeliest
from servobench.estimators.recursion.beginning import SETTLED, Setting, begun, gone_through, start_state
from servobench.estimators.recursion.motion import NOTHING, Motion, Samples, possible
from servobench.estimators.recursion.whiteness import is_white
from servobench.finding import Finding, refusal
from servobench.measurement.dataset import Dataset
from servobench.models.base import STRUCTURES, Model, Structure
from servobench.models.first_order import FirstOrder
from servobench.models.kernels import COLUMNS, COULOMB, DELAY, OFFSET
from servobench.models.records import is_plain

_KEPT = 20_000  # samples that may still be gone through again
_FIRST = 200  # samples, before a first look
_LATER = 0.3  # of the samples so far: so many more before the reference is looked at again
_SETTLES = 2.0  # time constants, after which a start state can be told
_PLACES = {"gain": 0, "time_constant": 1, "coulomb_voltage": COULOMB, "offset_voltage": OFFSET, "delay": DELAY}


class Recursive:
    """Follows a first-order motor sample by sample, and says what is known of it so far.

    The motor is simulated at a reference, with the derivatives by all parameters; Kalman filters for random torques of many
    sizes turn what is left over into innovations, and their sums give the Gauss-Newton step from the reference to the
    minimum of the prediction error, its covariance, and the likelihood of each size (Ljung 1999, chapter 11, with gain 1/t; the
    filters side by side after Magill 1965). The first reference is that of `output_error`. While the first 20,000 samples last,
    the run is gone through again whenever it has become 1.3 times as long; later the reference moves on from where it is.

    `setting` says what is known beforehand; without a structure the Coulomb voltage is what friction and offset take together while
    the motor turns one way only, and the offset is found once it has turned both ways. Memory and cost for each sample are
    bounded. Nothing is forgotten: a motor that changes is for `white` to notice, and for a new object to follow.
    """

    def __init__(self, setting: Setting) -> None:
        if not (np.isfinite(setting.sample_time) and setting.sample_time > 0):
            raise UsageError(f"the sample time is {setting.sample_time!r} s; expected a finite number above 0")
        if setting.quantum is not None and not (np.isfinite(setting.quantum) and setting.quantum > 0):
            raise UsageError(f"the encoder's step is {setting.quantum!r}; expected a finite number above 0, or None")
        self.setting = setting
        self._input_before = setting.input_before
        self.samples = 0
        self._last = -np.inf
        self._kept: list[Samples] | None = []
        self._waiting: list[Samples] | None = None
        self._motion: Motion | None = None
        self._next = _FIRST
        self._fresh = 0
        self._off = np.zeros(COLUMNS)
        self._found: Likeliest | None = None

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
        _check(samples, self._last)
        if not len(samples.t):
            return np.empty(0)
        self.samples += len(samples.t)
        self._last = float(samples.t[-1])
        self._found = None
        if self._kept is not None:
            self._kept.append(samples)
        if self._waiting is not None:
            self._waiting.append(samples)
            residual = self._begin_again()
        else:
            residual = np.empty(0) if self._motion is None else self._follow(samples)
        if self.samples >= self._next:
            self.look_again()
        return residual

    def start_again(self) -> None:
        """Say that the next row doesn't follow the last one: rows were lost, and with them what the input was meanwhile.

        What is known of the parameters stays; where the motor is, and how fast, is found anew.
        """
        self._last = -np.inf
        self._found = None
        if self._motion is None:
            self._kept = []
            return
        if self._waiting is None:
            self._motion.start_again()
        self._kept, self._waiting = None, []

    def look_again(self) -> None:
        """Move the reference to the estimate, going through the run again where it is still kept."""
        if self._kept is not None:
            self._go_through(reduce(Samples.then, self._kept, NOTHING))
        elif self._motion is not None and self._waiting is None:
            self._move_on(self._motion)
        kept = self.samples if self._kept is None else len(self._kept[0].t)
        self._next = self.samples + max(int(_LATER * kept), _FIRST)

    def _go_through(self, samples: Samples) -> None:
        """Begin again with all samples so far: where the estimate is, or where output error finds it in twice as many."""
        found, now = None, self._now()
        if now is None or len(samples.t) >= 2 * self._fresh:
            found = begun(self.setting, samples)
            self._fresh = len(samples.t) if found is not None else self._fresh
        if found is None and now is not None and self._motion is not None:
            found = gone_through(self.setting, samples, now, self._motion.friction)
        if found is not None:
            self._motion, self._off, self._found = found, np.zeros(COLUMNS), None
        self._kept = [samples]
        if len(samples.t) > _KEPT:
            # What a motor that hasn't told anything yet did long ago is no loss.
            self._kept = None if self._motion else [samples.since(_KEPT // 2)]

    def _move_on(self, motion: Motion) -> None:
        """Move the reference of a motion whose beginning isn't kept any more, if it is off by what matters."""
        found, now = self._answer(), self._now()
        if found is None or now is None:
            return
        change = now - motion.reference
        if np.any(np.abs(change) > SETTLED * np.sqrt(np.diag(found.covariance))):
            motion.shift(change)
            self._off, self._found = np.zeros(COLUMNS), None

    @property
    def structure(self) -> str:
        """The name of the structure whose parameters are found."""
        if self.setting.structure is not None:
            return STRUCTURES.name_of(self.setting.structure)
        return "first_order_coulomb" if self._both_ways else "first_order_one_way"

    @property
    def reference(self) -> Array | None:
        """The parameters (K, τ, u₀, u_c, d) and the last start state that the motor is followed at; None before a model."""
        return None if self._motion is None else self._motion.reference

    def estimate(self) -> dict[str, tuple[float, float]]:
        """Return value and standard deviation of each parameter by name, in SI units; empty as long as nothing can be told."""
        found, now = self._answer(), self._now()
        if found is None or now is None:
            return {}
        now[DELAY] -= self.setting.delay
        sd = np.sqrt(np.diag(found.covariance))
        return {name: (float(now[at]), float(sd[at])) for name, at in self._places.items()}

    @property
    def covariance(self) -> Array | None:
        """The covariance (P, P) of the parameters in the order of `estimate`; None as long as nothing can be told."""
        found = self._answer()
        if found is None:
            return None
        at = list(self._places.values())
        return found.covariance[np.ix_(at, at)]

    @property
    def white(self) -> bool | None:
        """Whether the last innovations leave nothing to explain: the motor is as the model says. None: too few to say."""
        found = self._answer()
        if found is None or self._motion is None:
            return None
        return is_white(self._motion.recent, self._motion.residuals, found, self.setting.quantum)

    @property
    def disturbance(self) -> Disturbance | None:
        """The likeliest random torque, with the measurement noise of a sample; None as long as nothing can be told."""
        found = self._answer()
        if found is None or self._motion is None:
            return None
        ratio = float(self._motion.bank.ratio[found.filter])
        return Disturbance(tau=float(self._motion.reference[1]), ratio=ratio, variance=found.variance)

    @property
    def _both_ways(self) -> bool:
        return self._motion is not None and self.setting.unknowns(self._motion)[1]

    @property
    def _places(self) -> dict[str, int]:
        """Where the parameters stand in a reference."""
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
        """The reference (7,) moved to where the estimate is; None as long as nothing can be told."""
        found, motion = self._answer(), self._motion
        if found is None or motion is None:
            return None
        _, is_brake = self.setting.unknowns(motion)
        change = possible(found.change, found, motion.reference, self.setting.sample_time, is_brake)
        return motion.reference + change

    def _follow(self, samples: Samples) -> Array:
        assert self._motion is not None
        return self._motion.take(samples, self._input_before, self._off)

    def _begin_again(self) -> Array:
        """Follow the motor again after rows were lost, once there are enough new ones to tell how it moves."""
        assert self._motion is not None and self._waiting is not None
        samples = reduce(Samples.then, self._waiting, NOTHING)
        self._waiting = [samples]
        if samples.t[-1] - samples.t[0] < _SETTLES * self._motion.reference[1]:
            return np.empty(0)
        self._waiting, self._input_before = None, float(samples.u[0])
        self._motion.reference = start_state(self.setting, samples, self._motion)
        return self._follow(samples)


def _check(samples: Samples, last: float) -> None:
    """Raise `UsageError` for samples that nothing can be made of."""
    for t, x, what in ((samples.t, samples.y, "position"), (samples.t_in, samples.u, "input")):
        if t.ndim != 1 or t.shape != x.shape:
            raise UsageError(f"the {what} has values of shape {x.shape} and times of shape {t.shape}; expected (N,) both")
        if not (np.isfinite(t).all() and np.isfinite(x).all()):
            raise UsageError(f"the {what} has values that are not finite; leave those rows out")
        if (np.diff(t) <= 0).any():
            raise UsageError(f"the times of the {what} don't increase everywhere")
    if len(samples.t) and not samples.t[0] > last:
        raise UsageError(
            f"a row at {samples.t[0]:g} s came after one at {last:g} s; give the rows in order, or start again"
        )
