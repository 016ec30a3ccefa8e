"""The variables in a MAT file of versions 4, 5 and 7.3.

Versions 4 and 5 are read here rather than by SciPy so that a damaged or hostile file can't cost more memory than it has bytes
to fill, and so that a variable which has no place in a recording costs only itself.
Source: MathWorks, "MAT-File Format": level 5 in its first chapter, level 4 in its appendix.
"""

from __future__ import annotations

import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, Literal, NoReturn, TypeAlias

import numpy as np
from numpy.typing import NDArray

from servobench.core.errors import FormatError
from servobench.recordings.formats.unpacking import most_bytes

Matrix: TypeAlias = NDArray[Any]
Order: TypeAlias = Literal["<", ">"]

NUMERIC = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_TEXT = {1: "utf-8", 2: "utf-8", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _CHAR, _OPAQUE = 1, 2, 4, 17
_NUMBERS = range(6, 16)
_OTHER = {_CELL: "a cell array", 3: "an object", 5: "a sparse matrix", 16: "a function", _OPAQUE: "an object"}
_COMPLEX = 0x0800
_DEEPEST = 16  # structs inside structs
_SAVE_PLAIN = "If it is sound, save it without compression (save -v7 -nocompression)"
_HEAP = b"GCOL\x01\0\0\0"  # what a heap of texts in HDF5 begins with
_LEVEL_4 = ("f8", "f4", "i4", "i2", "u2", "u1")


@dataclass(frozen=True, kw_only=True)
class Skipped:
    """`what` a variable is that has no numbers for a recording; where it `is_object` it may hold some all the same."""

    what: str
    is_object: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Variable:
    """A variable, or a field of a struct (`name` `a.b`, in an array of structs `a_2.b`), its `value` as MATLAB orients it."""

    name: str
    value: Matrix | str | Skipped


def variables(path: Path) -> tuple[Variable, ...]:
    """Return the variables in a file; raises `FormatError` where it's no MAT file, or damaged."""
    with path.open("rb") as file:
        head = file.read(128)
        data = b"" if is_level_7(head) else head + file.read()
    most = most_bytes(path)
    if is_level_7(head):
        read = _level_7(path, most)
    else:
        read = _level_5(data, most) if is_level_5(head) else _level_4(data)
    try:
        found = tuple(read)
    except (struct.error, zlib.error, ValueError, OverflowError) as error:
        raise FormatError(f"{path.name} is no MAT file, or a damaged one: {error}") from None
    numbers = sum(each.value.size for each in found if isinstance(each.value, np.ndarray))
    if 8 * numbers > most:
        raise FormatError(
            f"{path.name} has {numbers} numbers; of a file of its size no more than {most // 8} are read. {_SAVE_PLAIN}"
        )
    return found


def is_level_7(head: bytes) -> bool:
    """Return whether a file that begins like this is a MAT file of version 7.3, which is HDF5."""
    return head.startswith(b"MATLAB 7.3") or head[124:128] in (b"\x00\x02IM", b"\x02\x00MI")


def is_level_5(head: bytes) -> bool:
    """Return whether a file that begins like this is a MAT file of version 5."""
    return head[124:128] in (b"\x00\x01IM", b"\x01\x00MI")


def is_level_4(head: bytes) -> bool:
    """Return whether a file that begins like this may be a MAT file of version 4, which has no mark of its own."""
    try:
        first = _Level4Header.read(head, 0)
    except (struct.error, ValueError):
        return False
    return first.columns > 0 and first.rows > 0 and 1 < first.name_length <= 64 and head[20:21].isalpha()


def _damaged(why: str) -> NoReturn:
    raise ValueError(why)


@dataclass(frozen=True, kw_only=True)
class _Level4Header:
    """What comes before a variable of version 4: five integers, of which the first says how the numbers are stored."""

    numbers: np.dtype[Any]
    kind: int
    rows: int
    columns: int
    imaginary: int
    name_length: int

    @classmethod
    def read(cls, data: bytes, at: int) -> _Level4Header:
        """Return the header at a place; raises `ValueError` or `struct.error` where there is none."""
        for order in "<>":
            # The decimal digits of the first: byte order, always 0, type of the numbers, and full, text or sparse.
            first, rows, columns, imaginary, length = struct.unpack_from(f"{order}5i", data, at)
            digits = divmod(first, 1000)[0], first // 100 % 10, first // 10 % 10, first % 10
            sensible = min(rows, columns, length) >= 0 and imaginary in (0, 1)
            if (
                sensible
                and digits[0] == (order == ">")
                and digits[1] == 0
                and digits[2] < 6
                and digits[3] < 3
            ):
                numbers = np.dtype(order + _LEVEL_4[digits[2]])
                return cls(
                    numbers=numbers,
                    kind=digits[3],
                    rows=rows,
                    columns=columns,
                    imaginary=imaginary,
                    name_length=length,
                )
        _damaged(f"no variable begins at byte {at}")


def _level_4(data: bytes) -> Iterator[Variable]:
    at = 0
    while at < len(data):
        header = _Level4Header.read(data, at)
        at += 20 + header.name_length
        name = data[at - header.name_length : at].split(b"\0")[0].decode("latin-1")
        count = header.rows * header.columns
        if at + count * header.numbers.itemsize * (1 + header.imaginary) > len(data):
            _damaged(f"variable {name!r} is cut short")
        matrix = np.frombuffer(data, header.numbers, count, at).reshape(
            (header.rows, header.columns), order="F"
        )
        at += count * header.numbers.itemsize * (1 + header.imaginary)
        value: Matrix | str | Skipped = matrix
        if header.kind == 2:
            value = Skipped(what=_OTHER[5])
        elif header.kind == 1:
            value = _text_of(matrix)
        elif header.imaginary:
            value = Skipped(what="complex numbers")
        yield Variable(name=name, value=value)


def _text_of(codes: Matrix) -> str:
    """The text of a matrix of characters, whose rows are its lines."""
    known = np.where((codes >= 0) & (codes < 0xD800), codes, 0xFFFD).astype(np.uint32)
    return "\n".join("".join(map(chr, row)) for row in known.tolist())


def _level_5(data: bytes, most: int) -> Iterator[Variable]:
    """Elements one after the other behind 128 bytes of header, each a variable."""
    order: Order = "<" if data[126:128] == b"IM" else ">"
    for _, kind, body in unpacked(data, order, most):
        if kind != _MATRIX:
            _damaged(f"an element of type {kind} stands where a variable should be")
        yield from _matrix(body, order, None, 0)


def unpacked(data: bytes, order: Order, most: int) -> Iterator[tuple[int, int, memoryview]]:
    """Yield place, type and bytes of each element of a file of version 5, decompressed where it is compressed.

    Raises `ValueError`, `struct.error` or `zlib.error` where the file is damaged, or comes to more than `most` bytes.
    """
    view, at, left = memoryview(data), 128, most
    while at < len(data):
        place = at
        kind, body, at = element(view, at, order)
        if kind == _COMPRESSED:
            unpacker = zlib.decompressobj()
            plain = unpacker.decompress(body, left)
            left -= len(plain)
            if left <= 0:
                _damaged(f"its variables come to more than {most} bytes. {_SAVE_PLAIN}")
            if not unpacker.eof:
                _damaged("a compressed variable is cut short")
            kind, body, _ = element(memoryview(plain), 0, order)
        yield place, kind, body


def element(view: memoryview, at: int, order: Order) -> tuple[int, memoryview, int]:
    """Return the type of the element at a place, its bytes, and where the next one begins; raises as `unpacked` does."""
    kind, size = struct.unpack_from(f"{order}2I", view, at)
    if (
        kind >> 16
    ):  # a small element: its size stands in the upper half of the type, its bytes in place of the size
        kind, size, start, end = kind & 0xFFFF, kind >> 16, at + 4, at + 8
        if size > 4:
            _damaged(f"a small element of {size} bytes at byte {at}")
    else:
        start = at + 8
        end = start + size if kind == _COMPRESSED else start + size + -size % 8
    body = view[start : start + size]
    if len(body) < size:
        _damaged(f"an element of {size} bytes is cut short after {len(body)}")
    return kind, body, end


def _matrix(body: memoryview, order: Order, name: str | None, depth: int) -> Iterator[Variable]:
    """The variables in an element of type matrix; `name` is None where the element says it."""
    if not body:
        yield Variable(name=name or "", value=Skipped(what="empty"))
        return
    _, flags, at = element(body, 0, order)
    (word,) = struct.unpack_from(f"{order}I", flags)
    kind = word & 0xFF
    dims: tuple[int, ...] = ()
    if kind != _OPAQUE:  # which has no dimensions
        _, sizes, at = element(body, at, order)
        dims = struct.unpack(f"{order}{len(sizes) // 4}i", sizes)
        if len(dims) < 2 or min(dims) < 0:
            _damaged(f"a variable has the dimensions {dims}")
    _, letters, at = element(body, at, order)
    name = bytes(letters).decode("latin-1") if name is None else name
    if kind == _STRUCT:
        yield from _fields(body, at, order, name, prod(dims), depth + 1)
    elif kind in _OTHER:
        if name:  # without one it is where MATLAB keeps the contents of objects
            is_object = kind in (_CELL, _OPAQUE)
            yield Variable(name=name, value=Skipped(what=_OTHER[kind], is_object=is_object))
    elif kind == _CHAR:
        yield Variable(name=name, value=_text(body, at, order, dims))
    elif kind not in _NUMBERS:
        _damaged(f"variable {name!r} is of the unknown class {kind}")
    elif word & _COMPLEX:
        yield Variable(name=name, value=Skipped(what="complex numbers"))
    elif name:
        yield Variable(name=name, value=_values(body, at, order, dims, name))


def _values(body: memoryview, at: int, order: Order, dims: tuple[int, ...], name: str) -> Matrix:
    kind, numbers, _ = element(body, at, order)
    if kind not in NUMERIC:
        _damaged(f"the numbers of {name!r} are of the unknown type {kind}")
    values = np.frombuffer(numbers, order + NUMERIC[kind])
    if values.size != prod(dims):
        _damaged(f"variable {name!r} has {values.size} numbers and the dimensions {dims}")
    return values.reshape(dims, order="F")


def _text(body: memoryview, at: int, order: Order, dims: tuple[int, ...]) -> str:
    if not prod(dims):
        return ""
    kind, letters, _ = element(body, at, order)
    codec = _TEXT.get(kind)
    if codec is None:
        _damaged(f"text of the unknown type {kind}")
    if codec != "utf-8":
        codec += "-le" if order == "<" else "-be"
    text = bytes(letters).decode(codec, "replace")
    rows = dims[0]
    return text if rows == 1 else "\n".join(text[row::rows] for row in range(min(rows, len(text))))


def _fields(body: memoryview, at: int, order: Order, name: str, count: int, depth: int) -> Iterator[Variable]:
    """The fields of a struct, or of each in an array of `count` structs."""
    _, width, at = element(body, at, order)
    (length,) = struct.unpack(f"{order}i", width)
    _, letters, at = element(body, at, order)
    if length <= 0:
        _damaged(f"the fields of {name!r} have names of {length} letters")
    names = [
        bytes(letters[k : k + length]).split(b"\0")[0].decode("latin-1")
        for k in range(0, len(letters), length)
    ]
    if depth > _DEEPEST or not names or not count:
        yield Variable(
            name=name, value=Skipped(what="nested too deep" if depth > _DEEPEST else "an empty struct")
        )
        return
    for k in range(count):
        which = f"{name}_{k + 1}" if count > 1 else name
        for field in names:
            kind, inner, at = element(body, at, order)
            if kind != _MATRIX:
                _damaged(f"field {which}.{field} is of the unknown type {kind}")
            yield from _matrix(inner, order, f"{which}.{field}", depth)


def _level_7(path: Path, most: int) -> Iterator[Variable]:
    import h5py

    _check_heaps(path)
    try:
        with h5py.File(path, "r") as file:
            yield from _members(file, "", 0, most)
    except Exception as error:  # HDF5 tells of damage by errors of a dozen types
        raise ValueError(str(error)) from error


def _check_heaps(path: Path) -> None:
    """Raise `ValueError` where a heap of texts in an HDF5 file has free space of no size: HDF5 2.0 would walk it for ever.

    Source: HDF5 File Format Specification 3.0, III.E "Disk Format: Level 1E - Global Heap".
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        heap = data.find(_HEAP)
        while heap >= 0:
            at, end = heap + 16, min(heap + int.from_bytes(data[heap + 8 : heap + 16], "little"), len(data))
            while at + 16 <= end:
                index, _, size = struct.unpack_from("<HH4xQ", data, at)
                if index == 0:  # what is left is free
                    if size == 0:
                        _damaged(f"the heap at byte {heap} has free space of no size")
                    break
                at += 16 + size + -size % 8
            heap = data.find(_HEAP, heap + 8)


def _members(group: Any, name: str, depth: int, most: int) -> Iterator[Variable]:
    """The variables in an HDF5 group, of no more than `most` bytes each.

    Links to elsewhere aren't followed: they may lead out of the file.
    """
    import h5py

    for key in group:
        if key.startswith("#"):  # where MATLAB keeps what cells and objects refer to
            continue
        inner = f"{name}.{key}" if name else key
        if not isinstance(group.get(key, getlink=True), h5py.HardLink):
            yield Variable(name=inner, value=Skipped(what="a link"))
            continue
        item = group[key]
        if (
            isinstance(item, h5py.Dataset)
            and name
            and h5py.check_ref_dtype(item.dtype)
            and _class(item) is None
        ):
            for k, reference in enumerate(_checked(item, most)[()].ravel(), 1):
                yield from _item(item.file[reference], f"{name}_{k}.{key}", depth, most)
        else:
            yield from _item(item, inner, depth, most)


def _class(item: Any) -> str | None:
    """MATLAB's class of an HDF5 item, None where it says none."""
    said = item.attrs.get("MATLAB_class")
    return said.decode("latin-1") if isinstance(said, bytes) else None


def _item(item: Any, name: str, depth: int, most: int) -> Iterator[Variable]:
    import h5py

    kind = _class(item)
    if isinstance(item, h5py.Group):
        if "MATLAB_sparse" in item.attrs or kind not in (None, "struct"):
            is_object = "MATLAB_object_decode" in item.attrs
            yield Variable(name=name, value=Skipped(what=f"of class {kind}", is_object=is_object))
        elif depth >= _DEEPEST:
            yield Variable(name=name, value=Skipped(what="nested too deep"))
        else:
            yield from _members(item, name, depth + 1, most)
    elif "MATLAB_empty" in item.attrs:
        yield Variable(name=name, value=Skipped(what="empty"))
    elif "MATLAB_object_decode" in item.attrs or item.dtype.kind not in "biuf":
        what = "complex numbers" if item.dtype.names else f"of class {kind or item.dtype}"
        is_object = "MATLAB_object_decode" in item.attrs or kind == "cell"
        yield Variable(name=name, value=Skipped(what=what, is_object=is_object))
    elif item.is_virtual or item.external:
        yield Variable(name=name, value=Skipped(what="kept in another file"))
    else:
        matrix = _checked(item, most)[()].T
        yield Variable(name=name, value=_text_of(np.atleast_2d(matrix)) if kind == "char" else matrix)


def _checked(dataset: Any, most: int) -> Any:
    """A dataset that isn't larger than it may be; only what is stored can be read, but what isn't is filled in."""
    if dataset.size is None or 8 * dataset.size > most:
        _damaged(
            f"{dataset.name} says that it has {dataset.size} numbers; of a file of its size no more than {most // 8} are read"
        )
    return dataset
