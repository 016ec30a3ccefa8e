"""Checks of the place where a MAT file keeps its objects, before a library reads it.

The library allocates what a file claims, walks lists by the lengths in them, and looks types up in C without a check of its own:
a claim that the file has no bytes for would cost all memory, a length below zero never end, a type that isn't one crash Python.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from math import prod
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from servobench.recordings.formats.matfile import NUMERIC, Order, element, is_level_7, unpacked
from servobench.recordings.formats.unpacking import most_bytes

_INT32, _UINT32, _MATRIX = 5, 6, 14
_NAMES = (1, 16)
_CELL, _STRUCT, _CHAR, _FUNCTION, _OPAQUE = 1, 2, 4, 16, 17
_NUMBERS = range(6, 16)
_COMPLEX = 0x0800
_MOST_DIMENSIONS = 32
_DEEPEST = 32
_STORE = b"FileWrapper__"
_OBJECTS = 0xDD000000  # what an array of objects begins with
_SHORTEST_REFERENCE = 3  # mat-io 1.0, subsystem/subsys.py, is_valid_mcos_object: a shorter array is data


def is_there(path: Path) -> bool:
    """Return whether a file has a place where objects are kept."""
    with path.open("rb") as file:
        head = file.read(128)
    if is_level_7(head):
        import h5py

        with h5py.File(path, "r") as file_7:
            return "#subsystem#" in file_7
    return head[116:124].strip(b"\0 ") != b""


def check(path: Path) -> None:
    """Raise `ValueError` where a file of version 5 or 7.3 claims more than it has."""
    with path.open("rb") as file:
        data = file.read(128)
        if not is_level_7(data):
            data += file.read()
    if is_level_7(data):
        _check_hdf5(path)
        return
    order: Order = "<" if data[126:128] == b"IM" else ">"
    (store,) = struct.unpack_from(f"{order}Q", data, 116)
    for place, _, body in unpacked(data, order, most_bytes(path)):
        _check_matrix(body, order, 0)
        if place == store:
            _check_store(body, order)
            return
    _refuse("the place of the objects isn't in it")


def _refuse(why: str) -> NoReturn:
    raise ValueError(why)


def _part(body: memoryview, at: int, order: Order, types: Iterable[int], what: str) -> tuple[memoryview, int]:
    """The bytes of the element at a place, which has to be of one of these types, and where the next one begins."""
    kind, inner, following = element(body, at, order)
    if kind not in types:
        _refuse(f"{what} is of type {kind}")
    return inner, following


def _check_matrix(body: memoryview, order: Order, depth: int) -> None:
    """Go through a matrix and all that are in it. All of it has to be as the format has it: the library's C code trusts it."""
    if not body:
        return
    if depth > _DEEPEST:
        _refuse("objects are nested too deep")
    flags, at = _part(body, 0, order, (_UINT32,), "an array's head")
    if len(flags) != 8:
        _refuse("an array's head is cut short")
    (word,) = struct.unpack_from(f"{order}I", flags)
    kind = word & 0xFF
    if kind == _OPAQUE:
        _check_opaque(body, at, order, depth)
        return
    sizes, at = _part(body, at, order, (_INT32,), "an array's size")
    dims = struct.unpack(f"{order}{len(sizes) // 4}i", sizes)
    if not 2 <= len(dims) <= _MOST_DIMENSIONS or min(dims) < 0 or prod(dims) > len(body):
        _refuse(f"an array claims the size {dims} in {len(body)} bytes")
    _, at = _part(body, at, order, _NAMES, "a name")
    if kind in _NUMBERS:
        for _ in range(2 if word & _COMPLEX else 1):
            at = _check_numbers(body, at, order, prod(dims))
    elif kind == _CHAR:
        _check_text(body, at, order, prod(dims))
    elif kind in (_CELL, _STRUCT):
        count, at = prod(dims), at
        if kind == _STRUCT:
            fields, at = _fields(body, at, order)
            count *= fields
        _check_inner(body, at, order, count, depth)
    elif kind == _FUNCTION:
        _check_inner(body, at, order, 1, depth)
    elif depth:
        _refuse(f"an array of class {kind} is among the objects")


def _check_numbers(body: memoryview, at: int, order: Order, count: int) -> int:
    kind, numbers, at = element(body, at, order)
    if kind not in NUMERIC or len(numbers) != count * np.dtype(NUMERIC[kind]).itemsize:
        _refuse(f"{count} numbers of type {kind} stand in {len(numbers)} bytes")
    if kind == _UINT32:
        values = np.frombuffer(numbers, f"{order}u4")
        if _refers_to_objects(values):
            check_objects(values)
    return at


def _check_text(body: memoryview, at: int, order: Order, count: int) -> None:
    kind, letters, _ = element(body, at, order)
    width = {1: 1, 2: 1, 16: 1, 4: 2, 17: 2, 18: 4}.get(kind)
    if width is None or (len(letters) and len(letters) != count * width):
        _refuse(f"{count} letters of type {kind} stand in {len(letters)} bytes")


