"""The kind `measure`: stages of a measurement chain, and the chain of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal, Protocol, Self, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import UnknownName, UsageError
from servobench.core.registry import Registry
from servobench.recordings.measurement.presets import PRESETS

State: TypeAlias = Any
Kind: TypeAlias = Literal["position", "speed"]
Mask: TypeAlias = NDArray[np.bool_]


@runtime_checkable
class Stage(Protocol):
    """One stage of a measurement chain: a causal map from samples to samples.

    The one definition serves a live value (`step`) and a whole record (calling the stage), which agree to rounding.
    A linear stage starts from a state of zero, so that its response to a sum is the sum of the responses.
    The text of a stage (`str`), such as `lowpass 50 rad/s`, reads back as an equal stage.
    """

    linear: ClassVar[bool]
    """Whether the stage is linear in its input."""

    examples: ClassVar[tuple[str, ...]]
    """Texts that read as this stage, name included: for messages to users, and what the contract tests try."""

    @classmethod
    def parse(cls, arguments: tuple[str, ...]) -> Self:
        """Return the stage that the words after its name describe; raises `UsageError` where they don't."""
        ...

    def yields(self, kind: Kind) -> Kind:
        """Return what comes out where a position or a speed goes in; raises `UsageError` where that makes no sense."""
        ...

    def first_valid(self, first: int, t: Array) -> int:
        """Return the index of the first output that doesn't look back before the input number `first`, at times t (N,) [s].

        A start state that decays forever is no looking back: see `start_response`. N or more where no output is valid.
        """
        ...

    def start_response(self, t: Array) -> Array | None:
        """Return what a start state of one adds to the output at times t (N,) [s]; None if no state decays without end."""
        ...

    def start(self) -> State:
        """Return the state before the first sample."""
        ...

    def step(self, state: State, x: float, dt: float) -> tuple[State, float]:
        """Return the next state and the output for one sample; dt is the time since the sample before (0 for the first) [s]."""
        ...

    def __call__(self, x: Array, t: Array) -> Array:
        """Return the output for a whole record: samples x at times t (N,) [s]; the fold of `step`.

        x is (N,), or (N, P) for P signals side by side; the output has the same shape.
        """
        ...


STAGES: Registry[type[Stage]] = Registry(
    "stage", "servobench.recordings.measurement", "servobench.measurement"
)


MOST_STAGES = 32
"""The most stages of a chain; a motor controller's whole path, its filters and conversions, has less than ten."""


@dataclass(frozen=True)
class StartState:
    """A start state that a record doesn't tell: the stage it belongs to, and whether it is a position or a speed."""

    stage: Stage
    kind: Kind
    """Whether the state is a position or a speed."""


