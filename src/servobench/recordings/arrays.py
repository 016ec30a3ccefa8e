"""Arrays by name: times, input and output, each an array of numbers or a list of one array for each record."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from servobench.core.channels import Array, Channel
from servobench.core.errors import UsageError
from servobench.recordings.cells import mostly_numbers, to_numbers
from servobench.recordings.recording import Recording, Series, Source


def recordings_of_arrays(
    u: ArrayLike | Sequence[ArrayLike],
    y: ArrayLike | Sequence[ArrayLike],
    t: ArrayLike | Sequence[ArrayLike] | None,
    input_unit: str | None,
    output_unit: str | None,
) -> tuple[Recording, ...]:
    """Return a recording for each record: input u (N,) in `input_unit`, output y (N,) in `output_unit`, at times t (N,) [s].

    Lists of arrays are several records; one array of times then serves all that are as long. Without t the records have no
    times. Raises `UsageError`, which names the argument, for a unit that is missing, and for values or shapes that can't be.
    """
    for name, unit, array, example in (
        ("input_unit", input_unit, "u", "V"),
        ("output_unit", output_unit, "y", "rad"),
    ):
        if unit is None:
            raise UsageError(f'{name} is missing: say the unit of {array}, such as {name}="{example}"')
    inputs, outputs = _records("u", u), _records("y", y)
    if len(inputs) != len(outputs):
        raise UsageError(f"u has {len(inputs)} records and y {len(outputs)}; expected the same number")
    times = [None] * len(inputs) if t is None else _records("t", t)
    if len(times) == 1:
        times = times * len(inputs)
    if len(times) != len(inputs):
        raise UsageError(
            f"t has {len(times)} records and u {len(inputs)}; expected the same number, or one t for all"
        )
    several = len(inputs) > 1
    return tuple(
        _recording(f"arrays {k + 1}" if several else "arrays", *record, str(input_unit), str(output_unit))
        for k, record in enumerate(zip(inputs, outputs, times, strict=True))
    )


def _recording(
    name: str, u: Array, y: Array, t: Array | None, input_unit: str, output_unit: str
) -> Recording:
    if len(u) != len(y) or (t is not None and len(t) != len(u)):
        lengths = f"u has {len(u)} values, y {len(y)}" + ("" if t is None else f", t {len(t)}")
        raise UsageError(f"{name}: {lengths}; expected the same number of each")
    return Recording(
        name=name,
        series=(
            Series(channel=Channel(name="u", unit=input_unit), values=u, t=t),
            Series(channel=Channel(name="y", unit=output_unit), values=y, t=t),
        ),
        source=Source(name=name, format="memory"),
        input="u",
        output="y",
    )


def _records(name: str, argument: Any) -> list[Any]:
    """The arrays (N,) in an argument: itself, or each of a list of arrays."""
    several = isinstance(argument, list | tuple) and len(argument) > 0 and np.ndim(argument[0]) > 0
    parts = [(f"{name}[{k}]", each) for k, each in enumerate(argument)] if several else [(name, argument)]
    return [_numbers(*part) for part in parts]


def _numbers(name: str, argument: Any) -> Array:
    values, _ = to_numbers(name, argument)
    if values is None:
        texts = mostly_numbers(np.asarray(argument, dtype=object))[1]
        example = f": {name}[{min(texts)}] is {texts[min(texts)][:40]!r}" if texts else ""
        raise UsageError(
            f"{name} is a {type(argument).__name__} that doesn't hold numbers{example}; expected an array of numbers, (N,)"
        )
    if not values.size:
        raise UsageError(f"{name} is empty; expected one number for each sample, (N,)")
    if values.ndim != 1:
        hint = f": {name}.ravel()" if values.ndim == 2 and 1 in values.shape else ""
        raise UsageError(f"{name} has shape {values.shape}; expected one number for each sample, (N,){hint}")
    return values
