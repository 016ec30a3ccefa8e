"""Check requirements.lock: nothing but pinned, hashed packages, and all that pyproject.toml asks for.

A lock file that holds an address or a path works on one machine or with one mirror only; a requirement without
a hash is one that somebody else can change. Prints what is wrong and exits with status 1, or says nothing.
docs/decisions/0003-lock-file.md says why the file looks as it does.
"""

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PINNED = re.compile(r"(?P<name>[a-z0-9][a-z0-9._-]*)==[^\s;]+( ; [^\\]+)? \\")
HASH = re.compile(r"    --hash=sha256:[0-9a-f]{64}( \\)?")
COMMENT = re.compile(r"\s*#.*")
ADDRESS = re.compile(r"https?:|file:|(^|\s)[~.]{0,2}/\w")


def problems_of_lines(text: str) -> list[str]:
    """Return one sentence for each line of the lock file `text` that is neither a pin, a hash nor a harmless comment."""
    problems = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not any(kind.fullmatch(line) for kind in (PINNED, HASH, COMMENT)):
            problems.append(f"requirements.lock:{number}: expected 'name==version' or a hash, got {line!r}")
        elif ADDRESS.search(line):
            problems.append(f"requirements.lock:{number}: an address or a path: {line!r}")
    return problems


def requested(pyproject: dict) -> set[str]:
    """Return the normalised names of every package that `pyproject` (the parsed file) asks for, itself left out."""
    project = pyproject["project"]
    lists = [
        project["dependencies"],
        *project["optional-dependencies"].values(),
        *pyproject["dependency-groups"].values(),
    ]
    names = {re.split(r"[^A-Za-z0-9._-]", entry, maxsplit=1)[0] for entries in lists for entry in entries}
    return {re.sub(r"[-_.]+", "-", name).lower() for name in names} - {project["name"]}


def problems() -> list[str]:
    """Return everything that is wrong with the lock file of this checkout, one sentence each."""
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    locked = {match["name"] for line in text.splitlines() if (match := PINNED.fullmatch(line))}
    missing = sorted(requested(pyproject) - locked)
    return problems_of_lines(text) + [
        f"requirements.lock: {name} is missing; run `make lock`" for name in missing
    ]


if __name__ == "__main__":
    found = problems()
    print("\n".join(found), end="\n" if found else "")
    sys.exit(1 if found else 0)