@dataclass(frozen=True)
class Chain:
    """A measurement chain: stages in the order in which the signal passes them.

    Its text, such as `derivative | lowpass 50 rad/s`, reads back as an equal chain.
    Raises `UsageError` where neither a position nor a speed can pass, as through two derivatives, and for more than
    `MOST_STAGES` stages.
    """

    stages: tuple[Stage, ...] = ()

    def __post_init__(self) -> None:
        if len(self.stages) > MOST_STAGES:
            raise UsageError(
                f"a chain has {len(self.stages)} stages; expected at most {MOST_STAGES}: remove repeated ones"
            )
        if not self._passes("position") and not self._passes("speed"):
            self.yields("position")  # raises, and says which stage can't follow

    @classmethod
    def parse(cls, text: str) -> Chain:
        """Return the chain that a text describes: stages joined by `|`, each a name and its arguments.

        The name of a known device (`talon-srx`) stands for its stages. `none` says that there is nothing in between, and an
        empty text that nobody says: both give a chain without stages.
        Raises `UsageError` (an `UnknownName` for a stage that isn't known).

        >>> chain = Chain.parse("derivative | lowpass 50 rad/s")
        >>> [type(stage).__name__ for stage in chain.stages]
        ['Derivative', 'Lowpass']
        >>> str(chain)
        'derivative | lowpass 50 rad/s'
        """
        if not text.strip() or text.strip() == NONE:
            return cls()
        pieces = text.split("|")
        if len(pieces) > MOST_STAGES:
            raise UsageError(
                f"a chain has {len(pieces)} stages; expected at most {MOST_STAGES}: remove repeated ones"
            )
        stages: list[Stage] = []
        for piece in pieces:
            name, *words = piece.split() or [""]
            if not name:
                raise UsageError(
                    f"chain {text!r} has an empty stage between two bars; expected, for example, {_EXAMPLE!r}"
                )
            if name == NONE:
                raise UsageError(f"chain {text!r}: `{NONE}` means no measurement chain; use it alone")
            stages += _stages(name, tuple(words))
        return cls(tuple(stages))

    @cached_property
    def linear(self) -> Chain:
        """The chain of its linear stages: the part that a prediction goes through."""
        return Chain(tuple(stage for stage in self.stages if stage.linear))

    @property
    def takes(self) -> Kind | None:
        """The chain's input: a position where it differentiates or unwraps; None where a speed will do as well."""
        speed, position = self._passes("speed"), self._passes("position")
        if speed and position:
            return None
        return "speed" if speed else "position"

    def yields(self, kind: Kind) -> Kind:
        """Return what comes out where a position or a speed goes in; raises `UsageError` where that makes no sense."""
        for stage in self.stages:
            kind = stage.yields(kind)
        return kind

    def valid(self, t: Array) -> Mask:
        """Return which outputs (N,) at times t (N,) [s] don't look back before the first sample."""
        first = 0
        for stage in self.stages:
            first = stage.first_valid(first, t)
        return np.arange(len(t)) >= first

    def start_responses(self, t: Array) -> Array:
        """Return what each unknown start state adds to the output at times t (N,) [s], per unit of it, as columns (N, S).

        A filter that ran before the record began starts from a state that nobody knows; its response decays with the
        filter's time constant. One column for each of `start_states`, in the same order.
        """
        columns: list[Array] = []
        for i, stage in enumerate(self.stages):
            response = stage.start_response(t)
            if response is not None:
                columns.append(Chain(self.stages[i + 1 :]).linear(response, t))
        return np.column_stack(columns) if columns else np.empty((len(t), 0))

    def start_states(self, kind: Kind) -> tuple[StartState, ...]:
        """Return the S unknown start states, if a position or a speed goes into the chain.

        Raises `UsageError` where that kind can't pass.
        """
        states: list[StartState] = []
        for stage in self.stages:
            kind = stage.yields(kind)
            if stage.start_response(np.zeros(1)) is not None:
                states.append(StartState(stage, kind))
        return tuple(states)

    def start(self) -> State:
        """Return the state before the first sample."""
        return tuple(stage.start() for stage in self.stages)

    def step(self, state: State, x: float, dt: float) -> tuple[State, float]:
        """Return the next state and the output for one sample; dt is the time since the sample before (0 for the first) [s]."""
        states = []
        for stage, before in zip(self.stages, state, strict=True):
            after, x = stage.step(before, x, dt)
            states.append(after)
        return tuple(states), x

    def __call__(self, x: Array, t: Array) -> Array:
        """Return samples x, (N,) or (N, P) for P signals side by side, at times t (N,) [s] after all stages.

        Raises `UsageError` where times and samples don't match, or times don't increase.
        """
        x = np.asarray(x, dtype=np.float64)
        if t.ndim != 1 or x.ndim not in (1, 2) or len(x) != len(t):
            raise UsageError(
                f"a chain got samples of shape {x.shape} at times of shape {t.shape}; expected the same number of both"
            )
        if (np.diff(t) <= 0.0).any():
            raise UsageError("a chain got times that don't increase everywhere")
        for stage in self.stages:
            x = stage(x, t)
        return x

    def __add__(self, later: Chain) -> Chain:
        return Chain((*self.stages, *later.stages))

    def __str__(self) -> str:
        return " | ".join(str(stage) for stage in self.stages)

    def __bool__(self) -> bool:
        return bool(self.stages)

    def _passes(self, kind: Kind) -> bool:
        try:
            self.yields(kind)
        except UsageError:
            return False
        return True


NONE = "none"
"""The text of a chain that is known to have no stages."""

_EXAMPLE = "derivative | lowpass 50 rad/s"


def _stages(name: str, words: tuple[str, ...]) -> tuple[Stage, ...]:
    """The stages that a name stands for: those of a known device, or the one of that name."""
    if name in PRESETS:
        if words:
            raise UsageError(
                f"`{name} {' '.join(words)}`: `{name}` takes no settings; for other settings write out its stages, "
                f"as in `{PRESETS[name].chain}`"
            )
        return Chain.parse(PRESETS[name].chain).stages
    if name not in STAGES.names():
        raise UnknownName("stage", name, (*STAGES.names(), *PRESETS))
    return (STAGES[name].parse(words),)


def speed_of_position(stage: str, kind: Kind) -> Kind:
    """Return "speed", which a differentiating stage yields of a position; raises `UsageError` if its input is a speed."""
    if kind != "position":
        raise UsageError(f"`{stage}` turns a position into a speed, and its input here is a speed already")
    return "speed"


def fold(stage: Stage | Chain, x: Array, t: Array) -> Array:
    """Return the outputs of `step` for samples x (N,) at times t (N,) [s], one after the other."""
    state = stage.start()
    out = np.empty(len(x))
    before = t[0] if len(t) else 0.0
    for k in range(len(x)):
        state, out[k] = stage.step(state, float(x[k]), float(t[k] - before))
        before = t[k]
    return out
