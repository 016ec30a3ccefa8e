"""The tests of `long_tests.txt`, which `make test-long` runs beside those with the mark `long`."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
LISTED = [
    line
    for line in (ROOT / "tests" / "long_tests.txt").read_text(encoding="utf-8").splitlines()
    if line and not line.startswith("#")
]
FILES: dict[str, list[str]] = {}
for _line in LISTED:
    FILES.setdefault(_line.partition("::")[0], []).append(_line)


def mark_listed(items: Iterable[pytest.Item], named: Iterable[str]) -> None:
    """Give the listed tests among those that were collected their mark; `named` are pytest's arguments.

    Raises `pytest.UsageError` where a line stands for no test of a file that was collected as a whole.
    """
    found: set[str] = set()
    files: set[str] = set()
    for item in items:
        file = item.nodeid.partition("::")[0]
        files.add(file)
        lines = [line for line in FILES.get(file, ()) if _stands_for(line, item.nodeid)]
        if lines:
            found.update(lines)
            item.add_marker(pytest.mark.long)
    if any("::" in each for each in named):
        return
    if stale := [line for line in LISTED if line.partition("::")[0] in files and line not in found]:
        raise pytest.UsageError(f"tests/long_tests.txt: there are no tests {stale}")


def _stands_for(line: str, test: str) -> bool:
    if line.endswith("*"):
        return test.startswith(line[:-1])
    return test == line or test.startswith(f"{line}[")
