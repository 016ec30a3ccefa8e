"""The kind `causes`: possible reasons why two sets of values of one motor differ, and the question that they are judged by.

All effects are on logarithms, where they add: a cause that makes the time constant a third longer adds ln(4/3), whatever its
value.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias, runtime_checkable

import numpy as np

from servobench.core.channels import Array
from servobench.core.registry import Registry
from servobench.core.rounding import plain
from servobench.identification.reconciliation.readings import Lags

if TYPE_CHECKING:
    from servobench.identification.estimators.base import Fit
    from servobench.identification.reconciliation.readings import Reading
    from servobench.rig.experiment.experiment import Experiment
    from servobench.rig.motor.parameters import MotorParameters

Origin: TypeAlias = Literal["claim", "data sheet"]
Name: TypeAlias = Literal["gain", "time_constant", "delay"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Question:
    """A difference to explain: figures `before` and `after`, by name, in SI units or those of the data.

    Its `origin` is a claim or a data sheet. Of a `claim` the data's figures stand before and the claimed ones after: what did
    its author do, or have, that the data haven't? Of a `data sheet` its figures stand before and those of the data after: what
    does the motor have that the sheet doesn't know? `covariance` (D, D) is that of the `difference`, in the order of `names`.
    `fit` is the fit of the data, `motor` the data sheet where there is one, `friction` R b/k² where it can be known. `method`
    is how the claim was found, where that is said, and `readings` are what such methods
    read off these data. `known_lag` is what a measurement's lag adds to the time
    constant [s] where the measurement is known, `lags` what it would add behind filters
    of several cut-offs where it isn't; neither where there can't be any.
    """

    origin: Origin
    names: tuple[Name, ...]
    before: Mapping[str, float]
    after: Mapping[str, float]
    covariance: Array
    fit: Fit
    motor: MotorParameters | None = None
    friction: float | None = None
    method: str | None = None
    readings: tuple[Reading, ...] = ()
    known_lag: float | None = None
    lags: Lags | None = None

    @property
    def difference(self) -> Array:
        """ln(after/before) of gain and time constant, and the delay's difference over the time constant before (D,)."""
        return self.shift(
            **{
                name: self.after[name] - self.before[name]
                if name == "delay"
                else float(np.log(self.after[name] / self.before[name]))
                for name in self.names
            }
        )

    @property
    def sd(self) -> Array:
        """The standard deviations of the difference (D,)."""
        return np.sqrt(np.diag(self.covariance))

    def shift(self, *, gain: float = 0.0, time_constant: float = 0.0, delay: float = 0.0) -> Array:
        """Return a shift (D,) by the logarithms of gain and time constant, and a delay [s]."""
        shifts = {
            "gain": gain,
            "time_constant": time_constant,
            "delay": delay / self.before.get("time_constant", np.inf),
        }
        return np.array([shifts[name] for name in self.names])

    def distance(self, left: Array) -> float:
        """Return how improbable a rest (D,) of the difference is: its χ²."""
        return float(left @ np.linalg.solve(self.covariance, left))


@dataclass(frozen=True, kw_only=True, eq=False)
class Sizes:
    """The sizes that a cause may have before anybody looks at the difference, `values` (n,), and how probable each is.

    `weights` (n,) are those probabilities. `steps` (n,) are the distances to the neighbours where sizes are samples of a range,
    0 where each stands for itself. `likely` is the size that is typical; without it, the root mean square on the side that
    helps. `scatter` are standard deviations by name, in logarithms, that the cause has besides its size, such as a reading by
    eye; one, or one for each size.
    """

    values: Array
    weights: Array
    steps: Array
    likely: float | None = None
    scatter: Mapping[str, float | Array] = field(default_factory=dict)

    @property
    def is_range(self) -> bool:
        """Whether a size between two others is possible, too."""
        return bool((self.steps > 0).any())


@dataclass(frozen=True)
class Excluded:
    """A cause that is impossible here: the `reason` as a sentence."""

    reason: str


@dataclass(frozen=True, kw_only=True)
class Decision:
    """An experiment that decides whether a cause is one: what to do and to look at, and the run if a signal is all it takes."""

    sentence: str
    """The next step, with its outcome under each cause."""
    experiment: Experiment | None = None


@runtime_checkable
class Cause(Protocol):
    """One thing that may have made the difference."""

    @property
    def label(self) -> str:
        """Its name for people."""
        ...

    @property
    def law(self) -> str:
        """Its effect on gain and time constant, as a sentence."""
        ...

    @property
    def occurrence(self) -> float:
        """The probability that it takes part at all, before anybody looks."""
        ...

    @property
    def not_with(self) -> tuple[str, ...]:
        """The names of causes that can't take part together with it."""
        ...

    def sizes(self, question: Question) -> Sizes | Excluded:
        """Return how large it may be, or why it can't be a cause here."""
        ...

    def domain(self, question: Question) -> tuple[float, float]:
        """Return the sizes between which one is looked for that would explain everything."""
        ...

    def effect(self, question: Question, size: float) -> Array:
        """Return the shift (D,) that a size makes."""
        ...

    def size_text(self, question: Question, size: float) -> str:
        """Return a size in words."""
        ...

    def amount(self, question: Question, size: float) -> str:
        """Return a size as briefly as the end of an interval is written."""
        ...

    def decision_for(self, question: Question, size: float) -> Decision:
        """Return the experiment that would show whether it has this size."""
        ...


CAUSES: Registry[Cause] = Registry(
    "cause", "servobench.identification.reconciliation.causes", "servobench.reconciliation.causes"
)


def normal(sd: float, *, side: Literal["both", "positive"] = "both", mean: float = 0.0) -> Sizes:
    """Return sizes that are normally distributed, or the half of that above zero."""
    points = np.linspace(0.0 if side == "positive" else -4.0, 4.0, 81)
    weights = np.exp(-0.5 * points**2)
    steps = np.full(len(points), sd * (points[1] - points[0]))
    return Sizes(values=mean + sd * points, weights=weights / weights.sum(), steps=steps)


def single(value: float, **scatter: float) -> Sizes:
    """Return the one size that a cause has because it is known."""
    return Sizes(
        values=np.array([value]), weights=np.ones(1), steps=np.zeros(1), likely=value, scatter=scatter
    )


def share_of(factor: float) -> str:
    """Return a factor as people say it: `31 % more`, `6.2 % less`, `4 times`."""
    if factor >= 2.5:
        return f"{factor:.3g} times"
    percent = 100 * (factor - 1)
    return f"{plain(abs(percent), 2)} % {'more' if percent >= 0 else 'less'}"
