"""The variables in a MAT file of versions 4 and 5, by SciPy, and 7.3, by h5py.

Source: MathWorks, "MAT-File Format", on what a file of each version begins with.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from servobench.recordings.formats.extras import format_errors

Matrix: TypeAlias = NDArray[Any]

_DEEPEST = 16  # structs inside structs
_NAMELESS = "None"  # what SciPy calls each object, whose name it keeps inside


@dataclass(frozen=True, kw_only=True)
class SkippedVariable:
    """`what` a variable is that has no numbers for a recording; where it `is_object` it may hold some all the same."""

    what: str
    is_object: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Variable:
    """A variable, or a field of a struct (`name` `a.b`, in an array of structs `a_2.b`), its `value` as MATLAB orients it."""

    name: str
    value: Matrix | str | SkippedVariable


def variables(path: Path) -> tuple[Variable, ...]:
    """Return the variables in a file; raises `FormatError` where it's no MAT file, or damaged."""
    with path.open("rb") as file:
        head = file.read(128)
    with format_errors(path.name, "MAT"):
        return tuple(_level_7(path) if is_level_7(head) else _level_4_or_5(path))


def is_level_7(head: bytes) -> bool:
    """Return whether a file that begins like this is a MAT file of version 7.3, which is HDF5."""
    return head.startswith(b"MATLAB 7.3") or head[124:128] in (b"\x00\x02IM", b"\x02\x00MI")


def is_level_5(head: bytes) -> bool:
    """Return whether a file that begins like this is a MAT file of version 5."""
    return head[124:128] in (b"\x00\x01IM", b"\x01\x00MI")


def is_level_4(head: bytes) -> bool:
    """Return whether a file that begins like this may be a MAT file of version 4, which has no mark of its own.

    Its first five integers say how the numbers are stored, the size of the first variable, and the length of its name.
    """
    for order in ("<i4", ">i4"):
        if len(head) > 20:
            stored, rows, columns, imaginary, letters = np.frombuffer(head, order, 5).tolist()
            if 0 <= stored < 5000 and min(rows, columns) > 0 and imaginary in (0, 1) and 1 < letters <= 64:
                return head[20:21].isalpha()
    return False


def has_objects(path: Path) -> bool:
    """Return whether a file has a place where objects are kept."""
    with path.open("rb") as file:
        head = file.read(128)
    if is_level_7(head):
        import h5py

        with h5py.File(path, "r") as file_7:
            return "#subsystem#" in file_7
    return head[116:124].strip(b"\0 ") != b""


def import_mat_io() -> Any:
    """Return mat-io; raises `ImportError` where it isn't installed."""
    with warnings.catch_warnings():
        # mat-io 1.0 sets an option that pandas 3 has by default and tells on.
        warnings.filterwarnings("ignore", message="The 'future.infer_string' option is deprecated")
        import matio
    return matio


def _level_4_or_5(path: Path) -> Iterator[Variable]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatlabOpaque

    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # on objects of one name, and on variables that can't be read: see `_values`
        content = loadmat(path)
    for name, value in content.items():
        if name == _NAMELESS and isinstance(value, MatlabOpaque):
            for each in _object_names(path, value, set(content)):
                yield Variable(name=each, value=SkippedVariable(what="an object", is_object=True))
        elif not name.startswith("__"):
            yield from _values(name, value, 0)


def _object_names(path: Path, last: Any, others: set[str]) -> list[str]:
    """The names of the objects in a file: SciPy has a place for the last one only, and mat-io knows them all."""
    try:
        if has_objects(path):
            return [name for name in import_mat_io().whosmat(str(path)) if name not in others]
    except (
        Exception
    ):  # it isn't installed, or the objects are damaged: `matobjects` says so, and the rest is read
        pass
    return [str(last.ravel()[0]["s0"], "latin-1")]


