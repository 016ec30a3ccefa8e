"""Arrays as the HIL interface takes them: an address, and a number that the caller vouches for.

The board's library is given the address of an array and reinterprets the bytes there, whatever their type. What it reads or
writes correctly that way passes here, too, and bytes are memory for values of any type; what it would misread, or read or write
beyond the end of, is refused.
"""

from __future__ import annotations

import operator
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from servobench.compat.quanser.errors import Code, HILError, hil_error

_INTEGERS = "iub"


@dataclass(frozen=True)
class CType:
    """A type that the interface knows, as a `dtype`, and the `arrays` that have it, for messages."""

    dtype: np.dtype[Any]
    arrays: str

    def is_exactly(self, dtype: np.dtype[Any]) -> bool:
        """Return whether an array of that type holds such values, signed or not."""
        if dtype.itemsize != self.dtype.itemsize or not dtype.isnative:
            return False
        return dtype.kind == self.dtype.kind or (dtype.kind in _INTEGERS and self.dtype.kind in _INTEGERS)

    def is_long(self, dtype: np.dtype[Any]) -> bool:
        """Return whether it is a C long where that has 64 bits: 32 bits on Windows, where most programs were written."""
        return (
            dtype.kind in "iu"
            and dtype.itemsize == 8
            and self.dtype.kind in "iu"
            and self.dtype.itemsize == 4
        )

    def is_raw(self, dtype: np.dtype[Any]) -> bool:
        """Return whether an array of that type is memory of bytes, as a bytearray or a packed structure is."""
        return dtype.kind in "iu" and dtype.itemsize == 1 < self.dtype.itemsize


CHANNEL = CType(np.dtype(np.uint32), "numpy.uint32 or array('I')")
INT = CType(np.dtype(np.int32), "numpy.int32 or array('i')")
DOUBLE = CType(np.dtype(np.float64), "numpy.float64 or array('d')")
BOOLEAN = CType(np.dtype(np.int8), "numpy.int8 or array('b')")


def whole_number(number: object, name: str) -> int:
    """Return a whole number; raises `TypeError`, as the interface does, for anything else."""
    try:
        return operator.index(number)  # type: ignore[arg-type]
    except TypeError:
        raise TypeError(f"{name} is {number!r}; expected a whole number") from None


def channels(numbers: object, count: object, name: str, missing: Code) -> tuple[int, ...]:
    """Return the numbers of the channels; () for none. `missing` is the error where there are fewer than `count`."""
    number = whole_number(count, f"the number of {name}")
    if number < 0:
        raise OverflowError(
            f"the number of {name} is {number}; expected 0 or more, as the board's library has it unsigned"
        )
    if number == 0:
        return ()
    if numbers is None:
        raise hil_error(missing)
    return tuple(int(value) for value in values(numbers, number, CHANNEL, name, missing))


def values(raw: object, count: int, kind: CType, name: str, missing: Code) -> NDArray[Any]:
    """Return the first `count` values of an array that the caller hands in; shape (count,)."""
    if count <= 0:
        return np.empty(0, kind.dtype)
    if raw is None:
        raise hil_error(missing)
    array = _flat(raw, name)
    _check_size(array, count, kind, name, missing)
    meant = array[:count]
    if kind.is_exactly(array.dtype) or kind.is_long(array.dtype):
        return meant
    raw_values = np.frombuffer(array.tobytes()[: count * kind.dtype.itemsize], kind.dtype)
    if kind.is_raw(array.dtype):
        return raw_values
    if len(meant) < count or not np.array_equal(raw_values, meant):
        raise _wrong_type(array, kind, name, missing)
    return meant


@dataclass(frozen=True)
class Output:
    """An `array` of the caller's that results go into, checked before anything is read.

    It takes a `count` of values of a `kind`; `name` says in messages what it is, `missing` is the error where it doesn't fit.
    """

    array: NDArray[Any] | None
    count: int
    kind: CType
    name: str
    missing: Code

    def fill(self, results: Iterable[float]) -> None:
        """Write the results."""
        if self.array is None:
            return
        numbers = np.fromiter(results, self.kind.dtype, self.count)
        if self.kind.is_exactly(self.array.dtype) or self.kind.is_long(self.array.dtype):
            self.array[: self.count] = numbers
        elif self.kind.is_raw(self.array.dtype):
            self.array[: numbers.nbytes] = np.frombuffer(numbers.tobytes(), self.array.dtype)
        else:
            self._fill_bytes(numbers)

    def _fill_bytes(self, numbers: NDArray[Any]) -> None:
        """Write what fits in by luck: a boolean into the lowest byte of a wider integer."""
        array = self.array
        if array is None:
            return
        written = bytearray(array.tobytes())
        written[: numbers.nbytes] = numbers.tobytes()
        caller_values = np.frombuffer(bytes(written), array.dtype)
        if not np.array_equal(caller_values[: self.count], numbers):
            raise _wrong_type(array, self.kind, self.name, self.missing)
        array[:] = caller_values


def output(raw: object, count: int, kind: CType, name: str, missing: Code) -> Output:
    """Return the caller's array for `count` results; raises `HILError` where it is too short or of a type that doesn't fit."""
    if count <= 0:
        return Output(None, 0, kind, name, missing)
    if raw is None:
        raise hil_error(missing)
    array = _flat(raw, name)
    _check_size(array, count, kind, name, missing)
    if not array.flags.writeable:
        raise hil_error(missing, f"{name}: the array is read-only.")
    fits = kind.is_exactly(array.dtype) or kind.is_long(array.dtype) or kind.is_raw(array.dtype)
    if not fits and (
        array.dtype.kind not in _INTEGERS or kind.dtype.kind not in _INTEGERS or len(array) < count
    ):
        raise _wrong_type(array, kind, name, missing)
    return Output(array, count, kind, name, missing)


def _flat(buffer: object, name: str) -> NDArray[Any]:
    """The caller's own memory, as an array of one dimension."""
    try:
        view = memoryview(buffer)  # type: ignore[arg-type]
    except TypeError:
        raise TypeError(
            f"{name}: expected an array with a buffer (array.array or numpy), got {type(buffer).__name__}"
        ) from None
    if not view.c_contiguous:
        raise ValueError(f"{name}: the array isn't contiguous; pass a copy of it")
    return np.asarray(view).reshape(-1)


def _check_size(array: NDArray[Any], count: int, kind: CType, name: str, missing: Code) -> None:
    if array.nbytes < count * kind.dtype.itemsize or (len(array) < count and kind.is_exactly(array.dtype)):
        raise hil_error(
            missing, f"{name}: the array has {_size(array)}, and {count} of {kind.arrays} are needed."
        )


def _wrong_type(array: NDArray[Any], kind: CType, name: str, missing: Code) -> HILError:
    return hil_error(
        missing, f"{name}: the array has {_size(array)}, which the board would misread; use {kind.arrays}."
    )


def _size(array: NDArray[Any]) -> str:
    return f"{len(array)} value{'' if len(array) == 1 else 's'} of type {array.dtype}"


def finite(voltages: Sequence[float] | NDArray[Any], name: str) -> tuple[float, ...]:
    """Return values that are numbers; raises `HILError` for NaN and infinities, which a board's limits don't stop."""
    numbers = tuple(float(value) for value in voltages)
    for value in numbers:
        if not np.isfinite(value):
            raise hil_error(Code.OUT_OF_RANGE, f"{name}: {value} isn't a finite number.")
    return numbers