def _fields(body: memoryview, at: int, order: Order) -> tuple[int, int]:
    """How many fields a struct has, and where the first begins."""
    width, at = _part(body, at, order, (_INT32,), "the length of field names")
    names, at = _part(body, at, order, _NAMES, "a list of field names")
    (length,) = struct.unpack(f"{order}i", width)
    if length < 1:
        _refuse(f"field names have {length} letters")
    return len(names) // length, at


def _check_inner(body: memoryview, at: int, order: Order, count: int, depth: int) -> None:
    """Go through the matrices in a cell array, a struct or a function, as many as there have to be."""
    for _ in range(count):
        inner, at = _part(body, at, order, (_MATRIX,), "what should be an array")
        _check_matrix(inner, order, depth + 1)


def _check_store(body: memoryview, order: Order) -> None:
    """Go through the bytes of a matrix that are a file of their own, if they are: a mark, and then matrices."""
    at = 0
    for _ in range(3):  # flags, dimensions, name
        _, _, at = element(body, at, order)
    _, inside, _ = element(body, at, order)
    if bytes(inside[:4]) not in (b"\x00\x01IM", b"\x01\x00MI"):
        _refuse("the place of the objects doesn't begin as it should")
    inner: Order = "<" if bytes(inside[2:4]) == b"IM" else ">"
    at = 8
    while at + 8 <= len(inside):
        matrix, at = _part(inside, at, inner, (_MATRIX,), "the place of the objects")
        _check_matrix(matrix, inner, 1)


def _check_opaque(body: memoryview, at: int, order: Order, depth: int) -> None:
    """Go through an object: its name, the system of types it is of, its class, and a matrix."""
    for _ in range(2):
        _, at = _part(body, at, order, _NAMES, "a name")
    name, at = _part(body, at, order, _NAMES, "a class")
    inner, _ = _part(body, at, order, (_MATRIX,), "an object's content")
    _check_matrix(inner, order, depth + 1)
    kind, content = _content(inner, order)
    if bytes(name) == _STORE:
        check_lists(bytes(_content(content, order)[1]), order)
    elif kind == _UINT32:
        check_objects(np.frombuffer(content, f"{order}u4"))
    elif kind != _MATRIX and kind != _INT32:  # an enumeration is a struct
        _refuse(f"an object's content is of type {kind}")


def _content(body: memoryview, order: Order) -> tuple[int, memoryview]:
    """The type and the bytes of what stands first behind the head of a matrix, which is known to be sound."""
    at = 0
    for _ in range(3):  # flags, dimensions, name
        _, _, at = element(body, at, order)
    kind, content, _ = element(body, at, order)
    return kind, content


def _refers_to_objects(numbers: NDArray[np.uint32]) -> bool:
    """Return whether the library looks objects up by these numbers (N,).

    MATLAB also keeps the mark alone, as the beginning of a handle to a function: each timeseries has one, as its interpolation.
    """
    return len(numbers) >= _SHORTEST_REFERENCE and numbers[0] == _OBJECTS


def check_objects(numbers: NDArray[np.uint32]) -> None:
    """Raise `ValueError` where an array of objects, `numbers` (N,), has more dimensions, or more elements, than it has objects.

    It stands as a mark, the number of its dimensions, its size, the number of each object, and that of their class.
    """
    count = int(numbers[1]) if len(numbers) > 2 else len(numbers)
    dims = [int(size) for size in numbers[2 : 2 + count]]
    if len(numbers) < count + 3 or prod(dims) != len(numbers) - count - 3:
        _refuse(
            f"an array of objects claims the size {dims} and has {max(0, len(numbers) - count - 3)} objects"
        )


def check_lists(lists: bytes, order: Order) -> None:
    """Raise `ValueError` where the lists of objects and properties have a number below zero, or run past their end."""
    if len(lists) < 40:
        _refuse("the list of objects is cut short")
    starts = struct.unpack_from(f"{order}6i", lists, 8)
    if list(starts) != sorted(starts) or starts[0] < 40 or starts[-1] > len(lists) or starts[0] % 4:
        _refuse("the lists of objects aren't where they are said to be")
    numbers = np.frombuffer(lists[starts[0] : starts[-1] // 4 * 4], f"{order}i4")
    if (numbers < 0).any():
        _refuse("a list of objects has a number below zero")


def _check_hdf5(path: Path) -> None:
    """Go through all data sets: none may be kept elsewhere, and together they mustn't claim more than is read."""
    import h5py

    most = most_bytes(path)
    with h5py.File(path, "r") as file:
        claimed: list[int] = []

        def visit(_: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset):
                if item.is_virtual or item.external:
                    _refuse("some of it is kept in another file")
                claimed.append(8 * (item.size or 0))
                if item.dtype == np.uint32 and item.size and claimed[-1] <= most:
                    numbers = item[()].ravel()
                    if _refers_to_objects(numbers) or "MATLAB_object_decode" in item.attrs:
                        check_objects(numbers)

        file.visititems(visit)
        if sum(claimed) > most:
            _refuse(f"it claims {sum(claimed)} bytes; more than {most} aren't read")
        store = file.get("#subsystem#/MCOS")
        if isinstance(store, h5py.Dataset) and store.size and h5py.check_ref_dtype(store.dtype):
            check_lists(file[store[()].ravel()[0]][()].tobytes(), "<")
