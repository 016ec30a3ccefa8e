"""The kind `models`: model structures, and a structure with values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Protocol, TypeAlias, TypeVar, cast, get_args, runtime_checkable

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.registry import Registry
from servobench.identification.models.turning import Sliding
from servobench.recordings.measurement.dataset import Dataset
from servobench.systems.transfer_function import TransferFunction

Output: TypeAlias = Literal["position", "speed"]


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One parameter of a structure: its name, what it means, its unit and its bounds.

    In the unit, `{position}` and `{input}` stand for the units of the data (`{position}/(s·{input})`).
    """

    name: str
    meaning: str
    """A description, in a few words."""
    unit: str
    lower: float = -np.inf
    """Smallest value, in the unit."""
    upper: float = np.inf
    """Largest value, in the unit."""

    def unit_in(self, data: Dataset) -> str:
        """Return the unit, spelled out for that data."""
        return self.unit.format(position=data.position_unit, input=data.input_unit).replace("(s·1)", "s")


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """A structure's prediction for a dataset, in the dataset's own terms.

    `y` (M,) in the dataset's output unit; `jacobian` (M, P + Q): by the P parameters, then by the Q nuisance parameters of
    this record; `valid` (M,) is False where the chain still looks back before the record. `sliding` is as `Structure.sliding`,
    where a prediction knows it without another simulation.
    """

    y: Array
    jacobian: Array
    valid: np.ndarray[tuple[int], np.dtype[np.bool_]]
    sliding: Callable[[], Sliding] | None = None


@runtime_checkable
class Structure(Protocol):
    """A model structure: what is known of the form, with parameters to be found.

    A parameter vector for one dataset is the P parameters and then the Q nuisance parameters of that record.
    """

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The P parameters that all records share."""
        ...

    @property
    def friction(self) -> bool:
        """Whether the shaft can stick and slide, so that the response isn't linear."""
        ...

    def nuisance(self, data: Dataset) -> tuple[Parameter, ...]:
        """Return the Q nuisance parameters of a record: start position, start speed, start states of filters."""
        ...

    def bounds(self, data: Sequence[Dataset]) -> tuple[Array, Array]:
        """Return the lower and the upper bounds of the parameters, (P,) each, for that data."""
        ...

    def guesses(self, data: Sequence[Dataset]) -> tuple[Array, ...]:
        """Return first guesses to try: each the parameters, then the nuisance parameters of each record in turn.

        More than one where the search may end at different minima. Raises `NotIdentifiable` where the data can't support any.
        """
        ...

    def predict(self, theta: Array, data: Dataset) -> Prediction:
        """Return the prediction for the parameter vector theta (P + Q,), with its exact Jacobian."""
        ...

    def sliding(self, theta: Array, data: Dataset) -> Sliding:
        """Return where the shaft slides, rests and turns back at the samples of the output; theta (P + Q,)."""
        ...

    def unmodelled(self, theta: Array, data: Dataset) -> Array:
        """Return what the prediction may be wrong by for reasons the structure knows of but can't resolve, as columns (M, E).

        Each column is an error of its own, of unit variance, in the dataset's output unit; theta as for `predict`.
        """
        ...

    def transfer_function(self, theta: Array, output: Output, data: Dataset) -> TransferFunction:
        """Return the linear part for the parameters theta (P,) as a transfer function, in the units of the data."""
        ...


@runtime_checkable
class Simulator(Protocol):
    """A structure that can predict without derivatives, which is much faster where the input changes at each sample."""

    def simulate(self, theta: Array, data: Dataset, u: Array) -> Array:
        """Return the prediction (M,) alone for theta (P + Q,), as `predict` does, for an input u (N,) at the dataset's times."""
        ...


T = TypeVar("T")
_FULFILLED: dict[tuple[type, type], bool] = {}


def as_protocol(structure: Structure, protocol: Callable[..., T]) -> T | None:
    """Return a structure as something that it can do besides, such as a `Simulator`, None where it can't.

    That is what `isinstance` says, asked once for each class: asking takes as long as a short simulation.
    """
    key = (type(structure), cast(type, protocol))
    if key not in _FULFILLED:
        _FULFILLED[key] = isinstance(structure, key[1])
    return cast(T, structure) if _FULFILLED[key] else None


STRUCTURES: Registry[Structure] = Registry(
    "model structure", "servobench.identification.models", "servobench.models"
)


def check_output(output: str) -> None:
    """Raise `UsageError` where a name is none of an output of the shaft."""
    if not isinstance(output, str) or output not in get_args(Output):
        raise UsageError(f"output is {output!r}; expected 'position' or 'speed'")


@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """A structure with values for its parameters, `theta` (P,), in the units of `data`, the first dataset it came from."""

    structure: Structure
    theta: Array
    data: Dataset

    def __getitem__(self, name: str) -> float:
        """Return the value of a parameter."""
        return float(self.theta[self.names.index(name)])

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of the parameters."""
        return tuple(parameter.name for parameter in self.structure.parameters)

    @property
    def units(self) -> tuple[str, ...]:
        """The units of the parameters, spelled out."""
        return tuple(parameter.unit_in(self.data) for parameter in self.structure.parameters)

    def transfer_function(self, output: Output = "speed") -> TransferFunction:
        """Return the linear part as a transfer function from the input to the speed or the position.

        Raises `UsageError` for another output.
        """
        check_output(output)
        return self.structure.transfer_function(self.theta, output, self.data)

    def simulate(self, data: Dataset, nuisance: Array, u: Array | None = None) -> Array:
        """Return the predicted output (M,) for a dataset with nuisance parameters (Q,), chain included.

        `u` (N,) is an input in place of the dataset's own, at the same times.
        """
        return simulate_output(self.structure, np.concatenate([self.theta, nuisance]), data, u)


def simulate_output(structure: Structure, theta: Array, data: Dataset, u: Array | None = None) -> Array:
    """Return what a structure predicts (M,) for theta (P + Q,), without derivatives where it can do without them.

    `u` (N,) is an input in place of the dataset's own, at the same times.
    """
    simulator = as_protocol(structure, Simulator)
    if simulator is not None:
        return simulator.simulate(theta, data, data.u if u is None else u)
    return structure.predict(theta, data if u is None else replace(data, u=u, reference=None)).y
