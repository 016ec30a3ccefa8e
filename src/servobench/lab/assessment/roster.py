"""The roster: the students of a class, one row each, in a fixed order."""

from __future__ import annotations

import hashlib
import re
import unicodedata
from dataclasses import dataclass
from pathlib import Path

from servobench.core.errors import FormatError
from servobench.lab.assessment.tables import read_table
from servobench.rig.motor.individual import same_name

COLUMN = "student"
_LONGEST = 200  # characters of a name
_SAFE = re.compile(r"[^A-Za-z0-9._-]+")
_RESERVED = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")


@dataclass(frozen=True, kw_only=True)
class Student:
    """Somebody in the class: the id as the roster has it, and the name of the folder with what they get."""

    id: str
    folder: str


def read_roster(path: Path) -> tuple[Student, ...]:
    """Return the students in a table with a column `student`, in its order; other columns may be there.

    Raises `FormatError` with lines where there is no such column, nobody in it, a row without an id, or the same id twice:
    `Ada` and `ada ` would get the same motor, so they count as one.
    """
    table = read_table(path)
    if COLUMN not in table.headings:
        raise FormatError(
            f"{path}: there is no column `{COLUMN}`; its first row has {', '.join(map(repr, table.headings))}. Put a "
            f"header row before the first student, with a column `{COLUMN}`"
        )
    entries: dict[str, tuple[str, int]] = {}
    mistakes = []
    students = []
    for row in table.rows:
        name = row.cells.get(COLUMN, "")
        key = same_name(name)
        if not key or len(name) > _LONGEST or not name.isprintable():
            mistakes.append(
                f"{path}:{row.line}: {name[:40]!r} isn't an id; expected 1 to {_LONGEST} characters"
            )
        elif key in entries:
            other, line = entries[key]
            mistakes.append(
                f"{path}:{row.line}: {name!r} is the same as {other!r} in line {line}: both would get the same "
                "motor, as capitals and blanks don't count"
            )
        else:
            entries[key] = (name, row.line)
            students.append(name)
    if mistakes:
        raise FormatError("\n".join(mistakes))
    if not students:
        raise FormatError(f"{path}: it has no students; expected a row for each student")
    return _with_folders(students)


def _with_folders(names: list[str]) -> tuple[Student, ...]:
    """The students, each with a folder that any system can have; a name that had to be changed for it gets a mark of its own."""
    folders = []
    for name in names:
        plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
        safe = _SAFE.sub("_", plain)[:60].strip("._")
        if not safe or safe != name or _RESERVED.fullmatch(safe):
            safe = f"{safe or 'student'}-{hashlib.sha256(same_name(name).encode()).hexdigest()[:6]}"
        folders.append(safe)
    return tuple(Student(id=name, folder=folder) for name, folder in zip(names, folders, strict=True))