def _values(name: str, value: Any, depth: int) -> Iterator[Variable]:
    """The variables in a value as SciPy gives it; a text in place of an array says why it couldn't be read."""
    from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque
    from scipy.sparse import issparse

    skipped: SkippedVariable | None = None
    if isinstance(value, MatlabOpaque):
        skipped = SkippedVariable(what="an object", is_object=True)
    elif isinstance(value, MatlabFunction):
        skipped = SkippedVariable(what="a function")
    elif isinstance(value, MatlabObject):
        skipped = SkippedVariable(what="an object")
    elif issparse(value):
        skipped = SkippedVariable(what="a sparse matrix")
    elif not isinstance(value, np.ndarray):
        skipped = SkippedVariable(what="damaged")
    elif value.dtype.names:
        yield from _fields(name, value, depth + 1)
        return
    elif value.dtype.kind == "O":
        skipped = SkippedVariable(what="a cell array", is_object=True)
    elif value.dtype.kind == "c":
        skipped = SkippedVariable(what="complex numbers")
    elif value.dtype.kind == "U":
        yield Variable(name=name, value="\n".join(map(str, value.ravel())))
        return
    yield Variable(name=name, value=skipped or value)


def _fields(name: str, structs: Matrix, depth: int) -> Iterator[Variable]:
    """The fields of a struct, or of each in an array of structs."""
    if depth > _DEEPEST or not structs.size:
        what = "nested too deep" if depth > _DEEPEST else "an empty struct"
        yield Variable(name=name, value=SkippedVariable(what=what))
        return
    for k, struct in enumerate(structs.ravel(order="F"), 1):
        which = f"{name}_{k}" if structs.size > 1 else name
        for field in structs.dtype.names or ():
            yield from _values(f"{which}.{field}", struct[field], depth)


def _level_7(path: Path) -> Iterator[Variable]:
    import h5py

    with h5py.File(path, "r") as file:
        yield from _members(file, "", 0)


def _text_of(codes: Matrix) -> str:
    """The text of a matrix of characters, whose rows are its lines."""
    known = np.where((codes >= 0) & (codes < 0xD800), codes, 0xFFFD).astype(np.uint32)
    return "\n".join("".join(map(chr, row)) for row in known.tolist())


def _members(group: Any, name: str, depth: int) -> Iterator[Variable]:
    """The variables in an HDF5 group.

    Links to elsewhere aren't followed: they may lead out of the file.
    """
    import h5py

    for key in group:
        if key.startswith("#"):  # where MATLAB keeps what cells and objects refer to
            continue
        inner = f"{name}.{key}" if name else key
        if not isinstance(group.get(key, getlink=True), h5py.HardLink):
            yield Variable(name=inner, value=SkippedVariable(what="a link"))
            continue
        item = group[key]
        if (
            isinstance(item, h5py.Dataset)
            and name
            and h5py.check_ref_dtype(item.dtype)
            and _class(item) is None
        ):
            for k, reference in enumerate(item[()].ravel(), 1):
                yield from _item(item.file[reference], f"{name}_{k}.{key}", depth)
        else:
            yield from _item(item, inner, depth)


def _class(item: Any) -> str | None:
    """MATLAB's class of an HDF5 item, None where it says none."""
    name = item.attrs.get("MATLAB_class")
    return name.decode("latin-1") if isinstance(name, bytes) else None


def _item(item: Any, name: str, depth: int) -> Iterator[Variable]:
    import h5py

    kind = _class(item)
    if isinstance(item, h5py.Group):
        if "MATLAB_sparse" in item.attrs or kind not in (None, "struct"):
            is_object = "MATLAB_object_decode" in item.attrs
            yield Variable(name=name, value=SkippedVariable(what=f"of class {kind}", is_object=is_object))
        elif depth >= _DEEPEST:
            yield Variable(name=name, value=SkippedVariable(what="nested too deep"))
        else:
            yield from _members(item, name, depth + 1)
    elif "MATLAB_empty" in item.attrs:
        yield Variable(name=name, value=SkippedVariable(what="empty"))
    elif "MATLAB_object_decode" in item.attrs or item.dtype.kind not in "biuf":
        what = "complex numbers" if item.dtype.names else f"of class {kind or item.dtype}"
        is_object = "MATLAB_object_decode" in item.attrs or kind == "cell"
        yield Variable(name=name, value=SkippedVariable(what=what, is_object=is_object))
    elif item.is_virtual or item.external:
        yield Variable(name=name, value=SkippedVariable(what="kept in another file"))
    else:
        matrix = np.asarray(item[()]).T
        yield Variable(name=name, value=_text_of(np.atleast_2d(matrix)) if kind == "char" else matrix)
